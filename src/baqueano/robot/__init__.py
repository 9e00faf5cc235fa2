"""The real vehicle: the microcontroller that holds the motors, the gyro, and what runs beside them."""

from pathlib import Path

SOCKET = Path("/run/baqueano/door")  # of the service, on the vehicle
