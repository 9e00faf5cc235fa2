"""Search for the parameters of least cost."""
