"""Cars of the truth as the kinematic car with drags: what of its file has a true value, and which.

Per kilogram what is longitudinal. The steering gain and offset are those at low speed, where tyres do not slip. What
a car on tyres does not have (one lag of the yaw rate, a drag of cornering) has no true value.
"""

import numpy as np

from baqueano.study.truth import Cars
from baqueano.vehicle_file import VehicleFile, load

FREE_CAR = ("+model.drivetrain.delay_s", "+model.drivetrain.lag_s", "+model.quadratic_drag")
SPEED, AT = "speed", 0.35  # a straight drive at this throttle


def car_values(cars: Cars) -> dict[str, np.ndarray]:
    """Return the true value (n,) of each parameter that has one, and of the speed at a throttle of AT."""
    m = cars.mass_kg
    out = {
        "model.throttle_gain": cars.stall_n / m,
        "model.linear_drag": cars.rolling / m,
        "model.quadratic_drag": cars.air / m,
        "model.coulomb_m_s2": cars.dry_n / m,
        "model.steering_gain": cars.servo_rad,
        "model.steering_offset_rad": cars.servo_offset_rad,
        "model.drivetrain.dead_zone_forward[0]": cars.zone[:, 0],
    }
    return out | {SPEED: speed_at(np.stack([*list(out.values())[:4], cars.zone[:, 0]]))}


def speed_at(x: np.ndarray) -> np.ndarray:
    """Return the steady speed at a throttle of AT: gain (AT − zone) = dry + linear v + quadratic v².

    x (5, …): gain, linear drag, quadratic drag, dry friction, dead zone.
    """
    gain, linear, quadratic, dry, zone = x
    force = gain * (AT - zone) - dry
    return 2.0 * force / (linear + np.sqrt(np.maximum(linear**2 + 4.0 * quadratic * force, 1e-12)))


def car_file(car: Cars) -> VehicleFile:
    """Return the file of one car: true where there is a truth, plausible where there is none."""
    value = {path: float(v[0]) for path, v in car_values(car).items()}
    a, b = car.axle_m[0]
    imu, zone = car.imu, [*car.zone[0]]
    single = {path: v for path, v in value.items() if path != SPEED and "[" not in path}
    return load("car").with_values(single | {
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
