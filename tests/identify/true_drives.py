"""Drives of vehicles of the independent truth: their runs, their correct vehicle files and their true parameters.

The vehicle of the paper's case study I is here a robot of the truth without dead zones. Its full command is 100, and
its mass, forces and friction are those of the file. Its motors lag by 20 ms, because motors of the truth need a lag.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from baqueano.identify import excitation, random_steps
from baqueano.identify.result.fit_result import Fit
from baqueano.runs.run import Run
from baqueano.study.counterpart import car_file, car_values, drive_runs, robot_file, robot_values
from baqueano.study.counterpart.world import MAX_COMPILED_VEHICLES, ROBOT_STEP_S
from baqueano.study.identification.trials import FLOOR_NOISE, draw_car, draw_robot, quantised_commands
from baqueano.study.truth import Robots, draw_robots
from baqueano.vehicle_file import VehicleFile, load

CARS = 3  # different cars; fits of the same car share its compiled code
FULL, LAG_S = 100.0, 0.02  # command of case study I at a duty of 1, lag of its motors
CASE_FLOOR = (0.03, 0.01, 0.03)
LOCK = 0.3  # share of the full lock, at which the tyres hardly slip


class TrueDrive(NamedTuple):
    """A run of a vehicle of the truth."""

    run: Run
    file: VehicleFile  # correct in each parameter of the truth
    true: dict[str, float]

    @property
    def seed(self) -> int:
        """Return the seed of the commands and the noise."""
        return int(self.run.name.removeprefix("seed "))

    def normalised_errors(self, fit: Fit) -> np.ndarray:
        """Return (estimate − truth)/std of the parameters with a true value and an estimate inside its bounds."""
        truth = np.array([self.true.get(name, np.nan) for name in fit.names])
        z = (fit.estimate - truth) / fit.std
        return z[np.isfinite(z) & (fit.bound == 0)]


def cars_on_floor(seeds: Sequence[int], duration_s: float) -> list[TrueDrive]:
    """Return drives of CARS cars with the floor noise of the garage's file; each drive begins with 1 s of rest."""
    floor, drives = np.asarray(load("car").value("model.process_noise_std"))[None], []
    for first in range(0, len(seeds), MAX_COMPILED_VEHICLES):
        group = seeds[first : first + MAX_COMPILED_VEHICLES]
        cars = [draw_car(seed % CARS, "matched").with_parameters(floor=floor) for seed in group]
        files = [car_file(q) for q in cars]
        signals = [steps_of_car(seed, duration_s, files[0].rate_hz) for seed in group]
        values = [{name: float(v[0]) for name, v in car_values(q).items()} for q in cars]
        runs = drive_runs(cars, signals, group, files)
        drives += [TrueDrive(*drive) for drive in zip(runs, files, values, strict=True)]
    return drives


def steps_of_car(seed: int, duration_s: float, rate_hz: float) -> np.ndarray:
    """Return throttle and servo (N, 2) that jump every 2 and 1.2 s, after 1 s of rest."""
    draw, columns, count = np.random.default_rng([seed, 44]), [], round(duration_s * rate_hz)
    for low, high, hold_s in ((0.1, 0.55, 2.0), (-LOCK, LOCK, 1.2)):
        hold = round(hold_s * rate_hz)
        columns.append(np.repeat(draw.uniform(low, high, count // hold + 1), hold)[:count])
    u = np.stack(columns, axis=1)
    u[: round(rate_hz)] = 0.0
    return u


def robot_on_floor(seed: int, duration_s: float) -> TrueDrive:
    """Return a drive of a robot with dead zones and lag over a rough floor."""
    q = draw_robot(seed).with_parameters(floor=np.array([FLOOR_NOISE]))
    file = robot_file(q)
    u = quantised_commands(
        excitation("random_steps", file.command.limit, duration_s, file.rate_hz, seed, rest_s=0.0)
    )
    (run,) = drive_runs([q], [u], [seed], [file], ROBOT_STEP_S)
    return TrueDrive(run, file, {name: float(v[0]) for name, v in robot_values(q).items()})


def case_vehicle(file: VehicleFile) -> Robots:
    """Return the vehicle of the truth that a file of case study I describes."""
    single, two, three = np.ones(1), np.ones((1, 2)), np.ones((1, 3))
    model, imu = file.vehicle, file.sensors.imu
    q, gain = draw_robots(1, 0), np.asarray(file.value("model.actuator_matrix"))
    noise = np.array([[*imu.accel_noise_std, imu.gyro_noise_std]])
    fields = {"turn_rad": 0.0 * single, "gyro_scale": single, "low_pass_s": 0.0 * single}
    imu_without_bias = q.imu.with_parameters(
        place_m=0.0 * two, tilt_rad=0.0 * two, bias=0.0 * three, walk=0.0 * three, step=0.0 * three, noise=noise,
        **fields,
    )  # fmt: skip
    return q.with_parameters(
        mass_kg=model.mass_kg * single, inertia_kg_m2=model.inertia_kg_m2 * single, ahead_m=0.0 * single,
        arm_m=gain[2, 2] / gain[0, 0] * two, toe_rad=0.0 * two, stall_n=0.5 * FULL * gain[0, 0] * single, gain=two,
        wheel=two, forward=0.0 * two, backward=0.0 * two, lag_s=LAG_S * single, delay_s=0.0 * single, supply=single,
        levels=1e9 * single, viscous=np.array([model.friction.linear]), quadratic=np.array([model.friction.quadratic]),
        dry=0.0 * three, breakaway=single, slope_rad=0.0 * single,
        floor=np.array([file.value("model.process_noise_std")]) * three, imu=imu_without_bias,
    )  # fmt: skip


def case_file(changes: dict[str, Any] | None = None) -> VehicleFile:
    """Return the file of case study I with a motor lag and an IMU that measures v·ω."""
    physical = {"sensors.imu.measurement_model": "physical", "model.drivetrain.lag_s": LAG_S}
    return load("case-study-1").with_values(physical | (changes or {}))


def case_drives(
    seeds: Sequence[int], duration_s: float, files: VehicleFile | Sequence[VehicleFile]
) -> list[TrueDrive]:
    """Return drives of case study I, one for each seed of its random steps and of its noise."""
    files = [files] * len(seeds) if isinstance(files, VehicleFile) else list(files)
    signals = [
        random_steps(file.command.limit, duration_s, file.rate_hz, seed)
        for seed, file in zip(seeds, files, strict=True)
    ]
    vehicles, effective = [case_vehicle(file) for file in files], [u / FULL for u in signals]
    runs = drive_runs(vehicles, effective, seeds, files, ROBOT_STEP_S, signals)
    return [TrueDrive(run, file, truth_of(file)) for run, file in zip(runs, files, strict=True)]


def truth_of(file: VehicleFile) -> dict[str, float]:
    """Return the parameters of a file of case study I by their paths in a fit."""
    out = {"model.drivetrain.lag_s": LAG_S}
    for name in ("linear", "quadratic"):
        values = np.asarray(file.value(f"model.friction.{name}"))
        out |= {f"model.friction.{name}[{k}]": float(values[k]) for k in range(3)}
    T = np.asarray(file.value("model.actuator_matrix"))
    out |= {f"model.actuator_matrix[{i},{j}]": float(T[i, j]) for i in range(3) for j in (0, 2)}
    floor = np.asarray(file.value("model.process_noise_std")) * np.ones(3)
    return out | {f"model.process_noise_std[{k}]": float(floor[k]) for k in range(3)}
