"""Damped Gauss-Newton with bounds, on normal equations that somebody else sums.

    (H + λ D) s = −o g,   D the largest diagonal of H so far,   o = 1 + 0.17/(1 + 10³ λ)                  (1)
    ϱ = (C(θ) − C(θ + s)) / (−gᵀs − ½ sᵀHs),   accepted if ϱ > 0                                           (2)
    λ ← λ max(1/9, 1 − (2ϱ − 1)³)  if accepted, else  λ ← λ n, n ← 2n                                      (3)
    done when the decrement gᵀH⁻¹g < tolerance, in standard deviations squared                            (4)
    C(θ − h sign(g_i) e_i) > C(θ)   although g_i says that it falls, h = 10⁻³ standard deviations          (5)

C is the Huber cost, g its gradient, H = Σ w ∂r ∂rᵀ with Huber's weights w. H lies above the cost, so that an undamped
step falls short by E ψ' / E w = 1/1.17 on normal noise, which o makes up for. A parameter whose cost rises both ways
(5) is at a kink of a delay or a dead zone. It stays there, and the others go on without it; it is asked where hardly
anything gains and (4) is not met. An entry at its bound that would leave is taken out of (1); a step that crosses
bounds is solved again with those entries on them. H of many pieces is an arrow (block_arrow.py). Sources: Marquardt
1963; Nielsen 1999 for (3); Huber 1981, 7.8 for the weights.
"""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from baqueano.identify.residuals.block_arrow import BlockArrow, Evaluation, dense, rows_times

RIDGE = 1e-11  # of the diagonal: keeps every solve away from exactly singular directions
MOST = 80  # evaluations
SHRINK = 1.0 / 9.0  # of λ, at most, after a good step
OVER = 0.17  # by which an undamped step is lengthened
DAMPING = 1e-2  # λ at the start
STALLED = 1e-2  # decrement below which a search that no longer improves counts as converged
STUCK = 1e4  # λ above which steps are so small that something is in their way
STEEP, NEAR = 1e-2, 1e-3  # standard deviations: of a slope that is asked, and the step that asks it


class Solution(NamedTuple):
    """End of a search."""

    theta: np.ndarray  # (p,)
    at: Evaluation
    converged: bool
    decrement: float  # what is left of (4)
    evaluations: int
    bound: np.ndarray  # (p,) −1 at the low bound, 1 at the high one, 0 inside


class Minimiser(Protocol):
    """A solver of one's own: the θ (p,) of least cost between `low` and `high` (p,), from `theta` (p,).

    `fixed` (p,) bool marks entries that do not move. It may stop where less than `tolerance` (4) is left to gain, or
    after `most` evaluations; `damping` says how near the start is: 1e-2 far, 1e-6 near. `solution_at` makes the answer.
    """

    def __call__(
        self, evaluate: Callable[[np.ndarray], Evaluation], theta: np.ndarray, low: np.ndarray, high: np.ndarray, *,
        fixed: np.ndarray | None, tolerance: float, most: int, damping: float,
    ) -> Solution: ...  # fmt: skip


def solution_at(
    theta: np.ndarray, at: Evaluation, low: np.ndarray, high: np.ndarray, *, converged: bool, evaluations: int
) -> Solution:
    """Return the end of a search by a solver of one's own.

    Parameters
    ----------
    theta : ndarray (p,)
        Where it ended.
    at : Evaluation
        Cost, gradient and Hessian there.
    low, high : ndarray (p,)
        Bounds.
    converged : bool
        Nothing is left to gain.
    evaluations : int
        Calls of `evaluate`.

    Returns
    -------
    Solution
        With the entries at a bound, and the decrement (4).

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
    H, g = dense(at.hessian), np.where(bound == 0, at.gradient, 0.0)
    with np.errstate(invalid="ignore"):
        decrement = float(g @ np.linalg.pinv(H, hermitian=True) @ g) if np.isfinite(H).all() else np.inf
    return Solution(theta, at, converged, decrement, evaluations, bound)


def minimise(
    evaluate: Callable[[np.ndarray], Evaluation],
    theta: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    *,
    fixed: np.ndarray | None = None,
    tolerance: float = 1e-8,
    most: int = MOST,
    damping: float = DAMPING,
    at: Evaluation | None = None,
) -> Solution:
    """The θ (p,) of least cost between `low` and `high` (p,); `fixed` (p,) marks entries that do not move;
    `at` is the evaluation at the start, where it is known already."""
    theta = _clipped(theta, low, high)
    may_move = np.ones(len(theta), bool) if fixed is None else ~fixed
    here = evaluate(theta) if at is None else at
    done, grow, idle = 1 if at is None else 0, 2.0, 0
    if not _finite(here):
        return Solution(theta, here, False, np.inf, done, _bound(theta, low, high))
    scale, kinks_tested = np.zeros(len(theta)), False
    while True:
        scale = np.maximum(scale, here.hessian.diagonal())
        movable = may_move & (scale > 0.0) & ~_leaving(theta, here.gradient, low, high)
        decrement = _decrement(here, scale, movable)
        if (idle >= 3 or damping > STUCK) and decrement >= STALLED and done < most and not kinks_tested:
            at_kinks, tried = _at_kinks(evaluate, here, theta, scale, movable)
            may_move, done, kinks_tested = may_move & ~at_kinks, done + tried, True
            if at_kinks.any():
                damping, grow, idle = DAMPING, 2.0, 0
                continue
        if decrement < tolerance or idle >= 3 or done >= most:
            converged = decrement < tolerance or (idle >= 3 and decrement < STALLED)
            return Solution(theta, here, converged, decrement, done, _bound(theta, low, high))
        over = 1.0 + OVER / (1.0 + 1e3 * damping)
        s = _bounded_step(here, scale, damping, over, movable, theta, low, high)
        trial = _clipped(theta + s, low, high)
        there = evaluate(trial)
        done += 1
        expected = -float(s @ (here.gradient + 0.5 * (here.hessian @ s)))
        gained = here.cost - there.cost
        if _finite(there) and gained > 0.0 and expected > 0.0:
            damping *= max(SHRINK, 1.0 - (2.0 * gained / expected - 1.0) ** 3)
            grow = 2.0
            idle = idle + 1 if gained < 1e-12 * here.cost else 0
            theta, here, kinks_tested = trial, there, False
        else:
            damping, grow = damping * grow, 2.0 * grow
            idle += gained == 0.0
            if damping > 1e14:
                idle = 3


def _at_kinks(
    evaluate: Callable[[np.ndarray], Evaluation],
    here: Evaluation,
    theta: np.ndarray,
    scale: np.ndarray,
    movable: np.ndarray,
) -> tuple[np.ndarray, int]:
    """Return the mask (p,) of parameters at a kink, and the number of evaluations.  (5)

    At a kink the cost rises in both directions although the gradient is not zero.
    """
    at_kink, slope = np.zeros(len(theta), bool), here.gradient / np.sqrt(np.maximum(scale, 1e-300))
    steep = np.flatnonzero(movable & (np.abs(slope) > STEEP))
    for i in steep:
        there = theta.copy()
        there[i] -= NEAR * np.sign(slope[i]) / np.sqrt(scale[i])
        at_kink[i] = evaluate(there).cost > here.cost
    return at_kink, len(steep)


def _finite(at: Evaluation) -> bool:
    """Return False where the model diverges: a robust cost may be finite where its slopes are not."""
    H = at.hessian
    return bool(np.isfinite(at.cost) and (H.finite if isinstance(H, BlockArrow) else np.isfinite(H).all()))


def _clipped(theta: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    return np.minimum(np.maximum(theta, low), high)


def _leaving(theta: np.ndarray, gradient: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Entries (p,) on a bound that would cross it."""
    return ((theta <= low) & (gradient >= 0.0)) | ((theta >= high) & (gradient <= 0.0))


def _decrement(here: Evaluation, scale: np.ndarray, movable: np.ndarray) -> float:
    """gᵀH⁻¹g over the entries that may move.  (4)"""
    index = np.flatnonzero(movable)
    if not len(index):
        return 0.0
    g = here.gradient[index]
    return float(abs(g @ _solved(here.hessian, RIDGE, scale, index, g)))


def _solved(
    hessian: np.ndarray | BlockArrow, damping: float, scale: np.ndarray, index: np.ndarray, g: np.ndarray
) -> np.ndarray:
    """(H + λ D)⁻¹ g over the entries `index` (k,), solved in units in which D is 1; λ is at least RIDGE."""
    damping = max(damping, RIDGE)
    if isinstance(hessian, BlockArrow):
        free, whole = np.zeros(len(scale), bool), np.zeros(len(scale))
        free[index], whole[index] = True, g
        return hessian.solved(damping, scale, free, whole)[index]
    root = 1.0 / np.sqrt(scale[index])
    part = hessian if len(index) == len(hessian) else hessian[np.ix_(index, index)]
    A = part * (root[:, None] * root)
    A.reshape(-1)[:: len(A) + 1] += damping
    return root * np.linalg.solve(A, root * g)


def _bounded_step(
    here: Evaluation,
    scale: np.ndarray,
    damping: float,
    over: float,
    movable: np.ndarray,
    theta: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray:
    """s (p,) of (1) that stays between the bounds."""
    s = np.zeros(len(theta))
    free = movable.copy()
    for _ in range(len(theta)):
        index = np.flatnonzero(free)
        if not len(index):
            break
        g = over * here.gradient[index]
        if len(index) < len(theta):
            g += rows_times(here.hessian, index, np.where(free, 0.0, s))
        s[index] = -_solved(here.hessian, damping, scale, index, g)
        crossing = free & ((theta + s < low) | (theta + s > high))
        if not crossing.any():
            break
        s[crossing] = (_clipped(theta + s, low, high) - theta)[crossing]
        free &= ~crossing
    return s


def _bound(theta: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(p,) −1, 0 or 1."""
    return np.where(theta <= low, -1, np.where(theta >= high, 1, 0))
