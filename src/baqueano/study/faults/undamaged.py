"""The sound run without what a fit leaves out of the damaged one: what could still be known of it.

A damage that is noticed costs samples. A part of the error of such a fit is the price of what is gone, and a part is
harm in the rest. The sound run, without the same samples, tells them apart: those of the same time.
"""

from dataclasses import replace

import numpy as np

from baqueano.identify.diagnostics import clean
from baqueano.runs.run import Run
from baqueano.vehicle_file import VehicleFile


def undamaged(sound: Run, damaged: Run, file: VehicleFile) -> tuple[Run, float] | None:
    """The `sound` run with NaN for the readings that are left out of the `damaged` one, and which part they are;
    None where samples came at other times, so that none are the same."""
    pieces, _ = clean([damaged], file, file.sensors._asdict())
    sensors, lost_count, count = dict(sound.sensors), 0, 0
    for name, channel in sound.sensors.items():
        if not np.array_equal(damaged.sensors[name].arrival_ns, channel.arrival_ns):
            return None
        keep = np.zeros(channel.z.shape, bool)
        for piece in pieces:
            some = piece.sensors[name]
            keep[np.searchsorted(channel.arrival_ns, some.arrival_ns)] = np.isfinite(some.z)
        lost_count, count = lost_count + int(np.sum(~keep)), count + keep.size
        sensors[name] = channel._replace(z=np.where(keep, channel.z, np.nan))
    return replace(sound, sensors=sensors), lost_count / max(count, 1)
