"""Selection of the terms of a model, by simulation error on held-out data."""
