"""Compute quantiles of the normal distribution and of Student's t, without SciPy.

The error of Cornish and Fisher's expansion is at most 3e-3 from 7 degrees of freedom on. Below 5, the exact quantile
is computed.
"""

from statistics import NormalDist

import numpy as np

QUANTILE_95 = 1.959963984540054  # standard deviations within which 95 % of a normal distribution lie


def student_quantile(probability: float, freedom: float) -> float:
    """Return the quantile of Student's t with `freedom` degrees of freedom (below 5: a whole number)."""
    if freedom < 5:
        return _exact_student_quantile(probability, int(freedom))
    z, n = NormalDist().inv_cdf(probability), float(freedom)
    first = (z**3 + z) / (4.0 * n)
    second = (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / (96.0 * n**2)
    third = (3.0 * z**7 + 19.0 * z**5 + 17.0 * z**3 - 15.0 * z) / (384.0 * n**3)
    return z + first + second + third


def _exact_student_quantile(probability: float, freedom: int) -> float:
    """Return the exact quantile for n = 1 to 4 degrees of freedom, by bisection of the integral over θ = atan(t/√n)."""
    distribution = {
        1: lambda x: x / np.pi,
        2: lambda x: 0.5 * np.sin(x),
        3: lambda x: (x + np.sin(x) * np.cos(x)) / np.pi,
        4: lambda x: 0.5 * np.sin(x) * (1.0 + 0.5 * np.cos(x) ** 2),
    }[freedom]
    low, high = -0.5 * np.pi, 0.5 * np.pi
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if distribution(middle) < probability - 0.5 else (low, middle)
    return float(np.sqrt(freedom) * np.tan(low))
