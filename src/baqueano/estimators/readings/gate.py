"""The gate of a measurement with m channels: the largest accepted squared distance.

    P(χ²_m > limit) = P(|n| > σ), n normal                                                                (1)
    P(χ²_m > x) = [m odd] erfc √(x/2) + e^(−x/2) Σ_k (x/2)^k / Γ(k + 1),  k = m/2 − 1, m/2 − 2, … ≥ 0     (2)

σ is the gate in standard deviations of one channel. Source of (2): Abramowitz & Stegun 26.4.4, 26.4.5.
"""

from functools import cache
from math import erfc, exp, gamma, sqrt

import numpy as np

from baqueano.contracts.values import Value
from baqueano.parameter import INF


def is_within_gate(e: np.ndarray, mask: np.ndarray, sigma: float) -> Value:
    """Return True if the whitened innovations e (m,) of the measured channels are jointly within the gate.

    `mask` (m,) is 1 for a measured channel, else 0. Return False if no channel was measured.
    """
    count, limit = np.sum(mask), 0.0
    for k in range(1, len(e) + 1):
        limit = np.where(count == k, gate_limit(sigma, k), limit)
    return (count > 0.0) & (np.sum(mask * e**2) <= limit)


@cache
def gate_limit(sigma: float, m: int) -> float:
    """Return the limit of the squared distance of m channels, as improbable as `sigma` deviations of one channel.
    It is the χ² quantile, by bisection on the survival function (a finite series in m).  (1, 2)
    """
    if sigma == INF:
        return INF
    probability = erfc(sigma / sqrt(2.0))

    def survival(x: float) -> float:
        total = erfc(sqrt(x / 2.0)) if m % 2 else 0.0
        return total + exp(-x / 2.0) * sum(
            (x / 2.0) ** k / gamma(k + 1.0) for k in (j / 2.0 for j in range(m % 2, m, 2))
        )

    low, high = 0.0, sigma**2 + 1.0
    while survival(high) > probability:
        high *= 2.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if survival(middle) > probability else (low, middle)
    return high
