"""Drives in a closed loop over tags: robots of the independent truth, each with the file that was identified for it.

The gyro of a robot has a scale within ± GYRO_SCALE and a bias that walks as that of an MPU-6050; nothing in the file
knows either. Two tags lie a quarter and three quarters of a lap from the start.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baqueano.geometry import wrap
from baqueano.guides.repeat import Repeat
from baqueano.guides.route import Route
from baqueano.runs import Run
from baqueano.runs.run import Channel
from baqueano.signals import NANOSECONDS, Estimate, Reference, Slot, Tick
from baqueano.simulate.open_loop import times
from baqueano.study.driving import Loop
from baqueano.study.truth import Faults, Floor, Robots, World
from baqueano.vehicle_file import VehicleFile, parse

GYRO_SCALE = 0.03
BIAS_WALK = 1e-5  # rad/s^1.5
RATE_HZ = 100.0
STEP_S = 5e-3  # of the truth: hours are driven; after 10 s it is within 2 mm of steps of 1 ms
REST_S = 3.0  # before the first lap: the bias of the gyro is learned
AT = (0.25, 0.75)  # of a lap
RADIUS_M, NOISE_M = 0.15, 0.01
EVERY = 10  # ticks between two samples of the error


class Laps(NamedTuple):
    """What N robots did, sampled T times."""

    error: np.ndarray  # (T, N, 3) of the estimate: x, y [m], heading [rad]
    cov: np.ndarray  # (T, N, 3, 3) that it claims
    passed: np.ndarray  # (N,) tags that were passed
    stopped: np.ndarray  # (N,) True where the supervisor stopped it
    runs: tuple[Run, ...]  # the logs


class Gyros:
    """A world whose gyros have scales (n,) that nobody knows."""

    def __init__(self, robots: Robots, seeds: Sequence[int], eta: np.ndarray) -> None:
        walk = np.tile([0.0, 0.0, BIAS_WALK], (len(seeds), 1))
        self.world = World(robots.changed(imu=robots.imu.changed(walk=walk)), seeds, eta, STEP_S)
        self._bias = robots.imu.bias[:, 2]
        self._scale = np.array(
            [1.0 + np.random.default_rng([k, 23]).uniform(-GYRO_SCALE, GYRO_SCALE) for k in seeds]
        )

    def tick(self, u: np.ndarray) -> np.ndarray:
        """Return the readings (n, 3) one tick later."""
        z = self.world.tick(u, 1.0 / RATE_HZ)
        z[:, 2] = self._scale * (z[:, 2] - self._bias) + self._bias
        return z


def tags_of(route: Route) -> np.ndarray:
    """Places (2, 2) of the tags of a route."""
    return route.eta[[int(np.searchsorted(route.t_s, part * route.t_s[-1])) for part in AT], :2]


def with_tags(file: VehicleFile, route: Route) -> VehicleFile:
    """Return the file with the tags of a route, which its estimator uses."""
    table = f"points_m = {tags_of(route).tolist()}\nradius_m = {RADIUS_M}\nnoise_std = {NOISE_M}\n"
    text = file.text.partition("\n[sensors.tags]")[0] + f'\n[sensors.tags]\nkind = "tags"\n{table}'
    return parse(text, file.name).with_values({"estimator.use": ["imu", "tags"]})


def follow(
    files: list[VehicleFile], robots: Robots, route: Route, laps: int, seeds: Sequence[int], faults: Faults,
    backend: str,
) -> Laps:  # fmt: skip
    """Return what each robot does in so many laps of a route, after a rest at its start."""
    files = [with_tags(file, route) for file in files]
    n, guide, loops = len(files), Repeat.along(route, laps), [Loop(file, False, backend) for file in files]
    states, u = [one.start(route.eta[0]) for one in loops], np.zeros((n, 3))
    gyros = Gyros(robots, seeds, np.tile(route.eta[0], (n, 1)))
    floor = Floor(tags_of(route), RADIUS_M, NOISE_M, seeds, gyros.world.truth.eta[:, :2], faults)
    t_ns = times(round((REST_S + laps * route.t_s[-1]) * RATE_HZ), RATE_HZ)
    asked, reference = guide.init(), Reference(0, route.eta[0], np.zeros(3), 0.0)
    samples: list[tuple[np.ndarray, np.ndarray]] = []
    log: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for k, t in enumerate(t_ns.tolist()):
        z = gyros.tick(u)
        eta = gyros.world.truth.eta
        log.append((u, z, floor.read(1e-9 * t, eta[:, :2])))
        rests = t <= REST_S * NANOSECONDS
        if not rests:
            asked, reference = guide.step(asked, _at(t))
        u, believed = np.zeros((n, 3)), []
        for i, one in enumerate(loops):
            states[i], (command, estimate) = one.step(states[i], _tick(one, t, log[-1], i), reference)
            u[i] = 0.0 if rests else command
            believed.append(estimate)
        if not rests and k % EVERY == 0:
            samples.append(_error(believed, eta))
    error, cov = (np.array(one) for one in zip(*samples, strict=True))
    logs = zip(seeds, files, *(np.stack(one, axis=1) for one in zip(*log, strict=True)), strict=True)
    runs = tuple(_run(f"laps {seed}", t_ns, file, u, z, tags) for seed, file, u, z, tags in logs)
    return Laps(error, cov, floor.passed, np.array([bool(x[2].stopped > 0.0) for x in states]), runs)


def _error(believed: list[Estimate], eta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors (n, 3), and the covariances (n, 3, 3) that are claimed."""
    off = np.array([one.eta for one in believed]) - eta
    return np.column_stack([off[:, :2], wrap(off[:, 2])]), np.array([one.cov[:3, :3] for one in believed])


def _tick(one: Loop, t_ns: int, row: tuple[np.ndarray, ...], i: int) -> Tick:
    u, imu, tag = (x[i] for x in row)
    seen = not np.isnan(tag[0])
    return Tick(t_ns, u, one.slots(Slot(1.0, imu), Slot(float(seen), tag if seen else np.zeros(2))))


def _at(t_ns: int) -> Estimate:
    return Estimate(t_ns, np.zeros(3), np.zeros(3), np.zeros((6, 6)))


def _run(
    name: str, t_ns: np.ndarray, file: VehicleFile, u: np.ndarray, imu: np.ndarray, tags: np.ndarray
) -> Run:
    seen = ~np.isnan(tags[:, 0])
    sensors = {"imu": Channel(t_ns, t_ns, imu), "tags": Channel(t_ns[seen], t_ns[seen], tags[seen])}
    metadata = {"kind": "repeat", "rate_hz": f"{RATE_HZ:g}"}
    return Run(name, None, t_ns, u, sensors=sensors, vehicle_text=file.text, metadata=metadata)
