"""A perfect sensor of (η, ν), for simulations only; `estimators.PerfectState` uses it."""

from dataclasses import dataclass

import numpy as np

from baqueano.contracts.blocks import SensorBlocks
from baqueano.signals import Motion, Slot, sensor_slots


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """Perfect sensor of z = (η, ν) (6,) at every tick, without noise or delay, only for simulations.

    Parameters
    ----------
    size : int
        Length of the measurement.
    noise_size : int
        Number of standard normals that `step` needs.
    rate_hz : float
        Measurements per second.
    delay_s : float
        Age of the measurement.

    Examples
    --------
    >>> Truth().h(Motion(np.ones(3), np.zeros(3), np.zeros(3), np.zeros(2)))
    array([1., 1., 1., 0., 0., 0.])
    """

    size: int = 6
    noise_size: int = 0
    rate_hz: float = float("inf")
    delay_s: float = 0.0

    @property
    def cov(self) -> np.ndarray:
        """Return Q (6, 6), a matrix of zeros."""
        return np.zeros((6, 6))

    def h(self, motion: Motion) -> np.ndarray:
        """Return the true (η, ν) (6,)."""
        return np.concatenate([motion.eta, motion.nu])

    def init(self) -> tuple[()]:
        """Return an empty tuple: this sensor does not have a state."""
        return ()

    def step(
        self, state: tuple[()], motion: Motion, dt_s: float, noise: np.ndarray
    ) -> tuple[tuple[()], Slot]:
        """Return the true (η, ν) at the end of the tick."""
        return state, Slot(1.0, self.h(motion))


def truth_sensor() -> SensorBlocks:
    """Return the sensors of a simulated vehicle that measures its true state."""
    return sensor_slots(("truth",))(Truth())
