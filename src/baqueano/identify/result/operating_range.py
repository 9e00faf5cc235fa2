"""The motion that a fit saw: the range of each command, and of each channel that shows a speed or a turn rate.

A channel shows one if its h follows ν and not ν̇. Measurements beyond FAR standard deviations of the model are
outliers, and widen nothing.
"""

from collections.abc import Sequence

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.identify.data.record import FitRecord
from baqueano.identify.data.rest import shows_speed
from baqueano.identify.result.fit_result import ChannelFit
from baqueano.signals import ByName
from baqueano.vehicle_file.envelope import Envelope

FAR = 4.0


def envelope_of(
    records: Sequence[FitRecord],
    channels: Sequence[ChannelFit],
    sensors: ByName[Tree],
    commands: Sequence[str],
) -> Envelope:
    """The envelope of a fit to `records`, whose `commands` are in the order of u."""
    u = np.concatenate([record.u[record.lead :] for record in records])
    ranges = {name: (float(u[:, k].min()), float(u[:, k].max())) for k, name in enumerate(commands)}
    for name, sensor in sensors._asdict().items():
        for entry in np.flatnonzero(shows_speed(sensor)):
            same = [c for c in channels if (c.sensor, c.entry) == (name, entry) and np.isfinite(c.explained)]
            z = [c.measured[np.abs(c.measured - c.predicted) <= FAR * c.sigma] for c in same]
            if sum(map(len, z)):
                ranges[f"{name}[{entry}]"] = (
                    min(x.min() for x in z if len(x)),
                    max(x.max() for x in z if len(x)),
                )
    low, high = np.array(list(ranges.values())).T
    runs = dict.fromkeys(record.name for record in records)
    return Envelope(tuple(ranges), low, high, ", ".join(runs))
