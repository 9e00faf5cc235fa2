"""Sampling times and low-pass of a sensor, which all sensors share.

A sensor of rate f is asked at every tick of δ seconds and answers where its phase passes a whole number:

    φ⁺ = φ + f δ,   has = 1 if φ⁺ ≥ 1,   φ ← φ⁺ − ⌊φ⁺⌋                                                     (1)

A sensor that is faster than the ticks answers once a tick. Its low-pass is of the first order, τ = 1 / (2π
low_pass_hz), and exact for a signal p that is a parabola during the tick, through a, m and b:

    y⁺ = q(δ) + (y − q(0)) e^(−δ/τ),   q = p − τ ṗ + τ² p̈                                                (2)

Then the signal is delay_s old, read from a line of the past (vehicles/delay.py); until the line is long enough the
sensor is silent.
"""

from typing import ClassVar, NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.values import Tree, Value
from baqueano.signals import Motion, Slot
from baqueano.vehicles.bounds import check_bounds
from baqueano.vehicles.delay import BEFORE_S, SHORTEST_TICK_S, check_delay, read, with_newest

PHASE_TOLERANCE = 1e-6  # of a period: ticks come in whole nanoseconds


class Signal(NamedTuple):
    """State of a signal between the sensor and its reading."""

    past: np.ndarray  # (delay_slots, m) of the ticks before, behind the low-pass, newest first
    steps_s: np.ndarray  # (delay_slots,) from each to the one before it
    smooth: np.ndarray  # (m,) behind the low-pass; (0,) for a sensor without one


class SensorState(NamedTuple):
    """State of a sensor.

    Attributes
    ----------
    phase : float
        Part of a period since the last measurement.
    ticks : float
        Ticks so far.
    signal : Signal
        What lies between the sensor and its reading.
    bias : ndarray (m,)
        Walk of the bias since the start, in the sensor's units.
    """

    phase: float
    ticks: float
    signal: Signal
    bias: np.ndarray


def check(sensor: Tree) -> None:
    """Refuse parameters out of their bounds, and a delay for which no past is kept."""
    check_bounds(sensor)
    check_delay(type(sensor).__name__, sensor.delay_s, sensor.delay_slots)


class SampledSensor:
    """A sensor with white noise but for its h: a block of this room adds its parameters, `size` and h(motion) → (m,).

    It has rate_hz, delay_s, delay_slots, noise_std and measurement_noise_cov; and, where it is silent at times,
    detects(motion), or for angles difference(z, expected).
    """

    __slots__ = ()

    size: ClassVar[int]  # m
    noise_std: Value
    measurement_noise_cov: np.ndarray | None

    def __post_init__(self) -> None:
        check(self)

    @property
    def noise_size(self) -> int:
        """Unit normals a tick."""
        return self.size

    @property
    def cov(self) -> np.ndarray:
        """Q (m, m): the covariance of one measurement, as a fit found it, else the squares of noise_std."""
        Q = self.measurement_noise_cov
        return np.eye(self.size) * self.noise_std**2 if Q is None else Q

    def init(self) -> SensorState:
        """A sensor just switched on."""
        return start(self)

    def step(
        self, state: SensorState, motion: Motion, dt_s: float, noise: np.ndarray
    ) -> tuple[SensorState, Slot]:
        """The state one tick on, and what the sensor says at its end; `noise` (m,) are unit normals."""
        state, has, z = sample(self, state, motion, dt_s)
        has: Value = np.where(detects(self, motion), has, 0.0)
        z = difference(self, z + self.noise_std * noise, np.zeros(self.size))  # an angle is wrapped
        return state, Slot(has, np.where(has > 0.0, z, 0.0))


def start(sensor: Tree) -> SensorState:
    """Return the state of a sensor that was just switched on."""
    signal = steady_signal(sensor, np.zeros(sensor.size))
    return SensorState(0.0, 0.0, signal, np.zeros(sensor.size))


def steady_signal(sensor: Tree, h: np.ndarray) -> Signal:
    """Return the signal of a sensor that has shown `h` (m,) for long."""
    slots = optional.of(sensor, "delay_slots")
    smooth = h if optional.of(sensor, "has_low_pass") else np.zeros(0)
    return Signal(np.ones((slots, 1)) * h, BEFORE_S * np.ones(slots), smooth)


def step_signal(sensor: Tree, signal: Signal, motion: Motion, dt_s: Value) -> tuple[Signal, np.ndarray]:
    """Return the signal one tick on, and what the sensor shows then (m,), without noise.  (2)"""
    h, smooth = sensor.h(motion), signal.smooth
    if smooth.shape[0]:
        h = smooth = _smooth(sensor, smooth, motion, dt_s)
    if not signal.past.shape[0]:
        return signal._replace(smooth=smooth), h
    steps_s = with_newest(signal.steps_s, dt_s)
    late = read(h, signal.past, steps_s, sensor.delay_s, lambda z, h: difference(sensor, z, h))
    return Signal(with_newest(signal.past, h), steps_s, smooth), late


def sample(
    sensor: Tree, state: SensorState, motion: Motion, dt_s: float
) -> tuple[SensorState, float, np.ndarray]:
    """Return the state one tick on, `has`, and the noise-free measurement (m,).  (1)"""
    phase = state.phase + sensor.rate_hz * dt_s + PHASE_TOLERANCE
    periods = np.floor(phase)
    line_s = state.ticks * np.maximum(dt_s, SHORTEST_TICK_S) + PHASE_TOLERANCE * dt_s
    long = (line_s >= sensor.delay_s) | (state.ticks >= sensor.delay_slots)
    signal = state.signal
    if signal.smooth.shape[0]:
        first = motion if motion.tick is None else motion.tick[0]
        signal = signal._replace(smooth=np.where(state.ticks > 0.0, signal.smooth, sensor.h(first)))
    signal, z = step_signal(sensor, signal, motion, dt_s)
    state = SensorState(phase - periods - PHASE_TOLERANCE, state.ticks + 1.0, signal, state.bias)
    return state, np.minimum(periods, 1.0) * long, z


def detects(sensor: Tree, motion: Motion) -> Value:
    """Return whether a sensor has something to measure there; one that is silent at times brings its own."""
    own = optional.of(sensor, "detects")
    return True if own is None else own(motion)


def place_of(lever_arm_m: np.ndarray, motion: Motion) -> np.ndarray:
    """Return the place (2,) in the map of a sensor that sits at `lever_arm_m` (2,) in the body."""
    (x, y, psi), (ahead, left) = motion.eta, lever_arm_m
    c, s = np.cos(psi), np.sin(psi)
    return np.array([x + c * ahead - s * left, y + s * ahead + c * left])


def difference(sensor: Tree, z: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Return z − expected (m,); a sensor of angles brings its own."""
    own = optional.of(sensor, "difference")
    return z - expected if own is None else own(z, expected)


def mistakes(sensor: Tree, z: np.ndarray) -> np.ndarray:
    """Return by how much z (m,) is off if the sensor took one thing for another: (k, m), what z lacks then."""
    own = optional.of(sensor, "mistakes")
    return np.zeros((0, len(z))) if own is None else own(z)


def tells_pose(sensor: Tree) -> bool:
    """Return True for a sensor of place and heading, by which a run may begin anywhere in the map."""
    return optional.of(sensor, "difference") is not None and sensor.size >= 3


def low_pass_s(sensor: Tree) -> Value:
    """Return the time constant of the low-pass [s], 0 for a sensor without one."""
    return 0.5 / (np.pi * sensor.low_pass_hz) if optional.of(sensor, "has_low_pass") else 0.0


def _smooth(sensor: Tree, smooth: np.ndarray, motion: Motion, dt_s: Value) -> np.ndarray:
    a, m, b = (sensor.h(sample) for sample in motion.tick or (motion, motion, motion))
    tau_s = low_pass_s(sensor)
    part = tau_s / np.maximum(dt_s, SHORTEST_TICK_S)
    curvature = 4.0 * part**2 * (a - 2.0 * m + b)
    q_0 = a - part * (4.0 * m - 3.0 * a - b) + curvature
    q_end = b - part * (a - 4.0 * m + 3.0 * b) + curvature
    return q_end + (smooth - q_0) * np.exp(-dt_s / tau_s)
