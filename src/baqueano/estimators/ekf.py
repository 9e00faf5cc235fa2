"""The paper's extended Kalman filter, with the pose in the same covariance. State μ = (η, ν, ν̇), covariance Σ.

    μ̄ = g(u, μ),   Σ̄ = G Σ Gᵀ + R,              G = ∂g/∂μ                       `equ:EKF`   (1)
    S = H Σ̄ Hᵀ + Q,   K = Σ̄ Hᵀ S⁻¹,              H = ∂h/∂μ                                   (2)
    μ = μ̄ + K (z − h(μ̄)),   Σ = (I − K H) Σ̄ (I − K H)ᵀ + K Q Kᵀ                              (3)
    ν̄ = ν + ν̇ δ,   ν̇̄ = Φ(ν) ν + M⁻¹ T e            model of the paper, mode "paper"          (4)
    a_d = ν̇ − f(ν, e₋),   ν̄ = ν ⊕ f(·, e) δ + a_d δ,   ν̇̄ = f(ν̄, e) + exp(−δ/T_d) a_d         (5)
    ν̄ = V e,   ν̇̄ = (V e − ν) / δ                     kinematic model           (errata 7)    (6)
    h = h(η − d R(ψ) ν,  ν − d ν̇,  ν̇)                for a measurement of age d              (7)
    Σ̄_ηη += τ² diag(E|ν_xy|², E|ν_xy|², E ν_ψ²),     Σ̄ ← D Σ̄ D                               (8, 9)

η: pose; ν: velocity; u: command; e: effort; δ: tick; z: measurement of noise Q; R: process noise per tick at `rate_hz`;
R(ψ): rotation; f: ν̇ of the model; ⊕: its integrator; a_d: unexplained acceleration; τ: time without prediction; D: the
bound of pauses.py. Departures from Grotz et al., Positioning system using EKF: docs/derivations/ekf_with_pose.md.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from baqueano.contracts.blocks import Sensor, SensorBlocks
from baqueano.contracts.optional import is_dynamic
from baqueano.contracts.values import Value
from baqueano.errors import Invalid
from baqueano.estimators.covariance import block_diagonal, covariance, mirror_upper
from baqueano.estimators.kalman import Gaussian, boxplus, correct, predict
from baqueano.estimators.pauses import (
    FilterRow,
    filter_row,
    limit_covariance,
    row_effort,
    rows_before,
    step_rows,
    unpredicted_cov,
)
from baqueano.estimators.readings.gate import is_within_gate
from baqueano.estimators.readings.sensor_numbers import age_s, check_use, measured_channels, past_motion
from baqueano.geometry import map_from_body, wrap
from baqueano.parameter import INF, document, parameter
from baqueano.sensors.sampling import difference
from baqueano.signals import Estimate, Slot, Tick
from baqueano.symbolic import jacobian, tree_where
from baqueano.vehicles.drivetrain import DrivetrainState
from baqueano.vehicles.effort import Effort
from baqueano.vehicles.state import DynamicVehicle

if TYPE_CHECKING:
    from baqueano.estimators.unscented import Unscented

MODES = ("default", "paper")


class Belief(NamedTuple):
    """State of the filter between two ticks: mean, covariance, drivetrain.

    Attributes
    ----------
    t_ns : int
        Time of the last tick; -1 before the first.
    mean : ndarray (9,)
        Estimate of (η, ν, ν̇).
    cov : ndarray (9, 9)
        Covariance of (η, ν, ν̇).
    effort : ndarray (n,) [unit of u]
        Effort on the body at the end of the last interval.
    drivetrain : DrivetrainState
        State of the delay and the motor lag.
    """

    t_ns: int
    mean: np.ndarray
    cov: np.ndarray
    effort: np.ndarray
    drivetrain: DrivetrainState


@document
@dataclass(frozen=True, slots=True, eq=False)
class Ekf:
    """Extended Kalman filter for any vehicle and any sensors, with the state of the paper.

    `AugmentedEkf` is usually better.

    Parameters
    ----------
    vehicle : DynamicVehicle
        The model: a block of vehicles/.
    sensors : NamedTuple of Sensor
        The sensors, by name.
    mode : str
        "default", or "paper": the equations as printed.
    use : tuple of str
        Sensors that correct the state; the others are only recorded.

    References
    ----------
    Grotz et al., section State Estimation; Thrun, Burgard and Fox 2005, table 3.3. Derivation:
    docs/derivations/ekf_with_pose.md.

    Examples
    --------
    >>> from baqueano.signals import Tick, empty_slots
    >>> robot = bq.load("small")
    >>> ekf = Ekf(robot.vehicle, robot.sensors, 1e-4 * np.eye(6))
    >>> belief, estimate = ekf.step(ekf.init(), Tick(10_000_000, np.zeros(3), empty_slots({"imu": 3})))
    >>> estimate.cov.shape
    (6, 6)
    """

    stacks_innovations: ClassVar[bool] = True

    vehicle: DynamicVehicle
    sensors: SensorBlocks
    process_noise_cov: np.ndarray = parameter(
        "(m/s, m/s, rad/s, m/s², m/s², rad/s²)²", "R of (ν, ν̇) per tick at rate_hz, (6, 6)", shape=(6, 6)
    )
    rate_hz: float = parameter("Hz", "the rate for which process_noise_cov is given", low=1e-3, default=100.0)
    mode: str = "default"
    gate_sigma: float = parameter(
        "1", "a measurement further from its prediction than this is excluded", low=0.0, default=4.0
    )
    use: tuple[str, ...] = ("imu",)
    disturbance_time_s: float = parameter(
        "s", "T_d, time constant with which an unexplained acceleration decays", low=1e-6, default=0.5
    )
    initial_std: np.ndarray = parameter(
        "m, m, rad, m/s, m/s, rad/s, m/s², m/s², rad/s²",
        "standard deviations of (η, ν, ν̇) at the start",
        low=0.0,
        default=(1e-3, 1e-3, 1e-3, 1e-2, 1e-2, 1e-2, 0.1, 0.1, 0.1),
        shape=(9,),
    )

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise Invalid.of("ekf.mode", value=self.mode, valid=MODES)
        check_use(self.sensors, self.use)
        positive_fields = {
            name: getattr(self, name) for name in ("rate_hz", "gate_sigma", "disturbance_time_s")
        }
        if not all(value > 0.0 for value in positive_fields.values()):
            raise Invalid.of("ekf.positive", **positive_fields)
        object.__setattr__(
            self, "process_noise_cov", covariance(self.process_noise_cov, 6, "process_noise_cov")
        )
        object.__setattr__(self, "initial_std", np.array(self.initial_std, dtype=float))
        if self.initial_std.shape != (9,) or not np.all(self.initial_std > 0.0):
            raise Invalid.of("ekf.initial-std", value=self.initial_std)

    def init(self, eta: np.ndarray | None = None, nu: np.ndarray | None = None) -> Belief:
        """Return the belief at `eta` (3,) in the map with `nu` (3,) in the body; by default at rest at the origin."""
        start = [np.zeros(3) if x is None else np.array(x, dtype=float) for x in (eta, nu)]
        effort = np.zeros(self.vehicle.commands)
        nu_dot = self.vehicle.nu_dot(start[1], effort, start[0][2]) if self._is_dynamic else np.zeros(3)
        mean = np.concatenate([*start, nu_dot])
        return Belief(-1, mean, np.diag(self.initial_std**2), effort, self.vehicle.drivetrain.init())

    step, rows_before = step_rows, rows_before  # `row` for a tick, and for the parts of a long tick

    def row(self, belief: Belief, tick: Tick) -> tuple[Belief, Estimate]:
        """Return the belief and the estimate after a row of any duration; they are finite and positive definite.

        The mean is predicted for at most the longest row; after that only its covariance grows.
        """
        row = filter_row(belief.t_ns, tick, self.rate_hz)
        drivetrain, effort = row_effort(self.vehicle, belief, row)
        mean, cov = self._predict(belief, effort, row)
        y, s, w = [], [], []
        for name in self.use:
            mean, cov, *innovation = self._correct(name, mean, cov, getattr(tick.sensors, name))
            y, s, w = [*y, innovation[0]], [*s, innovation[1]], [*w, innovation[2]]
        next_belief = Belief(tick.t_ns, mean, cov, effort.last, drivetrain)
        belief = tree_where(row.is_new, next_belief, belief)
        innovations = (np.concatenate(y), block_diagonal(s), np.concatenate(w)) if y else ()
        mean, cov = belief.mean, belief.cov
        return belief, Estimate(tick.t_ns, mean[:3], mean[3:6], cov[:6, :6], *innovations)

    @property
    def _is_dynamic(self) -> bool:
        return is_dynamic(self.vehicle)

    def _predict(self, belief: Belief, effort: Effort, row: FilterRow) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean (9,) and the covariance (9, 9) one row later.  (1, 8, 9)"""
        previous = Gaussian(belief.mean, belief.cov)
        prediction = predict(
            previous, lambda x: self.advance_mean(x, belief.effort, effort, row.predicted_s), np.zeros((9, 9))
        )
        R = self.process_noise_cov * (row.dt_s * self.rate_hz)
        # (8)
        rest_cov = unpredicted_cov(row, prediction.mean, belief.cov + block_diagonal([np.zeros((3, 3)), R]))
        return prediction.mean, limit_covariance(prediction.cov + block_diagonal([rest_cov, R]))  # (9)

    def advance_mean(self, mean: np.ndarray, previous: np.ndarray, effort: Effort, dt_s: Value) -> np.ndarray:
        """Return g(u, μ) (9,), the mean after a tick; `previous` (n,) is the effort before it.  (4, 5, 6)"""
        if self.mode == "default" and self._is_dynamic:
            return move_by_model(self, mean, previous, effort, dt_s)
        eta, nu, nu_dot = mean[:3], mean[3:6], mean[6:]
        if not self._is_dynamic:
            return _state(*self.vehicle.advance(eta, nu, effort, dt_s))
        middle_rotation = map_from_body(eta[2] + 0.5 * dt_s * nu[2])
        eta_next = eta + middle_rotation @ (nu * dt_s + 0.5 * dt_s**2 * nu_dot)
        return _state(eta_next, nu + nu_dot * dt_s, self.vehicle.nu_dot(nu, effort.last, eta[2]))

    def _correct(self, name: str, mean: np.ndarray, cov: np.ndarray, slot: Slot) -> tuple[Value, ...]:
        """Return the mean, the covariance, the innovation (m,), its covariance (m, m) and the weights (m,).  (2, 3)"""
        sensor = getattr(self.sensors, name)
        elapsed_s = 0.0 if self.mode == "paper" else age_s(sensor, slot)
        z_bar, H, Q = self._h(mean, sensor, elapsed_s), jacobian(self._h)(mean, sensor, elapsed_s), sensor.cov
        mask = measured_channels(sensor, slot)
        y = difference(sensor, np.where(mask > 0.0, slot.z, z_bar), z_bar)
        update = correct(cov, y, H, Q, mask=mask)
        is_accepted = is_within_gate(update.e, mask, INF if self.mode == "paper" else self.gate_sigma)
        mean = np.where(is_accepted, boxplus(mean, update.mean_change), mean)
        S = mirror_upper(H @ cov @ H.T + Q)
        y, w = (np.where(mask > 0.0, x, np.nan) for x in (y, np.where(is_accepted, 1.0, 0.0)))
        return mean, np.where(is_accepted, update.cov, cov), y, S, w

    def _h(self, mean: np.ndarray, sensor: Sensor, elapsed_s: Value) -> np.ndarray:
        """Return the predicted measurement (m,) for a reading of the age `elapsed_s`.  (7)"""
        return sensor.h(past_motion(self.vehicle, mean[:3], mean[3:6], mean[6:], elapsed_s))


def move_by_model(
    kalman_filter: "Ekf | Unscented", mean: np.ndarray, previous: np.ndarray, effort: Effort, dt_s: Value
) -> np.ndarray:
    """Return g(u, μ) (9,) of a filter with a dynamic model; `previous` (n,) is the effort before the tick.  (5)"""
    vehicle, eta, nu = kalman_filter.vehicle, mean[:3], mean[3:6]
    a_d = mean[6:] - vehicle.nu_dot(nu, previous, eta[2])
    eta, nu, _ = vehicle.advance(eta, nu, effort, dt_s)
    eta, nu = eta + map_from_body(eta[2]) @ (0.5 * dt_s**2 * a_d), nu + a_d * dt_s
    f = vehicle.nu_dot(nu, effort.last, eta[2])
    return _state(eta, nu, f + np.exp(-dt_s / kalman_filter.disturbance_time_s) * a_d)


def _state(eta: np.ndarray, nu: np.ndarray, nu_dot: np.ndarray) -> np.ndarray:
    """Return μ (9,) with its heading wrapped."""
    return np.concatenate([np.array([eta[0], eta[1], wrap(eta[2])]), nu, nu_dot])
