"""The effort over a tick as a straight line with the same mean and the same first moment.

A tick of length δ consists of segments of constant drive w, each from the time a on for h (delay.py). Behind a motor
with the time constant λ, the effort l follows λ l̇ = w − l exactly:

    x = l − w,   E = e^(−h/λ),   J₀ = λ (1 − E),   J₁ = λ (J₀ − h E),    l ← w + x E                      (1)
    M₀ = ∫ l dt = Σ w h + x J₀,    M₁ = ∫ l t dt = Σ w h (a + h/2) + x (a J₀ + J₁)                        (2)
    m₀ = M₀/δ,   m₁ = 2 M₁/δ² − m₀,    the line from m₀ − 3 m₁ to m₀ + 3 m₁                               (3)

A Runge-Kutta step evaluates its stages on the line, and is as exact as the line. The change of ν depends on M₀; the
curve of ν during the tick also depends on M₁. An accelerometer at the end of the tick measures the effort of that
instant: l, or the last w without a lag. The effort changes with l̇ = (w − l)/λ; without a lag, l̇ is taken as 0.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.vehicles.delay import MIN_TICK_S, CommandSegment

TICK_END = 1.0 - 1e-9  # of a tick: a segment that begins later does not act at the end of the tick


class Effort(NamedTuple):
    """The effort of one tick, as a straight line in time.

    Attributes
    ----------
    start : ndarray (n,) [unit of u]
        Value of the line at the beginning of the tick.
    end : ndarray (n,) [unit of u]
        Value of the line at the end of the tick.
    last : ndarray (n,) [unit of u]
        The real effort at the end of the tick, which an accelerometer measures.
    start_rate, mean_rate, last_rate : ndarray (n,) [unit of u per s]
        Rate of change of the real effort: at the beginning, its mean, and at the end. Zero without a lag.

    Examples
    --------
    >>> from baqueano.vehicles import constant_effort
    >>> constant_effort(np.array([0.5])).mean
    array([0.5])
    """

    start: np.ndarray
    end: np.ndarray
    last: np.ndarray
    start_rate: np.ndarray
    mean_rate: np.ndarray
    last_rate: np.ndarray

    @property
    def mean(self) -> np.ndarray:
        """Return the mean effort (n,) over the tick."""
        return 0.5 * (self.start + self.end)


def constant_effort(effort: np.ndarray) -> Effort:
    """Return an effort (n,) that does not change during the tick."""
    return _without_rates(effort, effort, effort)


def direct_effort(pieces: Sequence[CommandSegment], dt_s: Value) -> Effort:
    """Return the effort of motors without a lag.  (2, 3)"""
    last = pieces[0].u
    if len(pieces) == 1:
        return constant_effort(last)
    integral = moment = np.zeros(len(pieces[0].u))
    dt_s = np.maximum(dt_s, MIN_TICK_S)
    for w, a, h in pieces:
        integral = integral + w * (h / dt_s)
        moment = moment + w * (h * (2.0 * a + h) / dt_s**2)
        last = np.where(a < TICK_END * dt_s, w, last)
    return _without_rates(*_line(integral, moment), last)


def lagged_effort(
    pieces: Sequence[CommandSegment], lag_state: np.ndarray, lag_s: Value, dt_s: Value
) -> Effort:
    """Return the effort of motors with the time constant `lag_s`; `lag_state` (k,) is their state before.  (1)-(3)"""
    drive, start_rate = direct_effort(pieces, dt_s), (pieces[0].u - lag_state) / lag_s
    integral = moment = np.zeros(len(pieces[0].u))
    dt_s = np.maximum(dt_s, MIN_TICK_S)
    for w, a, h in pieces:
        h = np.maximum(h, MIN_TICK_S) if len(pieces) == 1 else h
        x, fade = lag_state - w, np.exp(-h / lag_s)
        j_0 = lag_s * (1.0 - fade)
        j_1 = lag_s * (j_0 - h * fade)
        integral = integral + (w * h + x * j_0) / dt_s
        moment = moment + (w * (h * (2.0 * a + h)) + 2.0 * x * (a * j_0 + j_1)) / dt_s**2
        lag_state = w + x * fade
    mean_rate, last_rate = (drive.mean - integral) / lag_s, (drive.last - lag_state) / lag_s
    return Effort(*_line(integral, moment), lag_state, start_rate, mean_rate, last_rate)


def _line(mean: np.ndarray, moment: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    m_1 = moment - mean
    return mean - 3.0 * m_1, mean + 3.0 * m_1


def _without_rates(start: np.ndarray, end: np.ndarray, last: np.ndarray) -> Effort:
    zero = np.zeros(len(last))
    return Effort(start, end, last, zero, zero, zero)
