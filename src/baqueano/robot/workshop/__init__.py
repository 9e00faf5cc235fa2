"""Check and calibrate a vehicle: its health, its motors and their wiring, the axes of its IMU."""
