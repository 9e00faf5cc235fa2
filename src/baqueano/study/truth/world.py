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

    The integration step is 1 ms. A longer `step_s` simulates hours of driving, for robots whose IMU does not have a
    low-pass. `fast` is also for long drives: it accepts a function of arrays and example arrays, and returns an equal,
    faster function.
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
        self._current: tuple[TruthGroup, np.ndarray] | None = None  # motion and readings at t_s
        u = np.zeros((n, physics.commands))
        self._runge_kutta_step = fast(
            lambda x, u, h: runge_kutta(physics.state_derivative(u), x, h), self._x, u, np.ones((n, 1))
        )
        self._nu_dot = fast(lambda x, u: physics.state_derivative(u)(x)[:, 3:6], self._x, u)

    def tick(self, u: np.ndarray, dt_s: float) -> np.ndarray:
        """Send the commands u (n, m), move for `dt_s`, and return the readings (n, 3) of the IMUs."""
        self.move(u, dt_s)
        draw = np.stack([rng.standard_normal(6) for rng in self._noise])
        self._drift = self._drift + self.physics.imu.walk * np.sqrt(dt_s) * draw[:, 3:]
        has_filter = self.physics.imu.low_pass_s[:, None] > 0.0
        noiseless = self.noiseless_readings
        noiseless = noiseless if self._smooth is None else np.where(has_filter, self._smooth, noiseless)
        return self.physics.imu.readings(noiseless, self._drift, draw[:, :3])

    def move(self, u: np.ndarray, dt_s: float) -> None:
        """Send the commands u (n, m) and move for `dt_s`, without a reading of an IMU."""
        self._line.send(self.t_s, u)
        low_pass_s, end_s = self.physics.imu.low_pass_s, self.t_s + dt_s
        if not np.any(low_pass_s > 0.0):
            self._integrate(end_s, self._step_s)
            return
        edges = np.linspace(self.t_s, end_s, 1 + max(1, round(dt_s / STEP_S)))
        tau_s, reading = np.maximum(low_pass_s, MIN_STEP_S)[:, None], self.noiseless_readings
        self._smooth = reading if self._smooth is None else self._smooth
        for a, b in pairwise(edges.tolist()):
            self._integrate(b, STEP_S)
            previous_reading, reading = reading, self.noiseless_readings
            rise = (reading - previous_reading) * tau_s / (b - a)
            self._smooth = (
                reading - rise + (self._smooth - previous_reading + rise) * np.exp(-(b - a) / tau_s)
            )

    def _integrate(self, end_s: float, step_s: float) -> None:
        kick, span_s = self._apply_kick if len(self._rough) else None, (self.t_s, end_s)
        self._x = integrate(self._runge_kutta_step, self._x, span_s, self._line, kick, step_s)
        self.t_s, self._current = end_s, None

    @property
    def truth(self) -> TruthGroup:
        """Return the present pose, velocity and acceleration of the vehicles."""
        return self._motion_and_readings()[0]

    @property
    def noiseless_readings(self) -> np.ndarray:
        """Return the present readings (n, 3) of the IMUs without noise."""
        return self._motion_and_readings()[1]

    def _motion_and_readings(self) -> tuple[TruthGroup, np.ndarray]:
        if self._current is None:
            u = self._line.effective_commands(np.full(len(self._x), self.t_s - TIME_TOLERANCE_S))
            truth = TruthGroup(self._x[:, :3].copy(), self._x[:, 3:6].copy(), self._nu_dot(self._x, u))
            gravity = self.physics.gravity(self._x[:, 2])
            self._current = truth, self.physics.imu.noiseless_readings(truth, gravity)
        return self._current

    @property
    def rolling_speed(self) -> np.ndarray:
        """Return the rolling speed (n,) [m/s] of the wheels: the speed of the vehicles plus the slip."""
        return self.physics.rolling_speed(self._x)

    @property
    def bias_drift(self) -> np.ndarray:
        """Return the drift (n, 3) of the biases until now."""
        return self._drift

    def _apply_kick(self, x: np.ndarray, h: np.ndarray) -> np.ndarray:
        for i in self._rough[h[self._rough] > 0.0]:
            x[i, 3:6] += self.physics.floor[i] * np.sqrt(h[i]) * self._noise[i].standard_normal(3)
        return x
