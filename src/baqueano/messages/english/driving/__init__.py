"""English sentences of drives, simulations, comparisons, studies, tuning, and the monitor of sensors."""
