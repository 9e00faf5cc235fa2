"""The classical Runge-Kutta step of order four, with an effort that is a straight line over the step (effort.py).

    k₁ = f(x, e₀)   k₂ = f(x + h/2 k₁, ē)   k₃ = f(x + h/2 k₂, ē)   k₄ = f(x + h k₃, e₁)
    x⁺ = x + h/6 (k₁ + 2 k₂ + 2 k₃ + k₄)                                                                  (1)

x is the state, f its derivative, h the step; e₀, ē and e₁ are the effort at the start, in the middle and at the end.

For ẋ = −x/τ the step is stable while h < 2.785 τ, and the fastest motion of a small vehicle has a τ of 15 ms. So a tick
more than 25 % longer than MAX_ROW_S is divided into equal rows. Source: Kutta 1901.
"""

from collections.abc import Callable

import numpy as np

from baqueano.contracts.values import Value
from baqueano.vehicles.effort import Effort

# the longest row, and the share of it by which a tick can be longer without a division
MAX_ROW_S, ROW_TOLERANCE = (0.02, 0.25)


def rk4(f: Callable[[Value, Value], Value], x: np.ndarray, effort: Effort, dt_s: Value) -> np.ndarray:
    """Return x after one step of `dt_s`, in the same shape; f(x, e) returns ẋ at the effort e (n,).  (1)"""
    k1 = f(x, effort.start)
    k2 = f(x + 0.5 * dt_s * k1, effort.mean)
    k3 = f(x + 0.5 * dt_s * k2, effort.mean)
    k4 = f(x + dt_s * k3, effort.end)
    return x + dt_s / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def row_counts(dt_s: np.ndarray) -> np.ndarray:
    """Return the number of rows (N,) into which each of the ticks of `dt_s` (N,) is divided.

    >>> row_counts(np.array([0.01, 0.022, 0.05]))
    array([1, 1, 3])
    """
    return np.maximum(np.ceil(dt_s / MAX_ROW_S - ROW_TOLERANCE), 1).astype(int)


def row_rate_hz(rate_hz: float) -> float:
    """Return the rows per second of a loop with ticks at `rate_hz`.

    >>> row_rate_hz(100.0), row_rate_hz(10.0)
    (100.0, 50.0)
    """
    return rate_hz * int(row_counts(np.array(1.0 / rate_hz)))
