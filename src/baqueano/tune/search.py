"""Minimise a cost within bounds, from several starts, with exact gradients.

    g = low + (high − low) (e^{cx} − 1) / (e^c − 1),   x in [0, 1],   c = 7                           (1)

g is a gain, x its coordinate in the search. In x, small gains have the same share of the interval as large gains. The
slope of (1) at 0 is above 0, so that a gain can leave its bound. The cost is evaluated at a fixed set of points of
the unit cube (Halton 1960). A quasi-Newton method (quasi_newton.py) descends from those without a better point nearby,
the best first (Rinnooy Kan and Timmer 1987). If the gradient at the end is still large, the cost is not smooth (for
example, motors that switch direction). Then the simplex of Nelder and Mead continues from there. The search is
deterministic: the same input yields the same result.

Two gains can have the same effect, or one gain none; then a descent can end at a bound for a negligible advantage. With
`preferred_x` gains x_0, a descent stays near them, and minimises, for the cost C,

    C (1 + w |x − x_0|²),   w = 0.002                                                                 (2)
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from baqueano.errors import UsageError
from baqueano.numerics.quasi_newton import minimise

STRETCH_EXPONENT = 7.0  # c: the middle of the range is 3 % of its upper end
SAMPLED_POINTS = 48  # points of the cube that are evaluated before the descents
START_COUNT = 6
MIN_DISTANCE = 0.3  # of a start from a better point, in the coordinate that differs most
# a descent ends if PATIENCE evaluations decreased its cost by a smaller share than MIN_PROGRESS; above the cost of an
# earlier end, MIN_PROGRESS_ABOVE
PATIENCE, MIN_PROGRESS, MIN_PROGRESS_ABOVE = 5, 1e-6, 1e-4
JOIN_TOLERANCE = 1e-4  # descents with a smaller relative difference of their costs end at the same place
MAX_EVALUATIONS = 60  # of one descent
# ∂C/∂x relative to C above which the end of a descent is not a minimum of a smooth cost
MAX_RELATIVE_SLOPE = 1e-3
SIMPLEX_EVALUATIONS = 150  # evaluations of one search without gradients
SIMPLEX_SEARCHES = 3  # in a row
SIMPLEX_SIZE = 0.1  # size of the first simplex of each, in x
TIE_WEIGHT = 2e-3  # w: the share of the cost that is given up for a gain that moves across its range
PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37)
LIMIT_TOLERANCE = 1e-3  # fraction of the range in x
MAX_SLOPE = 1e12  # ∂C/∂x relative to C above which rounding decides its sign: the drive is chaotic
DIVERGED_COST = 1e30  # the cost of gains for which the simulation diverges

Cost = Callable[[np.ndarray], float]
CostAndGradient = Callable[[np.ndarray], tuple[float, np.ndarray]]


class Descent(NamedTuple):
    """A descent of the cost: its start, its end, and the costs on the path."""

    start: np.ndarray  # (p,) gains
    gains: np.ndarray  # (p,) gains at the end
    cost: float
    costs: np.ndarray  # (e,) of each evaluation, the start first
    slope: float  # gradient at the end, relative to the cost; 0 at the minimum of a smooth cost
    path: tuple[np.ndarray, ...] = ()  # gains (p,) after each step, the start first


def search(
    cost: Cost,
    cost_and_gradient: CostAndGradient,
    low: np.ndarray,
    high: np.ndarray,
    initial: Sequence[np.ndarray] = (),
    start_count: int = START_COUNT,
    polish: bool = True,
) -> list[Descent]:
    """Return the descents from each of `initial` and from at most `start_count` evaluated points, the least cost first.

    With `polish`, searches without gradients follow if the cost is rough.
    """
    minimize = _minimize()
    begin = [np.clip(g, low, high) for g in initial]
    if start_count:
        begin += _starts(cost, low, high)[:start_count]
    ends: list[Descent] = []
    for start in begin:
        best_end = min(ends, key=lambda d: d.cost, default=None)
        ends.append(descend(cost_and_gradient, start, low, high, best_end=best_end))
    ends.sort(key=lambda d: d.cost)
    if polish and ends[0].cost < DIVERGED_COST and ends[0].slope > MAX_RELATIVE_SLOPE:
        for _ in range(SIMPLEX_SEARCHES):
            first_indices = np.unique([end.gains for end in ends], axis=0, return_index=True)[1]
            for k in np.sort(first_indices)[:2]:
                ends[k] = _refine_with_simplex(minimize, cost, ends[k], low, high)
            ends.sort(key=lambda d: d.cost)
    return ends


def _starts(cost: Cost, low: np.ndarray, high: np.ndarray) -> list[np.ndarray]:
    """Return the gains of the evaluated points without a better point within MIN_DISTANCE, the best first."""
    points = halton(SAMPLED_POINTS, len(low))
    points = points[np.argsort([_finite(cost(gains(x, low, high))) for x in points], kind="stable")]
    return [
        gains(x, low, high)
        for k, x in enumerate(points)
        if np.all(np.max(np.abs(points[:k] - x), axis=1) > MIN_DISTANCE)
    ]


def descend(
    cost_and_gradient: CostAndGradient,
    start: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    preferred_x: np.ndarray | None = None,
    best_end: Descent | None = None,
) -> Descent:
    """Return the descent from the gains `start` (p,), which must be within the bounds; `preferred_x` (p,): see (2).

    The last step goes to the end of `best_end`, an earlier descent, if the value is nearly equal and the same gains
    are at bounds. The step before must be small.
    """
    costs: list[float] = []
    values: list[float] = []  # of (2)
    x0 = coordinates(start, low, high)
    weight, x_preferred = (
        (0.0, x0)
        if preferred_x is None
        else (TIE_WEIGHT, coordinates(np.clip(preferred_x, low, high), low, high))
    )

    def share_at(x: np.ndarray) -> float:  # (2)
        deviation = x - x_preferred
        return 1.0 + weight * float(deviation @ deviation)

    def f(x: np.ndarray) -> tuple[float, np.ndarray]:
        value, gradient = cost_and_gradient(gains(x, low, high))
        costs.append(_finite(value))
        values.append(DIVERGED_COST)
        if costs[-1] == DIVERGED_COST:
            return DIVERGED_COST, np.zeros(len(x))
        share = share_at(x)
        slope = share * gradient * gain_derivative(x, low, high) + 2.0 * weight * value * (x - x_preferred)
        if not np.max(np.abs(slope)) <= MAX_SLOPE * value:  # also if it is not finite
            slope = np.zeros(len(x))
        values[-1] = share * costs[-1]
        return values[-1], slope

    path, joins = [np.array(start, dtype=float)], False
    last_value, best_value, best_limits = np.inf, np.nan, np.zeros(0)
    if best_end is not None:
        best_x = coordinates(best_end.gains, low, high)
        best_value, best_limits = best_end.cost * share_at(best_x), limits(best_x)

    def is_end(x: np.ndarray) -> bool:
        nonlocal joins, last_value
        path.append(gains(x, low, high))
        value, max_change = min(values), JOIN_TOLERANCE * best_value
        is_near = best_value <= value <= best_value + max_change and last_value - value <= max_change
        joins, last_value = is_near and np.array_equal(limits(x), best_limits), value
        progress = MIN_PROGRESS_ABOVE if value > best_value else MIN_PROGRESS
        return joins or value > (1.0 - progress) * min(values[:-PATIENCE], default=np.inf)

    end = minimise(f, x0, MAX_EVALUATIONS, is_end)
    if best_end is not None and joins:
        costs_to_end = np.array([*costs, best_end.cost])
        return best_end._replace(start=start, costs=costs_to_end, path=(*path, best_end.gains))
    min_cost = end.value / share_at(end.x)
    slope = end.largest_slope() / max(abs(end.value), 1e-300)
    return Descent(start, gains(end.x, low, high), min_cost, np.array(costs), slope, tuple(path))


def _refine_with_simplex(
    minimize: Callable, cost: Cost, end: Descent, low: np.ndarray, high: np.ndarray
) -> Descent:
    """Return the descent, continued with the simplex of Nelder and Mead.

    Its end changes only if the cost decreases.
    """
    costs: list[float] = []

    def f(x: np.ndarray) -> float:
        costs.append(_finite(cost(gains(x, low, high))))
        return costs[-1]

    x0 = coordinates(end.gains, low, high)
    simplex = np.clip(
        x0 + SIMPLEX_SIZE * np.vstack([np.zeros(len(x0)), np.diag(np.where(x0 > 0.5, -1.0, 1.0))]), 0.0, 1.0
    )
    options = {
        "maxfev": SIMPLEX_EVALUATIONS,
        "initial_simplex": simplex,
        "xatol": 1e-6,
        "fatol": 1e-9 * end.cost,
    }
    optimum = minimize(f, x0, method="Nelder-Mead", bounds=[(0.0, 1.0)] * len(x0), options=options)
    all_costs = np.concatenate([end.costs, costs])
    if not optimum.fun < end.cost:
        return end._replace(costs=all_costs)
    return end._replace(gains=gains(optimum.x, low, high), cost=float(optimum.fun), costs=all_costs)


def gains(x: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the gains g (p,) of the coordinates x (p,).  (1)"""
    return low + (high - low) * np.expm1(STRETCH_EXPONENT * x) / np.expm1(STRETCH_EXPONENT)


def coordinates(g: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the coordinates x (p,) of the gains g (p,).  (1)"""
    return np.log1p((g - low) / (high - low) * np.expm1(STRETCH_EXPONENT)) / STRETCH_EXPONENT


def gain_derivative(x: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return ∂g/∂x (p,).  (1)"""
    return (high - low) * STRETCH_EXPONENT * np.exp(STRETCH_EXPONENT * x) / np.expm1(STRETCH_EXPONENT)


def at_limit(g: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return −1 for each gain of g (p,) at its lower bound, +1 for each gain at its upper bound, else 0: (p,)."""
    return limits(coordinates(np.clip(g, low, high), low, high))


def limits(x: np.ndarray) -> np.ndarray:
    """Return −1 for each coordinate of x (p,) at its lower bound, +1 for each at its upper bound, else 0: (p,)."""
    return np.where(x < LIMIT_TOLERANCE, -1, np.where(x > 1.0 - LIMIT_TOLERANCE, 1, 0))


def halton(points: int, dimensions: int) -> np.ndarray:
    """Return an array (points, dimensions) of evenly distributed points of the unit cube (Halton). Raise UsageError
    for more dimensions than PRIMES has entries.
    """
    if dimensions > len(PRIMES):
        raise UsageError.of("tune.too-many", dimensions=dimensions, maximum=len(PRIMES))
    sequence = np.zeros((points, dimensions))
    for j, base in enumerate(PRIMES[:dimensions]):
        for i in range(points):
            k, digit = i + 1, 1.0 / base
            while k:
                sequence[i, j] += digit * (k % base)
                k, digit = k // base, digit / base
    return sequence


def _finite(cost: float) -> float:
    return float(cost) if np.isfinite(cost) else DIVERGED_COST


def _minimize() -> Callable:
    try:
        from scipy.optimize import minimize
    except ImportError as error:
        raise UsageError.of("lab.scipy-for-tuning", "pip install scipy") from error
    return minimize
