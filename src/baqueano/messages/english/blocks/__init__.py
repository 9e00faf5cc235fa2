"""English sentences about blocks, and about the engine that compiles them."""
