"""Simulated cars whose truth is the kinematic car with drags: the true values of the parameters in its file.

Longitudinal parameters are per kilogram. The steering gain and offset are those at low speed, without tyre slip. The
true value of a parameter that a car on tyres lacks (lag of the yaw rate, drag of cornering) is not defined.
"""

from collections.abc import Mapping

import numpy as np

from baqueano.study.counterpart.columns import BIASES, NO_COLUMN, add_change, column
from baqueano.study.truth import Cars
from baqueano.vehicle_file import VehicleFile, load

FREE_CAR = ("+model.drivetrain.delay_s", "+model.drivetrain.lag_s", "+model.quadratic_drag")
SPEED, TEST_THROTTLE = "speed", 0.35  # a straight drive at this throttle


MASS_SPECIFIC_FIELDS: dict[str, tuple[str, int]] = {  # path → field of Cars, column
    "model.throttle_gain": ("stall_n", NO_COLUMN),
    "model.linear_drag": ("rolling", NO_COLUMN),
    "model.quadratic_drag": ("air_drag", NO_COLUMN),
    "model.coulomb_m_s2": ("dry_n", NO_COLUMN),
}
CAR_FIELDS: dict[str, tuple[str, int]] = {
    "model.steering_gain": ("servo_rad", NO_COLUMN),
    "model.steering_offset_rad": ("servo_offset_rad", NO_COLUMN),
    "model.drivetrain.dead_zone_forward[0]": ("zone", 0),
}
FIELDS_OUTSIDE_FILE: dict[str, tuple[str, int]] = {  # parameters that are not in a file under that name
    "tyre_n_rad[0]": ("tyre_n_rad", 0),
    "tyre_n_rad[1]": ("tyre_n_rad", 1),
    **{name: (name, NO_COLUMN) for name in ("lag_s", "delay_s", "servo_lag_s")},
}


def car_values(cars: Cars) -> dict[str, np.ndarray]:
    """Return path → true value (n,) of the parameters that have one, and the steady speed at TEST_THROTTLE."""
    values = {
        path: column(getattr(cars, name), k) / cars.mass_kg
        for path, (name, k) in MASS_SPECIFIC_FIELDS.items()
    }
    values |= {path: column(getattr(cars, name), k) for path, (name, k) in CAR_FIELDS.items()}
    zone = values["model.drivetrain.dead_zone_forward[0]"]
    return values | {SPEED: speed_at(np.stack([*(values[path] for path in MASS_SPECIFIC_FIELDS), zone]))}


def car_unknowns(cars: Cars) -> dict[str, np.ndarray]:
    """Return path → value (n,) of all unknowns of a run: parameters, FIELDS_OUTSIDE_FILE, and biases."""
    values = car_values(cars) | {
        path: column(getattr(cars, name), k) for path, (name, k) in FIELDS_OUTSIDE_FILE.items()
    }
    del values[SPEED]
    return values | {path: column(getattr(cars.imu, name), k) for path, (name, k) in BIASES.items()}


def with_car_unknowns(cars: Cars, values: Mapping[str, np.ndarray]) -> Cars:
    """Return the cars with the given `values` (n,) of some entries of `car_unknowns`, as its inverse."""
    current = car_unknowns(cars)
    car_changes: dict[str, np.ndarray] = {}
    imu_changes: dict[str, np.ndarray] = {}
    for path, new in values.items():
        change = new - current[path]
        if path in BIASES:
            add_change(imu_changes, cars.imu, BIASES[path], change)
        elif path in MASS_SPECIFIC_FIELDS:
            add_change(car_changes, cars, MASS_SPECIFIC_FIELDS[path], change * cars.mass_kg)
        else:
            add_change(car_changes, cars, (CAR_FIELDS | FIELDS_OUTSIDE_FILE)[path], change)
    return cars.with_parameters(imu=cars.imu.with_parameters(**imu_changes), **car_changes)


def speed_at(x: np.ndarray) -> np.ndarray:
    """Return the steady speed v at the throttle w = TEST_THROTTLE: gain (w − zone) = dry + linear v + quadratic v².

    x (5, …): gain, linear drag, quadratic drag, dry friction, dead zone.
    """
    gain, linear, quadratic, dry, zone = x
    force = gain * (TEST_THROTTLE - zone) - dry
    return 2.0 * force / (linear + np.sqrt(np.maximum(linear**2 + 4.0 * quadratic * force, 1e-12)))


def car_file(car: Cars) -> VehicleFile:
    """Return the file of one car, with true values if they exist, else with plausible values."""
    value = {path: float(v[0]) for path, v in car_values(car).items()}
    a, b = car.axle_m[0]
    imu, zone = car.imu, [*car.zone[0]]
    scalar_values = {path: v for path, v in value.items() if path != SPEED and "[" not in path}
    return load("car").with_values(scalar_values | {
        "model.wheelbase_m": float(a + b), "model.rear_axle_m": float(b), "model.yaw_lag_s": float(car.servo_lag_s[0]),
        "model.drivetrain.dead_zone_forward": [float(zone[0]), 0.0],
        "model.drivetrain.dead_zone_backward": [float(zone[1]), 0.0],
        "model.drivetrain.delay_s": float(car.delay_s[0]), "model.drivetrain.lag_s": float(car.lag_s[0]),
        "model.process_noise_std": car.floor[0].tolist(), "sensors.imu.accel_bias": [0.0, 0.0],
        "sensors.imu.gyro_bias": 0.0, "sensors.imu.gyro_scale": 1.0, "sensors.odometer.scale": 1.0,
        "sensors.imu.accel_noise_std": imu.noise[0, :2].tolist(),
        "sensors.imu.gyro_noise_std": float(imu.noise[0, 2]), "sensors.odometer.noise_std": ODOMETER_M_S,
    })  # fmt: skip


ODOMETER_M_S = 0.02
