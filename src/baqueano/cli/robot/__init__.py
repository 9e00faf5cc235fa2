"""Define the verbs of `baqueano robot`: setup, workshop and settings of the real vehicle. robot.py lists all verbs."""
