"""Protocol between the service of a vehicle and the programs that watch or drive it, independent of the hardware."""

from pathlib import Path

SOCKET = Path("/run/baqueano/door")  # socket of the service, on the vehicle
VERSION = 2  # version of the protocol; since 2 messages are diagnostics and not sentences
