"""Check and calibrate a vehicle at rest: its health, its wiring, the axes of its IMU."""
