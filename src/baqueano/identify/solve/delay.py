"""The search where the delay of the command is free.

A held command that comes d late is felt as a mean over two ticks (vehicles/delay.py), exact and linear in d
between whole ticks: there the cost has kinks, and far from the truth it has valleys that are not the deepest.

    d_0 = arg min over a grid of SCAN_S of min C(θ; d)                                                     (1)
    d   = arg min C(θ, d),  k δ < d < (k + 1) δ;  k ← k ± 1 while d ends at that side                      (2)

Within a tick δ the cost is smooth. Where (2) comes back to a whole tick from both sides, the least cost is at
the kink itself, and the search has converged although its slope is not 0. The grid is that of half a period of
the fastest command that a small vehicle follows, 20 Hz.
"""

from collections.abc import Callable

import numpy as np

from baqueano.identify.answer.intervals import information
from baqueano.identify.solve.parameters import DELAY
from baqueano.identify.solve.search import Search, Task, best_search, search

SCAN_S = 0.025
INSIDE = 1e-6  # of a tick, from whole ones: where the slope is one-sided
STEPS = 6  # ticks that (2) may walk


def best_search_of_all(task: Task, begin: np.ndarray) -> tuple[Task, Search]:
    """The best search from `begin` (p,), and the task in whose bounds it is smooth: `task` itself where no delay
    is free."""
    shared = task.problem.shape.shared
    if DELAY not in shared:
        return task, best_search(task, begin)
    i = shared.index(DELAY)
    tick_s = float(np.median(np.concatenate([record.dt_s for record in task.problem.records])))
    signal, count = task.problem.signal(), 0
    for first in (
        search,
        best_search,
    ):  # the second begins again from other ends, where the first leaves doubts
        found, evaluations = _scanned(task, begin, i, max(SCAN_S, tick_s), first)
        near = _bounded(task, i, found.solution.theta[i] - SCAN_S, found.solution.theta[i] + SCAN_S)
        found = search(near, found.solution.theta, None, found)
        within, found, more = _walked(task, found, i, tick_s)
        count += evaluations + more
        if found.stopped or found.sound(signal):
            break
    return within, found._replace(evaluations=count)


def bounds_of(task: Task, found: Search) -> Search:
    """`found` with those at their bounds in the eyes of `task`, not of a tick."""
    theta, near = found.solution.theta, 1e-3 * (task.high - task.low)
    near = np.where(np.isfinite(near), np.minimum(near, 1e-6), 0.0)
    bound = np.where(theta <= task.low + near, -1, np.where(theta >= task.high - near, 1, 0))
    return found._replace(solution=found.solution._replace(bound=bound))


def _scanned(
    task: Task, begin: np.ndarray, i: int, step_s: float, search_first: Callable[..., Search]
) -> tuple[Search, int]:
    """The best of the grid, each point begun where the one before ended.  (1)"""
    low, high = float(task.low[i]), float(task.high[i])
    grid = np.linspace(low, high, max(2, 1 + int(np.ceil((high - low) / step_s - 1e-9))))
    first = int(np.argmin(np.abs(grid - begin[i])))
    counts = np.sum([has.sum(axis=0) for has in task.problem.has], axis=0)
    held = np.arange(len(begin)) == i
    best = middle = search_first(_bounded(task, i, grid[first], grid[first]), _put(begin, i, grid[first]))
    total = best.evaluations
    for side in (grid[first + 1 :], grid[:first][::-1]):
        last = middle
        for delay_s in side if not last.stopped else ():
            last = search(task, _put(last.solution.theta, i, delay_s), held, last, rough=True)
            total += last.evaluations
            best = last if last.badness(counts) < best.badness(counts) else best
    return best, total


def _walked(task: Task, found: Search, i: int, tick_s: float) -> tuple[Task, Search, int]:
    """Tick by tick to the one that holds the least cost; at a kink, of the side with the larger error.  (2)"""
    k, total, been = int(found.solution.theta[i] / tick_s), found.evaluations, {}
    while True:
        low, high = max((k + INSIDE) * tick_s, task.low[i]), min((k + 1 - INSIDE) * tick_s, task.high[i])
        inside = _bounded(task, i, low, high)
        found = search(inside, np.clip(found.solution.theta, inside.low, inside.high), None, found)
        total += found.evaluations
        been[k] = inside, found
        side = int(found.solution.bound[i])
        ahead = (k + side + 0.5) * tick_s
        if found.stopped or side == 0 or not task.low[i] < ahead < task.high[i] or len(been) > STEPS:
            return inside, found, total
        if k + side in been:
            ends = been[k], been[k + side]
            return *max(ends, key=lambda end: _width(task, end[1], i)), total
        k += side


def _width(task: Task, found: Search, i: int) -> float:
    """The variance of entry i, all others known."""
    task.problem.weigh(found.sigma, found.profile)
    info = information(task.problem, found.solution.theta)
    return float(info.meat[i, i] / max(info.bread[i, i], 1e-300) ** 2)


def _bounded(task: Task, i: int, low: float, high: float) -> Task:
    bounds = np.array([task.low, task.high])
    bounds[:, i] = np.clip([low, high], *bounds[:, i])
    return task._replace(low=bounds[0], high=bounds[1])


def _put(theta: np.ndarray, i: int, value: float) -> np.ndarray:
    out = theta.copy()
    out[i] = value
    return out
