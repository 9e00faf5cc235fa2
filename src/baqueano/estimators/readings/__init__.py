"""Readings of sensors: measured velocities, uncertain parameters, gates and lasting disagreements."""
