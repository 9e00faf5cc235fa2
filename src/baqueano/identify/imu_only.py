"""Fit a vehicle from its commands and its IMU only, without encoder or camera.

The gyro gives the yaw rate of the simulation (gyro_aided.py), and each channel is weighted by its information on slow
motion (numerics/noise_level.py). The position l of the IMU along the vehicle is free; it changes a_x by −l ν_ψ², a_y by
l ν̇_ψ. For a car, delay and understeer are free by default. The IMU itself does not show the scales of gyro and
accelerometers: twice the gyro's scale and half the speed fit equally well. So the scales are fixed, and so is the
zero of a car's gyro, which acts like a small steering offset. The error bars contain their possible errors and that of
a fixed understeer (information.py), and the scatter between parts of the run (clusters.py).

Results: `baqueano study without-encoders` for a real car, benchmarks/coverage_without_encoders.py for simulated cars.
The method does not help a vehicle with two wheels. A recording at 10 Hz whose a_y scatters by 2 m/s² is not sufficient.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from baqueano.calibration.tolerances import scale_stds
from baqueano.diagnostics import Diagnostic, note
from baqueano.errors import UsageError
from baqueano.identify.covariance.clusters import jackknife, with_jackknife
from baqueano.identify.covariance.information import Information
from baqueano.identify.identifiability import FinishedFit
from baqueano.identify.options import FitOptions
from baqueano.identify.parameters.free import has_offset
from baqueano.identify.residuals.gyro_aided import GyroAidedResiduals
from baqueano.identify.residuals.simulation import Residuals
from baqueano.identify.result.assemble import assemble_fit, verdict_basis
from baqueano.identify.result.fit_result import Fit
from baqueano.numerics.noise_level import robust_sigma
from baqueano.runs.run import Run
from baqueano.sensors.sampling import is_imu
from baqueano.vehicles.freedoms import tyre_paths

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

ALLOWED_OPTIONS = "fixed", "bounds", "start", "gyro_leads", "backend"  # in a gyro-aided fit


def gyro_leads(
    vehicle_file: "VehicleFile", runs: Sequence[Run], use: Sequence[str] | None, free: Sequence[str] | None,
    options: FitOptions, residuals: type[Residuals],
) -> bool:  # fmt: skip
    """Return True if the fit is gyro-aided. The option `gyro_leads` decides if it is set. Otherwise, return True for a
    car with only an IMU, if all changed options are in ALLOWED_OPTIONS. Raise UsageError for other options if it is
    requested."""
    is_custom = residuals not in (Residuals, GyroAidedResiduals)
    refused_options = [name for name in options.non_defaults if name not in ALLOWED_OPTIONS]
    refused_options += ["residuals"] if is_custom else []
    if options.gyro_leads and refused_options:
        raise UsageError.of("imu-only.others", others=refused_options)
    if options.gyro_leads is not None:
        return options.gyro_leads
    return not refused_options and is_imu_only(vehicle_file, runs, use, free)


def is_imu_only(
    vehicle_file: "VehicleFile", runs: Sequence[Run], use: Sequence[str] | None, free: Sequence[str] | None
) -> bool:
    """Return True for a car with an IMU as its only sensor, and no requested parameter of a sensor."""
    sensors = vehicle_file.sensors._asdict()
    names = [n for n in sensors if all(n in run.sensors for run in runs)] if use is None else list(use)
    has_one_imu = len(names) == 1 and is_imu(sensors.get(names[0]))
    has_free_sensor = any(path.lstrip("+").startswith("sensors.") for path in free or ())
    return has_one_imu and has_offset(vehicle_file.vehicle) and not has_free_sensor


def select_imu(vehicle_file: "VehicleFile", use: Sequence[str] | None) -> list[str]:
    """Return the name of the IMU, as `use` of a fit. Raise UsageError unless it is the only candidate."""
    sensors = vehicle_file.sensors._asdict().items()
    names = [name for name, sensor in sensors if is_imu(sensor)]
    imus = names if use is None else list(use)
    if len(imus) == 1 and imus[0] in names:
        return imus
    if use is not None:
        raise UsageError.of("imu-only.not-an-imu", vehicle=vehicle_file.name, valid=names, use=list(use))
    raise UsageError.of("imu-only.which-imu", vehicle=vehicle_file.name, valid=names)


def make_imu_fit(end: FinishedFit) -> Fit:
    """Return the fit of a finished gyro-aided search."""
    problem, imu = end.task.problem, end.task.problem.names[0]
    sigma = robust_sigma(problem.misfits(end.search.solution.theta), problem.masks, end.task.floor)
    end = end._replace(info=_with_jackknife(end), search=end.search._replace(sigma=sigma))
    basis = verdict_basis(end)
    # the jackknife does not contain effects that shift all parts equally: fixed tyres, or times by a short lag
    is_time = np.array([parameter.unit == "s" for parameter in end.parameters.free], bool)
    lag_errors = np.where(is_time, basis.diagnosis.lag_errors, 0.0)
    fields, s = tyre_paths(end.blocks.model), len(is_time)
    is_tyre = np.array([path.partition("[")[0] in fields for path in end.fixed.paths], bool)
    cov = np.outer(lag_errors, lag_errors) + end.fixed.cov_part(is_tyre)[:s, :s]
    evidence = basis.evidence._replace(messages=tuple(map(_without_advice, basis.evidence.messages)))
    none = {"shifts": np.zeros((0, s)), "speed_changes": np.zeros((0, 2, 3)), "run_errors": 0.0}
    diagnosis = basis.diagnosis._replace(unmodelled_cov=cov, **none)
    basis = basis._replace(diagnosis=diagnosis, evidence=evidence)
    return _with_notes(assemble_fit(end, basis), imu, scale_stds(end.vehicle_file, imu))


def _without_advice(message: Diagnostic) -> Diagnostic:
    """Return a message without the advice to free a parameter of a sensor, which would end this method."""
    return replace(message, code="residual.missing", fix="") if "+sensors." in message.fix else message


def _with_jackknife(end: FinishedFit) -> Information:
    """Return the information, with the covariance enlarged by the scatter between parts of the run."""
    identifiable = np.flatnonzero(end.identifiability.mask)
    cov = jackknife(end.info, end.task.problem.layout, identifiable)
    return end.info if cov is None else with_jackknife(end.info, identifiable, cov)


def _with_notes(fit: Fit, imu: str, scales: np.ndarray) -> Fit:
    """Return the fit with notes on the scales that no run can show, and on its range of motion."""
    sensor, fix = getattr(fit.blocks.sensors, imu), "baqueano runs calibrate last --update"
    gyro, accel = (100.0 * float(scales[k]) for k in (2, 1))
    gyro_scale, accel_scale = float(sensor.gyro_scale), float(sensor.accel_scale[1])
    unobservable_scales = (
        *fit.always_unobservable,
        note("identifiability.gyro-scale", fix=fix, subject=imu, value=gyro_scale, percent=gyro),
        note("identifiability.accelerometer-scale", subject=imu, value=accel_scale, percent=accel),
    )
    notes = (*fit.notes, note("fit.envelope", ranges=fit.envelope.ranges))
    return replace(fit, always_unobservable=unobservable_scales, notes=notes)
