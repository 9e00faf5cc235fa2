"""Tune gains: minimise the paper's cost plus a weight on jerks (cost.py), with exact gradients of the compiled loop.

The vehicle starts at rest, `offset_m` behind and beside its route, and the reference begins and ends at full speed. So
the feedback has an effect: on its route, a vehicle with an exact model does not need feedback. jerk_m2 = 0 and
offset_m = 0 select the cost of the paper, whose gains switch the command from limit to limit.

By default the pose in the loop is exact, as in the paper ("η_e is obtained by simulating the system"). With
`estimator=True` the estimator of the file is in the loop, and the sensors have noise; the cost still uses the true
pose. Converters work without steps, because the slope of a staircase is 0. Gains for one exact model are too high for a
real vehicle. With `draws` the cost is about the largest cost of vehicles drawn from the covariance of the fit
(objective.py). That search also starts from the nominal gains, and both results are tested on other vehicles.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from baqueano.contracts.blocks import Guide
from baqueano.contracts.calls import checked_call
from baqueano.errors import UsageError
from baqueano.guides.route import Route
from baqueano.tune.margins import has_stable_loop
from baqueano.tune.objective import Objective, draw_vehicles, tuning_objective
from baqueano.tune.search import DIVERGED_COST, START_COUNT, TIE_WEIGHT, Descent, at_limit, descend, search
from baqueano.tune.tune_result import FACTORS, FreshSeeds, Gain, TuneResult, WorstCase

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

VALIDATION_VEHICLES = 200  # vehicles for the test of the result; the search did not use them
VALIDATION_SEEDS = 30  # seeds for the test of the result; the search did not use them
SEED_OFFSET = 1000  # offset between the seeds of the search and those of the test
MAX_WIDENED_SEARCHES = 3  # largest number of repeated searches with wider bounds


@checked_call("bq.tune(robot, route)", tuning_objective)
def tune(
    vehicle_file: "VehicleFile",
    route: Route | Guide | Sequence[Route | Guide],
    *,
    starts: int = START_COUNT,
    polish: bool = True,
    **options: Any,
) -> TuneResult:
    """Return the gains of a controller with which the vehicle follows its routes with the least cost.

    Parameters
    ----------
    vehicle_file : VehicleFile
        The identified vehicle and its controller.
    route : Route or guide, or sequence of them
        The routes to follow; the cost is the mean over them.
    starts : int
        Largest number of descents, at least 1, in addition to one descent from the gains of the file.
    polish : bool
        Continue the search without gradients if the cost is rough; this takes up to ten times as long.
    controller : str, type or block, optional
        A controller instead of the file's, as in `repeat`.
    gains : sequence of str, optional
        Names of the tuned parameters; by default all.
    bounds : dict, optional
        Name → smallest and largest value [unit of the gain].
    laps, duration_s : int, float
        Laps of each route, or the duration of the drive [s].
    radian_m, huber_m : float
        Weight of a radian [m/rad]; distance [m] from which on the cost of an error is linear.
    jerk_m2, effort_m2 : float
        Weight of a change of the command by its limit within a tick, and of a tick at the limit [m²].
    offset_m : float
        Distance of the vehicle's start behind and to the left of the route's start [m].
    estimator, seeds, seed : bool, int, int
        True: with the estimator in the loop, and with the noise of `seeds` seeds from `seed` on.
    draws : int
        Number of vehicles that are drawn from the covariance of the fit.
    backend : str
        "auto", "c", "python" or "numpy".

    Returns
    -------
    TuneResult
        The gains; `.updated_file()` returns the vehicle file with them, `.controller` is the block.

    Raises
    ------
    UsageError
        For a gain that the controller lacks, wrong bounds, starts below 1, or a vehicle that diverges with all gains.

    References
    ----------
    Grotz et al., `equ:controller_cost_function`, with a weight on jerks and a start beside the route. jerk_m2=0 and
    offset_m=0 select the cost of the paper.

    Examples
    --------
    >>> from baqueano.guides.shapes import circle
    >>> from baqueano.vehicle_file import load
    >>> result = tune(load("small"), circle(0.3, 0.2), gains=["k_chi"], starts=1, polish=False, duration_s=2.0)
    >>> result.cost < result.cost_before, result.gains[0].unit
    (True, '1/s')
    """
    if starts < 1:
        raise UsageError.of("tune.starts", starts=starts)
    rehearsal = tuning_objective(vehicle_file, route, **options)
    file_gains = rehearsal.space.file_gains
    initial_gains = [file_gains] if np.all(np.isfinite(file_gains)) else []
    nominal, descents = search_gains(rehearsal.nominal(), initial_gains, starts, polish)
    if descents[0].cost >= DIVERGED_COST:
        raise UsageError.of("tune.all-run-away", vehicle=vehicle_file.name)
    worst_cost = None
    if len(rehearsal.vehicles) > 1:
        seed, nominal_gains = options.get("seed", 0), descents[0].gains
        rehearsal = replace(rehearsal, space=nominal.space, cases=nominal.cases)
        rehearsal, robust = search_gains(rehearsal, [nominal_gains, *initial_gains], 1, polish=False)
        worst_cost, descents = rank_by_worst_case(vehicle_file, rehearsal, robust, nominal_gains, seed)
    else:
        rehearsal = nominal
    descents = _stable_first(vehicle_file, rehearsal, descents)
    fresh_seeds = None
    if options.get("estimator"):
        fresh_seeds = _fresh_seed_cost(rehearsal, descents[0].gains, options.get("seed", 0))
    return _tune_result(
        vehicle_file, rehearsal, descents, initial_gains, worst_cost, fresh_seeds, options.get("controller")
    )


def search_gains(
    rehearsal: Objective, initial: list[np.ndarray], start_count: int, polish: bool
) -> tuple[Objective, list[Descent]]:
    """Return the rehearsal with the final bounds, and the descents, the least cost first.

    If a gain ends on a bound, a descent that ends inside at nearly the same cost is preferred. Otherwise the
    search is repeated near the first of the `initial` gains (search.py, equation 2). If that also ends on a bound, and
    the bound is soft, the search continues with a wider bound.
    """
    descents: list[Descent] = []
    preferred_gains = initial[0] if initial else rehearsal.space.middle
    for _ in range(1 + MAX_WIDENED_SEARCHES):
        space = rehearsal.space
        descents += search(
            rehearsal.cost, rehearsal.cost_and_gradient, space.low, space.high, initial, start_count, polish
        )
        descents.sort(key=lambda d: d.cost)
        best_gains = descents[0].gains
        ends = at_limit(best_gains, space.low, space.high)
        if np.any(ends) and (interior := _bounded_descent(rehearsal, descents, preferred_gains)):
            return rehearsal, [interior, *(end for end in descents if end is not interior)]
        wider_space = space.widen(ends)
        if np.array_equal(wider_space.low, space.low) and np.array_equal(wider_space.high, space.high):
            break
        rehearsal, initial, start_count = replace(rehearsal, space=wider_space), [best_gains], 0
    return rehearsal, descents


def _bounded_descent(
    rehearsal: Objective, descents: list[Descent], preferred_x: np.ndarray
) -> Descent | None:
    """Return a descent to gains within their bounds, if it costs nearly the same as the best end; else None.

    Other descents are made only if none of `descents` ends there. Where the cost is rough, all of them stay at a bound.
    Then a second descent starts at the preferred values of these gains, if their cost is nearly the same.
    """
    low, high, best = rehearsal.space.low, rehearsal.space.high, descents[0]
    max_cost = (1.0 + TIE_WEIGHT * len(preferred_x)) * best.cost

    def is_inside(end: Descent) -> bool:
        return end.cost <= max_cost and not np.any(at_limit(end.gains, low, high))

    is_at_limit = at_limit(best.gains, low, high) != 0
    if interior := next(filter(is_inside, descents), None):
        return interior
    others: list[Descent] = []
    for start in (best.gains, np.where(is_at_limit, np.clip(preferred_x, low, high), best.gains)):
        if others and rehearsal.cost(start) > max_cost:
            break
        best_end = others[0] if others else None
        others.append(descend(rehearsal.cost_and_gradient, start, low, high, preferred_x, best_end))
        if is_inside(others[-1]):
            return others[-1]
    return None


def _stable_first(
    vehicle_file: "VehicleFile", rehearsal: Objective, descents: list[Descent]
) -> list[Descent]:
    """Return the descents, with the first one whose loop is stable in front. The cost of a short route can miss a slow
    growth of errors.
    """

    def is_stable(end: Descent) -> bool:
        controller = rehearsal.space.with_gains(end.gains)
        return has_stable_loop(vehicle_file, controller, rehearsal.speed_m_s)

    best = next(filter(is_stable, descents), descents[0])
    return [best, *(end for end in descents if end is not best)]


def rank_by_worst_case(
    vehicle_file: "VehicleFile",
    rehearsal: Objective,
    robust: list[Descent],
    nominal_gains: np.ndarray,
    seed: int,
) -> tuple[WorstCase, list[Descent]]:
    """Return the largest costs over other vehicles, and the descents in the order of these costs, the least first.

    `nominal_gains` are one of the candidates.
    """
    system = rehearsal.cases[0].system
    test_objective = replace(
        rehearsal, vehicles=draw_vehicles(vehicle_file, system, VALIDATION_VEHICLES, seed + SEED_OFFSET)[1]
    )
    cost = rehearsal.cost(nominal_gains)
    ends = [Descent(nominal_gains, nominal_gains, cost, np.array([cost]), 0.0), *robust]
    vehicle_costs = test_objective.vehicle_costs(np.array([end.gains for end in ends]))
    worst_cost = np.where(
        np.isfinite(vehicle_costs).all(axis=1), np.max(vehicle_costs, axis=1), DIVERGED_COST
    )
    order = np.argsort(worst_cost, kind="stable")
    draws = len(rehearsal.vehicles) - 1
    worst_case = WorstCase(draws, VALIDATION_VEHICLES, float(worst_cost[order[0]]), float(worst_cost[0]))
    return worst_case, [ends[k] for k in order]


def _fresh_seed_cost(rehearsal: Objective, gains: np.ndarray, seed: int) -> FreshSeeds:
    """Return the cost with noise of new seeds, which the search did not use, and the cost of the search."""
    test_objective = rehearsal.nominal().with_seeds(seed + SEED_OFFSET, VALIDATION_SEEDS)
    return FreshSeeds(VALIDATION_SEEDS, test_objective.cost(gains), rehearsal.nominal().cost(gains))


def _tune_result(
    vehicle_file: "VehicleFile", rehearsal: Objective, descents: list[Descent], initial: list[np.ndarray],
    worst_cost: WorstCase | None, fresh_seeds: FreshSeeds | None, controller: Any,
) -> TuneResult:  # fmt: skip
    space, best_descent = rehearsal.space, descents[0]
    ratios = _relative_costs(rehearsal, best_descent)
    limits = at_limit(best_descent.gains, space.low, space.high)
    block = space.with_gains(best_descent.gains)
    history = [(k, c) for k, descent in enumerate(descents) for c in descent.costs]
    return TuneResult(
        vehicle_file,
        tuple(_gain(rehearsal, k, best_descent, int(limits[k]), ratios) for k in range(len(space.names))),
        best_descent.cost,
        rehearsal.cost(initial[0]) if initial else float("nan"),
        rehearsal.cost(np.zeros(len(space.low))),
        rehearsal.weights,
        rehearsal.drive_errors(best_descent.gains),
        tuple(descents),
        np.array(history),
        rehearsal.loop,
        rehearsal.backend,
        block,
        controller,
        ratios,
        rehearsal.speed_m_s,
        worst_cost,
        fresh_seeds,
    )


def _relative_costs(rehearsal: Objective, best_descent: Descent) -> np.ndarray:
    """Return the cost (p, k) relative to the least cost, if one gain at a time is multiplied by each of k factors."""
    p = len(best_descent.gains)
    gains = np.tile(best_descent.gains, (p, len(FACTORS), 1))
    for k in range(p):
        gains[k, :, k] *= FACTORS
    return rehearsal.costs(gains.reshape(-1, p)).reshape(p, -1) / best_descent.cost


def _gain(rehearsal: Objective, k: int, best: Descent, limit: int, ratios: np.ndarray) -> Gain:
    """Return gain `k` with its bounds, and the relative costs if only this gain is multiplied by 0.8 or 1.25."""
    space, (low_index, high_index) = rehearsal.space, (FACTORS.index(factor) for factor in (0.8, 1.25))
    description = space.names[k], space.units[k], float(best.gains[k]), float(space.file_gains[k])
    ends = float(space.low[k]), float(space.high[k]), limit
    return Gain(*description, *ends, float(ratios[k, low_index]), float(ratios[k, high_index]))
