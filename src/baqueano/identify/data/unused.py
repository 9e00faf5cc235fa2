"""What the runs hold and the vehicle file does not know: it is told, for else it is left out without a word."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from baqueano.identify.data.voltage import CHANNEL
from baqueano.runs.maps.columns import KINDS
from baqueano.runs.run import Channel, Run

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

NO_MOTION = (CHANNEL, "imu_temperature")  # of the vehicle's state: voltage.py, `runs noise`
BY_SIZE = {1: "odometer", 2: "wheels", 3: "imu"}


def unused(runs: Sequence[Run], file: "VehicleFile") -> list[str]:
    """A sentence on each sensor of the runs that takes no part, and how it would."""
    held: dict[str, Channel] = {}
    for run in runs:
        held |= {name: channel for name, channel in run.sensors.items() if len(channel.z)}
    return [
        f"the run has '{name}', the vehicle file {file.name} has not: it is not used. To use it, write into the file: "
        f'[sensors.{name}] and below it kind = "{_kind(name, channel)}"'
        for name, channel in held.items()
        if name not in file.sensors._fields and name not in NO_MOTION
    ]


def _kind(name: str, channel: Channel) -> str:
    """What a sensor of that name, else of so many channels, is likely to be."""
    return name if name in KINDS else BY_SIZE.get(channel.z.shape[1], "…")
