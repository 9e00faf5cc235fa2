"""Extended Kalman filter with an augmented state: it also estimates disturbances and biases.

    x = (η, ν, d, κ, b)     pose, velocity, disturbance, scale errors, biases                               (1)

augmented/motion.py contains the motion of x, augmented/state.py the layout of x.

Two different parameters describe the error of the model (σ_d, T) and the noise of a sensor (Q). If the model turns
wrongly, d_ψ explains the difference, and the gyro determines the yaw rate. A model that was identified with a gyro has
the scale error of that gyro. Then the innovations do not show κ, and κ acts only on the path of the pose.

At rest (no command for MIN_REST_S, predicted speed below MAX_REST_NU) the filter sets ν and d to 0. Rejected readings
end the rest, because a person might carry the vehicle: each shortens quiet_s by REJECTION_COST rows. So a person ends
the rest within 0.05 s, but outliers in less than 1/REJECTION_COST of the rows do not.

Sources: Jazwinski 1970, section 8.4; Schmidt 1966 for κ; Skog et al. 2010 for the detection of rest.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.contracts.blocks import SensorBlocks
from baqueano.contracts.optional import is_dynamic
from baqueano.contracts.values import Value
from baqueano.estimators.augmented.correction import (
    Innovations,
    ReadingMemory,
    correct_tick,
    empty_reading_memory,
)
from baqueano.estimators.augmented.motion import (
    disturbance_variance,
    next_mean_disturbance,
    next_unmeasured_variance,
    predict_row,
    reported_velocity_cov,
    velocity_error,
)
from baqueano.estimators.augmented.state import FORWARD_STATES, MAX_SILENT_S, SCALE_INDEX, layout, start_std
from baqueano.estimators.covariance import block_diagonal, mirror_upper
from baqueano.estimators.kalman import Gaussian
from baqueano.estimators.pauses import filter_row, row_effort, rows_before, step_rows
from baqueano.estimators.readings.inconsistency import update_inconsistency
from baqueano.estimators.readings.sensor_numbers import check_use
from baqueano.estimators.smoother import RowErrors, make_row_errors
from baqueano.parameter import document, parameter
from baqueano.signals import Estimate, Tick
from baqueano.symbolic import branch, jacobian, tree_where
from baqueano.vehicles.bounds import check_bounds
from baqueano.vehicles.drivetrain import DrivetrainState
from baqueano.vehicles.state import DynamicVehicle

MIN_REST_S = 0.5  # without a command; by then a vehicle is at rest, if its predicted speed is also small
MAX_QUIET_S, REJECTION_COST = MIN_REST_S + 0.1, 3.0
MAX_REST_NU = np.array([0.01, 0.01, 0.03])  # m/s, m/s, rad/s
MAX_REST_BIAS = np.array([0.0, 0.0, 2.0])  # added to it, in standard deviations of a gyro's bias
AT_REST_STD = np.array([1e-3, 1e-3, 1e-3, 1e-2, 1e-2])  # of ν and d at rest


class AugmentedBelief(NamedTuple):
    """State of the filter between two ticks."""

    t_ns: int  # of the last tick; -1 before the first
    mean: np.ndarray  # (n,) of (1); biases and scales are differences from those of the vehicle file
    cov: np.ndarray  # (n, n)
    mean_disturbance: np.ndarray  # (2,) d̄ of motion.py: the part of d that does not decay
    unmeasured_variance: np.ndarray  # (2,) of d without any measurement: larger after a change of the effort
    model_nu: np.ndarray  # (3,) ν of the model, computed only from the commands
    memory: ReadingMemory  # of the checks of the readings
    quiet_s: Value  # time without a command; a rejected channel shortens it
    silent_s: np.ndarray  # (2,) since a reading corrected the speed, and the yaw rate
    drivetrain: DrivetrainState


@document
@dataclass(frozen=True, slots=True, eq=False)
class AugmentedEkf:
    """EKF that estimates disturbances and biases, with scale errors as consider states: the recommended estimator.

    Parameters
    ----------
    vehicle : DynamicVehicle
        The model: a block of vehicles/.
    sensors : NamedTuple of Sensor
        The sensors, by name.
    use : tuple of str
        Sensors that correct the state, or single channels of them: "imu[2]".
    speed_from : tuple of str
        Inertial channels that may also correct the speed: "imu[1]".

    References
    ----------
    Jazwinski 1970, section 8.4; Schmidt 1966; Skog et al. 2010 for the state of rest. docs/derivations/kalman.md.

    Examples
    --------
    >>> from baqueano.signals import Tick, empty_slots
    >>> robot = bq.load("small")
    >>> ekf = AugmentedEkf(robot.vehicle, robot.sensors, gate_sigma=5.0)
    >>> belief, estimate = ekf.step(ekf.init(), Tick(10_000_000, np.zeros(3), empty_slots({"imu": 3})))
    >>> estimate.cov.shape
    (6, 6)
    """

    vehicle: DynamicVehicle
    sensors: SensorBlocks
    rate_hz: float = parameter("Hz", "ticks per second", low=1e-3, default=100.0)
    use: tuple[str, ...] = ("imu",)
    speed_from: tuple[str, ...] = ()
    gate_sigma: float = parameter(
        "1", "a measurement further from its prediction than this gets a smaller weight", low=1.0, default=4.0
    )
    disturbance_std: np.ndarray = parameter(
        "m/s², rad/s² (kinematic: m/s, rad/s)", "σ_d of the motion that the model does not explain, forward and yaw",
        low=0.0, default=(0.3, 3.0), shape=(2,),
    )  # fmt: skip
    disturbance_fade_s: np.ndarray = parameter(
        "s", "T, time constant with which each of them decays", low=1e-3, default=(1.0, 0.2), shape=(2,)
    )
    motor_lag_std_s: float = parameter(
        "s", "τ_d: error of the motors' time constant; while their effort changes, it disturbs the yaw rate",
        low=0.0, high=10.0, default=0.0,
    )  # fmt: skip
    velocity_walk_std: np.ndarray = parameter(
        "m/s/√s, m/s/√s, rad/s/√s", "random walk of ν in 1 s, due to the floor", low=0.0,
        default=(0.03, 0.01, 0.1), shape=(3,),
    )  # fmt: skip
    course_std: float = parameter(
        "rad",
        "β: standard deviation between the course and the model, for example due to toe-in of the wheels",
        low=0.0,
        default=0.01,
    )
    sideslip_error_std: float = parameter(
        "1", "γ: error of the model's sideslip in turns, relative to this sideslip; 1: no sensor shows it",
        low=0.0, high=10.0, default=1.0,
    )  # fmt: skip
    speed_error_std: np.ndarray = parameter(
        "m/s, 1",
        "σ₀, σ₁: lasting error of the model's speed, at the speed of least error and per m/s away from it; "
        "0: by the data sheets",
        low=0.0, default=(0.0, 0.0), shape=(2,),
    )  # fmt: skip
    least_error_speed_m_s: float = parameter(
        "m/s",
        "v₀: speed at which the error of the model's speed is least",
        low=-100.0,
        high=100.0,
        default=0.0,
    )
    speed_per_gyro_scale: float = parameter(
        "1",
        "c: relative error of the model's speed per relative error of the gyro's scale; the fit determines both",
        low=-10.0,
        high=10.0,
        default=0.0,
    )
    lateral_offset_std_m: float = parameter(
        "m",
        "σ_y: lateral error of the model's centre of turns; times the yaw rate, it is an error of the speed",
        low=0.0,
        default=0.0,
    )
    slope_speed_std_m_s: float = parameter(
        "m/s",
        "σ_φ: error of the model's speed due to a slope of the floor, along each axis of the map",
        low=0.0,
        default=0.0,
    )
    noise_gain: float = parameter(
        "1",
        "share of one reading in the noise levels, which the filter adapts to the run; 0: the noise of the file",
        low=0.0,
        high=0.1,
        default=0.01,
    )
    initial_std: np.ndarray = parameter(
        "m, m, rad, m/s, m/s, rad/s", "standard deviations of (η, ν) at the start", low=0.0,
        default=(1e-3, 1e-3, 1e-3, 1e-2, 1e-2, 1e-2), shape=(6,),
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_bounds(self)
        check_use(self.sensors, (*self.use, *self.speed_from), allow_channels=True)

    def init(self, eta: np.ndarray | None = None, nu: np.ndarray | None = None) -> AugmentedBelief:
        """Return the belief at `eta` (3,) in the map with `nu` (3,) in the body; by default at rest at the origin."""
        eta, nu = (np.zeros(3) if x is None else np.array(x, dtype=float) for x in (eta, nu))
        states, cov = layout(self), np.diag(start_std(self) ** 2)
        mean, memory = np.concatenate([eta, nu, np.zeros(states.size - 6)]), empty_reading_memory(states)
        drivetrain = self.vehicle.drivetrain.init()
        variance = self.disturbance_std**2
        return AugmentedBelief(-1, mean, cov, np.zeros(2), variance, nu, memory, 0.0, np.zeros(2), drivetrain)

    step, rows_before = step_rows, rows_before  # `row` for a tick, and for the parts of a long tick

    def row(self, belief: AugmentedBelief, tick: Tick) -> tuple[AugmentedBelief, Estimate]:
        """Return the belief and the estimate after a row of any duration; they are finite and positive definite."""
        return self.row_errors(belief, tick)[:2]

    def row_errors(self, belief: AugmentedBelief, tick: Tick) -> tuple[AugmentedBelief, Estimate, RowErrors]:
        """Return the belief and the estimate after a row, and the change of the errors of the state."""
        states, driving_mask = layout(self), layout(self).driving_mask(belief.silent_s)
        belief = belief._replace(cov=mirror_upper(belief.cov))  # the generated code reads one triangle
        row = filter_row(belief.t_ns, tick, self.rate_hz)
        drivetrain, effort = row_effort(self.vehicle, belief, row)
        variance = disturbance_variance(self, belief.mean, effort)
        was_at_rest = self._is_at_rest(belief.quiet_s, Gaussian(belief.mean, belief.cov))
        prediction = predict_row(self, belief, effort, row, variance, was_at_rest)
        variance = next_unmeasured_variance(self, belief.unmeasured_variance, variance, row.dt_s)
        x = Gaussian(prediction.mean, prediction.cov)
        quiet_s = np.where(np.sum(np.abs(row.u)) > 0.0, 0.0, belief.quiet_s + row.dt_s)
        at_rest = self._is_at_rest(quiet_s, x)
        model_nu = self.vehicle.advance(belief.mean[:3], belief.model_nu, effort, row.predicted_s)[1]
        model_nu = np.where(at_rest, 0.0, model_nu)
        nu_dot = None  # for a dynamic model it follows from the state
        if not is_dynamic(self.vehicle):
            nu_dot = self.vehicle.advance(belief.mean[:3], belief.mean[3:6], effort, row.predicted_s)[2]

        G = prediction.G[:3, :3]
        memory = belief.memory._replace(dispute_cov=mirror_upper(G @ belief.memory.dispute_cov @ G.T))

        def correct(x: Gaussian, *, at_rest: bool) -> Value:
            if not states.correction_mask(FORWARD_STATES[0]).any():
                x = x._replace(mean=np.concatenate([x.mean[:3], model_nu[:1], x.mean[4:]]))
            E = states.resting_mask if at_rest else driving_mask
            return correct_tick(self, x, memory, effort, nu_dot, tick, E, at_rest, row.dt_s)

        x, innovations = branch(
            at_rest, lambda: correct(_rest_state(x), at_rest=True), lambda: correct(x, at_rest=False)
        )
        is_exceeded = (x.mean[6:SCALE_INDEX] ** 2 > self.gate_sigma**2 * variance) | (
            np.abs(belief.mean_disturbance) > self.gate_sigma * self.disturbance_std
        )
        replaces_gyro = belief.silent_s[1] > MAX_SILENT_S
        memory, nu_cov = self._disagree(x, innovations, model_nu, is_exceeded, replaces_gyro, row.dt_s)
        disagreement_s = np.where(innovations.rejected_count > 0.0, REJECTION_COST * row.dt_s, 0.0)
        is_corrected = states.corrected_rates(innovations.weight >= 0.5)
        silent_s = np.where(is_corrected, 0.0, belief.silent_s + row.dt_s)
        next_belief = AugmentedBelief(
            tick.t_ns,
            x.mean,
            x.cov,
            next_mean_disturbance(belief.mean_disturbance, x.mean[6:SCALE_INDEX], silent_s, row.dt_s),
            variance,
            model_nu,
            memory,
            np.maximum(np.minimum(quiet_s, MAX_QUIET_S) - disagreement_s, 0.0),
            silent_s,
            drivetrain,
        )
        next_belief = tree_where(row.is_new, next_belief, belief)
        gain = (prediction.mean[3] - belief.mean[3]) / row.predicted_s
        nu_cov = nu_cov + reported_velocity_cov(self, next_belief.mean[3:6], gain)
        D = innovations.growth_factors * np.where(at_rest, _rest_mask(len(x.mean)), 1.0)
        G = np.where(row.is_new, D[:, None] * prediction.G, np.eye(len(D)))
        E = np.where(at_rest, states.resting_mask, driving_mask)
        J = jacobian(self._pose_and_velocity)(next_belief.mean)
        bias_derivative = np.where(at_rest, 0.0, states.yaw_rate_by_bias)
        J = np.concatenate([J[:5], J[5:] + bias_derivative[None, :]])
        errors = make_row_errors(innovations.update, G, E, J, row.is_new)
        return next_belief, self._estimate(next_belief, tick.t_ns, J, nu_cov, innovations), errors

    def _is_at_rest(self, quiet_s: Value, x: Gaussian) -> Value:
        """Return True for a vehicle at rest. The bias of a gyro looks like a yaw rate, so it widens the limit."""
        bias_derivative = layout(self).yaw_rate_by_bias
        max_rest_nu = MAX_REST_NU + MAX_REST_BIAS * np.sqrt(bias_derivative @ x.cov @ bias_derivative)
        return (quiet_s >= MIN_REST_S) & np.all(np.abs(x.mean[3:6]) < max_rest_nu)

    def _disagree(
        self, x: Gaussian, innovations: Innovations, model_nu: np.ndarray, is_exceeded: np.ndarray,
        replaces_gyro: Value, dt_s: Value,
    ) -> tuple[ReadingMemory, np.ndarray]:  # fmt: skip
        """Return the memory after a row, with a wider W during a disagreement, and what var ν gains (3, 3)."""
        memory, model_deviation = innovations.memory, x.mean[[3, 5]] - model_nu[[0, 2]]
        update = update_inconsistency(
            (memory.inconsistency, memory.mean_checks), layout(self), innovations, model_deviation, is_exceeded,
            replaces_gyro, x.mean[:6], dt_s, self.gate_sigma,
        )  # fmt: skip
        memory = memory._replace(
            inconsistency=update.inconsistency,
            mean_checks=update.mean_checks,
            dispute_cov=memory.dispute_cov + update.pose_cov,
        )
        return memory, update.nu_cov

    def _estimate(
        self, belief: AugmentedBelief, t_ns: int, J: np.ndarray, nu_cov: np.ndarray, innovations: Innovations
    ) -> Estimate:
        """Return the estimate; `J` (6, n) is its derivative, `nu_cov` (3, 3) is added to var ν, and W to var η."""
        eta_nu = self._pose_and_velocity(belief.mean)
        cov = mirror_upper(J @ belief.cov @ J.T) + block_diagonal([belief.memory.dispute_cov, nu_cov])
        weight = np.where(layout(self).corrects_motion, innovations.weight, np.nan)
        innovation_fields = innovations.y, innovations.S, weight, innovations.file_S
        return Estimate(
            t_ns, eta_nu[:3], eta_nu[3:], cov, *(innovation_fields if layout(self).channels else ())
        )

    def _pose_and_velocity(self, x: np.ndarray) -> np.ndarray:
        """Return η and (1 + K) ν, (6,): the pose, and the velocity with the scale errors K."""
        return np.concatenate([x[:3], x[3:6] + velocity_error(self, x, x[3:6])])

    @property
    def process_noise_cov(self) -> np.ndarray:
        """Return R (6, 6) of (ν, ν̇) per tick: white noise of about the same size, for filters such as `Ekf`."""
        dt_s, d = 1.0 / self.rate_hz, self.disturbance_std[[0, 0, 1]]
        variance_share = 1.0 - np.exp(-2.0 * dt_s / self.disturbance_fade_s[[0, 0, 1]])
        return np.diag(
            np.concatenate([self.velocity_walk_std**2 * dt_s, np.maximum(d**2 * variance_share, 1e-9)])
        )


def _rest_state(x: Gaussian) -> Gaussian:
    """Return the state with ν = 0 and d = 0, each with the standard deviation AT_REST_STD."""
    rest_mask, rest_variance = _rest_mask(len(x.mean)), np.zeros(len(x.mean))
    rest_variance[3:SCALE_INDEX] = AT_REST_STD**2
    return Gaussian(
        x.mean * rest_mask, x.cov * rest_mask[:, None] * rest_mask[None, :] + np.diag(rest_variance)
    )


def _rest_mask(n: int) -> np.ndarray:
    """Return a mask (n,): 0 for ν and d, which are 0 at rest; 1 for the other states."""
    return np.concatenate([np.ones(3), np.zeros(SCALE_INDEX - 3), np.ones(n - SCALE_INDEX)])
