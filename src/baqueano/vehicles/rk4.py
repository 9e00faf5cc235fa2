"""The classical Runge-Kutta step of order four, with an effort that is a straight line over the step (effort.py).

    k₁ = f(x, e₀)   k₂ = f(x + h/2 k₁, ē)   k₃ = f(x + h/2 k₂, ē)   k₄ = f(x + h k₃, e₁)
    x⁺ = x + h/6 (k₁ + 2 k₂ + 2 k₃ + k₄)                                                                  (1)

x is the state, f its derivative, h the step; e₀, ē and e₁ are the effort at the start, in the middle and at the end.
A state r with λ ṙ = y − r is exact for a cubic polynomial y, also for λ → 0. With s = t/h and z = h/λ:

    y = y₀ + b s + c s² + d s³,   I₀ = 1 − e⁻ᶻ,   I₁ = 1 − I₀/z,   I₂ = 1 − 2 I₁/z
    h ṙ = z e⁻ᶻ (y₀ − r₀) + I₀ b + 2 I₁ c + 3 I₂ d,   r = y(1) − λ ṙ                                      (2)

For ẋ = −x/τ the step is stable while h < 2.785 τ, and the fastest motion of a small vehicle has a τ of 15 ms. So a tick
more than 25 % longer than MAX_ROW_S is divided into equal rows. Sources: Kutta 1901, Cox and Matthews 2002.
"""

from collections.abc import Callable

import numpy as np

from baqueano.contracts.values import Value
from baqueano.vehicles.delay import MIN_TICK_S
from baqueano.vehicles.effort import Effort

# the longest row, and the share of it by which a tick can be longer without a division
MAX_ROW_S, ROW_TOLERANCE = (0.02, 0.25)
MIN_DECAY_S = 1e-6  # a shorter lag decays within every tick; keeps 1/λ finite


def rk4(f: Callable[[Value, Value], Value], x: np.ndarray, effort: Effort, dt_s: Value) -> np.ndarray:
    """Return x after one step of `dt_s`, in the same shape; f(x, e) returns ẋ at the effort e (n,).  (1)"""
    k1 = f(x, effort.start)
    k2 = f(x + 0.5 * dt_s * k1, effort.mean)
    k3 = f(x + 0.5 * dt_s * k2, effort.mean)
    k4 = f(x + dt_s * k3, effort.end)
    return x + dt_s / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def lagged_rk4(
    f: Callable[[np.ndarray, Value, np.ndarray], tuple[np.ndarray, Value, np.ndarray]],
    x: np.ndarray,
    r: Value,
    effort: Effort,
    dt_s: Value,
    lag_s: Value,
) -> tuple[np.ndarray, Value, Value]:
    """Return x, r, and the part of ṙ that is due to the lag, after one step.  (1), (2)

    λ ṙ = y − r + λ p, and p is not due to the lag. f(x, r, e) returns ẋ, whose last entry is y + λ p, then p and
    ∂y/∂e (n,).
    """
    h = np.maximum(dt_s, MIN_TICK_S)
    z = h / np.maximum(lag_s, MIN_DECAY_S)
    half = np.exp(-0.5 * z)
    fade = half * half
    linear = 1.0 - (1.0 - fade) / z
    k1, *_ = f(x, r, effort.start)
    r2 = k1[-1] + half * (r - k1[-1])
    k2, *_ = f(x + 0.5 * h * k1, r2, effort.mean)
    k3, *_ = f(x + 0.5 * h * k2, k2[-1] + half * (r - k2[-1]), effort.mean)
    y = 2.0 * k3[-1] - k1[-1]
    r4 = y + half * (r2 - y)
    k4, *_ = f(x + h * k3, r4, effort.end)
    x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    k5, p, slope = f(x, r4, effort.last)
    # the real effort minus its line, and minus that parabola: neither changes the mean or the first moment of y
    bend = effort.last - effort.end
    twist = (h * effort.last_rate - effort.end + effort.start) / 6.0 - bend
    # a long lag smooths the twist, and its weight I₂ loses digits
    y_bend, y_twist = k5[-1] - k4[-1], (1.0 - half) ** 2 * (slope @ twist)
    start, middle, end = k1[-1] + y_bend, 0.5 * (k2[-1] + k3[-1] - y_bend), k5[-1]
    b = 4.0 * middle - 3.0 * start - end + 18.0 * y_twist
    c, d = 2.0 * (start - 2.0 * middle + end) - 36.0 * y_twist, 20.0 * y_twist
    polynomial = (1.0 - fade) * b + 2.0 * linear * c + 3.0 * (1.0 - 2.0 * linear / z) * d
    r_dot = (z * fade * (start - 2.0 * y_twist - r) + polynomial) / h
    return x, end - lag_s * r_dot, r_dot - p


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
