"""Vehicles of the independent truth with the IMU of a data sheet, each identified from commands and IMU.

    gyro      scale uniform within ± 3 %; its bias is a random walk, and changes at each power-on
    accel     scales uniform within ± 3 %, cross-axis sensitivities within ± 2 %
    motors    the battery sags by 3 to 8 %; in half of the vehicles the current lags, not the voltage
    floor     a drag of cornering; radii of the wheels differ by 2 %
    other     parts have the tolerances of real parts (truth/two_wheels.py)

Of these errors the vehicle file contains only gyro_scale_std of the garage, and gyro_bias_std for the bias at power-on.
"""

from collections.abc import Sequence

import numpy as np

from baqueano.diagnostics import Verdict
from baqueano.identify.noise.covariances import measure_noise
from baqueano.study.driving import identify_by_advice, initial_file, simulate_experiments
from baqueano.study.truth import Robots, draw_robots, merge
from baqueano.vehicle_file import VehicleFile

SCALE_TOLERANCE, CROSS_AXIS = 0.03, 0.02  # of the scales and cross-axis sensitivities of an MPU-6050
SAG, MAX_CORNERING = (0.03, 0.08), 0.1  # part of the supply; kg/rad
WHEEL_DIFFERENCE = 0.02  # of the radii of the wheels
BIAS_WALK = 1e-5  # rad/s^1.5; a real MPU-6050 at rest has 0.4e-5: `baqueano study recordings`
PAUSE_S = 600.0  # from the experiment to the drive


def vehicles(seeds: Sequence[int]) -> Robots:
    """Return the vehicles during the experiment, with random gyro scales and unequal wheel radii."""
    robots = merge([draw_robots(1, seed) for seed in seeds])
    draws = [_random_generator(seed) for seed in seeds]
    scale = np.array([1.0 + draw.uniform(-SCALE_TOLERANCE, SCALE_TOLERANCE) for draw in draws])
    side = np.array([draw.choice([-0.5, 0.5]) * WHEEL_DIFFERENCE for draw in draws])
    accel, cross = (
        np.stack([a * draw.uniform(-1.0, 1.0, 2) for draw in draws]) for a in (SCALE_TOLERANCE, CROSS_AXIS)
    )
    sag, cornering = (
        np.array([draw.uniform(*span) for draw in draws]) for span in (SAG, (0.0, MAX_CORNERING))
    )
    imu = robots.imu.with_parameters(
        gyro_scale=scale, accel_scale=1.0 + accel, cross_axis=cross,
        walk=np.tile([0.0, 0.0, BIAS_WALK], (len(draws), 1)),
    )  # fmt: skip
    return robots.with_parameters(
        imu=imu, wheel=1.0 + np.stack([-side, side], axis=1), sag=sag, cornering=cornering,
        lagging_emf=np.array([draw.choice([0.0, 1.0]) for draw in draws]),
    )  # fmt: skip


def switch_on_again(robots: Robots, seeds: Sequence[int], files: Sequence[VehicleFile]) -> Robots:
    """Return the vehicles with the gyro bias after they are switched on again, PAUSE_S after the experiment."""
    bias = robots.imu.bias.copy()
    for k, (seed, vehicle_file) in enumerate(zip(seeds, files, strict=True)):
        std = np.hypot(vehicle_file.sensors.imu.gyro_bias_std, BIAS_WALK * np.sqrt(PAUSE_S))
        bias[k, 2] += std * _random_generator(seed + 1_000_000).standard_normal()
    return robots.with_parameters(imu=robots.imu.with_parameters(bias=bias))


def identify_vehicles(robots: Robots, seeds: Sequence[int], backend: str) -> list[VehicleFile | None]:
    """Return the file of each vehicle after `identify --update`; None if the fit is refused."""
    vehicle_files: list[VehicleFile | None] = []
    for run in simulate_experiments(robots, range(seeds[0], seeds[-1] + 1)):
        fit = identify_by_advice(run, initial_file(), backend)
        is_refused = fit.verdict == Verdict.REFUSED
        vehicle_files.append(
            None if is_refused else measure_noise(fit, run, backend=backend).updated_file(fit.vehicle_file)
        )
    return vehicle_files


def _random_generator(seed: int) -> np.random.Generator:
    return np.random.default_rng([seed, 60])
