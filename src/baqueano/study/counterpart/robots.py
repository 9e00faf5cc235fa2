"""Robots of the truth as planar vehicles: the true values of the file's parameters, and robots with other values.

A wheel with toe angle τ and arm w pushes with F = g K:

    X_i = F_i cos τ_i, Y_i = F_i sin τ_i:   T_00 = X_l + X_r,  T_02 = X_r − X_l,  T_10 = Y_l + Y_r,  T_12 = Y_r − Y_l
    T_20 = X_r w_r − X_l w_l,  T_22 = X_r w_r + X_l w_l                                                   (1)

The file contains the true mass, because a scale measures it, and the true inertia, to which all terms about z refer. A
run shows only the sum of a tilt and an accelerometer bias. So the file contains the tilt, and the bias is free.
"""

from collections.abc import Mapping

import numpy as np

from baqueano.study.counterpart.columns import BIASES, NO_COLUMN, add_change, column
from baqueano.study.truth import Robots
from baqueano.vehicle_file import VehicleFile, load

FREE_ROBOT = (
    "+model.centre_of_mass_x_m",
    "+model.drivetrain.delay_s",
    "+sensors.imu.lever_arm_m",
    "+sensors.imu.heading_rad",
)
ACTUATOR_MATRIX_PATH = "model.actuator_matrix"
ROBOT_FIELDS: dict[str, tuple[str, int]] = {  # path → field of Robots, column
    **{f"model.friction.linear[{k}]": ("viscous", k) for k in range(3)},
    **{f"model.friction.quadratic[{k}]": ("quadratic", k) for k in range(3)},
    **{f"model.friction.coulomb[{k}]": ("dry", k) for k in (0, 2)},
    **{f"model.drivetrain.dead_zone_forward[{k}]": ("forward", k) for k in range(2)},
    **{f"model.drivetrain.dead_zone_backward[{k}]": ("backward", k) for k in range(2)},
    "model.friction.cornering": ("cornering", NO_COLUMN),
    "model.drivetrain.lag_s": ("lag_s", NO_COLUMN),
    "model.drivetrain.delay_s": ("delay_s", NO_COLUMN),
    "model.centre_of_mass_x_m": ("ahead_m", NO_COLUMN),
}
IMU_FIELDS: dict[str, tuple[str, int]] = {
    **{f"sensors.imu.lever_arm_m[{k}]": ("place_m", k) for k in range(2)},
    "sensors.imu.heading_rad": ("turn_rad", NO_COLUMN),
    **BIASES,
}
MATRIX_ENTRIES = ("00", "02", "10", "12", "20", "22")


def robot_values(robots: Robots) -> dict[str, np.ndarray]:
    """Return the true value (n,) of each parameter that a fit of `robot_file` can estimate."""
    values = {path: column(getattr(robots, name), k) for path, (name, k) in ROBOT_FIELDS.items()}
    values |= {path: column(getattr(robots.imu, name), k) for path, (name, k) in IMU_FIELDS.items()}
    force = robots.gain * robots.stall_n[:, None]
    X, Y = force * np.cos(robots.toe_rad), force * np.sin(robots.toe_rad)
    N = X * robots.arm_m
    for i, pushes in enumerate((X, Y, N)):  # (1); the left wheel turns the robot in the other direction
        left_push = -pushes[:, 0] if i == 2 else pushes[:, 0]
        values[f"{ACTUATOR_MATRIX_PATH}[{i},0]"] = left_push + pushes[:, 1]
        values[f"{ACTUATOR_MATRIX_PATH}[{i},2]"] = pushes[:, 1] - left_push
    return values


def with_values(robots: Robots, values: Mapping[str, np.ndarray]) -> Robots:
    """Return the robots with the given true `values` (n,) of some parameters, as the inverse of `robot_values`."""
    new = robot_values(robots) | dict(values)
    robot_changes: dict[str, np.ndarray] = {}
    imu_changes: dict[str, np.ndarray] = {}
    current = robot_values(robots)
    for path in values:
        if path in ROBOT_FIELDS:
            add_change(robot_changes, robots, ROBOT_FIELDS[path], new[path] - current[path])
        elif path in IMU_FIELDS:
            add_change(imu_changes, robots.imu, IMU_FIELDS[path], new[path] - current[path])
    if any(path.startswith(ACTUATOR_MATRIX_PATH) for path in values):
        t = {entry: new[f"{ACTUATOR_MATRIX_PATH}[{entry[0]},{entry[1]}]"] for entry in MATRIX_ENTRIES}
        X, Y = (0.5 * np.stack([t[f"{i}0"] - t[f"{i}2"], t[f"{i}0"] + t[f"{i}2"]], axis=1) for i in (0, 1))
        N = 0.5 * np.stack([t["22"] - t["20"], t["22"] + t["20"]], axis=1)
        robot_changes |= {
            "gain": np.hypot(X, Y) / robots.stall_n[:, None],
            "toe_rad": np.arctan2(Y, X),
            "arm_m": N / X,
        }
    return robots.with_parameters(imu=robots.imu.with_parameters(**imu_changes), **robot_changes)


def robot_file(robot: Robots) -> VehicleFile:
    """Return the file of one robot with its true values."""
    value = {path: float(v[0]) for path, v in robot_values(robot).items()}
    matrix = [[value.get(f"{ACTUATOR_MATRIX_PATH}[{i},{j}]", 0.0) for j in range(3)] for i in range(3)]
    arrays = {
        "model.friction.coulomb": [
            value["model.friction.coulomb[0]"],
            0.0,
            value["model.friction.coulomb[2]"],
        ]
    }
    for path in ROBOT_FIELDS | IMU_FIELDS:
        name, _, entry = path.partition("[")
        if entry and name not in arrays:
            arrays[name] = [v for k, v in value.items() if k.startswith(f"{name}[")]
    scalar_values = {path: v for path, v in value.items() if "[" not in path}
    exact_paths = {
        "model.mass_kg": float(robot.mass_kg[0]), "model.inertia_kg_m2": float(robot.inertia_kg_m2[0]),
        ACTUATOR_MATRIX_PATH: matrix,
        "model.drivetrain.gain": [1.0, 1.0], "sensors.imu.tilt_rad": robot.imu.tilt_rad[0].tolist(),
        "model.process_noise_std": robot.floor[0].tolist(), "sensors.imu.gyro_noise_std": float(robot.imu.noise[0, 2]),
        "sensors.imu.accel_noise_std": robot.imu.noise[0, :2].tolist(),
        "sensors.imu.accel_step": float(robot.imu.step[0, 0]), "sensors.imu.gyro_step": float(robot.imu.step[0, 2]),
    }  # fmt: skip
    return load("small").with_values(scalar_values | arrays | exact_paths)
