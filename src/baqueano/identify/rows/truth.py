"""The truth taken for a measurement: z = ν of a simulation, or z = (x, y, ψ) that a camera saw.

The paper finds its matrices "with the real values provided to simulate the system". It serves where a model
cannot be seen by the IMU alone: the kinematic one, whose accelerations are jumps; and with a camera it shows the
scales that nothing on board tells.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from baqueano.errors import UsageError
from baqueano.runs.run import Channel, Run
from baqueano.sensors import Pose
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
    """The runs with their truth among the sensors, and its block beside the others."""
    out = []
    velocity = all(run.truth is not None and np.isfinite(run.truth.nu).all() for run in runs)
    for run in runs:
        truth = run.truth
        if truth is None or not (velocity or np.isfinite(truth.eta).any()):
            raise UsageError(
                f"{run.name} holds no truth: only a simulation does, or a recording with a camera. Leave "
                "truth out of use."
            )
        channel = Channel(truth.t_ns, truth.t_ns, truth.nu if velocity else truth.eta)
        out.append(replace(run, sensors={**run.sensors, TRUTH: channel}))
    block = Velocity() if velocity else Pose()
    return out, sensor_slots((*sensors._fields, TRUTH))(*sensors, block)
