"""Free parameters of a fit, and the layout of θ."""
