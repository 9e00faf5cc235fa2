"""The truth of a simulation taken for a measurement: z = ν.

The paper finds its matrices "with the real values provided to simulate the system". It serves where a model
cannot be seen by the IMU alone: the kinematic one, whose accelerations are jumps.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from baqueano.errors import UsageError
from baqueano.runs.run import Channel, Run
from baqueano.signals import Motion, sensor_slots

TRUTH = "truth"


@dataclass(frozen=True, slots=True, eq=False)
class Velocity:
    """z = (ν_x, ν_y, ν_ψ) [m/s, m/s, rad/s]."""

    size: int = 3

    def h(self, motion: Motion) -> np.ndarray:
        """ν (3,)."""
        return motion.nu


def with_truth(runs: Sequence[Run], sensors: Any) -> tuple[list[Run], Any]:
    """The runs with their true velocity among the sensors, and its block beside the others."""
    out = []
    for run in runs:
        if run.truth is None or not np.isfinite(run.truth.nu).all():
            raise UsageError(
                f"{run.name} holds no true velocity: only a simulation does. Leave truth out of use."
            )
        channel = Channel(run.truth.t_ns, run.truth.t_ns, run.truth.nu)
        out.append(replace(run, sensors={**run.sensors, TRUTH: channel}))
    return out, sensor_slots((*sensors._fields, TRUTH))(*sensors, Velocity())
