"""Work at a vehicle that stands: is it well, how is it wired, how does its IMU sit."""
