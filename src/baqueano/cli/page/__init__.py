"""Define the verbs that open the page."""
