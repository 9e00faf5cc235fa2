"""The units of what sensors say, for people."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

CHANNEL_UNITS = {
    "imu": ("m/s²", "m/s²", "rad/s"),
    "odometer": ("m/s",),
    "wheels": ("m/s", "m/s"),
    "encoders": ("m/s", "m/s"),
    "pose": ("m", "m", "rad"),
    "mark": ("m",),
    "tags": ("m", "m"),
    "beacon": ("m",),
    "rangefinder": ("m",),
    "compass": ("rad",),
    "tape": ("m",),
    "back_on_mark": ("m", "m"),
    "battery": ("V",),
}


def channel_unit(file: "VehicleFile", sensor: str, entry: int) -> str:
    """The unit of one number of a sensor, by the kind that the vehicle file says; empty for one of somebody's own."""
    kind = file.data.get("sensors", {}).get(sensor, {}).get("kind", sensor)
    known = CHANNEL_UNITS.get(kind, ())
    return known[entry] if entry < len(known) else ""


def percent(part: float, digits: int = 1) -> str:
    """A share of a variance for people: below −100 % the figure says no more than that, and NaN is "-"."""
    if np.isnan(part):
        return "-"
    return f"{100.0 * part:.{digits}f} %" if part > -1.0 else "below -100 %"


def times(ratio: float) -> str:
    """Return "2.1×" for people; "-" for NaN."""
    if np.isnan(ratio):
        return "-"
    return f"{ratio:.2f}×" if ratio < 1e3 else "over 1000×"
