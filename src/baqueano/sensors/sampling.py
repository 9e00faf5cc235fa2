"""Compute sampling times, low-pass and delay in the same way for all sensors.

A sensor of rate f measures when its phase φ passes a whole number; δ is the length of a tick:

    φ⁺ = φ + f δ,   is_new = 1 if φ⁺ ≥ 1,   φ ← φ⁺ − ⌊φ⁺⌋                                                     (1)

A sensor that is faster than the ticks measures once per tick. The low-pass y is of the first order, with the time
constant τ = 1 / (2π low_pass_hz). It is exact for a signal p that is a parabola during the tick, given at its start,
middle and end:

    y⁺ = q(δ) + (y − q(0)) e^(−δ/τ),   q = p − τ ṗ + τ² p̈                                                (2)

The reading is the signal of delay_s ago, from a list of past values (vehicles/delay.py). The sensor is silent until
that list is long enough.
"""

from typing import Any, ClassVar, NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.optional import has_field
from baqueano.contracts.values import Tree, Value
from baqueano.parameter import parameter
from baqueano.signals import Motion, Slot
from baqueano.vehicles.bounds import check_bounds
from baqueano.vehicles.delay import INITIAL_STEP_S, MIN_TICK_S, check_delay, delayed_value, with_newest_value

PHASE_TOLERANCE = 1e-6  # fraction of a period: tick times are rounded to whole nanoseconds


def noise_cov_parameter(unit: str, size: int) -> Any:
    """Return the parameter for the covariance Q (size, size) that a filter assumes."""
    return parameter(
        unit,
        "covariance Q that the filter assumes; if missing: from the noise",
        default=None,
        shape=(size, size),
    )


class Signal(NamedTuple):
    """State of a signal between the sensor and its reading."""

    past_values: np.ndarray  # (delay_slots, m) values of the previous ticks, after the low-pass, newest first
    steps_s: np.ndarray  # (delay_slots,) time from each value to the older one
    low_passed: np.ndarray  # (m,) output of the low-pass; (0,) for a sensor without one


class SensorState(NamedTuple):
    """State of a sensor between two ticks.

    Attributes
    ----------
    phase : float
        Time since the last measurement, in periods of the sensor.
    ticks : float
        Number of ticks so far.
    signal : Signal
        Low-pass and delay between the sensor and its reading.
    bias : ndarray (m,)
        Random walk of the bias since the start, in the sensor's units.
    """

    phase: float
    ticks: float
    signal: Signal
    bias: np.ndarray


def check_sensor_fields(sensor: Tree) -> None:
    """Raise Invalid for a parameter outside its bounds, and for a delay without slots for past values."""
    check_bounds(sensor)
    check_delay(type(sensor).__name__, sensor.delay_s, sensor.delay_slots)


class SampledSensor:
    """Base of a sensor with white noise: a subclass adds its parameters, `size` and h(motion) → (m,).

    The parameters include rate_hz, delay_s, delay_slots, noise_std and measurement_noise_cov. A sensor that is
    sometimes silent adds detects(motion); a sensor of angles adds difference(z, expected).

    Parameters
    ----------
    delay_slots : int
        Number of past ticks that are stored for the delay: delay_s · rate of the loop, rounded up; not traced.
    """

    __slots__ = ()

    size: ClassVar[int]  # m
    noise_std: Value
    measurement_noise_cov: np.ndarray | None

    def __post_init__(self) -> None:
        check_sensor_fields(self)

    @property
    def noise_size(self) -> int:
        """Return the number of standard normals that a tick needs."""
        return self.size

    @property
    def cov(self) -> np.ndarray:
        """Return Q (m, m), the covariance of one measurement: measurement_noise_cov, or the squares of noise_std."""
        Q = self.measurement_noise_cov
        return np.eye(self.size) * self.noise_std**2 if Q is None else Q

    def init(self) -> SensorState:
        """Return the state of a sensor before its first tick."""
        return start_state(self)

    def step(
        self, state: SensorState, motion: Motion, dt_s: float, noise: np.ndarray
    ) -> tuple[SensorState, Slot]:
        """Return the state one tick later, and the reading at the end of the tick; `noise` (m,) is standard normal."""
        state, is_new, z = sample(self, state, motion, dt_s)
        is_new: Value = np.where(detects(self, motion), is_new, 0.0)
        z = difference(self, z + self.noise_std * noise, np.zeros(self.size))  # an angle is wrapped
        return state, Slot(is_new, np.where(is_new > 0.0, z, 0.0))


def start_state(sensor: Tree) -> SensorState:
    """Return the state of a sensor before its first tick."""
    signal = constant_signal(sensor, np.zeros(sensor.size))
    return SensorState(0.0, 0.0, signal, np.zeros(sensor.size))


def constant_signal(sensor: Tree, h: np.ndarray) -> Signal:
    """Return the signal of a sensor whose noise-free measurement has been `h` (m,) for a long time."""
    slots = optional.attribute(sensor, "delay_slots")
    low_passed = h if optional.attribute(sensor, "has_low_pass") else np.zeros(0)
    return Signal(np.ones((slots, 1)) * h, INITIAL_STEP_S * np.ones(slots), low_passed)


def step_signal(sensor: Tree, signal: Signal, motion: Motion, dt_s: Value) -> tuple[Signal, np.ndarray]:
    """Return the signal one tick later, and the measurement (m,) at that time without noise.  (2)"""
    h, low_passed = sensor.h(motion), signal.low_passed
    if low_passed.shape[0]:
        h = low_passed = _low_pass_step(sensor, low_passed, motion, dt_s)
    return delayed_signal(sensor, signal._replace(low_passed=low_passed), h, dt_s)


def delayed_signal(sensor: Tree, signal: Tree, h: np.ndarray, dt_s: Value) -> tuple[Tree, np.ndarray]:
    """Return the signal one tick later, and its delayed value (m,). `h` (m,) is its newest value."""
    if not signal.past_values.shape[0]:
        return signal, h
    steps_s = with_newest_value(signal.steps_s, dt_s)
    past_signal = delayed_value(
        h, signal.past_values, steps_s, sensor.delay_s, lambda z, h: difference(sensor, z, h)
    )
    past_values = with_newest_value(signal.past_values, h)
    return signal._replace(past_values=past_values, steps_s=steps_s), past_signal


def sample(
    sensor: Tree, state: SensorState, motion: Motion, dt_s: float
) -> tuple[SensorState, float, np.ndarray]:
    """Return the state one tick later, `is_new` (1 if the sensor measures, else 0), and the measurement (m,).

    The measurement does not contain noise.  (1)
    """
    phase = state.phase + sensor.rate_hz * dt_s + PHASE_TOLERANCE
    periods = np.floor(phase)
    line_length_s = state.ticks * np.maximum(dt_s, MIN_TICK_S) + PHASE_TOLERANCE * dt_s
    is_line_full = (line_length_s >= sensor.delay_s) | (state.ticks >= sensor.delay_slots)
    signal = state.signal
    if signal.low_passed.shape[0]:
        first = motion if motion.tick is None else motion.tick[0]
        signal = signal._replace(low_passed=np.where(state.ticks > 0.0, signal.low_passed, sensor.h(first)))
    signal, z = step_signal(sensor, signal, motion, dt_s)
    state = SensorState(phase - periods - PHASE_TOLERANCE, state.ticks + 1.0, signal, state.bias)
    return state, np.minimum(periods, 1.0) * is_line_full, z


def detects(sensor: Tree, motion: Motion) -> Value:
    """Return the sensor's `detects(motion)`: True if it can measure. Return True for a sensor without this method."""
    own_detects = optional.attribute(sensor, "detects")
    return True if own_detects is None else own_detects(motion)


def sensor_position(lever_arm_m: np.ndarray, motion: Motion) -> np.ndarray:
    """Return the position (2,) [m] in the map of a sensor at `lever_arm_m` (2,) in the body frame."""
    (x, y, psi), (forward, left) = motion.eta, lever_arm_m
    c, s = np.cos(psi), np.sin(psi)
    return np.array([x + c * forward - s * left, y + s * forward + c * left])


def difference(sensor: Tree, z: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Return z − expected (m,), computed by the sensor's method `difference` if it has this method."""
    own_difference = optional.attribute(sensor, "difference")
    return z - expected if own_difference is None else own_difference(z, expected)


def mistake_corrections(sensor: Tree, z: np.ndarray) -> np.ndarray:
    """Return the corrections (k, m) of z (m,), one for each object that can be mistaken; (0, m) by default."""
    own_mistakes = optional.attribute(sensor, "mistakes")
    return np.zeros((0, len(z))) if own_mistakes is None else own_mistakes(z)


def is_imu(sensor: Tree) -> bool:
    """Return True for a sensor with a gyro, whose readings are two accelerations and the yaw rate."""
    return has_field(sensor, "gyro_scale")


def measures_pose(sensor: Tree) -> bool:
    """Return True for a sensor of position and heading; with such a sensor, a run can begin anywhere in the map."""
    return optional.attribute(sensor, "difference") is not None and sensor.size >= 3


def low_pass_s(sensor: Tree) -> Value:
    """Return the time constant of the low-pass [s]; 0 for a sensor without one."""
    return 0.5 / (np.pi * sensor.low_pass_hz) if optional.attribute(sensor, "has_low_pass") else 0.0


def low_pass_gain(sensor: Tree, dt_s: Value) -> Value:
    """Return the fraction of a change that passes the low-pass by the end of a tick. The change is linear over the
    tick."""
    tau_s = low_pass_s(sensor)
    if isinstance(tau_s, float) and tau_s == 0.0:
        return 1.0
    ratio = tau_s / np.maximum(dt_s, MIN_TICK_S)
    return 1.0 - ratio * (1.0 - np.exp(-1.0 / ratio))


def _low_pass_step(sensor: Tree, low_passed: np.ndarray, motion: Motion, dt_s: Value) -> np.ndarray:
    a, m, b = (sensor.h(sample) for sample in motion.tick or (motion, motion, motion))
    tau_s = low_pass_s(sensor)
    tau_ratio = tau_s / np.maximum(dt_s, MIN_TICK_S)
    curvature = 4.0 * tau_ratio**2 * (a - 2.0 * m + b)
    q_0 = a - tau_ratio * (4.0 * m - 3.0 * a - b) + curvature
    q_end = b - tau_ratio * (a - 4.0 * m + 3.0 * b) + curvature
    return q_end + (low_passed - q_0) * np.exp(-dt_s / tau_s)


def sensor_range(block: Tree) -> np.ndarray | None:
    """Return the largest magnitude (m,) of a reading inside the range of an IMU, or None for other sensors."""
    if not has_field(block, "accel_limit"):
        return None
    limit = np.array([block.accel_limit, block.accel_limit, block.gyro_limit])
    return limit * (1.0 - 1e-9) - converter_steps(block)


def converter_steps(block: Tree) -> np.ndarray:
    """Return the steps (m,) of a sensor's converter, 0 without one."""
    if not has_field(block, "accel_step"):
        return np.zeros(block.size)
    return np.array([block.accel_step, block.accel_step, block.gyro_step])
