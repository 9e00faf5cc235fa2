"""NumPy text on symbols: arrays of scalars that obey NumPy's operators, elementwise functions and linear algebra."""
