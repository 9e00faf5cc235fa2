"""Diagnostics of a recording: units, signs, clocks and readings that disagree with each other.

plausible                     one signal alone: numbers that no small vehicle has
correlation, left_and_right   two signals
cross_checks                  all of them, and what follows for the import
repeated_readings             readings that repeat the one before
doubt                         one finding
"""
