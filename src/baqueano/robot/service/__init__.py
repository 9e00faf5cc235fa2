"""Run the service of a vehicle: it monitors the hardware, executes missions, and stops the vehicle at any fault."""
