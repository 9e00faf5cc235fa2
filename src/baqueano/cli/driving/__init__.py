"""Verbs that move a vehicle: experiment, teach, repeat, replay, drive.

targets         where a verb drives: simulated, emulated or real
manual_drive    a drive by hand from this terminal
iterate         design, drive, fit, and again
"""
