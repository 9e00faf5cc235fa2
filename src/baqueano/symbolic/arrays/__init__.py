"""Run NumPy code on symbols: arrays of symbols with NumPy's operators, elementwise functions and linear algebra."""
