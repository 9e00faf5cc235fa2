"""Fit the micromouse "Algernon" (opatiny/micromouse): duty and the steady speed of both wheels after each step.

Gain, both dead zones (forward and backward) and coast of each motor are fitted to one sweep. Its steps are 5 of 255,
each for 2 s. The fit is compared with a sweep of another day and battery, in steps of 1. The dead band is the mean of
both wheels and directions, in units of the duty. It is compared with the duty at which the wheels of the other sweep
begin to turn. There the left wheel sticks forward until 65 and then turns suddenly. A dead zone cannot model this.
The asymmetry is the modelled excess speed of the right wheel, over the commands at which both wheels turned.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from baqueano.contracts.values import TableRow
from baqueano.identify import Fit, FitOptions, identify
from baqueano.messages.language import number, translate as _
from baqueano.runs import Run
from baqueano.runs.importing import import_run
from baqueano.study.recorded.criteria import criterion_row, minimum_row, within
from baqueano.study.recorded.simulated import measured_and_simulated
from baqueano.study.recordings import recorded_path
from baqueano.vehicle_file import load

FITTED_SWEEP, OTHER_SWEEP = "wheelSpeedCalibration2.csv", "wheelSpeedCalibration3.csv"
FREE = (
    "model.drivetrain.gain",
    "model.drivetrain.dead_zone_forward",
    "model.drivetrain.dead_zone_backward",
    "model.drivetrain.coast",
)
FULL_DUTY = 255.0  # full duty in the author's unit
MIN_TURNING_M_S = 0.03  # 18 rpm, about one count of the encoders per measurement
DEAD_BAND_TOLERANCE = 0.10  # of the dead band: one step of the fitted sweep
ASYMMETRY, ASYMMETRY_TOLERANCE = 0.09, 0.02
MIN_EXPLAINED = 0.98  # of the speeds of a sweep with another battery, at most 5 % apart in voltage


def files() -> list[str]:
    """Return the names of the files that this study reads."""
    return [f"micromouse_pwm/{FITTED_SWEEP}", f"micromouse_pwm/{OTHER_SWEEP}"]


def rows(progress: Callable[[str], None] = lambda text: None, backend: str = "auto") -> list[TableRow]:
    """Return the rows of the study, with recording, quantity, value, criterion and ok."""
    progress(_("micromouse: fitting a sweep of the duty, testing on another sweep"))
    run, test_run = load_run(FITTED_SWEEP), load_run(OTHER_SWEEP)
    fit = fit_sweep(run, backend)
    band, threshold = dead_band(fit), starting_duty(test_run)
    wheel_asymmetry = asymmetry(fit, run, backend)
    z, simulated_values = measured_and_simulated(fit.vehicle_file, test_run, "wheels", backend)
    share = 1.0 - float(np.sum((z - simulated_values) ** 2) / np.sum((z - z.mean(axis=0)) ** 2))
    is_near = abs(band - threshold) <= DEAD_BAND_TOLERANCE * threshold
    name, criterion = "micromouse", f"{number(threshold):.1f} ± {100 * DEAD_BAND_TOLERANCE:.0f} %"
    percent = 100.0 * np.array([wheel_asymmetry, ASYMMETRY, ASYMMETRY_TOLERANCE])
    return [
        criterion_row(name, _("dead band [of 255]"), band, criterion, is_near),
        within(name, _("right wheel faster by [%]"), *percent.tolist()),
        minimum_row(name, _("held-out speeds explained"), share, MIN_EXPLAINED),
    ]


def load_run(file: str) -> Run:
    """Return the run of a sweep."""
    return import_run("micromouse_ms", [recorded_path(f"micromouse_pwm/{file}")]).run


def fit_sweep(run: Run, backend: str = "auto") -> Fit:
    """Return the fit of gains, dead zones and coast to one sweep."""
    return identify(
        run, load(Path(__file__).parent / "micromouse.toml"), FREE, options=FitOptions(backend=backend)
    )


def dead_band(fit: Fit) -> float:
    """Return the mean dead band of both wheels and directions [of 255]."""
    drivetrain = fit.vehicle_file.vehicle.drivetrain
    zones = np.concatenate([drivetrain.dead_zone_forward, drivetrain.dead_zone_backward])
    return FULL_DUTY * float(zones.mean())


def starting_duty(run: Run) -> float:
    """Return the duty [of 255] at which a wheel begins to turn, halfway between two steps.
    It is the mean over wheels and directions.
    """
    duty = FULL_DUTY * run.applied_commands[:, 0]
    speed = run.sensors["wheels"].z[-len(run.applied_commands) :]
    thresholds = []
    for wheel in speed.T:
        for direction in (1.0, -1.0):
            has_direction = direction * duty > 0.0
            duty_magnitude = direction * duty[has_direction]
            is_turning = direction * wheel[has_direction] > MIN_TURNING_M_S
            thresholds.append(0.5 * (duty_magnitude[~is_turning].max() + duty_magnitude[is_turning].min()))
    return float(np.mean(thresholds))


def asymmetry(fit: Fit, run: Run, backend: str = "auto") -> float:
    """Return the modelled excess speed of the right wheel, as a fraction, over the rows in which both wheels turned."""
    z, simulated_values = measured_and_simulated(fit.vehicle_file, run, "wheels", backend)
    is_turning = (np.abs(z) > MIN_TURNING_M_S).all(axis=1)
    left, right = np.abs(simulated_values[is_turning]).sum(axis=0)
    return float(right / left - 1.0)
