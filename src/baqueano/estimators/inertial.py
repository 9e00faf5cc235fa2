"""Dead reckoning with only the IMU, with zero-velocity updates: for a vehicle without a model.

The vehicle is assumed to be at rest before its first command, and when the command has been zero for MIN_REST_S. The
biases b and the noise σ of the channels are computed from readings at rest. While the vehicle drives, with v the speed,
ψ the heading, s the distance, δ the time between two readings:

    v ← v + (a_x − b_x) δ,   ψ ← ψ + (ω − b_ω) δ,   s ← s + v δ along ψ                                   (1)
    var v = σ_x² δ² k + σ_x² (k δ)² / n_rest,   the same for ψ with σ_ω                                   (2)

k counts the readings since the last rest, n_rest the samples at rest; a_x and ω are the readings of the IMU. If a speed
remains when the vehicle stops, it is integrated noise, and the distance is corrected:

    s ← s − ½ v k δ,   var s = σ_x² δ⁴ (k³/3 + k⁴/(4 n_rest) + Σ k³/12 over the earlier drives)           (3)
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.signals import Estimate, Tick, seconds

MIN_REST_S = 0.6  # without a command; after this time a small vehicle is at rest


class InertialBelief(NamedTuple):
    """The state of `Inertial`: statistics at rest, pose and speed."""

    t_ns: int  # of the last reading, -1 before the first
    since_ns: int  # time at which the last command ended
    rest_count: float  # number of samples at rest
    mean: np.ndarray  # (3,) mean of the samples at rest
    squared_deviations: np.ndarray  # (3,) sum of their squared deviations
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
    Equations (1)-(3) of the module.

    Examples
    --------
    >>> from baqueano.signals import silent
    >>> alone = Inertial()
    >>> state, estimate = alone.step(alone.init(), Tick(10_000_000, np.zeros(3), silent({"imu": 3})))
    >>> estimate.nu
    array([0., 0., 0.])
    """

    as_written: ClassVar[bool] = True

    sensor: str = "imu"

    def init(self) -> InertialBelief:
        """Return the belief before the first tick."""
        return InertialBelief(-1, -1, 0.0, np.zeros(3), np.zeros(3), np.zeros(3), 0.0, 0.0, 0.0, 0.0)

    def step(self, state: InertialBelief, tick: Tick) -> tuple[InertialBelief, Estimate]:
        """Return the belief, and the estimate: pose relative to the start, body velocity, variances of (2) and (3).

        The heading is not wrapped. A reading that is not finite, or not newer than the last one, is ignored.
        """
        since_ns = tick.t_ns if state.since_ns < 0 or np.any(tick.u != 0.0) else state.since_ns
        slot, s = getattr(tick.sensors, self.sensor), state._replace(since_ns=since_ns)
        if not (slot.has > 0.5 and np.all(np.isfinite(slot.z)) and tick.t_ns > s.t_ns):
            return s, _estimate(s, tick.t_ns)
        dt_s = 0.0 if s.t_ns < 0 else float(seconds(tick.t_ns, s.t_ns))
        is_at_rest = (
            seconds(tick.t_ns, since_ns) >= MIN_REST_S
            or s.rest_count == 0.0
            or (s.moving_count == 0.0 and not np.any(tick.u))
        )
        rest_count, mean, squared_deviations = s.rest_count, s.mean, s.squared_deviations
        z = np.asarray(slot.z, dtype=float)
        if is_at_rest:
            rest_count, deviation = rest_count + 1.0, z - mean
            mean = mean + deviation / rest_count
            squared_deviations = squared_deviations + deviation * (z - mean)
        omega = float(z[2] - mean[2])
        v = 0.0 if is_at_rest else s.v + float(z[0] - mean[0]) * dt_s
        psi = s.eta[2] + (0.0 if is_at_rest else omega * dt_s)
        distance = -0.5 * s.v * s.moving_count * dt_s if is_at_rest else v * dt_s
        eta = np.array([s.eta[0] + distance * np.cos(psi), s.eta[1] + distance * np.sin(psi), psi])
        moving_count, wander = (
            (0.0, s.displacement_sum + s.moving_count**3 / 12.0)
            if is_at_rest
            else (s.moving_count + 1.0, s.displacement_sum)
        )
        state = InertialBelief(
            tick.t_ns,
            since_ns,
            rest_count,
            mean,
            squared_deviations,
            eta,
            v,
            omega,
            moving_count,
            wander,
            dt_s,
        )
        return state, _estimate(state, tick.t_ns)


def _estimate(s: InertialBelief, t_ns: int) -> Estimate:
    return Estimate(t_ns, s.eta, np.array([s.v, 0.0, s.omega]), _cov(s))


def _cov(s: InertialBelief) -> Value:
    """Return the diagonal covariance (6, 6) of (2) and (3); zeros before three samples at rest have arrived."""
    cov = np.zeros((6, 6))
    if s.rest_count > 2.0:
        var = s.squared_deviations / (s.rest_count - 1.0)
        growth = s.dt_s * s.dt_s * (s.moving_count + s.moving_count * s.moving_count / s.rest_count)
        cov[2, 2], cov[3, 3], cov[5, 5] = var[2] * growth, var[0] * growth, var[2]
        displacement_sum = (
            s.displacement_sum + s.moving_count**3 / 3.0 + s.moving_count**4 / (4.0 * s.rest_count)
        )
        cov[0, 0] = cov[1, 1] = var[0] * s.dt_s**4 * displacement_sum
    return cov
