"""Readings of sensors as numbers: their noise, gates and faults."""
