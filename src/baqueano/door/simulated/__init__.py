"""Run the service of a simulated vehicle: the protocol of the door, without hardware."""
