"""The units of what sensors say, for people."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

CHANNEL_UNITS = {
    "imu": ("m/s²", "m/s²", "rad/s"),
    "odometer": ("m/s",),
    "wheels": ("m/s", "m/s"),
    "tape": ("m",),
    "back_on_mark": ("m", "m"),
    "battery": ("V",),
}


def channel_unit(file: "VehicleFile", sensor: str, entry: int) -> str:
    """The unit of one number of a sensor, by the kind that the vehicle file says; empty for one of somebody's own."""
    kind = file.data.get("sensors", {}).get(sensor, {}).get("kind", sensor)
    known = CHANNEL_UNITS.get(kind, ())
    return known[entry] if entry < len(known) else ""
