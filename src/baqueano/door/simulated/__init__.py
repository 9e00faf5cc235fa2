"""The service of a simulated vehicle: the words of the door, without hardware."""
