"""Identify robots of the independent truth. Each uses the vehicle file that its owner would obtain.

The gyro scale has an error of up to ± 3 % (corridor/vehicles.py). The gyro stays uncalibrated, or two turns on a mark
calibrate it before the experiment, as in `baqueano drive`. Or a taught lap, which a person drives from a mark back to
this mark, calibrates it after the experiment, as in `baqueano teach --closed`. The file of a robot without a fix is
identified from the experiment only. The files with a fix also use laps of a rectangle over tags, because these laps
show the speed error of the model.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baqueano.diagnostics import Verdict
from baqueano.drive.closure import closure, lap_closure
from baqueano.drive.recording import MARK_SOURCE
from baqueano.errors import AnswerNo
from baqueano.guides.repeat import Repeat
from baqueano.identify.noise.covariances import measure_noise
from baqueano.identify.result.fit_result import Fit
from baqueano.messages.language import mark as N_
from baqueano.runs import Run
from baqueano.runs.logs import Event
from baqueano.signals import NANOSECONDS, Reference, Slot, Tick
from baqueano.simulate.open_loop import tick_times
from baqueano.study.corridor.vehicles import switch_on_again, vehicles
from baqueano.study.counterpart import logged_run
from baqueano.study.driving import SHAPES, identify_by_advice, initial_file, simulate_experiments
from baqueano.study.laps.drives import RATE_HZ, STEP_S, FixTeam, Team, simulate_laps
from baqueano.study.laps.fixes import with_fix
from baqueano.study.truth import PassingFaults, Robots, TruthWorld
from baqueano.study.truth_drives import Loop, estimate_at
from baqueano.symbolic import function
from baqueano.vehicle_file import VehicleFile

LEARNING_LAPS, SPEED_M_S = 5, 0.3
GYROS = (N_("uncalibrated"), N_("calibrated"), N_("taught"))
STANDING_S, SETTLE_S, TURNS, MAX_TURN_S = 3.0, 1.0, 2, 20.0
TURN_U = 0.6  # command during the turns
MARK_M, MARK_RAD = 0.01, np.radians(2.0)  # standard deviations of the place and the heading at the final mark


class Teams(NamedTuple):
    """Robots whose fits were not refused, after they were switched on again."""

    experiment_team: Team  # with files from the experiment only
    lap_team: Team  # with files that also use laps over tags
    refused_robots: list[int]  # seeds whose fit was refused


def identify_teams(seeds: range, gyro: str, backend: str, with_laps: bool = True) -> Teams:
    """Return the robots of the seeds with their files; without `with_laps`, the group `lap_team` is empty."""
    robots = vehicles(seeds)
    starts = calibrate_by_turns(robots, seeds) if gyro == "calibrated" else [initial_file()] * len(seeds)
    runs = simulate_experiments(robots, seeds)
    fits = [identify_by_advice(run, start, backend) for run, start in zip(runs, starts, strict=True)]
    if gyro == "taught":
        fits = [
            identify_by_advice(run, start, backend)
            for run, start in zip(runs, calibrate_by_lap(robots, seeds, fits, runs), strict=True)
        ]
    usable = [k for k, fit in enumerate(fits) if fit.verdict != Verdict.REFUSED]
    files = [fits[k].vehicle_file for k in usable]
    ekf_files = [
        measure_noise(fits[k], runs[k], backend=backend).updated_file(fits[k].vehicle_file) for k in usable
    ]
    names = [seeds[k] for k in usable]
    learned_files = (
        _identify_with_laps(Team(files, robots.subset(usable), names), [runs[k] for k in usable], backend)
        if with_laps
        else {}
    )
    accepted_indices = [k for k, name in enumerate(names) if name in learned_files or not with_laps]
    names, ekf_files = [names[k] for k in accepted_indices], [ekf_files[k] for k in accepted_indices]
    fleet = switch_on_again(robots.subset([name - seeds[0] for name in names]), names, ekf_files)
    other_files = [learned_files[name] for name in names if name in learned_files]
    refusals = [seed for seed in seeds if seed not in names]
    return Teams(
        Team(ekf_files, fleet, names), Team(other_files, fleet, names if with_laps else []), refusals
    )


def _identify_with_laps(team: Team, runs: list[Run], backend: str) -> dict[int, VehicleFile]:
    """Return seed → file identified from an experiment and laps over tags; a refused fit does not have an entry."""
    route, file_by_name = SHAPES["rectangle"](SPEED_M_S), {}
    (laps,) = simulate_laps(route, LEARNING_LAPS, [FixTeam(team, "tags", PassingFaults())], backend, log=True)
    for vehicle_file, seed, run, laps_run in zip(
        team.vehicle_files, team.seeds, runs, laps.runs, strict=True
    ):
        robot_runs, start = [run, laps_run], with_fix(vehicle_file, "tags", route)
        fit = identify_by_advice(robot_runs, start, backend, ("imu",))
        if fit.verdict != Verdict.REFUSED:
            noise = measure_noise(fit, robot_runs, backend=backend)
            file_by_name[seed] = noise.updated_file(fit.vehicle_file, vehicle_file.name)
    return file_by_name


def calibrate_by_turns(robots: Robots, seeds: Sequence[int]) -> list[VehicleFile]:
    """Return the guess with the gyro scale of each robot by two turns; unchanged if the turns do not determine it."""
    vehicle_files = []
    for run in simulate_two_turns(robots, seeds):
        try:
            vehicle_files.append(initial_file().with_values(closure(run, initial_file()).values))
        except AnswerNo:
            vehicle_files.append(initial_file())
    return vehicle_files


def calibrate_by_lap(
    robots: Robots, seeds: Sequence[int], fits: Sequence[Fit], runs: Sequence[Run]
) -> list[VehicleFile]:
    """Return the guess with the gyro scale of each robot by a taught lap; unchanged for a refused fit."""
    files = [
        initial_file()
        if fit.verdict == Verdict.REFUSED
        else measure_noise(fit, run).updated_file(fit.vehicle_file)
        for fit, run in zip(fits, runs, strict=True)
    ]
    laps = simulate_taught_laps(robots, seeds, files)
    return [
        initial_file() if fit.verdict == Verdict.REFUSED else _with_lap_scale(lap, vehicle_file)
        for fit, lap, vehicle_file in zip(fits, laps, files, strict=True)
    ]


def _with_lap_scale(lap: Run, vehicle_file: VehicleFile) -> VehicleFile:
    try:
        return initial_file().with_values(lap_closure(lap, vehicle_file, MARK_M).values)
    except AnswerNo:
        return initial_file()


def simulate_taught_laps(
    robots: Robots, seeds: Sequence[int], files: Sequence[VehicleFile], ends: np.ndarray | None = None
) -> list[Run]:
    """Return a lap of each robot, driven by a person: a rest on the mark, a lap, and a rest on the mark.

    The person estimates the pose of the robot with an error that grows up to the error of the final mark. With `ends`
    (n, 3) the person stops at these poses relative to the mark.
    """
    route, n = SHAPES["rectangle"](SPEED_M_S), len(seeds)
    world = TruthWorld(
        robots, [seed + 9_000 for seed in seeds], np.tile(route.eta[0], (n, 1)), STEP_S, fast=function
    )
    errors = np.array(
        [[MARK_M, MARK_M, MARK_RAD] * random_generator(seed, 62).standard_normal(3) for seed in seeds]
    )
    errors = errors if ends is None else errors - ends
    loops = [Loop(vehicle_file, perfect=True, backend="auto") for vehicle_file in files]
    guide = Repeat.along(route)
    states, progress = [loop.start(route.eta[0]) for loop in loops], guide.init()
    begin_s, end_s = STANDING_S, STANDING_S + guide.duration_s + SETTLE_S
    t_ns = tick_times(round((end_s + STANDING_S) * RATE_HZ), RATE_HZ)
    u, z, current_u = np.zeros((len(t_ns), n, 3)), np.zeros((len(t_ns), n, 3)), np.zeros((n, 3))
    for k, t in enumerate(t_ns.tolist()):
        z[k], u[k] = world.tick(current_u, 1.0 / RATE_HZ), current_u
        now, t_s = world.truth, t / NANOSECONDS
        reference = Reference(t, route.eta[0], np.zeros(3), 0.0)
        if t_s >= begin_s:
            progress, reference = guide.step(progress, estimate_at(t))
        perceived_eta = now.eta + errors * np.clip((t_s - begin_s) / (end_s - begin_s), 0.0, 1.0)
        for i, loop in enumerate(loops):
            slot = Slot(1.0, np.concatenate([perceived_eta[i], now.nu[i]]))
            states[i], (command, _) = loop.step(states[i], Tick(t, u[k, i], loop.slots(slot)), reference)
            current_u[i] = command if begin_s <= t_s < end_s else 0.0
    return [
        logged_run(f"lap {seed}", files[i], t_ns, u[:, i], z[:, i], "teach") for i, seed in enumerate(seeds)
    ]


def random_generator(seed: int, stream: int) -> np.random.Generator:
    """Return the random numbers of a robot; each stream is independent."""
    return np.random.default_rng([seed, stream])


def simulate_two_turns(robots: Robots, seeds: Sequence[int]) -> list[Run]:
    """Return a run of each robot: it rests, then turns twice, with a mark event before and after the turns."""
    n, vehicle_file = len(seeds), initial_file()
    world = TruthWorld(robots, [seed + 7_000 for seed in seeds], step_s=STEP_S, fast=function)
    t_ns = tick_times(round(MAX_TURN_S * RATE_HZ), RATE_HZ)
    mark_error_rad = np.array([random_generator(seed, 61).normal(0.0, MARK_RAD) for seed in seeds])
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
        logged_run(
            f"turns {seed}", vehicle_file, t_ns, u[:, i], z[:, i], "drive",
            events=tuple(Event(t, "info", MARK_SOURCE, "") for t in marks[i]),
        )
        for i, seed in enumerate(seeds)
    ]  # fmt: skip
