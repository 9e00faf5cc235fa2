"""Repeat the references of a recorded run exactly."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from baqueano.signals import Estimate, Reference


@dataclass(frozen=True, slots=True, eq=False)
class Playback:
    """Guide that repeats the references of a recorded run exactly.

    Parameters
    ----------
    t_ns : ndarray (N,)
        Times, int64, increasing.
    eta : ndarray (N, 3) [m, m, rad]
        Poses in the map.
    nu : ndarray (N, 3) [m/s, m/s, rad/s]
        Velocities in the body frame.
    at_end : ndarray (N,)
        1.0 in the rows after the end of the guide, else 0.0 [no unit].

    Examples
    --------
    >>> from baqueano.signals import Estimate
    >>> guide = Playback(np.array([0, 10]), np.eye(2, 3), np.zeros((2, 3)), np.zeros(2))
    >>> guide.step(guide.init(), Estimate(10, np.zeros(3), np.zeros(3), np.eye(6)))[1].eta
    array([0., 1., 0.])
    """

    is_interpreted: ClassVar[bool] = True

    t_ns: np.ndarray
    eta: np.ndarray
    nu: np.ndarray
    at_end: np.ndarray

    def init(self) -> None:
        """Return None: this guide does not have a state."""

    def step(self, state: None, estimate: Estimate) -> tuple[None, Reference]:
        """Return the last reference recorded up to the time of the estimate; before the first time it is the first
        row."""
        k = max(int(np.searchsorted(self.t_ns, estimate.t_ns, side="right")) - 1, 0)
        return None, Reference(estimate.t_ns, self.eta[k], self.nu[k], float(self.at_end[k]))
