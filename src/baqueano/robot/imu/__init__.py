"""Read the IMU: an MPU-6050 or a chip sold under its name, on an I2C bus of Linux."""
