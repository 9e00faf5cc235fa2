"""Drives of the independent truth, with or without a sensor fault, and the sensor findings of their replay."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from baqueano.drive.session import sensor_monitor
from baqueano.monitor import Finding, SensorMonitor
from baqueano.runs.run import Channel, Run
from baqueano.simulate.open_loop import tick_times
from baqueano.study.counterpart import drive_group, vehicle_run
from baqueano.study.counterpart.recorded import GroupDrive
from baqueano.study.faults.subject import subject
from baqueano.symbolic import compile_block
from baqueano.vehicle_file import VehicleFile, parse
from baqueano.vehicle_file.provenance import ParameterCov

SECONDS, FROM_S = 20.0, 6.0  # of a drive; when a fault begins
TRACK_M = 0.12
POSE_STD = [0.003, 0.003, 0.006]
ADDED_SENSORS = {
    "wheels": f'\n[sensors.wheels]\nkind = "wheels"\nrate_hz = 100.0\nnoise_std = 0.02\ntrack_m = {TRACK_M}\n',
    "pose": f'\n[sensors.pose]\nkind = "pose"\nrate_hz = 100.0\nnoise_std = {POSE_STD}\n',
}
SCALES = {"half": 0.5, "15 % less": 0.85, "15 % more": 1.15}
NOISE = {"estimator.disturbance_std": [0.2, 0.5], "estimator.velocity_walk_std": [0.02, 0.01, 0.05]}


class Kind(NamedTuple):
    """A vehicle, the correct file for it, and its blocks."""

    file: VehicleFile
    estimator: Any
    sensors: SensorMonitor


@cache
def kind_of(
    kind: str, errors: tuple[tuple[str, float], ...] = (), stds: tuple[tuple[str, float], ...] = ()
) -> Kind:
    """Return "robot", "wheels" (a robot with encoders), "pose" (a robot below a camera) or "car" (with an odometer).
    `errors` contains factors of values of its file, which is then wrong. `stds` contains relative standard deviations
    of values, as a fit writes them into the file."""
    file = subject(_vehicle(kind), 0).vehicle_file.with_values(NOISE)
    if kind in ADDED_SENSORS:
        file = parse(file.text + ADDED_SENSORS[kind], file.name).with_values({"estimator.use": ["imu", kind]})
    elif kind == "car":
        file = file.with_values({"estimator.use": ["imu", "odometer"]})
    file = file.with_values({path: factor * file.value(path) for path, factor in errors})
    if stds:
        values = np.array([file.value(name) for name, _ in stds])
        fit = ParameterCov(tuple(dict(stds)), np.diag((values * np.array([std for _, std in stds])) ** 2))
        file = file.with_values({}, parameter_cov=fit)
    estimator = compile_block(file.estimator())
    sensors, reason = sensor_monitor(file, estimator, estimator.step)
    assert sensors is not None, reason
    return Kind(file, estimator, sensors)


@cache
def drives(kind: str, count: int) -> tuple[Run, ...]:
    """Return drives of one vehicle of the independent truth, each with its own commands and noise."""
    file, (u, motion), runs = kind_of(kind).file, _motion(_vehicle(kind), count), []
    for k in range(count):
        run = vehicle_run(motion, k, u[k], file, f"{kind} {k}", k)
        new_sensor = {kind: _readings(kind, run, k)} if kind in ADDED_SENSORS else {}
        runs.append(replace(run, sensors=run.sensors | new_sensor))
    return tuple(runs)


def _vehicle(kind: str) -> str:
    return "robot" if kind in ADDED_SENSORS else kind


@cache
def _motion(vehicle: str, count: int) -> tuple[list[np.ndarray], GroupDrive]:
    """Return the commands and the drives of a "robot" or a "car"; its sensors do not change a drive."""
    robot = subject(vehicle, 0)
    u = [robot._replace(seed=seed).signal(SECONDS) for seed in range(count)]
    t_ns = tick_times(len(u[0]), robot.vehicle_file.rate_hz)
    return u, drive_group(robot.vehicle.subset([0] * count), np.stack(u, axis=1), range(count), t_ns)


def watch(
    kind: str, run: Run, errors: Mapping[str, float] = MappingProxyType({}),
    stds: Mapping[str, float] = MappingProxyType({}),
) -> tuple[list[Finding], SensorMonitor]:  # fmt: skip
    """Return each finding at its start and again when it became DEGRADED, and the monitor at the end."""
    file, estimator, sensors = kind_of(kind, tuple(errors.items()), tuple(stds.items()))
    belief, findings = estimator.init(), []
    sensors.begin()
    for tick in run.ticks():
        tick = tick._replace(
            sensors=type(file.sensors)(*(getattr(tick.sensors, n) for n in file.sensors._fields))
        )
        belief, estimate = estimator.step(belief, tick)
        for notice in sensors.update(tick, estimate):
            if notice.finding is not None:
                findings.append(notice.finding)
    return findings, sensors


def damaged_run(run: Run, sensor: str, numbers: Sequence[int], fault: str, limit: float = np.inf) -> Run:
    """Return the run with a fault from FROM_S on."""
    z, mask, k = run.sensors[sensor].z.copy(), run.t_s >= FROM_S, list(numbers)
    first = int(np.argmax(mask))
    if fault == "frozen":
        z[np.ix_(mask, k)] = z[first, k]
    elif fault == "full scale":
        z[np.ix_(mask, k)] = limit
    elif fault in SCALES:
        z[np.ix_(mask, k)] *= SCALES[fault]
    elif fault == "slip":
        z[np.ix_(mask, k)] += 0.6 * np.sign(z[np.ix_(mask, k)])
    elif fault == "zeroes itself":  # uses the mean of the last 0.4 s as its bias
        mean = np.cumsum(z[:, k], axis=0)
        mean[40:] -= mean[:-40].copy()
        z[np.ix_(mask, k)] -= mean[mask] / 40.0
    elif fault == "moved":
        z[np.ix_(mask, k)] += 0.3
    elif fault == "zero":
        z[np.ix_(mask, k)] = 0.0
    elif fault == "not a number":
        z[np.ix_(mask, k)] = np.nan
    return replace(run, sensors=run.sensors | {sensor: run.sensors[sensor]._replace(z=z)})


def _readings(kind: str, run: Run, seed: int) -> Channel:
    assert run.truth is not None
    v, side = run.truth.nu[:, 0], 0.5 * TRACK_M * run.truth.nu[:, 2]
    z, std = (np.stack([v - side, v + side], axis=1), 0.02) if kind == "wheels" else (run.truth.eta, POSE_STD)
    noise = np.random.default_rng([seed, 23]).standard_normal(z.shape)
    return Channel(run.t_ns, run.t_ns, z + std * noise)
