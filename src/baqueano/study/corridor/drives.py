"""Drive each vehicle along a route lap by lap with the recommended filter and controller, from rest on a mark."""

from typing import NamedTuple

import numpy as np

from baqueano.geometry import wrap
from baqueano.guides.repeat import Repeat
from baqueano.guides.route import Route
from baqueano.signals import Slot, Tick
from baqueano.simulate.open_loop import tick_times
from baqueano.study.corridor.vehicles import identify_vehicles, switch_on_again, vehicles
from baqueano.study.counterpart.world import make_world
from baqueano.study.driving import SHAPES
from baqueano.study.truth import Robots
from baqueano.study.truth.integrate import STEP_S
from baqueano.study.truth_drives import Loop, estimate_at

SPEED_M_S = 0.2
REST_S, DRIVE_S = 2.0, 62.0
RECORD_INTERVAL_S = 1.0


class CorridorDrive(NamedTuple):
    """The pose errors and covariances of a vehicle at K instants."""

    seed: int
    shape: str
    lap_s: float
    t_s: np.ndarray  # (K,) since the start of the drive
    error: np.ndarray  # (K, 3) estimated minus true pose, in the map
    cov: np.ndarray  # (K, 3, 3) of the estimate


def drive_batch(seeds: range, backend: str) -> tuple[list[CorridorDrive], list[int]]:
    """Return the drives of the seeds, and the seeds whose fit was refused."""
    robots = vehicles(seeds)
    files = identify_vehicles(robots, seeds, backend)
    usable = [k for k, vehicle_file in enumerate(files) if vehicle_file is not None]
    names = [seeds[k] for k in usable]
    vehicle_files = [vehicle_file for vehicle_file in files if vehicle_file is not None]
    restarted_robots = switch_on_again(robots.subset(usable), names, vehicle_files)
    loops = [Loop(vehicle_file, perfect=False, backend=backend) for vehicle_file in vehicle_files]
    return simulate_drives(loops, restarted_robots, names), [s for s in seeds if s not in names]


def simulate_drives(loops: list[Loop], robots: Robots, seeds: list[int]) -> list[CorridorDrive]:
    """Simulate the drive of each vehicle along the route of its seed, and return its errors and covariances."""
    rate_hz, n = loops[0].file.rate_hz, len(loops)
    shapes = [list(SHAPES)[seed % len(SHAPES)] for seed in seeds]
    routes = [SHAPES[shape](SPEED_M_S) for shape in shapes]
    guides = [Repeat.along(route, 0) for route in routes]
    progress = [g.init() for g in guides]
    states = [o.start(r.eta[0]) for o, r in zip(loops, routes, strict=True)]
    t_ns, rest_ticks = tick_times(round((REST_S + DRIVE_S) * rate_hz), rate_hz), round(REST_S * rate_hz)
    world = make_world(robots, [s + 1 for s in seeds], STEP_S, np.stack([r.eta[0] for r in routes]))
    u = np.zeros((n, 3))
    sample_rows = [recorded_ticks(route, rest_ticks, len(t_ns), rate_hz) for route in routes]
    errors: list[list[tuple[float, np.ndarray, np.ndarray]]] = [[] for _ in loops]
    for k, t in enumerate(t_ns):
        z, previous_u, u = world.tick(u, 1.0 / rate_hz), u, np.zeros((n, 3))
        true_eta = world.truth.eta
        for i, loop in enumerate(loops):
            tick = Tick(int(t), previous_u[i], loop.slots(Slot(1.0, z[i])))
            progress[i], reference = guides[i].step(progress[i], estimate_at(int(t_ns[max(k, rest_ticks)])))
            states[i], (command, estimate) = loop.step(states[i], tick, reference._replace(t_ns=int(t)))
            u[i] = command if k >= rest_ticks else 0.0
            if k in sample_rows[i]:
                e = estimate.eta - true_eta[i]
                e[2] = wrap(e[2])
                errors[i].append(((k - rest_ticks) / rate_hz, e, estimate.cov[:3, :3]))
    columns = [[np.array(column) for column in zip(*rows, strict=True)] for rows in errors]
    laps_s = [float(route.t_s[-1]) for route in routes]
    return [
        CorridorDrive(s, shape, lap_s, *c)
        for s, shape, lap_s, c in zip(seeds, shapes, laps_s, columns, strict=True)
    ]


def recorded_ticks(route: Route, rest_ticks: int, tick_count: int, rate_hz: float) -> set[int]:
    """Return the ticks to record: one every RECORD_INTERVAL_S after the rest, and the ends of the laps."""
    laps = np.arange(1, tick_count) * float(route.t_s[-1]) * rate_hz
    ends = rest_ticks + np.rint(laps[laps < tick_count - rest_ticks]).astype(int)
    return {*range(rest_ticks, tick_count, round(RECORD_INTERVAL_S * rate_hz)), *ends.tolist()}
