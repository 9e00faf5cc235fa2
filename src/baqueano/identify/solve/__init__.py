"""Rows → parameters: the residuals of a simulation or of a filter as one kernel, and the search over them."""
