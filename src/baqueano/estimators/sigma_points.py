"""The unscented transform: mean and covariance of a function of an uncertain state, from points around its mean.

With P = L Lᵀ and a unit normal ξ the state is x̄ ⊞ L ξ. The 2n points ξ = ±√n e_i, each of weight 1/(2n), have the
moments of ξ up to the third. Of f, whose value at x̄ is 0:

    p_i, q_i = f(x̄ ⊞ ±√n L_i),   m = Σ (p_i + q_i)/(2n)                                                   (1)
    odd  o_i = (p_i − q_i)/(2 √n),   even  ē_i = ((p_i + q_i)/2 − m)/√n                                    (2)
    mean  m,   covariance  o oᵀ + ē ēᵀ,   with x  L oᵀ                                                    (3)

A linear function has o = G L alone. All weights are positive (κ = 0 of Julier and Uhlmann 1997; the cubature points of
Arasaratnam and Haykin 2009), so (3) is a covariance for any f. f gives differences from its value at x̄, headings
wrapped: so the mean of headings on both sides of ±π lies between them.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from baqueano.estimators.covariance import root
from baqueano.estimators.kalman import Gaussian, boxplus


class Spread(NamedTuple):
    """The function at the points."""

    mean: np.ndarray  # m (m,)
    odd: np.ndarray  # o (m, n)
    even: np.ndarray  # ē (m, n)
    root: np.ndarray  # L (n, n)


def spread(f: Callable[[np.ndarray], np.ndarray], x: Gaussian) -> Spread:
    """Return what f makes of the points around the mean of x.  (1, 2)"""
    L, n = root(x.cov), len(x.mean)
    steps = [np.sqrt(float(n)) * L[:, i] for i in range(n)]
    p, q = (np.stack([f(boxplus(x.mean, sign * step)) for step in steps], axis=1) for sign in (1.0, -1.0))
    m = np.sum(p + q, axis=1) / (2.0 * n)
    return Spread(m, (p - q) / (2.0 * np.sqrt(n)), (0.5 * (p + q) - m[:, None]) / np.sqrt(n), L)
