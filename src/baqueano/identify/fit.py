"""Estimate the parameters of a vehicle file from runs: `identify`.

    C(p) = Σ_t ‖s(t) − h_p(t)‖_Huber          Grotz et al., `equ:cost_function`                           (1)

The sum is over all channels of all sensors, each in units of its noise σ; k = 1.345 σ. The minimisation is damped
Gauss-Newton with exact derivatives. It is over the free parameters and, for each run, the sensors' biases and the
velocity at the start. Parameters that the data do not determine are fixed at their start, and the others are fitted
again.

    Dataset → Parameters → Residuals, the residuals → solve → Fit

Each stage is an immutable object, and the function that makes it can be replaced: docs/identification.md, "Own
stages".
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.calls import checked_call
from baqueano.contracts.values import Tree
from baqueano.diagnostics import note
from baqueano.identify import imu_only
from baqueano.identify.battery import with_shown_battery
from baqueano.identify.covariance.information import fixed_parameters, uncertain_parameters
from baqueano.identify.dataset import Dataset, dataset, parameters_of
from baqueano.identify.estimation.delay import (
    DUTY_STEP_PATH,
    complete_search,
    duty_step_count,
    with_bound_flags,
)
from baqueano.identify.estimation.search import Search, Task, search
from baqueano.identify.identifiability import FinishedFit, fix_unidentifiable
from baqueano.identify.options import FitOptions
from baqueano.identify.parameters.free import MAX_DECAY_PER_ROW, adds_to_default, has_offset, substitute
from baqueano.identify.parameters.theta import Parameters, parse_sigma
from baqueano.identify.prediction_error_fit import fit_by_innovations, fit_by_simulation
from baqueano.identify.residuals.gyro_aided import GyroAidedResiduals
from baqueano.identify.residuals.informative_rows import min_sigma, rare_channel_sigma
from baqueano.identify.residuals.simulation import Residuals
from baqueano.identify.result.fit_result import Fit
from baqueano.numerics.least_squares import Minimiser, minimise
from baqueano.runs.run import Run
from baqueano.vehicles.freedoms import slowing_bounds
from baqueano.vehicles.rk4 import row_rate_hz

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

# without a compiler, the first search uses 1/FIRST_SEARCH_PART of the rows of a run, at least MIN_FIRST_ROWS
FIRST_SEARCH_PART, MIN_FIRST_ROWS = 4, 1000


@checked_call("bq.identify(run, robot)")
def identify(
    runs: Run | Sequence[Run],
    vehicle_file: "VehicleFile",
    free: Sequence[str] | None = None,
    *,
    use: Sequence[str] | None = None,
    options: FitOptions = FitOptions(),  # noqa: B008  it is frozen
    residuals: type[Residuals] = Residuals,
    solver: Minimiser = minimise,
    progress: Callable[[str], object] | None = None,
) -> Fit:
    """Return the fit: the parameters of a vehicle file that explain the runs.

    Parameters
    ----------
    runs : Run or sequence of Run
        The measurements.
    vehicle_file : VehicleFile
        The vehicle; its values are the start of the search.
    free : sequence of str, optional
        Dotted paths of the file, such as "model.friction.linear" or "model.actuator_matrix[0,2]"; default: the
        parameters that the model needs. "+PATH" adds a path to the default.
    use : sequence of str, optional
        Sensors, or single channels such as "imu[2]"; default: all sensors that every run has. "truth" uses the
        velocity of a simulation, or the pose that a camera measured, as a measurement.
    options : FitOptions
        Bounds, noise, cost and other options.
    residuals : type of Residuals
        Class that computes the residuals; by default `Residuals`.
    solver : Minimiser
        Function that searches the minimum; by default `minimise`.
    progress : callable, optional
        Receives the progress as text; True from it ends the search.

    Returns
    -------
    Fit
        Estimates, their error bars, and a verdict. Wrong data do not raise: the verdict is WARN or REFUSED.

    Raises
    ------
    UsageError
        For names that do not exist, options that exclude each other or do not have an effect, and if no command
        moved.

    References
    ----------
    Grotz et al., `equ:cost_function`; docs/derivations/residuals_and_sensitivities.md.

    Examples
    --------
    >>> small, u = bq.load("small"), bq.excitation("random_steps", [1.0, 0.0, 1.0], 10.0, 100.0)
    >>> fit = identify(bq.simulate(small, u), small, ["model.mass_kg"])
    >>> print(f"{fit.value('model.mass_kg'):.2f} kg, {fit.verdict}")
    0.61 kg, USABLE
    """
    runs = [runs] if isinstance(runs, Run) else list(runs)
    if imu_only.gyro_leads(vehicle_file, runs, use, free, options, residuals):
        residuals, options = GyroAidedResiduals, replace(options, gyro_leads=True)
        use = imu_only.select_imu(vehicle_file, use)
    data = dataset(runs, vehicle_file, use, options)
    parameters = parameters_of(data, free, options)
    problem = residuals.from_parameters(parameters, options.backend)
    task, end = solve(problem, parameters, options, solver=solver, progress=progress, retry=data.is_usable)

    def refit(file: "VehicleFile", paths: Sequence[str] | None, options: FitOptions = options) -> Fit:
        return identify(
            runs, file, paths, use=use, options=options, residuals=residuals, solver=solver, progress=progress
        )

    steps = None if end.stopped else duty_step_count(parameters.blocks, end.problem, end.solution.theta)
    if steps is not None:
        fit = refit(vehicle_file.with_values({DUTY_STEP_PATH: 1.0 / steps}), free)
        return replace(fit, notes=(*fit.notes, note("fit.duty-step", steps=steps)))
    model = substitute(parameters.blocks, parameters.shape.shared_paths, end.solution.theta).model
    bounds = {} if end.stopped else _row_bounds(parameters, model, vehicle_file.rate_hz)
    fit = None if bounds else conclude(data, parameters, task, end, options)
    if fit is not None and not end.stopped:
        bounds = _row_bounds(parameters, fit.blocks.model, vehicle_file.rate_hz)
    if fit is None or bounds:
        fit = refit(vehicle_file, free, replace(options, bounds={**options.bounds, **bounds}))
        return replace(fit, notes=(*fit.notes, *(note("bound.integrable", subject=path) for path in bounds)))
    if end.stopped or not adds_to_default(free):
        return fit
    return with_shown_battery(
        fit, runs, vehicle_file, options.fixed, lambda file, path: refit(file, [*(free or ()), f"+{path}"])
    )


def solve(
    problem: Residuals,
    parameters: Parameters,
    options: FitOptions = FitOptions(),  # noqa: B008  it is frozen
    *,
    solver: Minimiser = minimise,
    progress: Callable[[str], object] | None = None,
    retry: bool = True,
) -> tuple[Task, Search]:
    """Return the task of the search for the least cost, and the result of the search.

    Parameters
    ----------
    problem : Residuals
        Residuals of the rows of `parameters`.
    parameters : Parameters
        θ: its start and bounds.
    options : FitOptions
        Options of the fit.
    solver : Minimiser
        `minimise`, or a custom solver.
    progress : callable, optional
        Receives the progress as text; True from it ends the search.
    retry : bool
        If the result of the search is not plausible, begin it again from other starts.

    Returns
    -------
    task : Task
        Residuals, bounds and noise of the search.
    end : Search
        θ of least cost, and the noise that was estimated with it.

    Examples
    --------
    >>> small, u = bq.load("small"), bq.excitation("prbs", [1.0, 0.0, 1.0], 10.0, 100.0)
    >>> parameters = parameters_of(dataset([bq.simulate(small, u)], small), ["model.mass_kg"])
    >>> end = solve(Residuals.from_parameters(parameters), parameters)[1]
    >>> bool(abs(end.solution.theta[0] - small.vehicle.mass_kg) < 0.01)
    True
    """
    sensors = parameters.blocks.sensors
    task = Task(
        problem, parameters.start, parameters.low, parameters.high, min_sigma(sensors, problem.z, problem.masks),
        None if options.sigma is None else parse_sigma(options.sigma, sensors),
        options.speed_noise or problem.has_speed_noise, progress,
        rare_channel_sigma(sensors, problem.masks), retry, solver,
    )  # fmt: skip
    return complete_search(task, _start_theta(task, parameters))


def conclude(
    data: Dataset,
    parameters: Parameters,
    task: Task,
    result: Search,
    options: FitOptions = FitOptions(),  # noqa: B008  it is frozen
) -> Fit:
    """Return the fit of a search. Parameters that the data do not determine are fixed at their start; the others
    receive standard errors.

    Parameters
    ----------
    data : Dataset
        First stage of the fit.
    parameters : Parameters
        Second stage.
    task : Task
        The search that `solve` returned.
    result : Search
        End of the search.
    options : FitOptions
        Options of the fit.

    Returns
    -------
    Fit
        The fit, as `identify` returns it.

    Examples
    --------
    >>> small, u = bq.load("small"), bq.excitation("prbs", [1.0, 0.0, 1.0], 10.0, 100.0)
    >>> data = dataset([bq.simulate(small, u)], small)
    >>> parameters = parameters_of(data, ["model.mass_kg"])
    >>> str(conclude(data, parameters, *solve(Residuals.from_parameters(parameters), parameters)).verdict)
    'USABLE'
    """
    has_zero = options.biases and has_offset(data.vehicle_file.vehicle)
    uncertain = uncertain_parameters(data.vehicle_file, parameters.blocks, result.problem, has_zero)
    best, identifiability, info, joint_info = fix_unidentifiable(task, result, parameters.free, uncertain)
    # the bounds of the search are those of one tick if the delay is free
    task = task._replace(low=parameters.low, high=parameters.high, problem=best.problem)
    best = with_bound_flags(task, best)
    fixed = fixed_parameters(uncertain, joint_info, best.problem, best.solution, identifiability.mask)
    end = FinishedFit(
        data.vehicle_file, parameters, task, best, identifiability, info, fixed, data.note, data.findings,
        score_test=options.diagnose,
    )  # fmt: skip
    if options.gyro_leads:
        return imu_only.make_imu_fit(end)
    return fit_by_innovations(end) if options.cost == "innovations" else fit_by_simulation(end)


def _row_bounds(parameters: Parameters, model: Tree, rate_hz: float) -> dict[str, tuple[float, float]]:
    """Return bounds of free parameters, within which a row can integrate the motion; {} if `model` is within them."""
    highs = {parameter.path: parameter.high for parameter in parameters.free}
    return slowing_bounds(model, highs, MAX_DECAY_PER_ROW * row_rate_hz(rate_hz))


def _start_theta(task: Task, parameters: Parameters) -> np.ndarray:
    """Return θ (p,) at the start of the search. Without a compiler each row takes long, so return the result of a rough
    search over the first part of each run."""
    problem, records = task.problem, task.problem.records
    if problem.scan.backend == "c":
        return task.start
    row_counts = [max(MIN_FIRST_ROWS, len(record.dt_s) // FIRST_SEARCH_PART) for record in records]
    if all(len(record.dt_s) <= n for record, n in zip(records, row_counts, strict=True)):
        return task.start
    first_records = [record.part(slice(n)) for record, n in zip(records, row_counts, strict=True)]
    short_problem = type(problem)(parameters.blocks, problem.shape, first_records, problem.scan.backend)
    return search(task._replace(problem=short_problem), task.start, rough=True).solution.theta
