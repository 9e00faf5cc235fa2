"""Run the service of a vehicle: it watches the hardware, drives missions, and stops the vehicle at any fault."""
