"""The site of the documents in two languages: `python -m docs.site` builds it without a network."""
