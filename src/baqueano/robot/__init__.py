"""Run the real vehicle: its microcontroller with the motors, its IMU, and the service on its computer.

uno         the microcontroller: frames, their codec, the link, the serial line, its settings, its firmware
imu         the MPU-6050 and related chips on the I2C bus
service     the program that runs on the vehicle permanently
workshop    checks and calibrations by the operator
setup       the set-up of a Raspberry Pi as a vehicle
"""

SERVICE = "baqueano.service"
HOME = "/var/lib/baqueano"  # of the service: the vehicle file and the runs
VEHICLE = f"{HOME}/vehicle.toml"
