"""When a sensor measures, and what its signal goes through first: what all sensors have in common.

A sensor of rate f is asked at every tick of δ seconds and answers where its phase passes a whole number:

    φ⁺ = φ + f δ,   has = 1 if φ⁺ ≥ 1,   φ ← φ⁺ − ⌊φ⁺⌋                                                     (1)

A sensor that is faster than the ticks answers once a tick. Its low-pass is of the first order, τ = 1 / (2π
low_pass_hz), and exact for a signal p that is a parabola during the tick, through a, m and b:

    y⁺ = q(δ) + (y − q(0)) e^(−δ/τ),   q = p − τ ṗ + τ² p̈                                                (2)

Then the signal is delay_s old, read from a line of the past (vehicles/delay.py); until the line is long enough the
sensor is silent.
"""

from typing import Any, NamedTuple

import numpy as np

from baqueano.signals import Motion
from baqueano.vehicles.delay import BEFORE_S, SHORTEST_TICK_S, read, with_newest

PHASE_TOLERANCE = 1e-6  # of a period: ticks come in whole nanoseconds


class Signal(NamedTuple):
    """State of a signal between the sensor and its reading."""

    past: np.ndarray  # (delay_slots, m) of the ticks before, behind the low-pass, newest first
    steps_s: np.ndarray  # (delay_slots,) from each to the one before it
    smooth: np.ndarray  # (m,) behind the low-pass; (0,) for a sensor without one


class SensorState(NamedTuple):
    """What a sensor remembers."""

    phase: float  # part of a period since the last measurement
    ticks: float  # ticks seen
    signal: Signal
    bias: np.ndarray  # (m,) what the bias walked since the start


def start(sensor: Any) -> SensorState:
    """Return the state of a sensor that was just switched on."""
    signal = begun(sensor, np.zeros(sensor.size))
    return SensorState(0.0, 0.0, signal, np.zeros(sensor.size))


def begun(sensor: Any, h: np.ndarray) -> Signal:
    """Return the signal of a sensor that has shown `h` (m,) for long."""
    slots = getattr(sensor, "delay_slots", 0)
    smooth = h if getattr(sensor, "has_low_pass", False) else np.zeros(0)
    return Signal(np.ones((slots, 1)) * h, BEFORE_S * np.ones(slots), smooth)


def shown(sensor: Any, signal: Signal, motion: Motion, dt_s: Any) -> tuple[Signal, np.ndarray]:
    """Return the signal one tick on, and what the sensor shows then (m,), without noise.  (2)"""
    h, smooth = sensor.h(motion), signal.smooth
    if smooth.shape[0]:
        h = smooth = _smoothed(sensor, smooth, motion, dt_s)
    if not signal.past.shape[0]:
        return signal._replace(smooth=smooth), h
    steps_s = with_newest(signal.steps_s, dt_s)
    late = read(h, signal.past, steps_s, sensor.delay_s, lambda z, h: difference(sensor, z, h))
    return Signal(with_newest(signal.past, h), steps_s, smooth), late


def sample(
    sensor: Any, state: SensorState, motion: Motion, dt_s: float
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
    signal, z = shown(sensor, signal, motion, dt_s)
    state = SensorState(phase - periods - PHASE_TOLERANCE, state.ticks + 1.0, signal, state.bias)
    return state, np.minimum(periods, 1.0) * long, z


def difference(sensor: Any, z: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Return z − expected (m,); a sensor of angles brings its own."""
    return sensor.difference(z, expected) if hasattr(sensor, "difference") else z - expected


def low_pass_s(sensor: Any) -> Any:
    """Return the time constant of the low-pass [s], 0 for a sensor without one."""
    return 0.5 / (np.pi * sensor.low_pass_hz) if getattr(sensor, "has_low_pass", False) else 0.0


def _smoothed(sensor: Any, smooth: np.ndarray, motion: Motion, dt_s: Any) -> np.ndarray:
    a, m, b = (sensor.h(there) for there in motion.tick or (motion, motion, motion))
    tau_s = low_pass_s(sensor)
    part = tau_s / np.maximum(dt_s, SHORTEST_TICK_S)
    bent = 4.0 * part**2 * (a - 2.0 * m + b)
    q_0 = a - part * (4.0 * m - 3.0 * a - b) + bent
    q_end = b - part * (a - 4.0 * m + 3.0 * b) + bent
    return q_end + (smooth - q_0) * np.exp(-dt_s / tau_s)
