"""Define the subcommands of `baqueano robot`: setup, maintenance and settings of a real vehicle. robot.py lists all."""
