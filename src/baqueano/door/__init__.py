"""The words between whoever looks at a vehicle and its service. Nothing here knows any hardware."""

from pathlib import Path

SOCKET = Path("/run/baqueano/door")  # of the service, on the vehicle
