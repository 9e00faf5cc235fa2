"""English sentences about runs and recordings."""
