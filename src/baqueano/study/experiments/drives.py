"""Plan the commands for vehicles of the truth around a file, and measure the information in these commands."""

import time
from typing import Any, NamedTuple

import numpy as np

from baqueano.design.containment import VEHICLES, contain_in_room
from baqueano.design.information import NUISANCE_STD, mean_error, unknowns
from baqueano.design.plan import design_plan
from baqueano.design.vehicle_cloud import VehicleCloud, possible_vehicles
from baqueano.identify import KINDS, excitation
from baqueano.routes.room import Room
from baqueano.simulate.open_loop import tick_times
from baqueano.study.counterpart import drive_group
from baqueano.study.experiments.result import DESIGNED, SignalErrors
from baqueano.study.identification.bound import (
    cramer_rao_bound,
    free_values,
    perturbed_copies,
    with_free_values,
)
from baqueano.study.truth import Cars, Robots, draw_cars, draw_robots, merge
from baqueano.vehicle_file import VehicleFile, load

SPREAD = 0.3
DRIVES = 10
# motor lag of a car whose file has only a delay, which contains this lag, and for the servo the delay of the tyres
# (docs/derivations/vehicles.md): both take about 10 ms
LAG_S = 0.01


class PlannedDrive(NamedTuple):
    """The commands of each vehicle, and the time to plan them."""

    u: np.ndarray  # (N, V, m)
    seconds: float  # planning time, the longest


def plan_signals(
    vehicle_file: VehicleFile, room: Room, count: int, seed: int, duration_s: float, backend: str
) -> dict[str, PlannedDrive]:
    """Return signal → commands of all vehicles; the designed commands are the same for all vehicles."""
    began_s = time.perf_counter()
    u = design_plan(vehicle_file, room, duration_s, seed=seed, backend=backend).u
    plans = {DESIGNED: PlannedDrive(np.repeat(u[:, None], count, axis=1), time.perf_counter() - began_s)}
    cloud = VehicleCloud(vehicle_file, possible_vehicles(vehicle_file, vehicle_count=VEHICLES), seed, backend)
    for kind in KINDS:
        commands, max_s = [], 0.0
        for k in range(count):
            began_s = time.perf_counter()
            command = excitation(
                kind, vehicle_file.command.limit, duration_s, vehicle_file.rate_hz, seed + k, rest_s=1.0
            )
            commands.append(contain_in_room(command, vehicle_file, room, cloud=cloud).u)
            max_s = max(max_s, time.perf_counter() - began_s)
        plans[kind] = PlannedDrive(np.stack(commands, axis=1), max_s)
    return plans


def vehicles_around(vehicle_file: VehicleFile, count: int, seed: int) -> Robots | Cars:
    """Return vehicles of the truth whose parameters are within ± SPREAD of the file's values."""
    q = draw_robots(count, seed) if len(vehicle_file.command.limit) == 3 else draw_cars(count, seed)
    if isinstance(q, Cars):  # the file has only a delay
        q = q.with_parameters(
            lag_s=np.full(count, LAG_S),
            delay_s=np.full(count, vehicle_file.vehicle.drivetrain.delay_s - LAG_S),
        )
    q = q.with_parameters(floor=np.tile(vehicle_file.vehicle.process_noise_std, (count, 1)))
    draw = np.random.default_rng([seed, 71])
    paths = [
        path for path in possible_vehicles(vehicle_file, vehicle_count=2).paths if path in free_values(q)
    ]
    unit = draw.uniform(-SPREAD, SPREAD, (len(paths), count))
    return with_free_values(
        q, {path: float(vehicle_file.value(path)) * (1.0 + x) for path, x in zip(paths, unit, strict=True)}
    )


def signal_outcome(
    job: tuple[str, PlannedDrive], vehicles: Robots | Cars, name: str, room: Room, seed: int
) -> tuple[str, SignalErrors]:
    """Return the name of a signal, and its errors and margins on the vehicles."""
    (signal, plan), vehicle_file = job, load(name)
    robots = [vehicles.subset([k]) for k in range(plan.u.shape[1])]
    copies: list[Any] = [perturbed_copies(q.with_parameters(floor=0.0 * q.floor)) for q in robots]
    group, vehicle_count = merge(copies), len(copies[0].mass_kg)
    noiseless = np.split(
        ideal_readings(group, np.repeat(plan.u, vehicle_count, axis=1), vehicle_file.rate_hz),
        len(robots),
        axis=1,
    )
    paths = [path for path in unknowns(vehicle_file).names if path in free_values(vehicles)]
    errors = [_error(readings, q, paths) for readings, q in zip(noiseless, robots, strict=True)]
    repeats = vehicles.subset(np.repeat(np.arange(len(robots)), DRIVES).tolist())
    seeds = [seed + 1000 + k for k in range(len(robots) * DRIVES)]
    t_ns = tick_times(len(plan.u), vehicle_file.rate_hz)
    motion = drive_group(repeats, np.repeat(plan.u, DRIVES, axis=1), seeds, t_ns, None)
    margins = np.min(room.free_half_width_m - np.abs(motion.truth[..., :2]), axis=(0, 2))
    return signal, SignalErrors(np.array(errors), margins, plan.seconds)


def ideal_readings(vehicles: Robots | Cars, u: np.ndarray, rate_hz: float) -> np.ndarray:
    """Return the noise-free readings (N, n, m) of IMUs, and odometers of cars, under commands u (N, n, k)."""
    motion = drive_group(vehicles, u, [0] * u.shape[1], tick_times(len(u), rate_hz), None)
    wheel_speed = [motion.rolling_speed[..., None]] if isinstance(vehicles, Cars) else []
    return np.concatenate([motion.noiseless, *wheel_speed], axis=2)


def _error(noiseless: np.ndarray, vehicle: Robots | Cars, paths: list[str]) -> float:
    """Return the mean error (1) of one vehicle from the readings (N, 2p, m) of its perturbed copies."""
    value = {path: abs(float(x[0])) for path, x in free_values(vehicle).items()}
    bound = cramer_rao_bound(noiseless, vehicle, {path: _parameter_scale(path, value) for path in value})
    return mean_error(np.array([bound[path] / value[path] for path in paths]))


def _parameter_scale(path: str, value: dict[str, float]) -> float:
    """Return the prior standard deviation of a parameter: NUISANCE_STD for a bias, else the magnitude of its value.
    If the value is 0, return the largest magnitude in its field, or 1.
    """
    if "bias" in path:
        return NUISANCE_STD
    field = path.partition("[")[0]
    return value[path] or max(x for key, x in value.items() if key.partition("[")[0] == field) or 1.0
