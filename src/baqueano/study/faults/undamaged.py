"""Remove from the undamaged run the readings that a fit excludes from the damaged run.

A fit does not use samples in which it detects damage. One part of its error comes from these missing samples, the
other part from damage to the remaining samples. The undamaged run without the samples of the same times separates the
two parts.
"""

from dataclasses import replace

import numpy as np

from baqueano.runs.diagnostics.cleaning import clean
from baqueano.runs.run import Run
from baqueano.vehicle_file import VehicleFile


def undamaged_run(sound_run: Run, damaged_run: Run, vehicle_file: VehicleFile) -> tuple[Run, float] | None:
    """Return the `sound_run` run with NaN for the readings that a fit excludes from the `damaged_run` run, and their
    fraction. Return None if the samples of the two runs have different times, so that they do not correspond.
    """
    segments, _ = clean([damaged_run], vehicle_file, vehicle_file.sensors._asdict())
    sensors, lost_count, count = dict(sound_run.sensors), 0, 0
    for name, channel in sound_run.sensors.items():
        if not np.array_equal(damaged_run.sensors[name].arrival_ns, channel.arrival_ns):
            return None
        keep = np.zeros(channel.z.shape, bool)
        for segment in segments:
            readings = segment.sensors[name]
            keep[np.searchsorted(channel.arrival_ns, readings.arrival_ns)] = np.isfinite(readings.z)
        lost_count, count = lost_count + int(np.sum(~keep)), count + keep.size
        sensors[name] = channel._replace(z=np.where(keep, channel.z, np.nan))
    return replace(sound_run, sensors=sensors), lost_count / max(count, 1)
