"""Execute missions for a service, of a robot or of a simulation: its observers, and the end of a mission."""
