"""An estimator that is told the truth: for tuning and for judging a controller alone.

`Truth` is a perfect sensor of (η, ν); `KnownState` believes it, with a covariance of zero. As a pair they
stand in a loop like any other sensor and estimator, so a loop with perfect pose is the same loop. No
vehicle has them.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from baqueano.signals import Estimate, Motion, Slot, Tick, sensor_slots


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """z = (η, ν), (6,), at every tick, without noise or delay."""

    size: int = 6
    noise_size: int = 0
    rate_hz: float = float("inf")
    delay_s: float = 0.0

    @property
    def cov(self) -> np.ndarray:
        """Q (6, 6): zero."""
        return np.zeros((6, 6))

    def h(self, motion: Motion) -> np.ndarray:
        """(η, ν), (6,)."""
        return np.concatenate([motion.eta, motion.nu])

    def init(self) -> tuple[()]:
        """Nothing to remember."""
        return ()

    def step(
        self, state: tuple[()], motion: Motion, dt_s: float, noise: np.ndarray
    ) -> tuple[tuple[()], Slot]:
        """The truth at the end of the tick."""
        return state, Slot(1.0, self.h(motion))


class Told(NamedTuple):
    """What was told last."""

    z: np.ndarray  # (6,) η, ν


@dataclass(frozen=True, slots=True, eq=False)
class KnownState:
    """Believes the sensor named `sensor`."""

    sensor: str = "truth"

    def init(self, eta: np.ndarray | None = None) -> Told:
        """At rest at `eta` (3,)."""
        return Told(np.concatenate([np.zeros(3) if eta is None else eta, np.zeros(3)]))

    def step(self, belief: Told, tick: Tick) -> tuple[Told, Estimate]:
        """What the sensor says; in its silence, what it said last."""
        slot = getattr(tick.sensors, self.sensor)
        z = np.where(slot.has > 0.0, slot.z, belief.z)
        return Told(z), Estimate(tick.t_ns, z[:3], z[3:], np.zeros((6, 6)))


def truth_sensor() -> Any:
    """The sensors of a vehicle that knows its state."""
    return sensor_slots(("truth",))(Truth())
