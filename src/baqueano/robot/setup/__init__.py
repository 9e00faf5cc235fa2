"""How a Raspberry Pi becomes a vehicle: its card, its packages, its vehicle file."""
