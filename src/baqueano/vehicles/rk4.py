"""The classical Runge-Kutta step of order four; `f` is held fixed in all but x over the step.

    k₁ = f(x)   k₂ = f(x + h/2 k₁)   k₃ = f(x + h/2 k₂)   k₄ = f(x + h k₃)
    x⁺ = x + h/6 (k₁ + 2 k₂ + 2 k₃ + k₄)                                                                  (1)

On ẋ = −x/τ the step is stable while h < 2.785 τ. Source: Kutta 1901.
"""

from collections.abc import Callable

import numpy as np


def rk4(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray, dt: float) -> np.ndarray:
    """x one step of `dt` seconds later, same shape.  (1)"""
    k1 = f(x)
    k2 = f(x + 0.5 * dt * k1)
    k3 = f(x + 0.5 * dt * k2)
    k4 = f(x + dt * k3)
    return x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
