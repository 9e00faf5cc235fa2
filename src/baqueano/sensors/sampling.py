"""When a sensor measures and how late its signal is: what all sensors have in common.

A sensor of rate f is asked at every tick of δ seconds and answers where its phase passes a whole number:

    φ⁺ = φ + f δ,   has = 1 if φ⁺ ≥ 1,   φ ← φ⁺ − ⌊φ⁺⌋                                                     (1)

A sensor that is faster than the ticks answers once a tick. Its signal is delay_s old (filters, cameras): the
noise-free measurement is read from a line of the past (vehicles/delay.py); until the line is long enough the
sensor is silent.
"""

from typing import NamedTuple

import numpy as np

from baqueano.vehicles.delay import SHORTEST_TICK_S, delayed

PHASE_TOLERANCE = 1e-6  # of a period: ticks come in whole nanoseconds


class SensorState(NamedTuple):
    """What a sensor remembers."""

    phase: float  # part of a period since the last measurement
    ticks: float  # ticks seen, counted up to the length of the line
    past: np.ndarray  # (delay_slots, m) noise-free measurements of the ticks before, newest first
    bias: np.ndarray  # (m,) what the bias walked since the start


def start(size: int, delay_slots: int) -> SensorState:
    """A sensor that was just switched on; `size` m."""
    return SensorState(0.0, 0.0, np.zeros((delay_slots, size)), np.zeros(size))


def sample(
    state: SensorState, newest: np.ndarray, rate_hz: float, delay_s: float, dt_s: float
) -> tuple[SensorState, float, np.ndarray]:
    """State one tick on, `has`, and the noise-free measurement (m,) that is delay_s old.  (1)"""
    phase = state.phase + rate_hz * dt_s + PHASE_TOLERANCE
    periods = np.floor(phase)
    line_s = state.ticks * np.maximum(dt_s, SHORTEST_TICK_S) + PHASE_TOLERANCE * dt_s
    has = np.minimum(periods, 1.0) * (line_s >= delay_s)
    past, z = delayed(state.past, newest, delay_s, dt_s)
    ticks = np.minimum(state.ticks + 1.0, state.past.shape[0])
    return SensorState(phase - periods - PHASE_TOLERANCE, ticks, past, state.bias), has, z
