"""Parts of the recommended filter: its state, its motion, its correction."""
