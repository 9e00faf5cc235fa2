"""Define the verbs of `baqueano robot`: setup, maintenance and settings of a real vehicle. robot.py lists all verbs."""
