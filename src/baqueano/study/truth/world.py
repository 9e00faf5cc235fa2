"""Simulate n vehicles in a world that receives commands and returns the readings of the IMUs and the truth."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from baqueano.study.truth.bicycle import Cars
from baqueano.study.truth.group import TruthGroup
from baqueano.study.truth.integrate import MIN_STEP_S, STEP_S, CommandDelayLine, integrate, runge_kutta
from baqueano.study.truth.two_wheels import Robots

TIME_TOLERANCE_S = 1e-6  # tolerance to find the command of the step that ends now


class TruthWorld:
    """Vehicles at rest at the poses `eta` (n, 3), each with the noise of its seed, which is the same in every group.

    The integration step is 1 ms. A longer `step_s` is for hours of driving of robots whose IMU does not have a
    low-pass. `fast` is also for long drives: it accepts a function of arrays and example arrays, and returns an
    equal, faster function.
    """

    def __init__(
        self,
        physics: Robots | Cars,
        seeds: Sequence[int],
        eta: np.ndarray | None = None,
        step_s: float = STEP_S,
        fast: Callable[..., Callable[..., Any]] = lambda f, *examples: f,
    ) -> None:
        self.physics, self._step_s, n = physics, step_s, len(seeds)
        self._noise = [np.random.default_rng([seed, 21]) for seed in seeds]
        self._rough = np.flatnonzero(np.any(physics.floor > 0.0, axis=1))
        self._x = np.zeros((n, physics.states))
        if eta is not None:
            self._x[:, :3] = eta
        self._line, self._drift = CommandDelayLine(physics.delay_s, physics.commands), np.zeros((n, 3))
        self.t_s = 0.0
        self._smooth: np.ndarray | None = None  # (n, 3) after the low-pass
        u = np.zeros((n, physics.commands))
        self._runge_kutta_step = fast(
            lambda x, u, h: runge_kutta(physics.rate_under(u), x, h), self._x, u, np.ones((n, 1))
        )
        self._nu_dot = fast(lambda x, u: physics.rate_under(u)(x)[:, 3:6], self._x, u)

    def tick(self, u: np.ndarray, dt_s: float) -> np.ndarray:
        """Send the commands u (n, m), move for `dt_s`, and return the readings (n, 3) of the IMUs."""
        self.move(u, dt_s)
        draw = np.stack([rng.standard_normal(6) for rng in self._noise])
        self._drift = self._drift + self.physics.imu.walk * np.sqrt(dt_s) * draw[:, 3:]
        has_filter = self.physics.imu.low_pass_s[:, None] > 0.0
        quiet = (
            np.where(has_filter, self._smooth, self.noiseless_readings)
            if self._smooth is not None
            else self.noiseless_readings
        )
        return self.physics.imu.readings(quiet, self._drift, draw[:, :3])

    def move(self, u: np.ndarray, dt_s: float) -> None:
        """Send the commands u (n, m) and move for `dt_s`, without a reading of an IMU."""
        self._line.send(self.t_s, u)
        previous_s, self.t_s = self.t_s, self.t_s + dt_s
        self._advance(previous_s, self._apply_kick if len(self._rough) else None)

    def _advance(self, before_s: float, kick: Any) -> None:
        """Integrate from `before_s` to now, in steps of 1 ms if an IMU has a low-pass."""
        low_pass_s, end_s = self.physics.imu.low_pass_s, self.t_s
        if not np.any(low_pass_s > 0.0):
            span_s = before_s, end_s
            self._x = integrate(self._runge_kutta_step, self._x, span_s, self._line, kick, self._step_s)
            return
        edges = np.linspace(before_s, end_s, 1 + max(1, round((end_s - before_s) / STEP_S)))
        tau_s = np.maximum(low_pass_s, MIN_STEP_S)[:, None]
        for a, b in pairwise(edges.tolist()):
            self.t_s, previous_reading = a, self.noiseless_readings
            self._smooth = previous_reading if self._smooth is None else self._smooth
            self._x = integrate(self._runge_kutta_step, self._x, (a, b), self._line, kick)
            self.t_s = b
            rise = (self.noiseless_readings - previous_reading) * tau_s / (b - a)
            self._smooth = (
                self.noiseless_readings
                - rise
                + (self._smooth - previous_reading + rise) * np.exp(-(b - a) / tau_s)
            )

    @property
    def truth(self) -> TruthGroup:
        """Return the present pose, velocity and acceleration of the vehicles."""
        u = self._line.effective_commands(np.full(len(self._x), self.t_s - TIME_TOLERANCE_S))
        return TruthGroup(self._x[:, :3].copy(), self._x[:, 3:6].copy(), self._nu_dot(self._x, u))

    @property
    def rolling_speed(self) -> np.ndarray:
        """Return the rolling speed (n,) [m/s] of the wheels: the speed of the vehicles plus the slip."""
        return self.physics.rolling_speed(self._x)

    @property
    def bias_drift(self) -> np.ndarray:
        """Return the drift (n, 3) of the biases until now."""
        return self._drift

    @property
    def noiseless_readings(self) -> np.ndarray:
        """Return the present readings (n, 3) of the IMUs without noise."""
        return self.physics.imu.noiseless_readings(self.truth, self.physics.gravity(self._x[:, 2]))

    def _apply_kick(self, x: np.ndarray, h: np.ndarray) -> np.ndarray:
        for i in self._rough[h[self._rough] > 0.0]:
            x[i, 3:6] += self.physics.floor[i] * np.sqrt(h[i]) * self._noise[i].standard_normal(3)
        return x
