"""A finished search by simulation error → the same by innovations, and which of the two to believe.

The simulation's answer is where the second search begins: it has seen what the data show, and found the noise of
the sensors. What it held stays held. Channels and verdict are still those of the simulation with the new numbers:
a prediction over one step is no evidence for a model. Only the colour of a simulation's errors, and that they are
larger than the sensors' noise, is no doubt any more where a floor that moves explains it and leaves nothing.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from baqueano.errors import UsageError
from baqueano.identify.answer.result import Fit
from baqueano.identify.answer.summary import Finished, fit_of
from baqueano.identify.answer.two_costs import Compared, Preferred, long_colour, preferred
from baqueano.identify.rows.pieces import without_starts
from baqueano.identify.solve.arrow import dense
from baqueano.identify.solve.intervals import Information, covariance_of
from baqueano.identify.solve.least_squares import Evaluation, Solution
from baqueano.identify.solve.parameters import FLOOR, described, value
from baqueano.identify.solve.prediction import Likely, Prediction, most_likely
from baqueano.symbolic import put

COSTS = ("simulation", "innovations")


class Second(NamedTuple):
    """The second search, and what it says of the first."""

    end: Finished
    likely: Likely
    preferred: Preferred
    axes: tuple[int, ...]


def checked(cost: str, clocks: Sequence[str] = ()) -> str:
    """`cost`; UsageError where it is none, or cannot be had with free clocks."""
    if cost not in COSTS:
        raise UsageError(f'cost = "{cost}": expected {" or ".join(COSTS)}.')
    if cost == "innovations" and clocks:
        raise UsageError(
            f"the clock of {', '.join(clocks)} is free, and a filter cannot wait for what a later row shows: find "
            "it first, and calibrate the run by it. Type: --cost simulation"
        )
    return cost


def fit_by_innovations(first: Finished) -> Fit:
    """The Fit by the second cost, with the floor's noise among its parameters; that of the first if somebody
    stopped it."""
    if first.found.stopped:
        return fit_of(first)
    second = by_innovations(first)
    fit, floor = fit_of(second.end), second.likely.noise.floor
    paths = [f"{FLOOR}[{axis}]" for axis in second.axes]
    free = [described(first.blocks, path, {}) for path in paths]
    std = np.sqrt(floor)
    sd = np.where(std > 0.0, second.likely.floor_sd / np.maximum(2.0 * std, 1e-300), np.nan)
    p, k = len(fit.names), len(paths)
    cov = np.zeros((p + k, p + k))  # a mean and a variance of normal noise are told apart: no cross terms
    cov[:p, :p] = fit.cov
    cov[p:, p:] = np.diag(sd**2)
    return replace(
        fit,
        names=(*fit.names, *paths),
        units=(*fit.units, *(one.unit for one in free)),
        start=np.concatenate([fit.start, [value(first.blocks, path) for path in paths]]),
        estimate=np.concatenate([fit.estimate, std]),
        sd=np.concatenate([fit.sd, sd]),
        bound=np.concatenate([fit.bound, np.where(floor > 0.0, 0, -1)]),
        weak=np.concatenate([fit.weak, np.zeros(k, bool)]),
        cov=cov,
        notes=(second.preferred.why, _sensors(second), *fit.notes),
    )


def by_innovations(first: Finished) -> Second:
    """The search by the second cost from where the first ended."""
    problem, theta = first.task.problem, first.found.solution.theta
    problem.weigh(first.found.sigma, first.found.profile)
    prediction = Prediction(problem, first.blocks)
    held = np.zeros(problem.size, bool)
    held[: len(first.sight.kept)] = ~first.sight.kept
    task = first.task
    likely = most_likely(prediction, theta, task.low, task.high, held, task.floor, task.say)
    info = _of_parameters(likely.info, first)
    found, at = likely.solution, likely.solution.at
    p = problem.size
    at = Evaluation(at.cost, at.gradient[:p], dense(at.hessian)[:p, :p])
    solution = Solution(
        likely.theta, at, found.converged, found.decrement, found.evaluations, found.bound[:p]
    )
    evaluations = first.found.evaluations + likely.evaluations
    search = first.found._replace(solution=solution, colour=likely.info.colour, evaluations=evaluations)
    std = np.zeros(3)
    std[list(prediction.axes)] = np.sqrt(likely.noise.floor)
    blocks = put(first.blocks, FLOOR, std)
    second = first._replace(blocks=blocks, found=search, info=info)
    dt_s = float(np.median(problem.records[0].dt_s))
    colours = [
        long_colour(left, problem.has, dt_s)
        for left in (problem.residuals(theta), prediction.innovations(found.theta))
    ]
    told = preferred(likely, prediction.axes, _compared(first, second), *colours)
    explained = told.cost == "innovations" and told.white
    return Second(second._replace(floor=explained), likely, told, prediction.axes)


def _of_parameters(info: Information, first: Finished) -> Information:
    """What the data say of the entries of θ that are told: the noise and the starts of pieces taken out."""
    layout, told = first.task.problem.layout, len(first.sight.kept)
    A, B = info.bread[: layout.size, : layout.size], info.meat[: layout.size, : layout.size]
    if told < layout.size:
        A, B = without_starts(A, B, layout)
    return info._replace(bread=A[:told, :told], meat=B[:told, :told], channels=info.channels[:, :told])


def _compared(first: Finished, second: Finished) -> Compared:
    """Both answers for the shared parameters."""
    names = first.task.problem.shape.shared
    inside = first.sight.kept & (first.found.solution.bound[: len(first.sight.kept)] == 0)
    kept = np.flatnonzero(inside[: len(names)])
    errors = [_errors(end, len(names)) for end in (first, second)]
    ends = [end.found.solution.theta[kept] for end in (first, second)]
    return Compared([names[k] for k in kept], ends[0], errors[0][kept], ends[1], errors[1][kept])


def _errors(end: Finished, count: int) -> np.ndarray:
    """Standard errors of the first `count` entries of θ, NaN for what was held."""
    kept, sd = np.flatnonzero(end.sight.kept), np.full(len(end.sight.kept), np.nan)
    sd[kept] = np.sqrt(np.diagonal(covariance_of(end.info, kept)))
    return sd[:count]


def _sensors(second: Second) -> str:
    """The noise of the sensors without the floor's part."""
    problem, noise = second.end.task.problem, second.likely.noise
    sigma = problem.sigma * np.exp(noise.sensors)
    ends = np.cumsum(problem.sizes)[:-1]
    said = zip(problem.names, np.split(sigma, ends), strict=True)
    return "noise of the sensors without the floor: " + "; ".join(
        f"{name} {_numbers(one)}" for name, one in said
    )


def _numbers(values: Sequence[float] | np.ndarray) -> str:
    return ", ".join(f"{x:.3g}" for x in values)
