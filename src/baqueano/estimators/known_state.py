"""An estimator that is told the truth: for tuning and for judging a controller alone.

`KnownState` believes the sensor `truth` (sensors/truth.py), with a covariance of zero. As a pair they stand in a loop
like any other sensor and estimator, so a loop with perfect pose is the same loop. No vehicle has them.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.signals import Estimate, Tick


class KnownStateBelief(NamedTuple):
    """What was told last."""

    z: np.ndarray  # (6,) η, ν


@dataclass(frozen=True, slots=True, eq=False)
class KnownState:
    """Believes the sensor named `sensor`."""

    sensor: str = "truth"

    def init(self, eta: np.ndarray | None = None) -> KnownStateBelief:
        """At rest at `eta` (3,)."""
        return KnownStateBelief(np.concatenate([np.zeros(3) if eta is None else eta, np.zeros(3)]))

    def step(self, belief: KnownStateBelief, tick: Tick) -> tuple[KnownStateBelief, Estimate]:
        """What the sensor says; in its silence, what it said last."""
        slot = getattr(tick.sensors, self.sensor)
        z = np.where(slot.has > 0.0, slot.z, belief.z)
        return KnownStateBelief(z), Estimate(tick.t_ns, z[:3], z[3:], np.zeros((6, 6)))
