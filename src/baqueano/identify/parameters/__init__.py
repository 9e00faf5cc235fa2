"""What is free in a fit, and what θ means."""
