"""Dead reckoning with only the IMU, with zero-velocity updates: for a vehicle without a model.

The vehicle rests before its first command, and when the command has been zero for MIN_REST_S. σ is the scatter within
the rests. The bias b changes from rest to rest: the gyro drifts, and on a slope gravity changes with the heading. With
the mean m of n readings of a rest, b_0 and n_0 before it; v the speed, ψ the heading, s the distance, δ the interval:

    b = (n_0' b_0 + n m)/(n_0' + n),   1/n_0' = 1/n_0 + w/σ²,   w = mean of (m − b_0)² − σ²/n − σ²/n_0 ≥ 0   (0)
    v ← v + (a_x − b_x) δ,   ψ ← ψ + (ω − b_ω) δ,   s ← s + v δ along ψ                                   (1)
    var v = σ_x² δ² k + σ_x² (k δ)² / n_rest,   the same for ψ with σ_ω                                   (2)

k counts the readings since the last rest, n_rest is n_0' + n; a_x and ω are the readings of the IMU. If a speed
remains when the vehicle stops, it is integrated noise, and the distance is corrected:

    s ← s − ½ v k δ,   var s = σ_x² δ⁴ (k³/3 + k⁴/(4 n_rest) + Σ k³/12 over the earlier drives)           (3)
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.signals import Estimate, Tick, seconds

MIN_REST_S = 0.6  # without a command; after this time a small vehicle is at rest
MIN_VAR = 1e-12


class RestBias(NamedTuple):
    """Mean and scatter of the readings at rest, (3,) each; the bias changes from rest to rest.  (0)"""

    readings: float = 0.0  # of this rest
    mean: np.ndarray = np.zeros(3)  # of this rest
    squared_deviations: np.ndarray = np.zeros(3)  # from the mean of their rest, over all rests
    degrees_of_freedom: float = -1.0  # of the squared deviations
    prior_bias: np.ndarray = np.zeros(3)  # b_0
    prior_count: np.ndarray = np.zeros(3)  # n_0
    change_sum: np.ndarray = np.zeros(3)  # sum of the changes of (0) over the earlier rests
    changes: float = 0.0  # their number

    def add(self, z: np.ndarray) -> "RestBias":
        """Return the bias after another reading of the same rest."""
        count, deviation = self.readings + 1.0, z - self.mean
        mean = self.mean + deviation / count
        squared_deviations = self.squared_deviations + deviation * (z - mean)
        return self._replace(
            readings=count, mean=mean, squared_deviations=squared_deviations,
            degrees_of_freedom=self.degrees_of_freedom + 1.0,
        )  # fmt: skip

    @property
    def var(self) -> np.ndarray:
        """Return σ² (3,), at least MIN_VAR: a simulated sensor can be without noise."""
        return np.maximum(self.squared_deviations / max(self.degrees_of_freedom, 1.0), MIN_VAR)

    def _changes(self) -> tuple[np.ndarray, float]:
        """Return the sum (3,) of the changes of (0), this rest included, and their number."""
        if not (self.readings and np.all(self.prior_count)):
            return self.change_sum, self.changes
        chance_variance = self.var * (1.0 / self.readings + 1.0 / self.prior_count)
        change = (self.mean - self.prior_bias) ** 2 - chance_variance
        return self.change_sum + change, self.changes + 1.0

    def level(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the bias b (3,), and the number of readings (3,) with the same information.  (0)"""
        if not np.all(self.prior_count):
            return self.mean, np.full(3, self.readings)
        change_sum, changes = self._changes()
        w = np.maximum(change_sum / max(changes, 1.0), 0.0)
        var = self.var
        prior_count = self.prior_count * var / (var + w * self.prior_count)
        count = prior_count + self.readings
        return (prior_count * self.prior_bias + self.readings * self.mean) / count, count

    def close_rest(self) -> "RestBias":
        """Return the bias with which a drive begins."""
        if self.readings == 0.0:
            return self
        (bias, count), (change_sum, changes) = self.level(), self._changes()
        return RestBias(
            0.0, np.zeros(3), self.squared_deviations, self.degrees_of_freedom - 1.0, bias, count,
            change_sum, changes,
        )  # fmt: skip


class InertialBelief(NamedTuple):
    """The state of `Inertial`: bias at rest, pose and speed."""

    t_ns: int  # of the last reading, -1 before the first
    command_end_ns: int  # time at which the last command ended
    rest: RestBias
    eta: np.ndarray  # (3,)
    v: float
    omega: float
    moving_count: float  # readings since the last rest
    displacement_sum: float  # Σ k³/12 of (3)
    dt_s: float = 0.0  # between the last two readings


@dataclass(frozen=True, slots=True, eq=False)
class Inertial:
    """Dead reckoning with only the IMU, for a vehicle without a model. ν is (v, 0, ω).

    Parameters
    ----------
    sensor : str
        Name of the IMU.

    Notes
    -----
    Equations (0)-(3) of the module.

    Examples
    --------
    >>> from baqueano.signals import empty_slots
    >>> alone = Inertial()
    >>> state, estimate = alone.step(alone.init(), Tick(10_000_000, np.zeros(3), empty_slots({"imu": 3})))
    >>> estimate.nu
    array([0., 0., 0.])
    """

    is_interpreted: ClassVar[bool] = True

    sensor: str = "imu"

    def init(self) -> InertialBelief:
        """Return the belief before the first tick."""
        return InertialBelief(-1, -1, RestBias(), np.zeros(3), 0.0, 0.0, 0.0, 0.0)

    def step(self, state: InertialBelief, tick: Tick) -> tuple[InertialBelief, Estimate]:
        """Return the belief, and the estimate: pose relative to the start, body velocity, variances of (2) and (3).

        The heading is not wrapped. A reading that is not finite, or not newer than the last one, is ignored.
        """
        command_end_ns = (
            tick.t_ns if state.command_end_ns < 0 or np.any(tick.u != 0.0) else state.command_end_ns
        )
        slot, s = getattr(tick.sensors, self.sensor), state._replace(command_end_ns=command_end_ns)
        if not (slot.is_new > 0.5 and np.all(np.isfinite(slot.z)) and tick.t_ns > s.t_ns):
            return s, _estimate(s, tick.t_ns)
        dt_s = 0.0 if s.t_ns < 0 else float(seconds(tick.t_ns, s.t_ns))
        is_at_rest = (
            seconds(tick.t_ns, command_end_ns) >= MIN_REST_S
            or s.t_ns < 0
            or (s.moving_count == 0.0 and not np.any(tick.u))
        )
        z = np.asarray(slot.z, dtype=float)
        rest = s.rest.add(z) if is_at_rest else s.rest.close_rest()
        bias, _ = rest.level()
        omega = float(z[2] - bias[2])
        v = 0.0 if is_at_rest else s.v + float(z[0] - bias[0]) * dt_s
        psi = s.eta[2] + (0.0 if is_at_rest else omega * dt_s)
        distance = -0.5 * s.v * s.moving_count * dt_s if is_at_rest else v * dt_s
        eta = np.array([s.eta[0] + distance * np.cos(psi), s.eta[1] + distance * np.sin(psi), psi])
        moving_count, displacement_sum = (
            (0.0, s.displacement_sum + s.moving_count**3 / 12.0)
            if is_at_rest
            else (s.moving_count + 1.0, s.displacement_sum)
        )
        state = InertialBelief(
            tick.t_ns, command_end_ns, rest, eta, v, omega, moving_count, displacement_sum, dt_s
        )
        return state, _estimate(state, tick.t_ns)


def _estimate(s: InertialBelief, t_ns: int) -> Estimate:
    return Estimate(t_ns, s.eta, np.array([s.v, 0.0, s.omega]), _cov(s))


def _cov(s: InertialBelief) -> Value:
    """Return the diagonal covariance (6, 6) of (2) and (3); zeros before three samples at rest have arrived."""
    cov = np.zeros((6, 6))
    if s.rest.degrees_of_freedom > 1.0:
        var, (_, n_rest) = s.rest.var, s.rest.level()
        growth = s.dt_s * s.dt_s * (s.moving_count + s.moving_count * s.moving_count / n_rest)
        cov[2, 2], cov[3, 3], cov[5, 5] = var[2] * growth[2], var[0] * growth[0], var[2]
        displacement_sum = (
            s.displacement_sum + s.moving_count**3 / 3.0 + s.moving_count**4 / (4.0 * n_rest[0])
        )
        cov[0, 0] = cov[1, 1] = var[0] * s.dt_s**4 * displacement_sum
    return cov
