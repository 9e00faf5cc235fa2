"""Estimators that return the true state, to tune and evaluate a controller without estimation errors.

`PerfectState` returns the reading of the sensor `truth` (sensors/truth.py), with a covariance of zero. Both work in the
loop like any other sensor and estimator. A real vehicle does not have this sensor.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from baqueano.signals import Estimate, Motion, Tick


class PerfectStateBelief(NamedTuple):
    """Belief of `PerfectState`: the last true state (η, ν) that was measured."""

    z: np.ndarray  # (6,) η, ν


@dataclass(frozen=True, slots=True, eq=False)
class PerfectState:
    """Estimator that uses the measurement of the sensor named `sensor` as the state.

    Parameters
    ----------
    sensor : str
        Name of a `sensors.Truth`.

    Examples
    --------
    >>> from baqueano.signals import Slot, sensor_slots
    >>> exact = PerfectState()
    >>> tick = Tick(0, np.zeros(3), sensor_slots(("truth",))(Slot(1.0, np.arange(6.0))))
    >>> exact.step(exact.init(), tick)[1].eta
    array([0., 1., 2.])
    """

    sensor: str = "truth"

    def init(self, eta: np.ndarray | None = None) -> PerfectStateBelief:
        """Return the belief at rest at `eta` (3,) in the map."""
        return PerfectStateBelief(np.concatenate([np.zeros(3) if eta is None else eta, np.zeros(3)]))

    def step(self, belief: PerfectStateBelief, tick: Tick) -> tuple[PerfectStateBelief, Estimate]:
        """Return the last measured state, with a covariance of zero."""
        slot = getattr(tick.sensors, self.sensor)
        z = np.where(slot.is_new > 0.0, slot.z, belief.z)
        return PerfectStateBelief(z), Estimate(tick.t_ns, z[:3], z[3:], np.zeros((6, 6)))


@dataclass(frozen=True, slots=True, eq=False)
class TrueState:
    """Estimator that reads the state of the simulated world, for a vehicle without a sensor `Truth`.

    Parameters
    ----------
    motion_now : callable
        Function without arguments that returns the Motion of the vehicle at the last tick.

    Examples
    --------
    >>> still = Motion(np.arange(3.0), np.zeros(3), np.zeros(3), np.zeros(2))
    >>> exact = TrueState(lambda: still)
    >>> exact.step(exact.init(), Tick(0, np.zeros(3), ()))[1].eta
    array([0., 1., 2.])
    """

    is_interpreted: ClassVar[bool] = True

    motion_now: Callable[[], Motion]

    def init(self) -> tuple[()]:
        """Return an empty belief; this estimator does not need a memory."""
        return ()

    def step(self, belief: tuple[()], tick: Tick) -> tuple[tuple[()], Estimate]:
        """Return the state of the world, with a covariance of zero."""
        motion = self.motion_now()
        return belief, Estimate(tick.t_ns, motion.eta, motion.nu, np.zeros((6, 6)))
