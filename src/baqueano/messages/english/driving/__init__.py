"""English sentences of drives, simulations, comparisons, studies and tuning, and of sensors that are watched."""
