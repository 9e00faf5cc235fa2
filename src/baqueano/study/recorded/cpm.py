"""Fit a model to one run of a real 1:18 car (CPM Lab µCar) under a camera, and evaluate it on the other run.

From the garage's file of this car only the dimensions are used. Gyro and odometer are treated as perfect, and the
delay is 0. The model begins with only a gain, viscous drag and the steering. Its other terms are chosen on the run
itself (selection/choose.py); the effect of the logged battery voltage is one of the candidates. The criterion is
the speed of the whole other run, simulated from throttle and servo only, in the odometer's unit.

The scale of the gyro and the clock of the camera are calibrated against the camera (calibration/against_truth.py).
First the clock shift that the map adds to the camera is removed, so that the camera has its raw clock.
"""

from collections.abc import Callable

from baqueano.calibration.against_truth import calibrate
from baqueano.calibration.result import Calibration
from baqueano.contracts.values import TableRow
from baqueano.identify import FitOptions
from baqueano.messages import text
from baqueano.messages.language import translate as _
from baqueano.runs import Run
from baqueano.runs.importing import import_run
from baqueano.runs.maps.column_map import load_map
from baqueano.selection.choice import Choice, Decision
from baqueano.selection.choose import choose
from baqueano.study.recorded.criteria import criterion_row, minimum_row, within
from baqueano.validation.held_out import validate
from baqueano.vehicle_file import load

MAPS = {"a": "cpm_run_a", "b": "cpm_run_b"}
SENSORS_USED = ("odometer", "imu[2]")
NEUTRAL_VALUES = {
    "sensors.imu.gyro_scale": 1.0,
    "sensors.imu.gyro_bias": 0.0,
    "sensors.odometer.scale": 1.0,
    "model.drivetrain.battery_v": 7.4,  # two cells, with the printed voltage
    "model.drivetrain.battery_nominal_v": 7.4,
}
MIN_EXPLAINED = {"a": 0.94, "b": 0.98}  # part of the variance of the other run's speed, by the run of the fit
GYRO_SCALE, GYRO_SCALE_TOLERANCE = 0.966, 0.003  # true rotation per measured rotation of the gyro
# added to the truth's timestamps, by correlation
CLOCK_S, CLOCK_TOLERANCE_S = {"a": 0.045, "b": 0.040}, 0.010
DRY_TERMS = {"dry friction", "dead zone", "dead zone forward", "dead zone backward"}
BATTERY_TERM = "battery voltage"
CAR = "cpm_mucar"


def rows(progress: Callable[[str], None] = lambda text: None, backend: str = "auto") -> list[TableRow]:
    """Return the rows of the study, with recording, quantity, value, criterion and ok.

    Raise FileError without recordings.
    """
    runs = {name: with_raw_clock(name) for name in MAPS}
    car = load("car").with_values(NEUTRAL_VALUES)
    study_rows = []
    for name, test_name in (("a", "b"), ("b", "a")):
        progress(
            _(
                "CPM: choosing a model on run {name}, {duration_s:.0f} s",
                name=name,
                duration_s=runs[name].duration_s,
            )
        )
        choice = choose(runs[name], car, use=SENSORS_USED, options=FitOptions(backend=backend))
        study_rows += choice_rows(choice, runs[test_name], name, test_name)
    for name, run in runs.items():
        progress(_("CPM: gyro and clock of run {name} by its camera", name=name))
        study_rows += calibration_rows(calibrate(run, car), name)
    return study_rows


def with_raw_clock(name: str) -> Run:
    """Return run "a" or "b" with the camera on its own clock."""
    column_map = load_map(MAPS[name])
    camera = column_map.files["camera"]._replace(shift_s=0.0)
    return import_run(column_map._replace(files={**column_map.files, "camera": camera})).run


def choice_rows(choice: Choice, other_run: Run, name: str, other_name: str) -> list[TableRow]:
    """Return the rows on the speed of the other run, the chosen terms and the battery."""
    figures = {figure.channel: figure for figure in validate(choice.fit, other_run).figures}
    share = figures["odometer[0]"].explained_fraction
    dry_terms = DRY_TERMS.intersection(choice.selected_terms)
    battery = next(result for result in choice.term_results if result.term.name == BATTERY_TERM)
    criterion = _("{name} → {other}: speed explained", name=name, other=other_name)
    terms, names = _("{name}: terms added", name=name), ", ".join(map(_, choice.selected_terms))
    battery_term, is_added = f"{name}: {_(BATTERY_TERM)}", battery.verdict == Decision.ADDED
    return [
        minimum_row(CAR, criterion, share, MIN_EXPLAINED[name]),
        criterion_row(CAR, terms, names, _("dry friction or dead zone"), bool(dry_terms)),
        criterion_row(CAR, battery_term, text(battery.message), _("not added"), not is_added),
    ]


def calibration_rows(calibration: Calibration, name: str) -> list[TableRow]:
    """Return the rows on gyro scale and camera clock; a file's gyro_scale is measured rotation per true rotation."""
    turn, offset = 1.0 / calibration.value("sensors.imu.gyro_scale"), calibration.value("clock.truth")
    scale = _("{name}: truth / gyro (1 / gyro_scale)", name=name)
    clock = _("{name}: clock of the truth [s]", name=name)
    return [
        within(CAR, scale, turn, GYRO_SCALE, GYRO_SCALE_TOLERANCE),
        within(CAR, clock, offset, CLOCK_S[name], CLOCK_TOLERANCE_S),
    ]
