"""The words between whoever looks at a vehicle and its service. Nothing here knows any hardware."""

from pathlib import Path

SOCKET = Path("/run/baqueano/door")  # of the service, on the vehicle
VERSION = 2  # of the words; 2: what is said is a diagnostic, where it was a sentence
