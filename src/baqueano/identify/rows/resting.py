"""The bias of a gyro, measured while the vehicle stands.

    b = b₀ + mean of (z − h), over what was measured while nothing was commanded for REST_S               (1)

A car that only drives cannot tell the bias of its gyro from a steering that is a little off: both are a
steady turn, and what is left of an imperfect model decides between them (on two recordings it said 0.1 rad/s
of a gyro that reads 0.002 rad/s at rest). So of a car the bias is not estimated along with the model: it is
(1) where a run stands for LEAST_S more, else the one of the vehicle file.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from baqueano.runs.run import Run
from baqueano.signals import Motion

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

REST_S = 1.0  # without any command, before the vehicle counts as standing
LEAST_S = 1.0  # of measurements from then on: the zero of a small gyro wanders in less
QUIET = 2.0  # times the noise of the file: a gyro that scatters more is being turned


def with_gyro_at_rest(file: "VehicleFile", runs: Sequence[Run]) -> tuple["VehicleFile", str]:
    """The file with the bias of its gyro as the runs show it at rest, and a sentence; "" where none rests."""
    for name, sensor in file.sensors._asdict().items():
        if not hasattr(sensor, "gyro_bias"):
            continue
        left = {run.name: _left_at_rest(run, name, sensor) for run in runs}
        stood = [name for name, x in left.items() if len(x)]
        x = np.concatenate(list(left.values()))
        if not len(x):
            continue
        bias, sd = float(sensor.gyro_bias + x.mean()), float(x.std(ddof=1) / np.sqrt(len(x)))
        said = f"{name}: gyro_bias = {bias:.4f} ± {sd:.2g} rad/s was measured at rest, in {', '.join(stood)}"
        return _written(file, name, bias, sd, stood), said
    return file, ""


def _left_at_rest(run: Run, name: str, sensor: Any) -> np.ndarray:
    """(K,) what the gyro showed beyond its model while the vehicle stood; empty if it did not."""
    channel = run.sensors.get(name)
    if channel is None or channel.z.shape[1] != sensor.size or not len(run.t_ns):
        return np.zeros(0)
    driven = np.any(run.applied != 0.0, axis=1)  # not known counts as driven
    last = np.maximum.accumulate(np.where(driven, run.t_ns, run.t_ns[0]))
    tick = np.clip(np.searchsorted(run.t_ns, channel.t_ns), 0, len(run.t_ns) - 1)
    at_rest = ~driven[tick] & (channel.t_ns - last[tick] > REST_S * 1e9) & np.isfinite(channel.z[:, -1])
    still = Motion(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(2))
    left = channel.z[at_rest, -1] - sensor.h(still)[-1]
    turned = len(left) and np.std(left) > QUIET * np.sqrt(sensor.cov[-1, -1]) > 0.0
    return np.zeros(0) if turned or len(left) < LEAST_S * sensor.rate_hz else left


def _written(file: "VehicleFile", name: str, bias: float, sd: float, stood: list[str]) -> "VehicleFile":
    from baqueano.vehicle_file import Provenance
    from baqueano.vehicle_file.file import today

    path = f"sensors.{name}.gyro_bias"
    return file.with_values({path: bias}, {path: Provenance(", ".join(stood), today(), sd, "USABLE")})
