"""Readings of sensors as numbers: their noise, their gates, their faults."""
