"""The real vehicle: the microcontroller that holds the motors, the gyro, and what runs beside them.

uno         the microcontroller: frames, their codec, the link, the serial line, its settings, its firmware
imu         the MPU-6050 and its relatives on the I2C bus
service     what runs on the vehicle all day
workshop    what a person does at a vehicle that stands: check it, calibrate it
setup       how a Raspberry Pi becomes a vehicle
"""

SERVICE = "baqueano.service"
HOME = "/var/lib/baqueano"  # of the service: the vehicle file and the runs
VEHICLE = f"{HOME}/vehicle.toml"
