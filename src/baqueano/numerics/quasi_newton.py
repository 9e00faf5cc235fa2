"""Minimise a function within bounds, by a quasi-Newton method, with its gradient or by differences.

    B d = −g,    x⁺ = x + t d,    B⁺ = τ (B − B s sᵀ B / sᵀ B s) + y yᵀ / sᵀ y                             (1)
    s = x⁺ − x,    y = g⁺ − g,    τ = min(1, sᵀ y / sᵀ B s)

(1) is the update of Broyden, Fletcher, Goldfarb and Shanno, scaled as by Al-Baali (1998). A coordinate at its bound
does not move if the gradient presses it there; all others are clipped (Bertsekas 1982). The value never increases. The
L-BFGS-B of SciPy needs as many evaluations, but its linear algebra keeps all threads busy even for a few coordinates.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

FIRST_STEP, MAX_STEP = 0.1, 0.3  # largest moves of a coordinate in the cube, before and after B is known
MIN_SHARE, MAX_SHARE = 1e-4, 0.9  # shares of the first slope: least mean descent, largest slope at the end
EXTENSION, MAX_EXTENSION = 4.0, 64.0  # lengthening of a step after which the function still descends steeply
MIN_STEP = 1e-8  # t below which the line search gives up
MIN_FORECAST = 1e-10  # decrease that (1) predicts, relative to the value, below which the search ends
MIN_SLOPE = 1e-8  # relative to the first value
MIN_COSINE = 1e-10  # between s and y, for an update
COARSE_STEPS = (2.0, 1.0)  # of the search before a descent by differences, for entries that are logarithms
DIFFERENCE = 1e-6  # of an entry, for its slope
MAX_POINTS = 60  # of a descent by differences
MIN_DECREASE = 1e-2  # of the cost by the last two of these points, below which the descent ends


class Point(NamedTuple):
    """A point with the value of the function and its gradient."""

    x: np.ndarray  # (p,)
    value: float
    gradient: np.ndarray  # (p,)

    def movable(self) -> np.ndarray:
        """Return True for each coordinate that no bound blocks."""
        return ~(((self.x <= 0.0) & (self.gradient > 0.0)) | ((self.x >= 1.0) & (self.gradient < 0.0)))

    def largest_slope(self) -> float:
        """Return the largest component of the gradient that no bound blocks."""
        return float(np.max(np.abs(self.gradient) * self.movable()))


def minimise(
    f: Callable[[np.ndarray], tuple[float, np.ndarray]],
    x: np.ndarray,
    max_evaluations: int,
    is_end: Callable[[np.ndarray], bool],
) -> Point:
    """Return the end of the descent of f(x) → (value, gradient) from x (p,) in the unit cube.

    `is_end` receives each new point and returns True to stop.
    """
    count = 0

    def evaluate(x: np.ndarray) -> Point | None:
        nonlocal count
        count += 1
        return Point(x, *f(x)) if count <= max_evaluations else None

    point = Point(x, *f(x))
    count, updates, curvature = 1, 0, None  # B
    min_slope = MIN_SLOPE * abs(point.value)
    while count < max_evaluations and point.largest_slope() > min_slope:
        step = _step(point, curvature)
        descent = -float(step @ point.gradient)
        is_known = updates >= np.count_nonzero(step)
        if is_known and 0.0 <= 0.5 * descent <= MIN_FORECAST * abs(point.value):
            break
        limit = MAX_STEP if updates else FIRST_STEP
        step *= min(1.0, limit / np.max(np.abs(step)))
        end = _line_search(evaluate, point, step) if descent > 0.0 else None
        if end is None:
            if curvature is None:
                break
            updates, curvature = 0, None
            continue
        s, y = end.x - point.x, end.gradient - point.gradient
        product = float(s @ y)
        if product > MIN_COSINE * np.sqrt((s @ s) * (y @ y)):
            curvature = _updated_curvature(curvature, s, y, product)
            updates += 1
        point = end
        if is_end(point.x):
            break
    return point


def minimise_logarithms(
    cost: Callable[[np.ndarray], float], q: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Return a minimum q (n,) of the cost between `low` and `high` (n,), from a start q, without the gradient.

    Steps of COARSE_STEPS along one entry leave a flat region. Then a descent follows narrow valleys.

    >>> valley = lambda q: 1e3 * (q[0] + q[1]) ** 2 + (q[0] - 3.0) ** 2
    >>> minimise_logarithms(valley, np.zeros(2), np.full(2, -5.0), np.full(2, 5.0)).round(2)
    array([ 3., -3.])
    """
    best, min_cost = q, cost(q)
    for step in COARSE_STEPS:
        is_improved = True
        while is_improved:
            is_improved = False
            for direction in np.vstack([np.eye(len(q)), -np.eye(len(q))]):
                trial = np.clip(best + step * direction, low, high)
                trial_cost = cost(trial) if np.any(trial != best) else np.inf
                if trial_cost < min_cost - MIN_DECREASE:
                    best, min_cost, is_improved = trial, trial_cost, True
    size, costs, ends = high - low, [], [np.inf, np.inf]

    def value_and_slope(x: np.ndarray) -> tuple[float, np.ndarray]:
        q = low + x * size
        costs.append(cost(q))
        steps = np.where(q + DIFFERENCE > high, -DIFFERENCE, DIFFERENCE)
        changes = [cost(q + step) - costs[-1] for step in np.diag(steps)]
        slope = np.array(changes) / steps * size
        return costs[-1], slope if np.isfinite(slope).all() else np.zeros(len(q))

    def is_end(x: np.ndarray) -> bool:
        ends.append(min(costs))
        return bool(ends[-3] - ends[-1] < MIN_DECREASE)

    end = minimise(value_and_slope, (best - low) / size, MAX_POINTS, is_end)
    return low + end.x * size if end.value < min_cost else best


def _step(point: Point, curvature: np.ndarray | None) -> np.ndarray:
    """Return d; along the gradient if B is None.  (1)"""
    free, step = point.movable(), np.zeros(len(point.x))
    if curvature is None:
        step[free] = -point.gradient[free] * (FIRST_STEP / point.largest_slope())
    else:
        step[free] = -np.linalg.solve(curvature[np.ix_(free, free)], point.gradient[free])
    return step


def _line_search(
    evaluate: Callable[[np.ndarray], Point | None], start: Point, step: np.ndarray
) -> Point | None:
    """Return a point with a sufficient decrease along the step, or None."""
    t, best, is_shortened = 1.0, None, False
    first_slope = float(step @ start.gradient)
    while MIN_STEP <= t <= MAX_EXTENSION:
        x = start.x + t * step
        is_inside = x.min() >= 0.0 and x.max() <= 1.0
        x = x if is_inside else np.clip(x, 0.0, 1.0)
        change = float(start.gradient @ (x - start.x))
        end = evaluate(x) if change < 0.0 else None
        if end is None:
            return best
        if end.value <= (start.value + MIN_SHARE * change if best is None else best.value):
            best = end
            is_steep = float(step @ end.gradient) < MAX_SHARE * first_slope
            if is_shortened or not is_inside or not is_steep:
                return best
            t *= EXTENSION
        elif best is not None:
            return best
        else:
            excess = end.value - start.value - change  # of the value over its tangent
            t *= min(max(-0.5 * change / excess, 0.1), 0.5)
            is_shortened = True
    return best


def _updated_curvature(
    curvature: np.ndarray | None, s: np.ndarray, y: np.ndarray, product: float
) -> np.ndarray:
    """Return B⁺; without B, from a multiple of the unit matrix.  (1)"""
    if curvature is None:
        curvature = np.eye(len(s)) * (y @ y / product)
    forecast = curvature @ s
    size = float(s @ forecast)
    scale = min(1.0, product / size)
    return scale * (curvature - np.outer(forecast, forecast) / size) + np.outer(y, y) / product
