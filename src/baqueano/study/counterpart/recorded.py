"""Drive vehicles of the truth with given commands, and return the runs that a logger on board would write."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.runs.run import Channel, Run, TruthLog
from baqueano.simulate.open_loop import tick_times
from baqueano.study.counterpart.cars import ODOMETER_M_S
from baqueano.study.counterpart.world import make_world
from baqueano.study.truth import Cars, Robots, merge
from baqueano.study.truth.integrate import STEP_S
from baqueano.vehicle_file import VehicleFile


class GroupDrive(NamedTuple):
    """The drives of n vehicles over N ticks."""

    t_ns: np.ndarray  # (N,)
    readings: np.ndarray  # (N, n, 3) readings of the IMU
    noiseless: np.ndarray  # (N, n, 3) without noise
    truth: np.ndarray  # (N, n, 9) η, ν, ν̇
    rolling_speed: np.ndarray  # (N, n) speed of the rolling wheels
    bias_drift: np.ndarray  # (n, 3) drift of the biases, mean of all ticks


def drive_group(
    vehicles: Robots | Cars,
    u: np.ndarray,
    seeds: Sequence[int],
    t_ns: np.ndarray,
    step_s: float | None = STEP_S,
) -> GroupDrive:
    """Return the drives of the vehicles under the commands u (N, n, m). Each command is applied until its tick.

    `step_s` is the step of the integration; None selects a step that is short enough to be exact.
    """
    world, n = make_world(vehicles, seeds, step_s), len(seeds)
    z, noiseless, truth = (np.zeros((len(u), n, size)) for size in (3, 3, 9))
    drift, wheel_travel = np.zeros((n, 3)), np.zeros((len(u), n))
    for k, dt_s in enumerate(np.diff(t_ns, prepend=0) * 1e-9):
        z[k] = world.tick(u[k], float(dt_s))
        truth[k] = np.concatenate(world.truth, axis=1)
        noiseless[k], wheel_travel[k] = world.noiseless_readings, world.rolling_speed
        drift += world.bias_drift / len(u)
    return GroupDrive(t_ns, z, noiseless, truth, wheel_travel, drift)


def drive_runs(
    vehicles: Sequence[Robots | Cars], signals: Sequence[np.ndarray], seeds: Sequence[int],
    files: Sequence[VehicleFile], step_s: float | None = STEP_S, logged: Sequence[np.ndarray] | None = None,
) -> list[Run]:  # fmt: skip
    """Return the run of each vehicle under its commands (N, m); all vehicles are simulated together.

    `logged` are the commands in the runs, by default the commands that moved the vehicles.
    """
    t_ns = tick_times(len(signals[0]), files[0].rate_hz)
    motion = drive_group(merge(vehicles), np.stack(signals, axis=1), seeds, t_ns, step_s)
    return [
        vehicle_run(motion, k, u, file, f"seed {seed}", seed)
        for k, (u, file, seed) in enumerate(zip(logged or signals, files, seeds, strict=True))
    ]


def logged_run(
    name: str, vehicle_file: VehicleFile, t_ns: np.ndarray, u: np.ndarray, imu: np.ndarray, kind: str = "experiment",
    **fields: Tree,
) -> Run:  # fmt: skip
    """Return the run that a logger writes: commands u (N, m), readings (N, 3) of the IMU, and `fields` of Run."""
    channels = {"imu": Channel(t_ns, t_ns, imu)} | fields.pop("sensors", {})
    metadata = {"kind": kind, "rate_hz": f"{vehicle_file.rate_hz:g}"}
    text = vehicle_file.text
    return Run(name, None, t_ns, u, sensors=channels, vehicle_text=text, metadata=metadata, **fields)


def vehicle_run(
    group_drive: GroupDrive, k: int, u: np.ndarray, vehicle_file: VehicleFile, name: str, seed: int
) -> Run:
    """Return the run of vehicle `k` under u (N, m); with an odometer if the file has one."""
    t_ns, truth = group_drive.t_ns, group_drive.truth[:, k]
    channels = {}
    if "odometer" in vehicle_file.sensors._fields:
        noise = np.random.default_rng([seed, 22]).standard_normal((len(t_ns), 1))
        channels["odometer"] = Channel(
            t_ns, t_ns, group_drive.rolling_speed[:, k, None] + ODOMETER_M_S * noise
        )
    log, readings = TruthLog(t_ns, *np.split(truth, 3, axis=1)), group_drive.readings[:, k]
    return logged_run(name, vehicle_file, t_ns, u, readings, sensors=channels, truth=log)
