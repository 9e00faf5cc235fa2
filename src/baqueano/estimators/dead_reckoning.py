"""Dead reckoning: integrate the gyro and the wheels, and use the model for each velocity that no sensor measures.

η is the pose, ν the velocity, e the effort, δ the length of a tick, ₋ the previous tick, J = J(ψ) at mean heading:

    ν̄ = f(ν₋, (1 + s_v) e) + w                    the model f, with process noise w of covariance R       (1)
    ν = ν̄ + L ((z + n − h(0) − b)/(1 + s) − H ν̄)  for each reading z; n is its noise, of covariance Q     (2)
    η = η₋ + J ((ν₋ + ν) δ/2 + d (ν − ν₋) + (ν − ν̄) t/2)                                                  (3)
    Σ = F diag(Σ₋, R, Q) Fᵀ,   F = ∂(η, ν, b, s, s_v) / ∂(η₋, ν₋, b, s, s_v, w, n)                        (4)

velocity_readings.py defines h(0), H and L: L H = I, so a reading replaces the velocity of the model. Readings are not
gated. ν has the age d of its reading, η is current: the sum of (3) is the trapezoid rule plus d times the last ν.
During t, the time without a reading before this tick, the error of the model is assumed to grow linearly. b is the bias
of the gyro, a random walk. At rest (MIN_REST_S without a command, |ν| < MAX_REST_NU) the gyro measures it. s and s_v
are the constant scale errors of gyro and speed. Both stay 0, and only their uncertainty has an effect (consider states,
Schmidt 1966).
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from baqueano.contracts.blocks import SensorBlocks
from baqueano.contracts.values import Value
from baqueano.estimators.covariance import block_diagonal, covariance, mirror_upper
from baqueano.estimators.kalman import boxplus, correct
from baqueano.estimators.pauses import filter_row, row_effort, rows_before, step_rows, unpredicted_cov
from baqueano.estimators.readings.sensor_numbers import (
    UncertainParameter,
    age_s,
    scale_std,
    uncertain_parameters,
)
from baqueano.estimators.readings.velocity_readings import (
    SIDEWAYS_INDEX,
    TURNING_INDEX,
    Reading,
    has_reading,
    replace_velocity,
    velocity_readings,
)
from baqueano.geometry import map_from_body
from baqueano.parameter import document, parameter
from baqueano.signals import ByName, Estimate, Slot, Tick
from baqueano.symbolic import jacobian, tree_where
from baqueano.vehicles.bounds import check_bounds
from baqueano.vehicles.drivetrain import DrivetrainState
from baqueano.vehicles.effort import Effort
from baqueano.vehicles.state import DynamicVehicle

MIN_REST_S = 1.0  # without a command
MAX_REST_NU = np.array([0.01, 0.01, 0.1])  # m/s, m/s, rad/s; a gyro with a larger bias is not used at rest
BIAS_INDEX = 6  # of b in the state


class DeadReckoningBelief(NamedTuple):
    """The state of dead reckoning between two ticks."""

    t_ns: int  # of the last tick; -1 before the first
    mean: np.ndarray  # (9,) η, ν, b, and zeros for s_ω, s_v
    cov: np.ndarray  # (9, 9) of their errors
    since_s: np.ndarray  # (3,) t of each entry of ν
    rest_s: Value  # time since the last command
    drivetrain: DrivetrainState


@document
@dataclass(frozen=True, slots=True, eq=False)
class DeadReckoning:
    """Dead reckoning with gyro and wheels, and with the model if a sensor is missing. It also estimates its covariance.
    Sensors of the pose are ignored. Prefer `AugmentedEkf` if a camera or a floor mark measures the pose.

    Parameters
    ----------
    vehicle : DynamicVehicle
        The model: a block of vehicles/.
    sensors : NamedTuple of Sensor
        The sensors, by name.
    use : tuple of str
        Sensors that are read; if empty, all sensors that measure a velocity.
    readings : tuple of Reading
        The velocities that the sensors measure; computed from the sensors, not an argument.
    gyro_bias : tuple of UncertainParameter
        Bias of the gyro that is read first; computed from the sensors, not an argument.

    References
    ----------
    Schmidt 1966 for the consider states; equations (1)-(4) of the module.

    Examples
    --------
    >>> from baqueano.signals import Tick, empty_slots
    >>> robot = bq.load("small")
    >>> sums = DeadReckoning(robot.vehicle, robot.sensors, 1e-4 * np.eye(6))
    >>> belief, estimate = sums.step(sums.init(), Tick(10_000_000, np.zeros(3), empty_slots({"imu": 3})))
    >>> estimate.cov.shape
    (6, 6)
    """

    vehicle: DynamicVehicle
    sensors: SensorBlocks
    process_noise_cov: np.ndarray = parameter(
        "(m/s, m/s, rad/s, m/s², m/s², rad/s²)²", (
            "R of (ν, ν̇) per tick at rate_hz, (6, 6); only the part of ν is used"
        ),
        shape=(6, 6),
    )  # fmt: skip
    rate_hz: float = parameter("Hz", "the rate for which process_noise_cov is given", low=1e-3, default=100.0)
    use: tuple[str, ...] = ()
    initial_std: np.ndarray = parameter(
        "m, m, rad, m/s, m/s, rad/s", "standard deviations of (η, ν) at the start", low=0.0,
        default=(1e-3, 1e-3, 1e-3, 1e-2, 1e-2, 1e-2), shape=(6,),
    )  # fmt: skip
    readings: tuple[Reading, ...] = field(init=False)
    gyro_bias: tuple[UncertainParameter, ...] = field(init=False)

    def __post_init__(self) -> None:
        check_bounds(self)
        cov = covariance(self.process_noise_cov, 6, "process_noise_cov")
        object.__setattr__(self, "process_noise_cov", cov)
        readings = velocity_readings(self.sensors, self.use)
        gyro = [r for r in readings if r.is_gyro][:1]
        uncertainties = [
            bias for r in gyro for bias in uncertain_parameters(self.sensors, r.name, r.rows, np.zeros(3))
        ]
        object.__setattr__(self, "readings", readings)
        object.__setattr__(self, "gyro_bias", tuple(bias for bias in uncertainties if bias.walk))

    def init(self, eta: np.ndarray | None = None, nu: np.ndarray | None = None) -> DeadReckoningBelief:
        """Return the belief at `eta` (3,) in the map with `nu` (3,) in the body; by default at rest at the origin."""
        start = [np.zeros(3) if x is None else np.array(x, dtype=float) for x in (eta, nu)]
        speed_channels, turn_channels = (
            {r.name: r.rows for r in self.readings if k in r.entries} for k in (0, TURNING_INDEX)
        )
        speed_std, turning_std = scale_std(self.sensors, speed_channels, turn_channels)
        bias = [bias.value_at(self.sensors, bias.std) for bias in self.gyro_bias]
        errors = np.array([*(bias or [0.0]), turning_std, speed_std])
        cov = np.diag(np.concatenate([self.initial_std, errors]) ** 2)
        return DeadReckoningBelief(
            -1, np.concatenate([*start, np.zeros(3)]), cov, np.zeros(3), 0.0, self.vehicle.drivetrain.init()
        )

    step, rows_before = step_rows, rows_before  # `row` for a tick, and for the parts of a long tick

    def row(self, belief: DeadReckoningBelief, tick: Tick) -> tuple[DeadReckoningBelief, Estimate]:
        """Return the belief and the estimate after a row. Beyond the longest row only the covariance is predicted."""
        row = filter_row(belief.t_ns, tick, self.rate_hz)
        drivetrain, effort = row_effort(self.vehicle, belief, row)
        noise = [self.process_noise_cov[:3, :3] * (row.dt_s * self.rate_hz)]
        noise += [getattr(self.sensors, r.name).cov[list(r.rows)][:, list(r.rows)] for r in self.readings]
        mean_and_noise = np.concatenate([belief.mean, np.zeros(sum(len(Q) for Q in noise))])
        ages_s, since_s = self._reading_times(belief, tick, row.predicted_s)
        arguments = effort, row.predicted_s, tick.sensors, ages_s, belief.since_s
        F, mean = (
            jacobian(self._advance_state)(mean_and_noise, *arguments),
            self._advance_state(mean_and_noise, *arguments),
        )
        walk = sum((bias.value_at(self.sensors, bias.walk) ** 2 * row.dt_s for bias in self.gyro_bias), 0.0)
        walk = np.diag(np.array([walk, 0.0, 0.0]))
        added_cov = block_diagonal([unpredicted_cov(row, belief.mean, belief.cov), np.zeros((3, 3)), walk])
        cov = mirror_upper(F @ block_diagonal([belief.cov, *noise]) @ F.T + added_cov)
        rest_s = np.where(np.sum(np.abs(row.u)) > 0.0, 0.0, belief.rest_s + row.dt_s)
        mean, cov = self._with_rest_bias(mean, cov, rest_s, tick)
        next_belief = DeadReckoningBelief(tick.t_ns, mean, cov, since_s, rest_s, drivetrain)
        belief = tree_where(row.is_new, next_belief, belief)
        return belief, Estimate(tick.t_ns, belief.mean[:3], belief.mean[3:6], belief.cov[:6, :6])

    def _with_rest_bias(
        self, mean: np.ndarray, cov: np.ndarray, rest_s: Value, tick: Tick
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the state and its covariance after the gyro has measured its bias; unchanged if not at rest."""
        if not self.gyro_bias:
            return mean, cov
        gyro = self.readings[0]
        sensor, k = getattr(self.sensors, gyro.name), gyro.rows[0]
        at_rest = (rest_s > MIN_REST_S) & np.all(np.abs(mean[3:6]) < MAX_REST_NU)
        is_measured = at_rest & has_reading(gyro, sensor, getattr(tick.sensors, gyro.name))
        H, q = np.eye(9)[BIAS_INDEX][None], np.array([sensor.cov[k, k]])
        update = correct(cov, mean[5:6], H, q, mask=np.where(is_measured, np.ones(1), 0.0))
        return boxplus(mean, update.mean_change), update.cov

    def _reading_times(
        self, belief: DeadReckoningBelief, tick: Tick, dt_s: Value
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return d and t (3,) [s] of ν after this row. A reading of ν_ψ is also a reading of ν_y, as in a car."""
        ages_s, since_s = [0.0, 0.0, 0.0], [t + dt_s for t in belief.since_s]
        for reading in self.readings:
            sensor, slot = getattr(self.sensors, reading.name), getattr(tick.sensors, reading.name)
            for i in {*reading.entries, *(SIDEWAYS_INDEX for k in reading.entries if k == TURNING_INDEX)}:
                ages_s[i] = age_s(sensor, slot)
                since_s[i] = np.where(has_reading(reading, sensor, slot), 0.0, since_s[i])
        return np.array(ages_s), np.array(since_s)

    def _advance_state(
        self,
        x: np.ndarray,
        effort: Effort,
        dt_s: Value,
        slots: ByName[Slot],
        ages_s: np.ndarray,
        since_s: np.ndarray,
    ) -> np.ndarray:
        """Return (η, ν, b, s, s_v) (9,) after one row.  (1)-(3)

        `x` (9 + 3 + m,) stacks the previous state, the process noise w and the noise n of each reading.
        """
        eta, previous_nu, n = x[:3], x[3:6], x[12:]
        effort = Effort(*((1.0 + x[8]) * e for e in effort))
        nu = model_nu = self.vehicle.advance(eta, previous_nu, effort, dt_s)[1] + x[9:12]
        for reading in self.readings:
            sensor = getattr(self.sensors, reading.name)
            slot = getattr(slots, reading.name)
            m = len(reading.rows)
            bias, scale = (x[6], x[7]) if reading.is_gyro else (0.0, x[8])
            nu, n = replace_velocity(reading, sensor, slot, nu, bias - n[:m], scale), n[m:]
        nu = self.vehicle.init(eta, nu).nu
        displacement = (
            0.5 * dt_s * (previous_nu + nu) + ages_s * (nu - previous_nu) + 0.5 * since_s * (nu - model_nu)
        )
        return np.concatenate(
            [boxplus(eta, map_from_body(eta[2] + 0.5 * displacement[2]) @ displacement), nu, x[6:9]]
        )
