"""Identify robots of the independent truth. Each gets the vehicle file that its owner would obtain.

The gyro scale has an error of up to ± 3 % (corridor/vehicles.py). The gyro stays uncalibrated, or two turns on a mark
calibrate it before the experiment, as in `baqueano drive`. The file of a robot without a fix is identified from the
experiment only. The files with a fix also use laps of a rectangle over tags, because these laps show the speed error
of the model.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baqueano.diagnostics import Verdict
from baqueano.drive.closure import closure
from baqueano.drive.recording import MARK_SOURCE
from baqueano.errors import AnswerNo
from baqueano.identify import FitOptions, identify
from baqueano.identify.noise.covariances import measure_noise
from baqueano.messages.language import mark as N_
from baqueano.runs import Run
from baqueano.runs.logs import Event
from baqueano.runs.run import Channel
from baqueano.signals import NANOSECONDS
from baqueano.simulate.open_loop import tick_times
from baqueano.study.corridor.vehicles import switched_on_anew, vehicles
from baqueano.study.driving import FREE, SHAPES, experiments, guess
from baqueano.study.laps.drives import RATE_HZ, STEP_S, Team, TeamWithFix, follow
from baqueano.study.laps.fixes import with_fix
from baqueano.study.truth import PassingFaults, Robots, TruthWorld
from baqueano.symbolic import function
from baqueano.vehicle_file import VehicleFile

LEARNING_LAPS, SPEED_M_S = 5, 0.3
GYROS = (N_("uncalibrated"), N_("calibrated"))
STANDING_S, TURNS, MAX_TURN_S = 3.0, 2, 20.0
TURN_U, MARK_RAD = (
    0.6,
    np.radians(2.0),
)  # command during the turns; standard deviation of the heading at the final mark


class Teams(NamedTuple):
    """Robots whose fits were not refused, after they were switched on again."""

    alone: Team  # with files from the experiment only
    learned: Team  # with files that also use laps over tags
    refused: list[int]  # seeds whose fit was refused


def identify_teams(seeds: range, gyro: str, backend: str, learns: bool = True) -> Teams:
    """Return the robots of the seeds with their files; without `learns`, the group `learned` is empty."""
    robots, options = vehicles(seeds), FitOptions(backend=backend)
    starts = calibrate(robots, seeds) if gyro == "calibrated" else [guess()] * len(seeds)
    runs = experiments(robots, seeds)
    fits = [identify(run, start, FREE, options=options) for run, start in zip(runs, starts, strict=True)]
    usable = [k for k, fit in enumerate(fits) if fit.verdict != Verdict.REFUSED]
    files = [fits[k].vehicle_file for k in usable]
    alone = [
        measure_noise(fits[k], runs[k], backend=backend).updated_file(fits[k].vehicle_file) for k in usable
    ]
    names = [seeds[k] for k in usable]
    learned = (
        _identify_with_laps(Team(files, robots.subset(usable), names), [runs[k] for k in usable], backend)
        if learns
        else {}
    )
    accepted = [k for k, name in enumerate(names) if name in learned or not learns]
    names, alone = [names[k] for k in accepted], [alone[k] for k in accepted]
    anew = switched_on_anew(robots.subset([name - seeds[0] for name in names]), names, alone)
    others = [learned[name] for name in names if name in learned]
    refusals = [seed for seed in seeds if seed not in names]
    return Teams(Team(alone, anew, names), Team(others, anew, names if learns else []), refusals)


def _identify_with_laps(team: Team, runs: list[Run], backend: str) -> dict[int, VehicleFile]:
    """Return seed → file identified from an experiment and laps over tags; a refused fit does not have an entry."""
    route, vehicle_file_of = SHAPES["rectangle"](SPEED_M_S), {}
    (laps,) = follow(route, LEARNING_LAPS, [TeamWithFix(team, "tags", PassingFaults())], backend, log=True)
    for vehicle_file, seed, run, laps_run in zip(
        team.vehicle_files, team.seeds, runs, laps.runs, strict=True
    ):
        runs_of_robot, start = [run, laps_run], with_fix(vehicle_file, "tags", route)
        fit = identify(runs_of_robot, start, FREE, use=("imu",), options=FitOptions(backend=backend))
        if fit.verdict != Verdict.REFUSED:
            noise = measure_noise(fit, runs_of_robot, backend=backend)
            vehicle_file_of[seed] = noise.updated_file(fit.vehicle_file, vehicle_file.name)
    return vehicle_file_of


def calibrate(robots: Robots, seeds: Sequence[int]) -> list[VehicleFile]:
    """Return the guess with the gyro scale of each robot by two turns; unchanged if the turns do not determine it."""
    vehicle_files = []
    for run in turned_twice(robots, seeds):
        try:
            vehicle_files.append(guess().with_values(closure(run, guess()).values))
        except AnswerNo:
            vehicle_files.append(guess())
    return vehicle_files


def turned_twice(robots: Robots, seeds: Sequence[int]) -> list[Run]:
    """Return a run of each robot: it rests, then turns twice, with a mark event before and after the turns."""
    n, vehicle_file = len(seeds), guess()
    world = TruthWorld(robots, [seed + 7_000 for seed in seeds], step_s=STEP_S, fast=function)
    t_ns = tick_times(round(MAX_TURN_S * RATE_HZ), RATE_HZ)
    mark_error_rad = np.array([np.random.default_rng([seed, 61]).normal(0.0, MARK_RAD) for seed in seeds])
    end, ends, current_u = 2.0 * np.pi * TURNS + mark_error_rad, np.full(n, np.nan), np.zeros((n, 3))
    u, z, psi = np.zeros((len(t_ns), n, 3)), np.zeros((len(t_ns), n, 3)), np.zeros(n)
    for k, t in enumerate(t_ns.tolist()):
        previous_psi, z[k], u[k] = psi, world.tick(current_u, 1.0 / RATE_HZ), current_u
        psi = world.truth.eta[:, 2]
        # The fraction of the tick after the end of the turns.
        overshoot_fraction = (psi - end) / np.maximum(psi - previous_psi, 1e-9)
        ends = np.where(np.isnan(ends) & (psi >= end), t - overshoot_fraction / RATE_HZ * NANOSECONDS, ends)
        turns = (k >= STANDING_S * RATE_HZ) & np.isnan(ends)
        current_u = np.column_stack([np.zeros((n, 2)), np.where(turns, TURN_U, 0.0)])
    begin_ns = round(STANDING_S * NANOSECONDS)
    marks = [[begin_ns, round(end_ns)] if np.isfinite(end_ns) else [] for end_ns in ends.tolist()]
    return [
        Run(
            f"turns {seed}", None, t_ns, u[:, i], sensors={"imu": Channel(t_ns, t_ns, z[:, i])},
            vehicle_text=vehicle_file.text, metadata={"kind": "drive", "rate_hz": f"{RATE_HZ:g}"},
            events=tuple(Event(t, "info", MARK_SOURCE, "") for t in marks[i]),
        )
        for i, seed in enumerate(seeds)
    ]  # fmt: skip
