"""The classical Runge-Kutta step of order four, with an effort that is a straight line over the step (effort.py).

    k₁ = f(x, e₀)   k₂ = f(x + h/2 k₁, ē)   k₃ = f(x + h/2 k₂, ē)   k₄ = f(x + h k₃, e₁)
    x⁺ = x + h/6 (k₁ + 2 k₂ + 2 k₃ + k₄)                                                                  (1)

On ẋ = −x/τ the step is stable while h < 2.785 τ. A tick that is longer than a row is cut into equal ones: the fastest
motion of a small vehicle has a τ of 15 ms. Source: Kutta 1901.
"""

from collections.abc import Callable

import numpy as np

from baqueano.contracts.values import Value
from baqueano.vehicles.effort import Effort

ROW_S, MORE = 0.02, 0.25  # the longest row; of it, what a tick may last longer and stay one


def rk4(f: Callable[[Value, Value], Value], x: np.ndarray, effort: Effort, dt_s: Value) -> np.ndarray:
    """Return x one step of `dt_s` seconds later, same shape; f(x, e) is ẋ at the effort e (n,).  (1)"""
    k1 = f(x, effort.start)
    k2 = f(x + 0.5 * dt_s * k1, effort.mean)
    k3 = f(x + 0.5 * dt_s * k2, effort.mean)
    k4 = f(x + dt_s * k3, effort.end)
    return x + dt_s / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def rows_in(dt_s: np.ndarray) -> np.ndarray:
    """Into how many rows (N,) ticks of `dt_s` (N,) are cut.

    >>> rows_in(np.array([0.01, 0.022, 0.05]))
    array([1, 1, 3])
    """
    return np.maximum(np.ceil(dt_s / ROW_S - MORE), 1).astype(int)
