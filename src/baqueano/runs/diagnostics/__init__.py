"""Diagnostics of a recording: units, signs, clocks and readings that disagree with each other.

signal_map          the signal and the unit that each channel shows, by likelihood
physical_limits     one signal alone: numbers that no small vehicle has
motion, by_motion   the motion that each source tells, and sensors and commands against that of the others
truth               course and heading of the truth
cross_checks        all of them, and what follows for the import
repeated_readings   readings that repeat the one before
doubt               one finding
"""
