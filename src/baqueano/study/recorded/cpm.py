"""A real car of 1:18 (CPM Lab µCar), driven twice under a camera: chosen and fitted on one run, judged on the other.

Nothing that the garage's file of this car says of it is used but its tape measure: gyro and odometer count as
perfect, the delay is 0, and the model begins bare, with a gain, viscous drag and what steers. What else it has is
chosen on the run itself (selection/selection.py), the effect of the logged battery among the candidates. Judged is the
speed of the whole other run, simulated from throttle and servo alone, in the odometer's own unit.

The scale of the gyro and the clock of the camera are calibrated against the camera (identify/sensor_calibration.py),
which begins on its own clock: what the map adds to it is taken off first.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

from baqueano.identify import FitOptions
from baqueano.identify.selection.choice import Choice, Decision
from baqueano.identify.selection.selection import choose
from baqueano.identify.sensor_calibration import Calibration, calibrate
from baqueano.identify.validation import validate
from baqueano.language import number
from baqueano.language import translated as _
from baqueano.messages import text
from baqueano.runs import Run
from baqueano.runs.importing import import_run
from baqueano.runs.maps.column_map import load_map
from baqueano.study.recorded.bars import row
from baqueano.vehicle_file import load

if TYPE_CHECKING:
    from baqueano.contracts.values import TableRow
    from baqueano.identify.selection.choice import Choice
    from baqueano.runs import Run

MAPS = {"a": "cpm_run_a", "b": "cpm_run_b"}
USE = ("odometer", "imu[2]")
NEUTRAL = {
    "sensors.imu.gyro_scale": 1.0,
    "sensors.imu.gyro_bias": 0.0,
    "sensors.odometer.scale": 1.0,
    "model.drivetrain.battery_v": 7.4,  # two cells, as printed on them
    "model.drivetrain.battery_nominal_v": 7.4,
}
EXPLAINED = {"a": 0.94, "b": 0.98}  # of the variance of the other run's speed, by the run that was fitted
GYRO, NEAR = 0.966, 0.003  # what the truth turns per turn of the gyro
CLOCK_S, CLOSE_S = {"a": 0.045, "b": 0.040}, 0.010  # to be added to the truth's stamps, by correlation
DRY = {"dry friction", "dead zone", "dead zone forward", "dead zone backward"}
BATTERY = "battery voltage"
CAR = "cpm_mucar"


def rows(say: Callable[[str], None] = lambda text: None, backend: str = "auto") -> list["TableRow"]:
    """recording, quantity, value, bar, ok. FileError where the recordings are missing."""
    runs = {name: with_raw_clock(name) for name in MAPS}
    car = load("car").with_values(NEUTRAL)
    out = []
    for name, test_name in (("a", "b"), ("b", "a")):
        say(
            _(
                "CPM: choosing a model on run {name}, {duration_s:.0f} s",
                name=name,
                duration_s=runs[name].duration_s,
            )
        )
        choice = choose(runs[name], car, use=USE, options=FitOptions(backend=backend))
        out += of_choice(choice, runs[test_name], name, test_name)
    for name, run in runs.items():
        say(_("CPM: gyro and clock of run {name} by its camera", name=name))
        out += of_calibration(calibrate(run, car), name)
    return out


def with_raw_clock(name: str) -> "Run":
    """Run "a" or "b", the camera on its own clock."""
    column_map = load_map(MAPS[name])
    camera = column_map.files["camera"]._replace(shift_s=0.0)
    return import_run(column_map._replace(files={**column_map.files, "camera": camera})).run


def of_choice(choice: "Choice", other_run: "Run", name: str, other: str) -> list["TableRow"]:
    """Speed of the other run, the terms, the battery."""
    figures = {figure.channel: figure for figure in validate(choice.fit, other_run).figures}
    share, bar = figures["odometer[0]"].explained, EXPLAINED[name]
    dry = DRY.intersection(choice.taken)
    battery = next(judgement for judgement in choice.judged if judgement.term.name == BATTERY)
    return [
        row(
            CAR,
            _("{name} → {other}: speed explained", name=name, other=other),
            share,
            f"≥ {number(bar):g}",
            share >= bar,
        ),
        row(
            CAR,
            _("{name}: terms taken", name=name),
            ", ".join(map(_, choice.taken)),
            _("dry friction or dead zone"),
            bool(dry),
        ),
        row(
            CAR,
            f"{name}: {_(BATTERY)}",
            text(battery.message),
            _("not taken"),
            battery.verdict != Decision.TAKEN,
        ),
    ]


def of_calibration(calibration: Calibration, name: str) -> list["TableRow"]:
    """Gyro and clock. The vehicle file's gyro_scale is the inverse: what the gyro says of a turn."""
    turn, offset = 1.0 / calibration.value("sensors.imu.gyro_scale"), calibration.value("clock.truth")
    near = abs(turn - GYRO) <= NEAR
    close = abs(offset - CLOCK_S[name]) <= CLOSE_S
    return [
        row(
            CAR,
            _("{name}: truth / gyro (1 / gyro_scale)", name=name),
            turn,
            f"{number(GYRO):g} ± {number(NEAR):g}",
            near,
        ),
        row(
            CAR,
            _("{name}: clock of the truth [s]", name=name),
            offset,
            f"{number(CLOCK_S[name]):g} ± {number(CLOSE_S):g}",
            close,
        ),
    ]
