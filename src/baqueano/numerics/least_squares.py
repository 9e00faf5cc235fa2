"""Minimise a robust cost by damped Gauss-Newton with bounds, on normal equations that the caller sums.

    (H + λ D) s = −o g,   D the largest diagonal of H so far,   o = 1 + 0.17/(1 + 10³ λ)                  (1)
    ϱ = (C(θ) − C(θ + s)) / (−gᵀs − ½ sᵀHs),   accepted if ϱ > 0                                           (2)
    λ ← λ max(1/9, 1 − (2ϱ − 1)³)  if accepted, else  λ ← λ n, n ← 2n                                      (3)
    done when the decrement gᵀH⁻¹g < tolerance, in standard deviations squared                            (4)
    C(θ − h sign(g_i) e_i) > C(θ)   although g_i predicts a fall, h = 10⁻³ standard deviations             (5)

C is the Huber cost, g its gradient, H = Σ w ∂r ∂rᵀ with Huber's weights w. H overestimates the curvature, so an
undamped step is too short by E ψ' / E w = 1/1.17 on normal noise; o corrects this. A parameter whose cost rises in
both directions (5) is at a kink of a delay or a dead zone. It stays there, and the search continues without it. (5)
is tested if steps no longer reduce the cost and (4) is not met. An entry at its bound whose step would cross the
bound is removed from (1). A step that crosses bounds is solved again with these entries at their bounds. H of many
segments is an arrow (normal_equations.py). Sources: Marquardt 1963; Nielsen 1999 for (3); Huber 1981, 7.8 for w.
"""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from baqueano.numerics.normal_equations import BlockArrow, Evaluation, dense, row_product

RIDGE = 1e-11  # fraction of the diagonal: keeps every solve away from exactly singular directions
MAX_EVALUATIONS = 80  # evaluations
MIN_SHRINK = 1.0 / 9.0  # of λ, at most, after a good step
ROUNDING = 1e-15  # fraction of a bound
OVERSTEP = 0.17  # relative lengthening of an undamped step
DAMPING = 1e-2  # λ at the start
STALLED_DECREMENT = 1e-2  # decrement below which a search that no longer improves is treated as converged
STUCK_DAMPING = 1e4  # λ above which the search is stuck
MIN_KINK_SLOPE, KINK_STEP = 1e-2, 1e-3  # standard deviations: least slope for test (5), and its step h


class Solution(NamedTuple):
    """Result of a search: θ and the evaluation at its end."""

    theta: np.ndarray  # (p,)
    evaluation: Evaluation
    converged: bool
    decrement: float  # (4)
    evaluations: int
    bound: np.ndarray  # (p,) −1 at the low bound, 1 at the high one, 0 inside


class Minimiser(Protocol):
    """Interface of a custom solver: it returns the θ (p,) of least cost between `low` and `high` (p,), from `theta`.
    `is_fixed` (p,) is a mask of entries that do not change. The solver can stop at a decrement (4) below `tolerance` or
    after `max_evaluations`. `damping` is 1e-2 for a start far from the minimum, 1e-6 near it. `solution_at` builds the
    result."""

    def __call__(
        self, evaluate: Callable[[np.ndarray], Evaluation], theta: np.ndarray, low: np.ndarray, high: np.ndarray, *,
        is_fixed: np.ndarray | None, tolerance: float, max_evaluations: int, damping: float,
    ) -> Solution: ...  # fmt: skip


def solution_at(
    theta: np.ndarray,
    evaluation: Evaluation,
    low: np.ndarray,
    high: np.ndarray,
    *,
    converged: bool,
    evaluations: int,
) -> Solution:
    """Return the result of a search by a custom solver.

    Parameters
    ----------
    theta : ndarray (p,)
        End of the search [unit of each].
    evaluation : Evaluation
        Cost, gradient and Hessian at `theta`.
    low, high : ndarray (p,)
        Bounds [unit of each].
    converged : bool
        True if the cost cannot be reduced further.
    evaluations : int
        Calls of `evaluate`.

    Returns
    -------
    Solution
        The end, with the entries at a bound and the decrement (4).

    Notes
    -----
    Equation (4) of the module.

    Examples
    --------
    >>> at = Evaluation(1.0, np.array([0.2, 0.0]), np.diag([4.0, 1.0]))
    >>> solution_at(np.zeros(2), at, -np.ones(2), np.ones(2), converged=True, evaluations=7).decrement
    0.010000000000000002
    """
    bound = _bound(theta, low, high)
    H, g = dense(evaluation.hessian), np.where(bound == 0, evaluation.gradient, 0.0)
    with np.errstate(invalid="ignore"):
        decrement = float(g @ np.linalg.pinv(H, hermitian=True) @ g) if np.isfinite(H).all() else np.inf
    return Solution(theta, evaluation, converged, decrement, evaluations, bound)


def minimise(
    evaluate: Callable[[np.ndarray], Evaluation],
    theta: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    *,
    is_fixed: np.ndarray | None = None,
    tolerance: float = 1e-8,
    max_evaluations: int = MAX_EVALUATIONS,
    damping: float = DAMPING,
    evaluation: Evaluation | None = None,
) -> Solution:
    """Return the solution with the θ (p,) of least cost between `low` and `high` (p,), searched from `theta`.
    `is_fixed` (p,) masks entries that do not change. `evaluation` is the evaluation at `theta` if it is known."""
    theta = _clip(theta, low, high)
    free_mask = np.ones(len(theta), bool) if is_fixed is None else ~is_fixed
    current = evaluate(theta) if evaluation is None else evaluation
    count, growth, stalled_count = 1 if evaluation is None else 0, 2.0, 0
    if not _is_finite(current):
        return Solution(
            theta,
            current,
            converged=False,
            decrement=np.inf,
            evaluations=count,
            bound=_bound(theta, low, high),
        )
    scale, are_kinks_tested = np.zeros(len(theta)), False
    while True:
        scale = np.maximum(scale, current.hessian.diagonal())
        active_mask = free_mask & (scale > 0.0) & ~_is_leaving(theta, current.gradient, low, high)
        decrement = _decrement(current, scale, active_mask)
        if (
            (stalled_count >= 3 or damping > STUCK_DAMPING)
            and decrement >= STALLED_DECREMENT
            and count < max_evaluations
            and not are_kinks_tested
        ):
            kink_mask, trial_count = _kink_mask(evaluate, current, theta, scale, active_mask)
            free_mask, count, are_kinks_tested = free_mask & ~kink_mask, count + trial_count, True
            if kink_mask.any():
                damping, growth, stalled_count = DAMPING, 2.0, 0
                continue
        if decrement < tolerance or stalled_count >= 3 or count >= max_evaluations:
            converged = decrement < tolerance or (stalled_count >= 3 and decrement < STALLED_DECREMENT)
            return Solution(theta, current, converged, decrement, count, _bound(theta, low, high))
        step_factor = 1.0 + OVERSTEP / (1.0 + 1e3 * damping)
        s = _bounded_step(current, scale, damping, step_factor, active_mask, theta, low, high)
        trial = _clip(theta + s, low, high)
        trial_evaluation = evaluate(trial)
        count += 1
        expected_decrease = -float(s @ (current.gradient + 0.5 * (current.hessian @ s)))
        gain = current.cost - trial_evaluation.cost
        if _is_finite(trial_evaluation) and gain > 0.0 and expected_decrease > 0.0:
            damping *= max(MIN_SHRINK, 1.0 - (2.0 * gain / expected_decrease - 1.0) ** 3)
            growth = 2.0
            stalled_count = stalled_count + 1 if gain < 1e-12 * current.cost else 0
            theta, current, are_kinks_tested = trial, trial_evaluation, False
        else:
            damping, growth = damping * growth, 2.0 * growth
            stalled_count += gain == 0.0
            if damping > 1e14:
                stalled_count = 3


def _kink_mask(
    evaluate: Callable[[np.ndarray], Evaluation],
    current: Evaluation,
    theta: np.ndarray,
    scale: np.ndarray,
    active_mask: np.ndarray,
) -> tuple[np.ndarray, int]:
    """Return the mask (p,) of parameters at a kink, and the number of evaluations. (5) At a kink the cost rises in both
    directions although the gradient is not zero."""
    kink_mask, slope = np.zeros(len(theta), bool), current.gradient / np.sqrt(np.maximum(scale, 1e-300))
    steep_entries = np.flatnonzero(active_mask & (np.abs(slope) > MIN_KINK_SLOPE))
    for i in steep_entries:
        shifted_theta = theta.copy()
        shifted_theta[i] -= KINK_STEP * np.sign(slope[i]) / np.sqrt(scale[i])
        kink_mask[i] = evaluate(shifted_theta).cost > current.cost
    return kink_mask, len(steep_entries)


def _is_finite(evaluation: Evaluation) -> bool:
    """Return True if cost and Hessian are finite. If a model diverges, a robust cost can be finite although its
    derivatives are not."""
    H = evaluation.hessian
    return bool(
        np.isfinite(evaluation.cost) and (H.is_finite if isinstance(H, BlockArrow) else np.isfinite(H).all())
    )


def _clip(theta: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return θ (p,) between the bounds; an entry that is at a bound except for rounding is set to the bound."""
    bounded_theta = np.minimum(np.maximum(theta, low), high)
    for bound in (low, high):
        is_near = np.isfinite(bound) & (np.abs(bounded_theta - bound) <= ROUNDING * np.abs(bound))
        bounded_theta = np.where(is_near, bound, bounded_theta)
    return bounded_theta


def _is_leaving(theta: np.ndarray, gradient: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return a mask (p,) of the entries at a bound which a step would cross."""
    return ((theta <= low) & (gradient >= 0.0)) | ((theta >= high) & (gradient <= 0.0))


def _decrement(current: Evaluation, scale: np.ndarray, active_mask: np.ndarray) -> float:
    """Return gᵀH⁻¹g over the entries `active_mask` (p,).  (4)"""
    index = np.flatnonzero(active_mask)
    if not len(index):
        return 0.0
    g = current.gradient[index]
    return float(abs(g @ _step(current.hessian, RIDGE, scale, index, g)))


def _step(
    hessian: np.ndarray | BlockArrow, damping: float, scale: np.ndarray, index: np.ndarray, g: np.ndarray
) -> np.ndarray:
    """Return (H + λ D)⁻¹ g over the entries `index` (k,), solved in units in which D is 1. λ is at least RIDGE."""
    damping = max(damping, RIDGE)
    if isinstance(hessian, BlockArrow):
        is_free, gradient = np.zeros(len(scale), bool), np.zeros(len(scale))
        is_free[index], gradient[index] = True, g
        return hessian.solve(damping, scale, is_free, gradient)[index]
    root = 1.0 / np.sqrt(scale[index])
    submatrix = hessian if len(index) == len(hessian) else hessian[np.ix_(index, index)]
    A = submatrix * (root[:, None] * root)
    A.reshape(-1)[:: len(A) + 1] += damping
    return root * np.linalg.solve(A, root * g)


def _bounded_step(
    current: Evaluation,
    scale: np.ndarray,
    damping: float,
    step_factor: float,
    active_mask: np.ndarray,
    theta: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray:
    """Return the step s (p,) of (1), limited so that θ + s is between the bounds."""
    s = np.zeros(len(theta))
    is_free = active_mask.copy()
    for _ in range(len(theta)):
        index = np.flatnonzero(is_free)
        if not len(index):
            break
        g = step_factor * current.gradient[index]
        if len(index) < len(theta):
            g += row_product(current.hessian, index, np.where(is_free, 0.0, s))
        s[index] = -_step(current.hessian, damping, scale, index, g)
        is_crossing = is_free & ((theta + s < low) | (theta + s > high))
        if not is_crossing.any():
            break
        s[is_crossing] = (_clip(theta + s, low, high) - theta)[is_crossing]
        is_free &= ~is_crossing
    return s


def _bound(theta: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return −1 (low bound), 0 (inside) or 1 (high bound) for each entry (p,)."""
    return np.where(theta <= low, -1, np.where(theta >= high, 1, 0))
