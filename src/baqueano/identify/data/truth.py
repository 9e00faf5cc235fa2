"""The truth taken for a measurement: z = ν of a simulation, or z = (x, y, ψ) that a camera saw.

The paper finds its matrices "with the real values provided to simulate the system". It serves where a model
cannot be seen by the IMU alone: the kinematic one, whose accelerations are jumps; and with a camera it shows the
scales that nothing on board tells. Where the mark sits is asked for as of a sensor, "sensors.truth.lever_arm_m" and
"sensors.truth.heading_rad"; it belongs to the recording, and no vehicle file takes it.

    ν of the mark = R(−χ) (ν_x − l_y ν_ψ,  ν_y + l_x ν_ψ)                                                  (1)
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.diagnostics import fault
from baqueano.errors import UsageError
from baqueano.parameter import parameter
from baqueano.runs.run import Channel, Run
from baqueano.sensors import Pose
from baqueano.sensors.pose import turned
from baqueano.signals import ByName, Motion, sensor_slots
from baqueano.vehicles.bounds import check_bounds

TRUTH = "truth"
MOUNT = f"sensors.{TRUTH}."  # begins what belongs to a recording


@dataclass(frozen=True, slots=True, eq=False)
class Velocity:
    """z = (ν_x, ν_y, ν_ψ) [m/s, m/s, rad/s]."""

    size: int = 3
    lever_arm_m: np.ndarray = parameter(
        "m", "place of the mark in the body, l", low=-100.0, high=100.0, default=(0.0, 0.0), shape=(2,)
    )
    heading_rad: float = parameter(
        "rad", "angle to the left by which the mark is turned, χ", low=-7.0, high=7.0, default=0.0
    )

    def __post_init__(self) -> None:
        check_bounds(self)

    def h(self, motion: Motion) -> np.ndarray:
        """ν (3,) of the mark, in its own axes.  (1)"""
        vx, vy, w = motion.nu
        way = np.array([vx - self.lever_arm_m[1] * w, vy + self.lever_arm_m[0] * w])
        return np.array([*turned(way, -self.heading_rad), w])


def with_truth(runs: Sequence[Run], sensors: ByName[Tree]) -> tuple[list[Run], Any]:
    """The runs with their truth among the sensors, and its block beside the others."""
    out = []
    velocity = all(run.truth is not None and np.isfinite(run.truth.nu).all() for run in runs)
    for run in runs:
        truth = run.truth
        if truth is None or not (velocity or np.isfinite(truth.eta).any()):
            raise UsageError(fault("truth.not-held", run=run.name))
        channel = Channel(truth.t_ns, truth.t_ns, truth.nu if velocity else truth.eta)
        out.append(replace(run, sensors={**run.sensors, TRUTH: channel}))
    block = Velocity() if velocity else Pose()
    return out, sensor_slots((*sensors._fields, TRUTH))(*sensors, block)
