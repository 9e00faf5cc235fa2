"""Run NumPy code on symbols: arrays of scalars with NumPy's operators, elementwise functions and linear algebra."""
