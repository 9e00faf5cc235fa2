"""Protocol between the service of a vehicle and the programs that watch or drive it. It is independent of hardware."""

from pathlib import Path

SOCKET = Path("/run/baqueano/door")  # of the service, on the vehicle
VERSION = 2  # of the protocol; 2: messages are diagnostics, before they were sentences
