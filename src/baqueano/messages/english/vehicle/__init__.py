"""English sentences about the real vehicle and the connections to it."""
