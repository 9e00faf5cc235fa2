"""Define the protocol between the service of a vehicle and its clients, independent of the hardware."""

from pathlib import Path

SOCKET = Path("/run/baqueano/door")  # socket of the service, on the vehicle
VERSION = 4  # version of the protocol; since version 4, the field `type` names a message
