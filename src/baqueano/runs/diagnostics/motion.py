"""Compute the motion from each source of a recording, as means over common windows; NaN for an unmeasured quantity.

    truth: Δψ/Δt, Δ(x, y)/Δt · (cos ψ, sin ψ)   gyro: ω_z   odometer, or mean of two wheels: v   wheels: v_l, v_r

Windows have 0.2 s or four samples, and overlap the previous window by half.
A mean is the difference of an integral between the ends of the window.
A derivative is the difference of the signal between the same ends, so v̇ and a_x refer to the same span.
"""

from typing import TYPE_CHECKING

import numpy as np

from baqueano.runs.run import Run
from baqueano.signals import NANOSECONDS

if TYPE_CHECKING:
    from baqueano.runs.maps.columns import ColumnMap

WINDOW_S, MIN_SAMPLES = 0.2, 4.0


class LoggedMotion:
    """Window means (W,) of a run: `imu` (W, 3), `wheels` (W, 2); `speed`, `rate`, `v_dot` from the best source."""

    def __init__(self, run: Run, m: "ColumnMap") -> None:
        self.run, self.m = run, m
        self.imu_name, self.wheels_name = self._first("imu"), self._first("wheels", "encoders")
        self.speed_name = self._first("odometer") or self.wheels_name
        stamps = [run.sensors[name].t_ns for name in (self.imu_name, self.speed_name) if name]
        stamps += [run.truth.t_ns] if run.truth is not None else []
        spans = [(t[0], t[-1], np.median(np.diff(t))) for t in stamps if len(t) > 10]
        start, end = (max(s[0] for s in spans), min(s[1] for s in spans)) if spans else (0, 0)
        self.half_s = (
            0.5 * max(WINDOW_S, *(MIN_SAMPLES * s[2] / NANOSECONDS for s in spans)) if spans else 1.0
        )
        self._origin, length = int(start), (end - start) / NANOSECONDS
        is_long = length > 4.0 * self.half_s
        self._t = np.arange(self.half_s, length - self.half_s, self.half_s) if is_long else np.zeros(0)
        self.imu, self.wheels = self._means(self.imu_name, 3), self._means(self.wheels_name, 2)
        self.speed, self.v_dot = self.true_speed(), np.full(len(self._t), np.nan)
        if self.speed_name:
            channel, self.speed = run.sensors[self.speed_name], self._means(self.speed_name, 1).mean(axis=1)
            self.v_dot = self._rate_of_change(self._seconds(channel.t_ns), channel.z.mean(axis=1))
        elif len(self._t) > 2:
            self.v_dot = np.gradient(self.speed, self.half_s)
        self.rate = self.imu[:, 2] if run.truth is None else self.true_rate()

    def mean(self, t_ns: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return the window means (W,) of values (M,), interpolated over gaps; NaN without values."""
        is_known = np.isfinite(values)
        if not is_known.any():
            return np.full(len(self._t), np.nan)
        t, values = self._seconds(t_ns)[is_known], values[is_known]
        area = np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(t))
        return self._rate_of_change(t, np.concatenate([[0.0], area]))

    def true_rate(self, time_shift_s: float = 0.0) -> np.ndarray:
        """Return ω (W,) [rad/s] of the truth, with `time_shift_s` added to its timestamps."""
        if (truth := self.run.truth) is None:
            return np.full(len(self._t), np.nan)
        return self._rate_of_change(self._seconds(truth.t_ns) + time_shift_s, np.unwrap(truth.eta[:, 2]))

    def heading_rate(self, name: str) -> np.ndarray:
        """Return the mean rate of change (W,) [rad/s] of the heading of a compass."""
        channel = self.run.sensors[name]
        is_known = np.isfinite(channel.z[:, 0])
        return self._rate_of_change(self._seconds(channel.t_ns[is_known]), np.unwrap(channel.z[is_known, 0]))

    def true_speed(self, time_shift_s: float = 0.0) -> np.ndarray:
        """Return ν_x (W,) [m/s] of the truth, with `time_shift_s` added to its timestamps."""
        if (truth := self.run.truth) is None:
            return np.full(len(self._t), np.nan)
        t = self._seconds(truth.t_ns) + time_shift_s
        psi = np.interp(self._t, t, np.unwrap(truth.eta[:, 2]))
        return self._rate_of_change(t, truth.eta[:, 0]) * np.cos(psi) + self._rate_of_change(
            t, truth.eta[:, 1]
        ) * np.sin(psi)

    def _first(self, *kinds: str) -> str | None:
        return next((name for name, s in self.m.sensors.items() if s.kind in kinds), None)

    def _means(self, name: str | None, column_count: int) -> np.ndarray:
        if name is None:
            return np.full((len(self._t), column_count), np.nan)
        channel = self.run.sensors[name]
        return np.stack([self.mean(channel.t_ns, column) for column in channel.z.T], axis=1)

    def _seconds(self, t_ns: np.ndarray) -> np.ndarray:
        return (t_ns - self._origin) / NANOSECONDS

    def _rate_of_change(self, t: np.ndarray, values: np.ndarray) -> np.ndarray:
        high, low = (np.interp(self._t + s * self.half_s, t, values) for s in (1.0, -1.0))
        return (high - low) / (2.0 * self.half_s)
