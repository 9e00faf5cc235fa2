"""The classical Runge-Kutta step of order four, with an effort that is a straight line over the step (effort.py).

    k₁ = f(x, e₀)   k₂ = f(x + h/2 k₁, ē)   k₃ = f(x + h/2 k₂, ē)   k₄ = f(x + h k₃, e₁)
    x⁺ = x + h/6 (k₁ + 2 k₂ + 2 k₃ + k₄)                                                                  (1)

On ẋ = −x/τ the step is stable while h < 2.785 τ. Source: Kutta 1901.
"""

from collections.abc import Callable

import numpy as np

from baqueano.contracts.values import Value
from baqueano.vehicles.effort import Effort


def rk4(f: Callable[[Value, Value], Value], x: np.ndarray, effort: Effort, dt_s: Value) -> np.ndarray:
    """Return x one step of `dt_s` seconds later, same shape; f(x, e) is ẋ at the effort e (n,).  (1)"""
    k1 = f(x, effort.start)
    k2 = f(x + 0.5 * dt_s * k1, effort.mean)
    k3 = f(x + 0.5 * dt_s * k2, effort.mean)
    k4 = f(x + dt_s * k3, effort.end)
    return x + dt_s / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
