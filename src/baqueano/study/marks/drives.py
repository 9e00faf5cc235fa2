"""Drives in a closed loop over tags: robots of the independent truth, each with the file that was identified for it.

The robots are those of corridor/vehicles.py. Two tags lie a quarter and three quarters of a lap from the start.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from baqueano.compare.errors import cross_track
from baqueano.geometry import wrap
from baqueano.guides.repeat import Repeat
from baqueano.guides.route import Route
from baqueano.runs import Run
from baqueano.runs.run import Channel
from baqueano.signals import NANOSECONDS, Estimate, Reference, Slot, Tick
from baqueano.simulate.open_loop import times
from baqueano.study.driving import Loop
from baqueano.study.truth import Floor, Robots, TagFaults, TruthWorld
from baqueano.symbolic import function
from baqueano.vehicle_file import VehicleFile, parse

RATE_HZ = 100.0
STEP_S = 1e-2  # of the truth: hours are driven; after 10 s it is within 2 mm of steps of 1 ms
REST_S = 3.0  # before the first lap: the bias of the gyro is learned
AT = (0.25, 0.75)  # of a lap
RADIUS_M, NOISE_M = 0.15, 0.01
EVERY = 10  # ticks between two samples of the error


class Team(NamedTuple):
    """n robots side by side."""

    files: list[VehicleFile]
    robots: Robots
    seeds: list[int]


class Laps(NamedTuple):
    """Drives of n robots, sampled T times."""

    error: np.ndarray  # (T, n, 3) of the estimate: x, y [m], heading [rad]
    cov: np.ndarray  # (T, n, 3, 3) that it claims
    across: np.ndarray  # (T, n) how far beside the route it is in truth [m], left is positive
    stopped: np.ndarray  # (n,) True where the supervisor stopped it
    runs: tuple[Run, ...]  # the logs, where they were asked for


def tags_of(route: Route) -> np.ndarray:
    """Places (2, 2) of the tags of a route."""
    return route.eta[[int(np.searchsorted(route.t_s, part * route.t_s[-1])) for part in AT], :2]


def with_tags(file: VehicleFile, route: Route) -> VehicleFile:
    """Return the file with the tags of a route, which its estimator uses."""
    table = f"points_m = {tags_of(route).tolist()}\nradius_m = {RADIUS_M}\nnoise_std = {NOISE_M}\n"
    text = file.text.partition("\n[sensors.tags]")[0] + f'\n[sensors.tags]\nkind = "tags"\n{table}'
    return parse(text, file.name).with_values({"estimator.use": ["imu", "tags"]})


def follow(
    team: Team, route: Route, laps: int, ways: Sequence[TagFaults], backend: str, log: bool = False
) -> list[Laps]:
    """Return what each robot does in so many laps of a route after a rest at its start, for each way to read the tags.

    All drive side by side, for the truth takes hardly longer for many than for one.
    """
    n, guide = len(team.files), Repeat.along(route, laps)
    loops = [Loop(with_tags(file, route), False, backend) for file in team.files] * len(ways)
    states, u = [loop.start(route.eta[0]) for loop in loops], np.zeros((len(loops), 3))
    robots = team.robots.some([*range(n)] * len(ways))
    start, fast = np.tile(route.eta[0], (len(loops), 1)), partial(function, backend=backend)
    world = TruthWorld(robots, team.seeds * len(ways), start, STEP_S, fast)
    floors = [Floor(tags_of(route), RADIUS_M, NOISE_M, team.seeds, start[:n, :2], way) for way in ways]
    t_ns = times(round((REST_S + laps * route.t_s[-1]) * RATE_HZ), RATE_HZ)
    progress, reference = guide.init(), Reference(0, route.eta[0], np.zeros(3), 0.0)
    samples: list[tuple[np.ndarray, ...]] = []
    rows: list[tuple[np.ndarray, ...]] = []
    for k, t in enumerate(t_ns.tolist()):
        z = world.tick(u, 1.0 / RATE_HZ)
        eta = world.truth.eta
        tags = [floor.read(1e-9 * t, eta[i * n : i * n + n, :2]) for i, floor in enumerate(floors)]
        row, estimates, rests = (u, z, np.concatenate(tags)), [], t <= REST_S * NANOSECONDS
        if not rests:
            progress, reference = guide.step(progress, _at(t))
        u = np.zeros_like(u)
        for i, loop in enumerate(loops):
            states[i], (command, estimate) = loop.step(states[i], _tick(loop, t, row, i), reference)
            u[i] = 0.0 if rests else command
            estimates.append(estimate)
        if log:
            rows.append(row)
        if not rests and k % EVERY == 0:
            samples.append((*_error(estimates, eta), eta[:, :2], reference.eta[:2]))
    error, cov, place, reference_xy = (np.array(values) for values in zip(*samples, strict=True))
    ticks = np.arange(len(reference_xy)) * round(EVERY / RATE_HZ * NANOSECONDS)
    across = [cross_track(ticks, place[:, i], ticks, reference_xy) for i in range(len(loops))]
    is_stopped = np.array([bool(x[2].stopped > 0.0) for x in states])
    runs = _runs(team, t_ns, rows) if log else ()
    parts = [slice(i * n, i * n + n) for i in range(len(ways))]
    return [
        Laps(error[:, at], cov[:, at], np.stack(across[at], axis=1), is_stopped[at], runs[at]) for at in parts
    ]


def _error(estimates: list[Estimate], eta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors (n, 3), and the covariances (n, 3, 3) that are claimed."""
    off = np.array([estimate.eta for estimate in estimates]) - eta
    return np.column_stack([off[:, :2], wrap(off[:, 2])]), np.array(
        [estimate.cov[:3, :3] for estimate in estimates]
    )


def _tick(loop: Loop, t_ns: int, row: tuple[np.ndarray, ...], i: int) -> Tick:
    u, imu, tag = (x[i] for x in row)
    visible = not np.isnan(tag[0])
    return Tick(t_ns, u, loop.slots(Slot(1.0, imu), Slot(float(visible), tag if visible else np.zeros(2))))


def _at(t_ns: int) -> Estimate:
    return Estimate(t_ns, np.zeros(3), np.zeros(3), np.zeros((6, 6)))


def _runs(team: Team, t_ns: np.ndarray, rows: list[tuple[np.ndarray, ...]]) -> tuple[Run, ...]:
    """The logs of the first n robots."""
    u, imu, tags = (np.stack(values, axis=1) for values in zip(*rows, strict=True))
    metadata, out = {"kind": "repeat", "rate_hz": f"{RATE_HZ:g}"}, []
    for i, (file, seed) in enumerate(zip(team.files, team.seeds, strict=True)):
        visible = ~np.isnan(tags[i, :, 0])
        sensors = {
            "imu": Channel(t_ns, t_ns, imu[i]),
            "tags": Channel(t_ns[visible], t_ns[visible], tags[i, visible]),
        }
        name = f"laps {seed}"
        out.append(Run(name, None, t_ns, u[i], sensors=sensors, vehicle_text=file.text, metadata=metadata))
    return tuple(out)
