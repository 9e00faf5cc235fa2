"""Which terms a model needs, by simulation error on what it was not fitted to."""
