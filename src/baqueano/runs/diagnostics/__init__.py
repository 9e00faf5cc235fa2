"""Diagnose a recording: find units, signs, clocks and readings that contradict each other.

signal_map          the signal and the unit that each channel shows, by likelihood
physical_limits     each signal alone: values that no small vehicle reaches
motion              the motion by each source
motion_checks       sensors and commands compared with the motion by the others
truth               course and heading of the truth
cross_checks        all checks, and the consequence for the import
repeated_readings   readings that repeat the previous one
finding             one finding
cleaning            repairs before a fit: timestamps, samples, physical_units
"""
