"""English sentences of the real vehicle and of its door."""
