"""Complementary filter: use the fast part of the speed from the model, and the slow part from the wheels.

    v ← v + a δ,   v ← v + (1 − e^(−δ/T)) (v_wheels − v)                                                  (1)
    ψ ← ψ + (ω − b) δ,   at rest  b ← b + (1 − e^(−δ/T_b)) (ω − b)                                         (2)
    x ← x + v cos ψ δ,   y ← y + v sin ψ δ                                                                (3)
    Σ_η ← F Σ_η Fᵀ + 2 T δ J V Jᵀ,   F = ∂η⁺/∂η                                                           (4)

δ is the tick, v the speed, a the acceleration of the model. η = (x, y, ψ) is the pose with covariance Σ_η, J the
rotation from body to map. a is available at once, but its errors add up: (1) uses only its changes faster than T.
The wheels are noisy but correct on average: (1) uses only their changes slower than T. Without wheels, v follows the
model. ω is the yaw rate of the gyro. Its bias b is estimated while readings arrive, |ω − b| < 0.1 rad/s and the last
command is at least 1 s old. V is the covariance of the errors of ν, which are treated as independent after each T.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from baqueano.contracts.blocks import SensorBlocks
from baqueano.contracts.values import Value
from baqueano.estimators.covariance import block_diagonal, mirror_upper
from baqueano.estimators.dead_reckoning import MAX_REST_NU, MIN_REST_S
from baqueano.estimators.kalman import boxplus
from baqueano.estimators.pauses import filter_row, rows_before, step_rows
from baqueano.estimators.readings.velocity_readings import (
    TURNING_INDEX,
    Reading,
    has_reading,
    measured_velocity,
    velocity_readings,
)
from baqueano.geometry import map_from_body
from baqueano.parameter import document, parameter
from baqueano.signals import Estimate, Tick
from baqueano.symbolic import jacobian, tree_where
from baqueano.vehicles.state import DynamicVehicle


class ComplementaryBelief(NamedTuple):
    """The state of the filter between two ticks."""

    t_ns: int  # of the last tick; -1 before the first
    eta: np.ndarray  # (3,)
    nu: np.ndarray  # (3,)
    cov: np.ndarray  # (3, 3) of η
    bias: Value  # b [rad/s], added to the bias in the gyro's block
    rest_s: Value  # since the last command
    model: Value  # state of the vehicle, simulated by the model from the commands only


@document
@dataclass(frozen=True, slots=True, eq=False)
class Complementary:
    """Complementary filter of wheels and model, with an integrated gyro: its code is short, for a first course.

    `AugmentedEkf` is usually better.

    Parameters
    ----------
    vehicle : DynamicVehicle
        The model: a block of vehicles/.
    sensors : NamedTuple of Sensor
        The sensors, by name.
    readings : tuple of Reading
        The velocities that the sensors measure; computed from the sensors, not an argument.

    Examples
    --------
    >>> from baqueano.signals import Tick, empty_slots
    >>> robot = bq.load("small")
    >>> blend = Complementary(robot.vehicle, robot.sensors, blend_time_s=0.3)
    >>> belief, estimate = blend.step(blend.init(), Tick(10_000_000, np.zeros(3), empty_slots({"imu": 3})))
    >>> estimate.nu
    array([0., 0., 0.])
    """

    vehicle: DynamicVehicle
    sensors: SensorBlocks
    rate_hz: float = parameter("Hz", "ticks per second", low=1e-3, default=100.0)
    blend_time_s: float = parameter(
        "s", "time constant T: slower changes are taken from the wheels", low=1e-3, default=0.5
    )
    rest_time_s: float = parameter("s", "time constant T_b of the estimated gyro bias", low=1e-3, default=1.0)
    velocity_std: np.ndarray = parameter(
        "m/s, m/s, rad/s",
        "standard deviations of the measured velocity in the body, √V",
        low=0.0,
        default=(0.03, 0.03, 0.01),
        shape=(3,),
    )
    readings: tuple[Reading, ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "readings", velocity_readings(self.sensors))

    def init(self, eta: np.ndarray | None = None, nu: np.ndarray | None = None) -> ComplementaryBelief:
        """Return the belief at `eta` (3,) in the map with `nu` (3,) in the body; by default at rest at the origin."""
        eta, nu = (np.zeros(3) if x is None else np.array(x, dtype=float) for x in (eta, nu))
        return ComplementaryBelief(-1, eta, nu, 1e-6 * np.eye(3), 0.0, 0.0, self.vehicle.init(eta, nu))

    step, rows_before = step_rows, rows_before  # `row` for a tick, and for the parts of a long tick

    def row(self, belief: ComplementaryBelief, tick: Tick) -> tuple[ComplementaryBelief, Estimate]:
        """Return the belief and the estimate after one row.  (1)-(4)"""
        row = filter_row(belief.t_ns, tick, self.rate_hz)
        eta, dt_s = belief.eta, row.predicted_s
        model, motion = self.vehicle.step(belief.model, row.u, dt_s, np.zeros(3))
        predicted_nu = belief.nu + (motion.nu - belief.model.nu) + np.array([0.0, 0.0, belief.bias])
        measured_nu = measured_velocity(self.readings, self.sensors, tick.sensors, predicted_nu)
        omega = measured_nu[2] - belief.bias
        v = predicted_nu[0] + (1.0 - np.exp(-dt_s / self.blend_time_s)) * (measured_nu[0] - predicted_nu[0])
        rest_s = np.where(np.sum(np.abs(row.u)) > 0.0, 0.0, belief.rest_s + dt_s)
        is_learning = (
            (rest_s > MIN_REST_S) & (np.abs(omega) < MAX_REST_NU[2]) & (self._turning_count(tick) > 0.0)
        )
        bias_gain = np.where(is_learning, 1.0 - np.exp(-dt_s / self.rest_time_s), 0.0)
        nu = self.vehicle.init(eta, np.array([v, 0.0, omega])).nu  # a car's ν_y follows from its turning
        J, V = map_from_body(eta[2] + 0.5 * dt_s * omega), np.diag(self.velocity_std**2)
        F = jacobian(lambda eta: eta + map_from_body(eta[2] + 0.5 * dt_s * omega) @ (dt_s * nu))(eta)
        cov = mirror_upper(F @ belief.cov @ F.T + (2.0 * self.blend_time_s * row.dt_s) * (J @ V @ J.T))
        eta, bias = boxplus(eta, J @ (dt_s * nu)), belief.bias + bias_gain * omega
        belief = tree_where(
            row.is_new, ComplementaryBelief(tick.t_ns, eta, nu, cov, bias, rest_s, model), belief
        )
        return belief, Estimate(tick.t_ns, belief.eta, belief.nu, block_diagonal([belief.cov, V]))

    def _turning_count(self, tick: Tick) -> Value:
        """Return the number of readings of the yaw rate in this tick."""
        arrivals = [
            has_reading(reading, getattr(self.sensors, reading.name), getattr(tick.sensors, reading.name))
            for reading in self.readings
            if TURNING_INDEX in reading.entries
        ]
        return sum((np.where(has_arrived, 1.0, 0.0) for has_arrived in arrivals), 0.0)
