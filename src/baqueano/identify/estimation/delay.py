"""Search for the parameters of least cost if the delay of the command is free.

    d_0 = arg min over a grid of GRID_STEP_S of min C(θ; d),  σ from the start                                  (1)
    d_1 = arg min over a grid of FINE_TICKS about d_0 of min C(θ; d),  σ from d_0                          (2)
    d_2 = arg min C(θ, d)  within a step of d_1, on this side of a whole tick and on the other             (3)
    d   = arg min C(θ, d),  k δ < d < (k + 1) δ;  k ← k ± 1 while d ends at that side                      (4)
    C(θ; u) − C(θ; round(steps · u) / steps) > MIN_COST_GAIN    at the θ that was fitted without steps             (5)

Without a lag of the motors the cost jumps at delays of whole ticks δ. With a lag, commands in even steps leave
valleys on both sides of the deepest. If (4) returns to a whole tick from both sides, the least cost is at the tick.
The search has then converged although the derivative is not 0. The grid (1) is half a period of 20 Hz, the fastest
command that a small vehicle follows. If a tick is much shorter, the interval about d_0 is halved until MAX_FINE_TICKS
ticks remain for (2). A timer of 8 bits rounds a duty to 1/255. With a dead zone this exceeds the noise of a gyro, and
(5) finds the steps.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.identify.covariance.information import information
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.estimation.search import ROUGH_DECREMENT, Search, Task, best_search, search
from baqueano.identify.parameters.free import DELAY_PATH
from baqueano.identify.residuals.simulation import Residuals
from baqueano.numerics.least_squares import Solution
from baqueano.vehicles.drivetrain import mix, quantise

GRID_STEP_S = 0.025
COST_TOLERANCE = 1e-2  # share of the least cost: tolerance of the searches at other delays of the grid (1)
FINE_TICKS = 0.25  # part of a tick: the deepest valley is wider on both sides, for a dead zone of any size
MAX_FINE_TICKS = 6  # ticks that (2) searches
MAX_EVALUATIONS = 8  # evaluations at one delay: the next delay begins where they end
EDGE_TICKS = 1e-6  # fraction of a tick: least distance from a whole tick, where the derivative is one-sided
MAX_STEPS = 6  # largest number of ticks by which (4) moves
JUMP_LOG_SIGMA = 1e-2  # a smaller difference of Σ counts log σ at a whole tick is a kink, not a jump
DUTY_STEP_PATH = "model.drivetrain.duty_step"
TIMERS = (255, 100, 1023)  # 8 bits, per cent, 10 bits
MIN_COST_GAIN = 25.0
MAX_UPDATES = 8  # updates of residuals that depend on the fit, at most
SETTLED_SIGMA = 0.1  # standard deviations: a smaller move of all parameters together ends the search


def complete_search(task: Task, begin: np.ndarray) -> tuple[Task, Search]:
    """Return the task and the search of `search_with_free_delay`. Residuals that depend on the fit are updated, and
    searched again, until θ is constant. Each update changes the best delay, so the delay is searched again, too."""
    bounded_task, end = search_with_free_delay(task, begin)
    for _ in range(MAX_UPDATES if task.problem.depends_on_fit else 0):
        end = _search_updated(bounded_task, end)
        task, bounded_task = (part._replace(problem=end.problem) for part in (task, bounded_task))
        if end.stopped or DELAY_PATH not in task.problem.shape.shared_paths:
            break
        previous = end
        bounded_task, end = search_with_free_delay(task, previous.solution.theta)
        end = end._replace(evaluations=previous.evaluations + end.evaluations)
        if _is_settled(previous, end):
            break
    return bounded_task, end


def _search_updated(task: Task, end: Search) -> Search:
    """Update the residuals and repeat the search at this delay until θ is constant."""
    for _ in range(MAX_UPDATES):
        previous, problem = end, end.problem.at_estimate(end.solution.theta)
        end = search(task._replace(problem=problem), previous.solution.theta, None, previous)
        end = end._replace(evaluations=previous.evaluations + end.evaluations)
        if end.stopped or _is_settled(previous, end):
            break
    return end


def _is_settled(previous: Search, end: Search) -> bool:
    """Return True if a search changed all parameters together by less than SETTLED_SIGMA standard deviations."""
    step = end.solution.theta - previous.solution.theta
    return float(step @ information(end.problem, end.solution.theta).bread @ step) < SETTLED_SIGMA**2


def search_with_free_delay(task: Task, begin: np.ndarray) -> tuple[Task, Search]:
    """Return the best search, and the task whose bounds contain one tick of delay, or `task` if it is not free."""
    shared_names, counts = task.problem.shape.shared_paths, []
    if DELAY_PATH not in shared_names:
        return task, best_search(task, begin)

    def count_evaluations(*arguments: Tree, **options: Tree) -> Solution:
        solution = task.minimise(*arguments, **options)
        counts.append(solution.evaluations)
        return solution

    i, counting_task = shared_names.index(DELAY_PATH), task._replace(minimise=count_evaluations)
    tick_s = float(np.median(np.concatenate([record.dt_s for record in task.problem.records])))
    # if the first search is not sound, the second one also uses other starts
    for first in (partial(search, rough=True), best_search):
        end = _search_delay_grid(counting_task, begin, i, max(GRID_STEP_S, tick_s), first)
        end = _refine(counting_task, end, i, max(GRID_STEP_S, tick_s), tick_s)
        bounded_task, end = _walk_ticks(counting_task, end, i, tick_s)
        if end.stopped or end.is_sound(task.problem.signal_std()):
            break
    return bounded_task._replace(minimise=task.minimise), end._replace(evaluations=sum(counts))


def with_bound_flags(task: Task, end: Search) -> Search:
    """Return `end` with its `bound` from the bounds of `task`: a delay at the edge of a tick is not marked."""
    theta, tolerance = end.solution.theta, 1e-3 * (task.high - task.low)
    tolerance = np.where(np.isfinite(tolerance), np.minimum(tolerance, 1e-6), 0.0)
    bound = np.where(theta <= task.low + tolerance, -1, np.where(theta >= task.high - tolerance, 1, 0))
    return end._replace(solution=end.solution._replace(bound=bound))


def _search_delay_grid(
    task: Task, begin: np.ndarray, i: int, step_s: float, search_first: Callable[..., Search]
) -> Search:
    """Return the best search of the grid. Each point starts at the end of the previous one.  (1)"""
    low, high = float(task.low[i]), float(task.high[i])
    grid = np.linspace(low, high, max(2, 1 + int(np.ceil((high - low) / step_s - 1e-9))))
    first = int(np.argmin(np.abs(grid - begin[i])))
    middle = search_first(_with_bounds(task, i, grid[first], grid[first]), _with_value(begin, i, grid[first]))
    if middle.stopped:
        return middle
    best_solution, lighter_task = middle.solution, task._replace(problem=middle.problem)
    for side in (grid[first + 1 :], grid[:first][::-1]):
        best_solution = _best_delay(lighter_task, middle.solution, best_solution, i, side)
    if best_solution is middle.solution:
        return middle
    return _fixed_delay_search(
        task, middle._replace(solution=best_solution), i, float(best_solution.theta[i])
    )


def _refine(task: Task, end: Search, i: int, step_s: float, tick_s: float) -> Search:
    """Return `end` with θ at the best delay of a finer grid, one step of the first grid to both sides.  (2)"""
    best, counts = end, task.problem.counts
    while 2.0 * step_s > MAX_FINE_TICKS * tick_s and not best.stopped:
        step_s, middle = 0.5 * step_s, best
        for delay_s in middle.solution.theta[i] + np.array([-step_s, step_s]):
            if task.low[i] <= delay_s <= task.high[i]:
                end = _fixed_delay_search(task, middle, i, delay_s)
                best = min(best, end, key=lambda search: search.log_sigma_sum(counts))
    centre_s, fine_s = best.solution.theta[i], FINE_TICKS * tick_s
    task = task._replace(problem=best.problem)
    middle = solution = _delay_solution(task, best.solution.theta, i, centre_s)
    if best.stopped:
        return best._replace(solution=middle)
    for side in (fine_s, -fine_s):
        delays_s = centre_s + np.arange(1, 1 + round(step_s / fine_s)) * side
        is_inside = (task.low[i] <= delays_s) & (delays_s <= task.high[i])
        solution = _best_delay(task, middle, solution, i, delays_s[is_inside])
    return best._replace(solution=_search_both_sides(task, solution, i, fine_s, tick_s))


def _best_delay(task: Task, begin: Solution, best: Solution, i: int, delays_s: np.ndarray) -> Solution:
    """Return `best`, or a solution at one of the `delays_s` that is expected to cost less. The search at each delay
    starts at the end of the previous one, the first at `begin`; costs are those at the ends of their parabolas."""
    last = begin
    for delay_s in delays_s:
        last = _delay_solution(task, last.theta, i, delay_s, COST_TOLERANCE * best.evaluation.cost)
        best = min(best, last, key=lambda end: end.evaluation.cost - 0.5 * end.decrement)
    return best


def _search_both_sides(task: Task, nearest: Solution, i: int, fine_s: float, tick_s: float) -> Solution:
    """Return the solution with the least cost in the one or two ticks within `fine_s` of `nearest`.  (3)"""
    best_solution = nearest
    for side in (-fine_s, fine_s):
        begin = float(nearest.theta[i]) + 0.5 * side
        k = int(np.floor(begin / tick_s))
        low, high = sorted((float(nearest.theta[i]), float(nearest.theta[i]) + side))
        bounded_task = _with_bounds(
            task, i, max(low, (k + EDGE_TICKS) * tick_s), min(high, (k + 1 - EDGE_TICKS) * tick_s)
        )
        if bounded_task.low[i] < bounded_task.high[i]:
            end = _fit(bounded_task, _with_value(nearest.theta, i, begin), None)
            best_solution = end if end.evaluation.cost < best_solution.evaluation.cost else best_solution
    return best_solution


def _delay_solution(
    task: Task, theta: np.ndarray, i: int, delay_s: float, tolerance: float = ROUGH_DECREMENT
) -> Solution:
    """Return the solution of least cost at this delay, with the present σ, up to `tolerance` of the decrement."""
    return _fit(task, _with_value(theta, i, delay_s), np.arange(len(theta)) == i, tolerance)


def _fit(
    task: Task, theta: np.ndarray, is_fixed: np.ndarray | None, min_tolerance: float = ROUGH_DECREMENT
) -> Solution:
    return task.minimise(
        task.problem.evaluate, theta, task.low, task.high,
        is_fixed=is_fixed, tolerance=max(min_tolerance, ROUGH_DECREMENT), max_evaluations=MAX_EVALUATIONS, damping=1e-6,
    )  # fmt: skip


def _fixed_delay_search(task: Task, nearest: Search, i: int, delay_s: float) -> Search:
    """Return the search with this fixed delay, started at the end of `nearest`."""
    is_fixed = np.arange(len(task.start)) == i
    return search(task, _with_value(nearest.solution.theta, i, delay_s), is_fixed, nearest, rough=True)


def _walk_ticks(task: Task, nearest: Search, i: int, tick_s: float) -> tuple[Task, Search]:
    """Return the task and the search of the tick with the least cost, at most MAX_STEPS ticks away. The cost can jump
    at a whole tick. At a kink without a jump, select the side with the larger standard error of the delay. (4)"""
    k, visits = int(nearest.solution.theta[i] / tick_s), {}
    while True:
        bounded_task = _with_bounds(task, i, (k + EDGE_TICKS) * tick_s, (k + 1 - EDGE_TICKS) * tick_s)
        begin = np.clip(nearest.solution.theta, bounded_task.low, bounded_task.high)
        nearest = search(bounded_task, begin, None, nearest)
        visits[k] = bounded_task, nearest
        k += int(nearest.solution.bound[i])
        is_inside = task.low[i] < (k + 0.5) * tick_s < task.high[i]
        if nearest.stopped or k in visits or not is_inside or len(visits) > MAX_STEPS:
            break
    sums = {k: end.log_sigma_sum(task.problem.counts) for k, (_, end) in visits.items()}
    equal = [visits[k] for k in sums if sums[k] <= min(sums.values()) + JUMP_LOG_SIGMA]
    return (bounded_task, nearest) if nearest.stopped else max(equal, key=lambda e: _delay_variance(e[1], i))


def _delay_variance(end: Search, i: int) -> float:
    """Return the variance of entry i of θ if all others are known, or infinity without information."""
    info = information(end.problem, end.solution.theta)
    bread = float(info.bread[i, i])
    return float(info.meat[i, i]) / bread**2 if bread > 0.0 else np.inf


def _with_bounds(task: Task, i: int, low: float, high: float) -> Task:
    bounds = np.array([task.low, task.high])
    bounds[:, i] = np.clip([low, high], *bounds[:, i])
    return task._replace(low=bounds[0], high=bounds[1])


def _with_value(theta: np.ndarray, i: int, value: float) -> np.ndarray:
    changed_theta = theta.copy()
    changed_theta[i] = value
    return changed_theta


def duty_step_count(blocks: FittedBlocks, problem: Residuals, theta: np.ndarray) -> int | None:
    """Return the number of steps to which a timer rounds the duties, or None if no steps are visible. (5) Also return
    None if the file contains the steps, or if the commands are not the duties of two wheels."""
    drivetrain: Tree = getattr(blocks.model, "drivetrain", None)
    n = blocks.model.commands
    if getattr(drivetrain, "mixing", "none") != "two_wheels" or drivetrain.duty_step > 0.0:
        return None
    if max(float(np.max(np.abs(u[:, 0]) + np.abs(u[:, 2]))) for u in (r.u for r in problem.records)) > 2.0:
        return None  # these are not duties

    def on_timer(steps: int, rows: np.ndarray) -> np.ndarray:
        left_duty, right = quantise(mix("two_wheels", rows[:, 1 : 1 + n].T), 1.0 / steps)
        u = np.stack([0.5 * (left_duty + right), rows[:, 2], 0.5 * (right - left_duty)], axis=1)
        return np.concatenate([rows[:, :1], u, rows[:, 1 + n :]], axis=1)

    unrounded_cost = problem.cost(theta, lambda rows: rows)
    gains = {
        steps: unrounded_cost - problem.cost(theta, lambda rows, k=steps: on_timer(k, rows))
        for steps in TIMERS
    }
    best_steps = max(gains, key=lambda steps: gains[steps])
    return best_steps if gains[best_steps] > MIN_COST_GAIN else None
