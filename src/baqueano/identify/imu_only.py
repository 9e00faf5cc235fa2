"""Fit a vehicle from its commands and its IMU only, without encoder or camera.

The gyro gives the yaw rate of the simulation (gyro_aided.py), and each channel is weighted by its information on slow
motion (noise_level.py). The position l of the IMU along the vehicle is also free; it changes a_x by −l ν_ψ² and a_y by
l ν̇_ψ. For a car, the delay of the commands is also free. The IMU itself does not show the scales of gyro and
accelerometers: twice the gyro's scale and half the speed fit equally well. So the scales are fixed, and so is the
zero of a car's gyro, which acts like a small steering offset. The error bars contain their possible errors
(information.py), and the scatter between parts of the run (clusters.py). A change of the yaw rate of the gyro
changes the best delay. So both are searched in turn until they are constant (at most MAX_ROUNDS times). A fit that
starts from its own result then stays there.

Results: `baqueano study without-encoders` for a real car, benchmarks/coverage_without_encoders.py for simulated cars.
The method does not help a vehicle with two wheels. A recording at 10 Hz whose a_y scatters by 2 m/s² is not sufficient.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from baqueano.calibration.tolerances import scale_stds, std_of_gyro_bias
from baqueano.contracts.optional import has_field
from baqueano.diagnostics import fault, note
from baqueano.errors import UsageError
from baqueano.identify.covariance.clusters import jackknife, with_jackknife
from baqueano.identify.covariance.information import Information, information, with_systematic_errors
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.dataset import dataset
from baqueano.identify.estimation.delay import search_with_free_delay
from baqueano.identify.estimation.search import Search, Task, search
from baqueano.identify.identifiability import FinishedFit, finished_fit
from baqueano.identify.options import FitOptions
from baqueano.identify.parameters.free import (
    DELAY_PATH,
    FreeParameter,
    default_free,
    free_parameter,
    free_parameters,
    has_offset,
    requested_paths,
)
from baqueano.identify.parameters.theta import parameters_for_fit
from baqueano.identify.residuals.gyro_aided import GyroAidedResiduals, can_be_gyro_aided
from baqueano.identify.residuals.noise_level import min_sigma, robust_sigma
from baqueano.identify.result.assemble import fit_of, verdict_basis
from baqueano.identify.result.fit_result import Fit
from baqueano.numerics.least_squares import Minimiser, minimise
from baqueano.runs.run import Run

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

LEVER_ARM = "lever_arm_m[0]"
# options that are allowed in a gyro-aided fit
ALLOWED_OPTIONS = "fixed", "bounds", "start", "gyro_leads", "backend"
MAX_ROUNDS = 8  # rounds of updates of the yaw rate of the gyro, at most
# standard deviations: the search is settled if a round moves all parameters together by less
SETTLED_SIGMA = 0.1


def fit_imu_only(
    runs: Run | Sequence[Run],
    vehicle_file: "VehicleFile",
    free: Sequence[str] | None = None,
    use: Sequence[str] | None = None,
    *,
    options: FitOptions = FitOptions(),  # noqa: B008  it is frozen
    tolerance: Mapping[str, float] | None = None,
    solver: Minimiser = minimise,
    progress: Callable[[str], object] | None = None,
) -> Fit:
    """Return the parameters of `vehicle_file` that explain what an IMU measured in `runs`.

    `free`, `solver` and the `options` in ALLOWED_OPTIONS are as in `identify`, which calls this function for a car
    with only an IMU. `use` names the IMU; default: the only IMU of the file. `tolerance` {"gyro": 0.01, "accel":
    0.02} is the largest relative error ± of the scales. Its default is the error of the calibration in the file, else
    3 % and 2 % of a data sheet. Raise UsageError without an IMU, for other options, and for a model that the gyro
    cannot lead.
    """
    if names := _other_options(options):
        raise UsageError(fault("imu-only.others", others=names))
    imu = _imu_name(vehicle_file, use)
    scales = scale_stds(vehicle_file, imu, tolerance or {})
    data = dataset([runs] if isinstance(runs, Run) else runs, vehicle_file, (imu,), options)
    if not can_be_gyro_aided(data.blocks):
        kind = type(data.vehicle_file.vehicle).__name__
        raise UsageError(fault("imu-only.no-dynamics", vehicle=data.vehicle_file.name, kind=kind))
    zero_rad_s = std_of_gyro_bias(data.vehicle_file, imu) if has_offset(data.vehicle_file.vehicle) else 0.0
    free_list, rate_hz = _requested_parameters(data.blocks, free, options, imu), data.vehicle_file.rate_hz
    parameters = parameters_for_fit(data.blocks, free_list, data.runs, data.channels, rate_hz, options)
    blocks = parameters.blocks
    problem = GyroAidedResiduals(blocks, parameters.shape, parameters.records, options.backend)
    floor = min_sigma(blocks.sensors, problem.z, problem.has)
    begin = parameters.start, parameters.low, parameters.high
    task = Task(problem, *begin, floor, None, by_speed=True, progress=progress, minimise=solver)
    bounded_task, result = _search_yaw_rate_and_delay(task)
    end = finished_fit(bounded_task, result, parameters, data.vehicle_file, data.note, data.findings)
    residuals = end.task.problem.misfits(end.search.solution.theta)
    end = end._replace(
        info=_with_all_errors(end, scales, zero_rad_s),
        search=end.search._replace(sigma=robust_sigma(residuals, end.task.problem.has, floor)),
    )
    basis = verdict_basis(end)
    # the jackknife already contains effects that the model lacks
    diagnosis = basis.diagnosis._replace(unmodelled_cov=np.zeros_like(basis.diagnosis.unmodelled_cov))
    return _with_notes(fit_of(end, basis._replace(diagnosis=diagnosis)), imu, scales)


def _search_yaw_rate_and_delay(task: Task) -> tuple[Task, Search]:
    """Search for the yaw rate of the gyro and the delay in turn, at most MAX_ROUNDS times. Return the task and the
    search."""
    bounded_task, end = search_with_free_delay(task, task.start)
    for _ in range(MAX_ROUNDS):
        end = _search_gyro_aided(bounded_task, end)
        task, bounded_task = (part._replace(problem=end.problem) for part in (task, bounded_task))
        if end.stopped or DELAY_PATH not in task.problem.shape.shared_paths:
            break
        previous_theta, count = end.solution.theta, end.evaluations
        bounded_task, end = search_with_free_delay(task, previous_theta)
        end = end._replace(evaluations=count + end.evaluations)
        if _is_settled(previous_theta, end):
            break
    return bounded_task, end


def _search_gyro_aided(task: Task, end: Search) -> Search:
    """Repeat the search, aided by the yaw rate from gyro and model, until θ is constant, at most MAX_ROUNDS times."""
    problem, count = end.problem, end.evaluations
    assert isinstance(problem, GyroAidedResiduals)
    for _ in range(MAX_ROUNDS):
        previous_theta = end.solution.theta
        problem = problem.with_yaw_rate_at(previous_theta)
        end = search(task._replace(problem=problem), previous_theta, None, end)
        count += end.evaluations
        if end.stopped or _is_settled(previous_theta, end):
            break
    return end._replace(evaluations=count)


def _is_settled(previous: np.ndarray, end: Search) -> bool:
    """Return True if a search changed all parameters together by less than SETTLED_SIGMA standard deviations from
    `previous` (p,)."""
    step = end.solution.theta - previous
    return float(step @ information(end.problem, end.solution.theta).bread @ step) < SETTLED_SIGMA**2


def _with_all_errors(end: FinishedFit, scales: np.ndarray, zero_rad_s: float) -> Information:
    """Return the information with its covariance enlarged by the scatter between parts of the run, and by scales and
    zero."""
    problem, theta = end.task.problem, end.search.solution.theta
    identifiable = np.flatnonzero(end.identifiability.mask)
    assert isinstance(problem, GyroAidedResiduals)
    cov = jackknife(problem, theta, identifiable, end.info.bread)
    info = end.info if cov is None else with_jackknife(end.info, identifiable, cov)
    gradient = partial(problem.gradient_of_changed_channel, theta)
    return with_systematic_errors(info, gradient, scales, zero_rad_s)


def gyro_leads(
    vehicle_file: "VehicleFile", runs: Sequence[Run], use: Sequence[str] | None, free: Sequence[str] | None,
    options: FitOptions,
) -> bool:  # fmt: skip
    """Return True if the fit is gyro-aided. The option `gyro_leads` decides if it is set. Otherwise, return True for a
    car with only an IMU, if all changed options are in ALLOWED_OPTIONS."""
    if options.gyro_leads is not None:
        return options.gyro_leads
    return not _other_options(options) and is_imu_only(vehicle_file, runs, use, free)


def _other_options(options: FitOptions) -> list[str]:
    """Return the names of changed options that are not allowed in a gyro-aided fit."""
    return [name for name in options.non_defaults if name not in ALLOWED_OPTIONS]


def is_imu_only(
    vehicle_file: "VehicleFile", runs: Sequence[Run], use: Sequence[str] | None, free: Sequence[str] | None
) -> bool:
    """Return True for a car with an IMU as its only sensor, and no requested parameter of a sensor."""
    sensors = vehicle_file.sensors._asdict()
    recorded_names = [name for name in sensors if all(name in run.sensors for run in runs)]
    names = recorded_names if use is None else list(use)
    has_one_imu = len(names) == 1 and has_field(sensors.get(names[0]), "gyro_scale")
    has_free_sensor = any(path.lstrip("+").startswith("sensors.") for path in free or ())
    return has_one_imu and has_offset(vehicle_file.vehicle) and not has_free_sensor


def _imu_name(vehicle_file: "VehicleFile", use: Sequence[str] | None) -> str:
    """Return the name of the IMU. Raise UsageError if `use` names another sensor, or if the IMU is ambiguous or
    missing."""
    sensors = vehicle_file.sensors._asdict().items()
    names = [name for name, sensor in sensors if has_field(sensor, "gyro_scale")]
    if use is None and len(names) == 1:
        return names[0]
    if use is not None and len(use) == 1 and use[0] in names:
        return use[0]
    if use is not None:
        raise UsageError(fault("imu-only.not-an-imu", vehicle=vehicle_file.name, valid=names, use=list(use)))
    raise UsageError(fault("imu-only.which-imu", vehicle=vehicle_file.name, valid=names))


def _requested_parameters(
    blocks: FittedBlocks, free: Sequence[str] | None, options: FitOptions, imu: str
) -> list[FreeParameter]:
    """Return the requested free parameters, and the position of the IMU along the vehicle if it is not fixed."""
    lever = f"sensors.{imu}.{LEVER_ARM}"
    is_fixed = any(lever == path or lever.startswith(f"{path}[") for path in options.fixed)
    if has_offset(blocks.model):
        free = requested_paths(free, lambda: [*default_free(blocks), DELAY_PATH])
    bounds = {path: b for path, b in options.bounds.items() if path != lever}
    requested_parameters = free_parameters(blocks, free, options.fixed, bounds)
    if not is_fixed and lever not in [parameter.path for parameter in requested_parameters]:
        requested_parameters.append(free_parameter(blocks, lever, options.bounds))
    return requested_parameters


def _with_notes(fit: Fit, imu: str, scales: np.ndarray) -> Fit:
    """Return the fit with notes on the scales that no run can show, and on its range of motion."""
    sensor = getattr(fit.blocks.sensors, imu)
    gyro, accel = (100.0 * float(scales[k]) for k in (2, 1))
    fix, gyro_scale, accel_scale = (
        "baqueano runs calibrate last --update",
        sensor.gyro_scale,
        sensor.accel_scale[1],
    )
    never_shown = (
        *fit.always_unobservable,
        note("identifiability.gyro-scale", fix=fix, subject=imu, at=float(gyro_scale), percent=gyro),
        note("identifiability.accelerometer-scale", subject=imu, at=float(accel_scale), percent=accel),
    )
    fitted_to = note("fit.envelope", ranges=fit.envelope.ranges)
    return replace(fit, always_unobservable=never_shown, notes=(*fit.notes, fitted_to))
