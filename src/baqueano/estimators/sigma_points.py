"""The unscented transform: mean and covariance of a function of an uncertain state, from points around its mean.

With P = L Lᵀ and standard normal ξ (n,), the state is x̄ ⊞ L ξ. The 2n points ξ = ±√n e_i, each with the weight 1/(2n),
have the same moments as ξ up to the third order. L_i is column i of L, and f is a function with f(x̄) = 0:

    p_i, q_i = f(x̄ ⊞ ±√n L_i),   m = Σ (p_i + q_i)/(2n)                                                   (1)
    odd  o_i = (p_i − q_i)/(2 √n),   even  ē_i = ((p_i + q_i)/2 − m)/√n                                    (2)
    mean  m,   covariance  o oᵀ + ē ēᵀ,   covariance with x  L oᵀ                                         (3)

For a linear function with Jacobian G, o = G L and ē = 0. All weights are positive, so (3) is a covariance for any f
(κ = 0 of Julier and Uhlmann 1997; the cubature points of Arasaratnam and Haykin 2009). f returns differences from its
value at x̄ with wrapped headings. So the mean of headings on both sides of ±π is correct.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from baqueano.estimators.covariance import cholesky_root
from baqueano.estimators.kalman import Gaussian, boxplus


class SigmaSpread(NamedTuple):
    """Mean, odd part and even part of a function at the sigma points, and the root L of the covariance."""

    mean: np.ndarray  # m (m,)
    odd_part: np.ndarray  # o (m, n)
    even_part: np.ndarray  # ē (m, n)
    root: np.ndarray  # L (n, n)


def propagate(f: Callable[[np.ndarray], np.ndarray], x: Gaussian) -> SigmaSpread:
    """Return the mean, the odd part and the even part of `f` at the sigma points of x, and L.  (1, 2)"""
    L, n = cholesky_root(x.cov), len(x.mean)
    steps = [np.sqrt(float(n)) * L[:, i] for i in range(n)]
    p, q = (np.stack([f(boxplus(x.mean, sign * step)) for step in steps], axis=1) for sign in (1.0, -1.0))
    m = np.sum(p + q, axis=1) / (2.0 * n)
    return SigmaSpread(m, (p - q) / (2.0 * np.sqrt(n)), (0.5 * (p + q) - m[:, None]) / np.sqrt(n), L)
