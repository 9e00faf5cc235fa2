"""The real vehicle: the microcontroller that holds the motors, the gyro, and what runs beside them."""
