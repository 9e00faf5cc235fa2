"""Laps in a closed loop: robots of the independent truth, each with its identified vehicle file.

All robots drive in parallel, each with its sensor of the position (a fix). As in `baqueano repeat`, a robot is stopped
by its supervisor, or if it might touch a wall of the room (room_watch.py). The walls are CLEARANCE_M from the body of a
vehicle on the route.
"""

from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from baqueano.compare.errors import cross_track
from baqueano.contracts.values import Tree
from baqueano.drive.safety.room_watch import RoomWatch
from baqueano.geometry import wrap
from baqueano.guides.repeat import Repeat
from baqueano.guides.route import Route
from baqueano.loop import Record
from baqueano.routes.room import Room, body_radius
from baqueano.runs import Run
from baqueano.runs.run import Channel
from baqueano.signals import NANOSECONDS, Command, Estimate, Reference, Slot, Tick
from baqueano.simulate.open_loop import tick_times
from baqueano.study.counterpart import logged_run
from baqueano.study.laps.fixes import FIXES, with_fix
from baqueano.study.truth import PassingFaults, Reader, Robots, TruthWorld, merge
from baqueano.study.truth_drives import Loop, estimate_at
from baqueano.symbolic import function
from baqueano.vehicle_file import VehicleFile

RATE_HZ = 100.0
STEP_S = 1e-2  # of the truth, for drives of hours: after 10 s the difference from steps of 1 ms is below 2 mm
REST_S = 3.0  # before the first lap: the filter estimates the bias of the gyro
SAMPLE_TICKS = 10  # ticks between two samples
CLEARANCE_M = 0.5  # between the walls and the body of a vehicle on its route


class Team(NamedTuple):
    """n robots in parallel, with their vehicle files and seeds."""

    vehicle_files: list[VehicleFile]
    robots: Robots
    seeds: list[int]


class FixTeam(NamedTuple):
    """A group of robots, its position sensor (tags, lines, gate or none), and the fault rates of that sensor."""

    team: Team
    fix: str
    faults: PassingFaults


class Laps(NamedTuple):
    """Drives of n robots, sampled T times, until the last robot has stopped."""

    error: np.ndarray  # (T, n, 3) of the estimate: x, y [m], heading [rad]
    cov: np.ndarray  # (T, n, 3, 3) of the estimate
    cross_track_m: np.ndarray  # (T, n) true distance from the route [m], left is positive
    drives: np.ndarray  # (T, n) False after the stop
    touches: np.ndarray  # (n,) True if the body touched a wall
    runs: tuple[Run, ...]  # the logs, if they were requested


def room_around(route: Route, vehicle_file: VehicleFile) -> Room:
    """Return the room around a route, for the body of the vehicle in `vehicle_file`."""
    low, high = np.min(route.eta[:, :2], axis=0), np.max(route.eta[:, :2], axis=0)
    radius_m = body_radius(vehicle_file)
    width_m, height_m = (high - low + 2.0 * (CLEARANCE_M + radius_m)).tolist()
    x, y = (route.eta[0, :2] - 0.5 * (low + high)).tolist()
    return Room(width_m, height_m, radius_m, (x, y, float(route.eta[0, 2])))


class _Driver:
    """The software of one robot: its blocks, and the watch that stops it before a wall."""

    def __init__(self, loop: Loop, fix: str, route: Route) -> None:
        self._loop, self._sizes = loop, FIXES[fix].sizes
        self._watch = RoomWatch.for_route(route, room_around(route, loop.file), loop.file.vehicle)
        self._silence = [Slot(0.0, np.zeros(size)) for size in (3, *self._sizes.values())]
        self._states: Tree = loop.start(route.eta[0])
        self.is_stopped = False

    def step(
        self, t_ns: int, u: np.ndarray, imu: np.ndarray, marks: np.ndarray, reference: Reference
    ) -> Tree:
        """Return the command and the estimate of a tick; `marks` contains NaN for each sensor without a reading."""
        slots, offset = [Slot(1.0, imu)], 0
        for size in self._sizes.values():
            z, offset = marks[offset : offset + size], offset + size
            is_new = not np.isnan(z[0])
            slots.append(Slot(float(is_new), z if is_new else np.zeros(size)))
        tick = Tick(t_ns, u, self._loop.slots(*slots))
        self._states, (command, estimate) = self._loop.step(self._states, tick, reference)
        self.is_stopped = bool(self._states[2].stopped > 0.0)
        return command, estimate

    def check_wall_distance(self, estimate: Estimate, reference: Reference) -> None:
        """Stop the robot if it might touch a wall."""
        zero, tick = Command(0, np.zeros(3)), Tick(0, np.zeros(3), self._loop.slots(*self._silence))
        self._watch.on_record(Record(tick, zero, zero, estimate, reference))
        self.is_stopped = self.is_stopped or self._watch.stop_reason(0) is not None


def simulate_laps(
    route: Route, laps: int, parts: Sequence[FixTeam], backend: str, log: bool = False
) -> list[Laps]:
    """Return the drives of each part: a rest at the start of the route, then `laps` laps, or until all robots
    have stopped. If `log`, also return the runs."""
    drivers = _drivers(route, parts, backend)
    ends = np.cumsum([0, *(len(part.team.vehicle_files) for part in parts)]).tolist()
    spans = [slice(a, b) for a, b in pairwise(ends)]
    world, readers = _truth(route, parts, backend)
    guide, walls = Repeat.along(route, 0), room_around(route, parts[0].team.vehicle_files[0])
    centre, touches = route.eta[0, :2] - np.array(walls.start[:2]), np.zeros(len(drivers), dtype=bool)
    progress, reference = guide.init(), Reference(0, route.eta[0], np.zeros(3), 0.0)
    u, estimates = np.zeros((len(drivers), 3)), [estimate_at(0)] * len(drivers)
    samples, rows = [], []
    t_ns = tick_times(round((REST_S + laps * route.t_s[-1]) * RATE_HZ), RATE_HZ)
    for k, t in enumerate(t_ns.tolist()):
        z, rests = world.tick(u, 1.0 / RATE_HZ), t <= REST_S * NANOSECONDS
        eta = world.truth.eta
        marks = [reader.read(1e-9 * t, eta[span]) for reader, span in zip(readers, spans, strict=True)]
        row_marks = [row for part_marks in marks for row in part_marks]
        if log:
            rows.append((u, z, row_marks))
        if not rests:
            progress, reference = guide.step(progress, estimate_at(t))
        previous_u, u = u, np.zeros_like(u)
        is_sample = not rests and k % SAMPLE_TICKS == 0
        for i, driver in enumerate(drivers):
            if driver.is_stopped:
                continue
            command, estimates[i] = driver.step(t, previous_u[i], z[i], row_marks[i], reference)
            if is_sample:
                driver.check_wall_distance(estimates[i], reference)
            u[i] = 0.0 if rests or driver.is_stopped else command
        if is_sample:
            drives = np.array([not driver.is_stopped for driver in drivers])
            touches |= np.any(np.abs(eta[:, :2] - centre) > walls.free_half_width_m, axis=1)
            samples.append((*_error(estimates, eta), eta[:, :2], drives, reference.eta[:2]))
            if not drives.any():
                break
    runs = [
        _runs(part, t_ns, rows, span.start) if log else () for part, span in zip(parts, spans, strict=True)
    ]
    return _laps(samples, touches, spans, runs)


def _drivers(route: Route, parts: Sequence[FixTeam], backend: str) -> list[_Driver]:
    """Return a driver for each robot; robots with the same file and fix share the compiled blocks."""
    loops: dict[tuple[int, str], Loop] = {}
    for part in parts:
        for vehicle_file in part.team.vehicle_files:
            if (key := (id(vehicle_file), part.fix)) not in loops:
                loops[key] = Loop(with_fix(vehicle_file, part.fix, route), perfect=False, backend=backend)
    return [
        _Driver(loops[id(vehicle_file), part.fix], part.fix, route)
        for part in parts
        for vehicle_file in part.team.vehicle_files
    ]


def _truth(route: Route, parts: Sequence[FixTeam], backend: str) -> tuple[TruthWorld, list[Reader]]:
    """Return the world of all robots, and the readers of each part of the robots."""
    teams = [part.team for part in parts]
    robots = merge([team.robots for team in teams])
    seeds = [seed for team in teams for seed in team.seeds]
    start, compiler = np.tile(route.eta[0], (len(seeds), 1)), partial(function, backend=backend)
    readers = [
        FIXES[part.fix].reader(route, part.team.seeds, start[: len(part.team.seeds), :2], part.faults)
        for part in parts
    ]
    return TruthWorld(robots, seeds, start, STEP_S, compiler), readers


def _laps(
    samples: list[Tree], touches: np.ndarray, spans: list[slice], runs: list[tuple[Run, ...]]
) -> list[Laps]:
    error, cov, sample_eta, drives, reference_xy = (np.array(values) for values in zip(*samples, strict=True))
    sample_ns = np.arange(len(reference_xy)) * round(SAMPLE_TICKS / RATE_HZ * NANOSECONDS)
    cross_track_m = np.stack(
        [
            cross_track(sample_ns, sample_eta[:, i], sample_ns, reference_xy)
            for i in range(sample_eta.shape[1])
        ],
        axis=1,
    )
    return [
        Laps(error[:, span], cov[:, span], cross_track_m[:, span], drives[:, span], touches[span], logs)
        for span, logs in zip(spans, runs, strict=True)
    ]


def _error(estimates: list[Estimate], eta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the pose errors (n, 3) of the estimates, and their covariances (n, 3, 3)."""
    pose_error = np.array([estimate.eta for estimate in estimates]) - eta
    covs = np.array([estimate.cov[:3, :3] for estimate in estimates])
    return np.column_stack([pose_error[:, :2], wrap(pose_error[:, 2])]), covs


def _runs(part: FixTeam, t_ns: np.ndarray, rows: list[Tree], first: int) -> tuple[Run, ...]:
    """Return the logs of a part; its first robot has the index `first` in `rows`."""
    ticks, sizes, part_runs = t_ns[: len(rows)], FIXES[part.fix].sizes, []
    for i, (vehicle_file, seed) in enumerate(
        zip(part.team.vehicle_files, part.team.seeds, strict=True), first
    ):
        u, imu, marks = (np.array([row[column][i] for row in rows]) for column in range(3))
        sensors, offset = {}, 0
        for name, size in sizes.items():
            z, offset = marks[:, offset : offset + size], offset + size
            is_present = ~np.isnan(z[:, 0])
            sensors[name] = Channel(ticks[is_present], ticks[is_present], z[is_present])
        part_runs.append(logged_run(f"laps {seed}", vehicle_file, ticks, u, imu, "repeat", sensors=sensors))
    return tuple(part_runs)
