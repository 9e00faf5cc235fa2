"""English sentences about drives, simulations, comparisons, studies, tuning, and the monitor of sensors."""
