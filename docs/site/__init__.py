"""The site of the documents: `python -m docs.site` builds it, in two languages, without a network."""
