"""`baqueano study laps`: drive fifty laps with an IMU, an identified model, and a position sensor (a fix).

Robots of the independent truth (corridor/vehicles.py: gyro within ± 3 %, wheels that differ by 2 %) are identified
(team.py) and switched on again. They follow three routes with each fix (fixes.py). In some cases all readings arrive.
In the others 20 % are missed, 10 % arrive twice and 5 % are mistaken for another mark. With an uncalibrated gyro, the
study compares the share of robots that stay on the route with the forecast. With only an IMU, the study tests the
coverage of the filter's region, and that the robot stops before a wall.
"""

from collections.abc import Callable, Sequence
from functools import partial
from math import erf, nan, sqrt

import numpy as np

from baqueano.compare.corridor import QUANTILE_95
from baqueano.compare.corridor_forecast import forecast_corridor
from baqueano.guides.route import Route
from baqueano.messages.language import mark as N_
from baqueano.study.driving import SHAPES
from baqueano.study.laps.drives import RATE_HZ, SAMPLE_TICKS, FixTeam, Team, simulate_laps
from baqueano.study.laps.fixes import FIXES, with_fix
from baqueano.study.laps.result import (
    MAX_DISTANCE_M,
    SETTLING_LAPS,
    FullDrive,
    Lap,
    LapCase,
    LapStudy,
    robot_laps,
)
from baqueano.study.laps.team import GYROS, SPEED_M_S, identify_teams
from baqueano.study.truth import PassingFaults
from baqueano.sweep.workers import run_in_batches
from baqueano.vehicle_file import VehicleFile

ROUTES = ("rectangle", "eight", "sinuous")
READ_FAULTS = {
    N_("no reading lost"): PassingFaults(),
    N_("faults"): PassingFaults(missed_rate=0.2, double_rate=0.1, mistaken_rate=0.05),
}
ROBOT_BATCH = 4  # robots in parallel


def study_fix_laps(
    seeds: int = 20, first: int = 0, count: int = 50, processes: int = 1, backend: str = "auto",
    cases: Sequence[LapCase] | None = None, advance: Callable[[int], None] = lambda k: None,
) -> LapStudy:  # fmt: skip
    """Return `count` laps of robots `first` … `first + seeds − 1`. `advance` is called with the number of robots that
    have just finished.
    """
    work = partial(run_cases, count=count, backend=backend, cases=all_cases() if cases is None else cases)
    results = run_in_batches(work, range(first, first + seeds), ROBOT_BATCH, processes, advance)
    drives = tuple(lap for _, batch_drives, _, _ in results for lap in batch_drives)
    full_drives = tuple(drive for _, _, batch_wholes, _ in results for drive in batch_wholes)
    refusals = {seed for *_, refused_seeds in results for seed in refused_seeds}
    completed_count = sum(robots for robots, *_ in results)
    return LapStudy(drives, full_drives, completed_count, count, tuple(sorted(refusals)))


def all_cases() -> list[LapCase]:
    """Return the cases of the study. A robot with an uncalibrated gyro drives only without a fix and over two tags."""
    return [
        LapCase(route, fix, gyro, read)
        for gyro in GYROS
        for route in ROUTES
        for fix in FIXES
        for read in READ_FAULTS
        if (gyro != "uncalibrated" or (fix in ("none", "tags") and read == "no reading lost"))
        and (fix != "none" or read == "no reading lost")
    ]


def run_cases(
    seeds: range, count: int, backend: str, cases: Sequence[LapCase]
) -> tuple[int, list[Lap], list[FullDrive], list[int]]:
    """Return the number of robots, their laps, their whole drives, and the seeds whose fit was refused."""
    drives: list[Lap] = []
    full_drives: list[FullDrive] = []
    refusals: list[int] = []
    for gyro in dict.fromkeys(case.gyro for case in cases):
        gyro_cases = [case for case in cases if case.gyro == gyro]
        robots = identify_teams(seeds, gyro, backend, any(case.fix != "none" for case in gyro_cases))
        refusals += robots.refused_robots
        for route in dict.fromkeys(case.route for case in gyro_cases):
            route_cases = [case for case in gyro_cases if case.route == route]
            teams = [
                robots.experiment_team if case.fix == "none" else robots.lap_team for case in route_cases
            ]
            new_drives, new_full_drives = drive_cases(route_cases, teams, count, backend)
            drives += new_drives
            full_drives += new_full_drives
    return len(seeds), drives, full_drives, refusals


def drive_cases(
    cases: Sequence[LapCase], teams: Sequence[Team], count: int, backend: str
) -> tuple[list[Lap], list[FullDrive]]:
    """Return the laps and the whole drives of the cases of one route; all robots drive in parallel."""
    if not teams[0].seeds:
        return [], []
    route, drives, full_drives = SHAPES[cases[0].route](SPEED_M_S), [], []
    teams_and_measures = [
        FixTeam(team, case.fix, READ_FAULTS[case.read]) for case, team in zip(cases, teams, strict=True)
    ]
    samples_per_lap = round(route.t_s[-1] * RATE_HZ / SAMPLE_TICKS)
    for case, team, team_result in zip(
        cases, teams, simulate_laps(route, count, teams_and_measures, backend), strict=True
    ):
        drives += robot_laps(team_result, case, team.seeds, count, samples_per_lap)
        is_forecast = (case.fix, case.gyro) == ("tags", "uncalibrated")
        for k, seed in enumerate(team.seeds):
            chance = forecast(team.vehicle_files[k], case.fix, route, count, backend) if is_forecast else nan
            full_drives.append(FullDrive(case, seed, bool(team_result.touches[k]), chance))
    return drives, full_drives


def forecast(vehicle_file: VehicleFile, fix: str, route: Route, count: int, backend: str) -> float:
    """Return the probability that a robot stays within MAX_DISTANCE_M of the route, from the predicted corridor of
    the first laps. It is 0 if the filter loses the vehicle in these laps.
    """
    corridor = forecast_corridor(
        with_fix(vehicle_file, fix, route), route, min(count, SETTLING_LAPS), backend, rest_s=0.0
    ).corridor
    if np.isfinite(corridor.loss_s):
        return 0.0
    return erf(MAX_DISTANCE_M * QUANTILE_95 / float(np.max(corridor.across_m)) / sqrt(2.0))
