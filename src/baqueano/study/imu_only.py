"""Fit a real car from throttle, servo and IMU only, and evaluate it with its hidden odometer (CPM Lab µCar, 1:18).

Each of two runs is fitted twice, without its odometer. One fit uses the raw gyro (scale 1, known to 3 % by the data
sheet), the other one a gyro calibrated to 1 %. Each fit is evaluated
    on the other run    The speed is simulated from throttle and servo only. Its error against the odometer is compared
                        with the error of the same model fitted to odometer and gyro.
    by its intervals    The 95 % intervals have a width, and cover or miss the odometer's fit of the same run. The
                        errors of that fit are included. The intervals belong to gain, viscous and dry friction,
                        cornering drag, and the steady speed at 0.4 throttle.
    by its messages     They must report that an IMU does not determine the gyro's scale. They must also report that
                        the other run leaves the range of the fit.

The camera determined the garage's odometer scale. The gyro's zero is the mean of the 76 readings of run a at rest,
because neither run rests long enough to fit it. Dimensions, dead zone, delay and the initial values of the fitted
parameters are from the garage's file of this car.
"""

from collections.abc import Callable
from datetime import date
from typing import NamedTuple

import numpy as np

from baqueano.calibration.tolerances import with_tolerance
from baqueano.contracts.values import TableRow
from baqueano.diagnostics import Verdict
from baqueano.identify import Fit, FitOptions, identify
from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.numerics.statistics import QUANTILE_95
from baqueano.runs import Run
from baqueano.runs.importing import import_run
from baqueano.study.cross_validation_cpm import predict_run
from baqueano.study.recorded.criteria import criterion_row, maximum_row, message_row, minimum_row
from baqueano.study.recordings import RecordingStudy, check_cpm_present
from baqueano.vehicle_file import Provenance, VehicleFile, load

MAPS = {"a": "cpm_run_a", "b": "cpm_run_b"}
DRIVE_PARAMETERS = ("model.throttle_gain", "model.linear_drag", "model.coulomb_m_s2", "model.cornering_drag")
GYRO_BIAS_PATH, GYRO_SCALE_PATH = "sensors.imu.gyro_bias", "sensors.imu.gyro_scale"
ZERO_RAD_S, ZERO_STD_RAD_S, RECORDING_DATE = 0.0024, 0.0013, date(2019, 5, 13)
FREE = (*DRIVE_PARAMETERS, "model.steering_gain", "model.steering_offset_rad", "model.yaw_lag_s")
BARE_VALUES = {"model.quadratic_drag": 0.0, GYRO_BIAS_PATH: ZERO_RAD_S}
MAX_SPEED_ERROR_RATIO = 1.5  # limit of the speed error on the other run, relative to the odometer's fit
MIN_COVERAGE = 0.85  # required coverage of the intervals
# of the value, gain, viscous, dry, cornering drag, steady speed
MAX_WIDTHS = (0.40, 0.40, 0.50, np.inf, 0.08)
TEST_THROTTLE = 0.4  # throttle
QUANTITY_NAMES = (
    N_("gain"), N_("viscous drag"), N_("dry friction"), N_("cornering drag"), N_("speed at 0.4 throttle"),
)  # fmt: skip


class GyroCalibration(NamedTuple):
    """A calibration of the gyro: its scale, and the tolerance that a user states."""

    name: str
    scale: float
    tolerance: float


class FittedDrive(NamedTuple):
    """The fitted gains, frictions and steady speed, with their errors."""

    value: np.ndarray  # (5,) in the order of QUANTITY_NAMES
    std: np.ndarray  # (5,)


def imu_only_study(
    backend: str = "auto", progress: Callable[[str], object] = lambda text: None
) -> RecordingStudy:
    """Fit both runs with both gyros, and return the results. Raise FileError with the names of missing recordings."""
    check_cpm_present()
    return RecordingStudy(tuple(rows(progress, backend)), ())


def rows(progress: Callable[[str], object] = lambda text: None, backend: str = "auto") -> list[TableRow]:
    """Return the rows of the study, with recording, quantity, value, criterion and ok."""
    runs = {name: import_run(path).run for name, path in MAPS.items()}
    car = load("car").with_values(
        BARE_VALUES,
        {GYRO_BIAS_PATH: Provenance("standing, run a", RECORDING_DATE, ZERO_STD_RAD_S, Verdict.USABLE)},
    )
    reference = {}
    for name, run in runs.items():
        progress(
            _("run {name}: fitting the odometer, {duration_s:.0f} s", name=name, duration_s=run.duration_s)
        )
        reference[name] = identify(
            run, car, FREE, use=("odometer", "imu[2]"), options=FitOptions(backend=backend)
        )
    calibrations = (
        GyroCalibration(N_("raw"), 1.0, 0.03),
        GyroCalibration("± 1 %", float(car.sensors.imu.gyro_scale), 0.01),
    )
    study_rows: list[TableRow] = []
    is_covered, width, fits = [], [], []
    for gyro in calibrations:
        for name, test_name in (("a", "b"), ("b", "a")):
            progress(
                _("run {name}, gyro {gyro}: fitting the IMU, odometer hidden", name=name, gyro=_(gyro.name))
            )
            vehicle_file = with_tolerance(
                car.with_values({GYRO_SCALE_PATH: gyro.scale}), {GYRO_SCALE_PATH: gyro.tolerance}
            )
            fit = identify(
                runs[name], vehicle_file, FREE, options=FitOptions(backend=backend, gyro_leads=True)
            )
            study_rows += held_out_rows(
                fit, reference[name], runs[test_name], f"cpm {name} → {test_name}, {_(gyro.name)}", backend
            )
            estimate, truth = fitted_drive(fit, vehicle_file), fitted_drive(reference[name], car)
            fits.append(fit)
            joint_std = np.hypot(estimate.std, truth.std)
            is_covered.append(np.abs(estimate.value - truth.value) <= QUANTILE_95 * joint_std)
            width.append(QUANTILE_95 * estimate.std / np.abs(estimate.value))
    return study_rows + interval_rows(np.array(is_covered), np.array(width)) + message_rows(fits[-1], runs)


def held_out_rows(fit: Fit, reference: Fit, run: Run, label: str, backend: str) -> list[TableRow]:
    """Return the rows on the simulated speed of `run`, which neither `fit` nor `reference` has used."""
    car = reference.vehicle_file  # odometer and gyro unchanged: only the model is evaluated
    fitted_car = car.with_values(
        {name: float(fit.value(name)) for name in FREE if np.isfinite(fit.value(name))}
    )
    error = [float(predict_run(model, run, backend).rmse[0]) for model in (fitted_car, car)]
    criterion = MAX_SPEED_ERROR_RATIO * error[1]
    ratio = _("speed error, divided by the error of the odometer's fit")
    return [
        maximum_row(label, ratio, error[0] / error[1], MAX_SPEED_ERROR_RATIO),
        criterion_row(
            label, _("speed error [m/s rms]"), error[0], f"≤ {number(criterion):.3f}", error[0] <= criterion
        ),
    ]


def fitted_drive(fit: Fit, vehicle_file: VehicleFile) -> FittedDrive:
    """Return gain, frictions and the steady speed on a straight path, with their standard errors."""
    entries = [fit.names.index(name) for name in DRIVE_PARAMETERS]
    gain, viscous, dry = (fit.value(name) for name in DRIVE_PARAMETERS[:3])
    effort = TEST_THROTTLE - float(vehicle_file.vehicle.drivetrain.dead_zone_forward[0])
    speed = (gain * effort - dry) / viscous
    gradient = np.array([effort, -speed, -1.0, 0.0]) / viscous
    cov = np.nan_to_num(fit.cov[np.ix_(entries, entries)])
    value = np.append(fit.estimate[entries], speed)
    stds = np.append(fit.std[entries], np.sqrt(gradient @ cov @ gradient))
    return FittedDrive(value, stds)


def interval_rows(is_covered: np.ndarray, width: np.ndarray) -> list[TableRow]:
    """Return the rows on the coverage and the width of the intervals, from arrays (cases, 5)."""
    coverage = float(np.mean(is_covered))
    table_rows = [minimum_row("cpm", _("intervals that contain the odometer's fit"), coverage, MIN_COVERAGE)]
    for k, name in enumerate(QUANTITY_NAMES):
        if np.isfinite(MAX_WIDTHS[k]):
            max_width, quantity = float(np.max(width[:, k])), _("widest of {name}, ± parts", name=_(name))
            table_rows.append(maximum_row("cpm", quantity, max_width, MAX_WIDTHS[k]))
    return table_rows


def message_rows(fit: Fit, runs: dict[str, Run]) -> list[TableRow]:
    """Return the rows on the messages about the gyro's scale and about a run beyond the range of the fit."""
    is_reported = any(message.code == "identifiability.gyro-scale" for message in fit.always_unobservable)
    is_outside = bool(fit.envelope.range_warnings(runs["a"]))  # a fit of run b
    return [
        message_row("cpm", _("the gyro's scale is reported as not identifiable"), is_reported),
        message_row("cpm b → a", _("the run that leaves the envelope is flagged"), is_outside),
    ]
