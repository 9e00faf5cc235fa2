"""English sentences of the real vehicle and of the connections to it."""
