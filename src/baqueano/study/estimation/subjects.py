"""Runs for the fit and runs for the evaluation, with the initial vehicle file of the fit.

    cpm             a car of 1:18 under a camera, two runs: a fit to each run is evaluated on the other run
    dart            a JetRacer of 1:10 under a Vicon, two runs of free driving: evaluated as cpm
    dart bag        the same car on another day, a ROS bag: each fit of dart is evaluated on it

Each subject is evaluated with its IMU only (without the odometer in file and run), and with both sensors.
"""

import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from baqueano.runs import Run
from baqueano.runs.importing import import_run, import_runs
from baqueano.study.recordings import missing_paths, recorded_path
from baqueano.vehicle_file import VehicleFile, load, parse

IMU, BOTH = "imu", "imu + odometer"
SENSOR_SETS = {IMU: ("imu",), BOTH: ("imu", "odometer")}
FREE_DRIVING = "dart_jetracer/free_driving_*.csv.gz"
BAG = "dart_jetracer/4_sept_random_driving_slow.bag"
CPM = ("cpm_mucar/run_a_vehicle.csv.gz", "cpm_mucar/run_b_vehicle.csv.gz")
RECORDED_FOLDER = Path(__file__).parent.parent / "recorded"


class Subject(NamedTuple):
    """A vehicle with a run for the fit and a run for the evaluation."""

    name: str
    vehicle_file: VehicleFile
    fit_run: Run
    test_run: Run
    free: tuple[str, ...] | None = None  # free parameters; None: the defaults of `identify`


def cpm() -> list[Subject]:
    """Return the two CPM subjects: one is fitted to run a and evaluated on run b, the other one vice versa."""
    return _cross_validation_subjects(
        "cpm", load("car"), {"a": import_run("cpm_run_a").run, "b": import_run("cpm_run_b").run}
    )


def dart() -> list[Subject]:
    """Return the two DART subjects: one is fitted to run 1 and evaluated on run 2, the other one vice versa."""
    pattern = str(recorded_path("dart_jetracer").parent / FREE_DRIVING)
    runs = [imported_run.run for imported_run in import_runs("dart_jetracer_vicon", [pattern])]
    return _cross_validation_subjects(
        "dart", load(RECORDED_FOLDER / "jetracer.toml"), dict(zip("12", runs, strict=True))
    )


def dart_bag() -> list[Subject]:
    """Return two subjects: each is fitted to one run of free driving and evaluated on the bag."""
    bag = import_run("dart_jetracer_bag").run
    return [subject._replace(name=f"{subject.name[:6]} → bag", test_run=bag) for subject in dart()]


SUBJECTS: dict[str, tuple[Callable[[], list[Subject]], tuple[str, ...]]] = {
    "cpm": (cpm, CPM),
    "dart": (dart, (FREE_DRIVING,)),
    "dart bag": (dart_bag, (FREE_DRIVING, BAG)),
}


def missing_files(name: str) -> list[str]:
    """Return the files of the recordings `name` that are missing."""
    return missing_paths(SUBJECTS[name][1])


def with_sensors(vehicle_file: VehicleFile, names: tuple[str, ...]) -> VehicleFile:
    """Return the file with only the sensors `names`; its estimator uses all of these sensors."""
    text = vehicle_file.text
    for name in set(vehicle_file.sensors._fields) - set(names):
        text = re.sub(rf"^\[sensors\.{name}\].*?(?=^\[|\Z)", "", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"^use = .*\n", "", text, flags=re.MULTILINE)
    return parse(text, vehicle_file.name).with_values({"estimator.use": list(names)})


def _cross_validation_subjects(name: str, vehicle_file: VehicleFile, runs: dict[str, Run]) -> list[Subject]:
    (a, first), (b, second) = runs.items()
    return [
        Subject(f"{name} {a} → {b}", vehicle_file, first, second),
        Subject(f"{name} {b} → {a}", vehicle_file, second, first),
    ]
