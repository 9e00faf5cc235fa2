"""Set up a Raspberry Pi as a vehicle: its card, its packages, its vehicle file."""
