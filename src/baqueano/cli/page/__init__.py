"""Verbs that open the page."""
