"""A guide of your own: it repeats the route as it was taught, and begins gently.

    s = t − T (1 − e^(−t/T)),   ṡ = 1 − e^(−t/T)      the time along the route, t since the first tick, T = ease_s
    η_r = route(s),   ν_r = ṡ · velocity of the route at s

It runs without changes. Change it, then:

    baqueano blocks check my_guide.py:MyGuide
    baqueano repeat lap --guide my_guide.py:MyGuide
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.geometry import wrap
from baqueano.signals import Estimate, Reference, seconds


class GuideState(NamedTuple):
    """The state of the guide between two ticks."""

    start_ns: int  # -1 before the first tick


@dataclass(frozen=True, slots=True, eq=False)
class MyGuide:
    """A guide along a route.

    The route of the drive fills t_s (m,), eta (m, 3), nu (m, 3) and closed. ease_s is a key of the table [guide].
    """

    t_s: np.ndarray
    eta: np.ndarray
    nu: np.ndarray
    closed: bool = False
    laps: int = 1
    ease_s: float = 1.0

    def init(self) -> GuideState:
        """Return the state before the first tick."""
        return GuideState(-1)

    def step(self, state: GuideState, estimate: Estimate) -> tuple[GuideState, Reference]:
        """Return the state, and the reference pose and velocity at this time; at_end is 1.0 after the last lap."""
        start_ns: Value = np.where(state.start_ns < 0, estimate.t_ns, state.start_ns)
        t = seconds(estimate.t_ns, start_ns)
        pace = 1.0 - np.exp(-t / self.ease_s)  # ṡ
        s = t - self.ease_s * pace
        period, laps = self.t_s[-1], self.laps if self.closed else 1
        at_end: Value = np.where(s >= laps * period, 1.0, 0.0) if laps > 0 else 0.0
        path_time_s = np.where(at_end > 0.0, period, s - period * np.floor(s / period))
        x, y, psi = (np.interp(path_time_s, self.t_s, self.eta[:, i]) for i in range(3))
        nu = np.array(
            [
                np.where(at_end > 0.0, 0.0, pace * np.interp(path_time_s, self.t_s, self.nu[:, i]))
                for i in range(3)
            ]
        )
        return GuideState(start_ns), Reference(estimate.t_ns, np.array([x, y, wrap(psi)]), nu, at_end)
