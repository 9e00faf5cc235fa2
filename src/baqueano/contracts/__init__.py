"""Promises of blocks and world, what a block may leave out, and the types of what the engine computes with."""
