"""Repeat a finished search with the innovations cost, and choose between the results of the two costs.

The second search starts from the result of the simulation, which has already found the identifiable parameters and
the noise of the sensors. Parameters that were fixed stay fixed. Channels and verdict still come from a simulation
with the new estimates, because a prediction over one step does not support a model. For a fit by simulation error the
second search is a test. The errors of its parameters already contain the autocorrelation of the residuals
(covariance/). Autocorrelation and size are findings, because a model that lacks an effect also causes them. They are
dropped if process noise explains them (result/objective_choice.py).
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from baqueano.contracts.optional import has_field, is_dynamic
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.identify.covariance.information import Information, parameter_cov
from baqueano.identify.estimation.prediction_error import MaximumLikelihood, Prediction, maximum_likelihood
from baqueano.identify.identifiability import FinishedFit
from baqueano.identify.parameters.free import PROCESS_NOISE_PATH, free_parameter, value
from baqueano.identify.residuals.informative_rows import sensor_sigma
from baqueano.identify.result.assemble import assemble_fit, is_only_autocorrelated, verdict_basis
from baqueano.identify.result.fit_result import Fit
from baqueano.identify.result.objective_choice import (
    LeaveOneOutComparison,
    ObjectiveChoice,
    choose_objective,
    leave_one_out,
)
from baqueano.numerics.normal_equations import Evaluation, dense, eliminate
from baqueano.symbolic import with_value


class PredictionErrorFit(NamedTuple):
    """The second search, and the choice between its result and the result of the first search."""

    end: FinishedFit
    likelihood_fit: MaximumLikelihood
    choice: ObjectiveChoice
    axes: tuple[int, ...]
    info: Information  # about the identifiable θ, then the noise


def fit_by_simulation(first: FinishedFit) -> Fit:
    """Return the fit with the cost of the simulation errors. If autocorrelation and size of the residuals are the only
    findings, the second cost tests if process noise explains them. The test needs a dynamic model without free
    clocks."""
    basis, model = verdict_basis(first), first.blocks.model
    can_have_floor = (
        is_dynamic(model) and has_field(model, "process_noise_std") and not first.task.problem.shape.clocks
    )
    if first.search.stopped or not can_have_floor or not is_only_autocorrelated(basis):
        return assemble_fit(first, basis)
    second = search_prediction_error(first)
    if not second.end.search.solution.converged:
        return assemble_fit(first, basis)
    fit = assemble_fit(first._replace(is_explained_by_floor=second.choice.is_explained), basis)
    reason = second.choice.reason
    if second.choice.cost == "innovations":
        reason = note("cost.try-innovations", fix="--cost innovations", cause=reason)
    return replace(fit, notes=(reason, *fit.notes))


def fit_by_innovations(first: FinishedFit) -> Fit:
    """Return the fit with the cost of the innovations, with the process noise among its parameters. If the first search
    was stopped, return its fit."""
    if first.search.stopped:
        return assemble_fit(first)
    second = search_prediction_error(first)
    fit, floor = assemble_fit(second.end), second.likelihood_fit.noise.floor
    paths = [f"{PROCESS_NOISE_PATH}[{axis}]" for axis in second.axes]
    free = [free_parameter(first.blocks, path, {}) for path in paths]
    std, cov = np.sqrt(floor), _covariance(second, fit)
    return replace(
        fit, names=(*fit.names, *paths), units=(*fit.units, *(parameter.unit for parameter in free)),
        start=np.concatenate([fit.start, [value(first.blocks, path) for path in paths]]),
        estimate=np.concatenate([fit.estimate, std]), std=np.sqrt(np.diagonal(cov)),
        bound=np.concatenate([fit.bound, np.where(floor > 0.0, 0, -1)]),
        poorly_identified=np.concatenate([fit.poorly_identified, np.zeros(len(paths), bool)]),
        cov=cov, unmodelled_cov=np.pad(fit.unmodelled_cov, (0, len(paths))),
        unmodelled_shifts=np.pad(fit.unmodelled_shifts, ((0, 0), (0, len(paths)))),
        fixed=fit.fixed._replace(shifts=np.pad(fit.fixed.shifts, ((0, 0), (0, len(paths))))),
        notes=(second.choice.reason, _sensors(second), *fit.notes),
    )  # fmt: skip


def _covariance(second: PredictionErrorFit, fit: Fit) -> np.ndarray:
    """Return the covariance (p + k, p + k) of the parameters of `fit` and of the process noise; NaN if unknown."""
    p, k, count = len(fit.names), len(second.axes), len(second.end.identifiability.mask)
    floor, theta_indices = second.likelihood_fit.noise.floor, second.end.parameters.theta_indices
    bread = second.info.bread
    is_free = np.r_[second.end.identifiability.mask, floor > 0.0, np.ones(len(bread) - count - k, bool)]
    entries = np.flatnonzero(is_free & (np.diagonal(bread) > 0.0))
    full_cov, cov = np.full(bread.shape, np.nan), np.full((p + k, p + k), np.nan)
    full_cov[np.ix_(entries, entries)] = parameter_cov(second.info, entries)
    scale = np.r_[np.ones(count), 0.5 / np.sqrt(np.where(floor > 0.0, floor, np.nan))]  # v → √v
    rows = np.r_[: len(theta_indices), count : count + k]
    places = np.r_[np.array(theta_indices, int), p : p + k]
    cov[np.ix_(places, places)] = full_cov[np.ix_(rows, rows)] * np.outer(scale[rows], scale[rows])
    cov[:p, :p] = fit.cov
    return cov


def search_prediction_error(first: FinishedFit) -> PredictionErrorFit:
    """Return the search with the second cost. It starts at the result of the first search."""
    problem, theta, task = first.task.problem, first.search.solution.theta, first.task
    prediction = Prediction(problem, first.blocks)
    is_fixed = np.zeros(problem.size, bool)
    is_fixed[: len(first.identifiability.mask)] = ~first.identifiability.mask
    likely = maximum_likelihood(prediction, theta, task.low, task.high, is_fixed, task.floor, task.progress)
    choice = choose_objective(
        likely, prediction.axes, _compare_objectives(first, prediction, likely), _noise_ratios(first, likely)
    )
    noise_info, info = _information_matrices(likely, first)
    evaluation, p = likely.solution.evaluation, problem.size
    evaluation = Evaluation(evaluation.cost, evaluation.gradient[:p], dense(evaluation.hessian)[:p, :p])
    solution = likely.solution._replace(
        theta=likely.theta, evaluation=evaluation, bound=likely.solution.bound[:p]
    )
    rho, evaluations = likely.info.autocorrelation, first.search.evaluations + likely.evaluations
    search = first.search._replace(solution=solution, autocorrelation=rho, evaluations=evaluations)
    std = np.zeros(3)
    std[list(prediction.axes)] = np.sqrt(likely.noise.floor)
    parameters = replace(first.parameters, blocks=with_value(first.blocks, PROCESS_NOISE_PATH, std))
    findings = first.findings
    if choice.is_contradicted:
        findings = (*findings, replace(choice.reason, severity=Severity.WARNING))
    second = first._replace(parameters=parameters, search=search, info=info, findings=findings)
    second = second._replace(is_explained_by_floor=choice.is_explained, is_filtered=True)
    return PredictionErrorFit(second, likely, choice, prediction.axes, noise_info)


def _compare_objectives(
    first: FinishedFit, prediction: Prediction, likely: MaximumLikelihood
) -> LeaveOneOutComparison | None:
    """Return the comparison of both results on left-out blocks, or None with too few blocks."""
    problem, ends = first.task.problem, first.search.solution
    mask = first.identifiability.mask
    identifiable = np.flatnonzero(mask & (ends.bound[: len(mask)] == 0))
    noise = problem.size + np.flatnonzero(_is_inside_bounds(likely))
    free = np.flatnonzero(mask & (likely.solution.bound[: len(mask)] == 0))
    return leave_one_out(
        problem, ends.theta, identifiable, prediction, likely.solution.theta, np.r_[free, noise]
    )


def _is_inside_bounds(likely: MaximumLikelihood) -> np.ndarray:
    """Return a mask (k + m,), True for the noise entries that are not at a bound."""
    return likely.solution.bound[len(likely.theta) :] == 0


def _information_matrices(likely: MaximumLikelihood, first: FinishedFit) -> tuple[Information, Information]:
    """Return two information matrices: of (identifiable θ, noise parameters), and of the identifiable θ only. The
    initial states of the segments are eliminated from both. The second also eliminates the noise parameters, because
    they are also estimated."""
    layout, count, info = first.task.problem.layout, len(first.identifiability.mask), likely.info
    n, noise = len(info.bread) - layout.size, layout.size + np.arange(len(info.bread) - layout.size)
    order = np.r_[np.arange(count), noise, np.arange(count, layout.size)]
    A, B = info.bread[np.ix_(order, order)], info.meat[np.ix_(order, order)]
    starts = [layout.start_slice(k) for k in range(len(layout.runs))] if count < layout.size else []
    A, B = eliminate(A, B, count + n, [slice(span.start + n, span.stop + n) for span in starts])
    noise_info = info._replace(bread=A, meat=B)
    free = np.r_[np.arange(count), count + np.flatnonzero(_is_inside_bounds(likely))]
    A, B = eliminate(A[np.ix_(free, free)], B[np.ix_(free, free)], count, [slice(count, len(free))])
    return noise_info, info._replace(bread=A, meat=B, channel_information=info.channel_information[:, :count])


def _noise_ratios(first: FinishedFit, likely: MaximumLikelihood) -> np.ndarray:
    """Return the sensor noise (m,) without process noise, relative to that in the file, or 0 without one."""
    file_sigma = sensor_sigma(first.blocks.sensors)
    estimate = first.task.problem.sigma * np.exp(likely.noise.sensors)
    return np.where(file_sigma > 0.0, estimate / np.where(file_sigma > 0.0, file_sigma, 1.0), 0.0)


def _sensors(second: PredictionErrorFit) -> Diagnostic:
    """Return a note with the noise of the sensors without the process noise."""
    problem, noise = second.end.task.problem, second.likelihood_fit.noise
    sigma = problem.sigma * np.exp(noise.sensors)
    stds = [
        note("noise.of-sensor", sensor=name, values=map(float, sigma[span]))
        for name, span in problem.spans.items()
    ]
    return note("noise.without-floor", noise=stds)
