"""A gyro whose bias was never measured leads the heading, and its error is in the region of the heading."""

import numpy as np
import pytest

from baqueano.identify import random_steps
from baqueano.runs.filter_ticks import example_filter_tick, make_ticks
from baqueano.simulate import simulate
from baqueano.symbolic import scan
from baqueano.vehicle_file import load

BIAS, DRIVE_S, REST_S = 0.1, 10.0, 3.0


def followed(std_rad_s, rest_s):
    """Return the belief after a drive of a car with the bias BIAS; its file has 0 and `std_rad_s`."""
    car = load("car").with_values({"sensors.imu.gyro_bias": 0.0, "sensors.imu.gyro_bias_std": std_rad_s})
    u = random_steps([0.5, 0.6], DRIVE_S + rest_s, car.rate_hz, 5)
    u[: round(rest_s * car.rate_hz)] = 0.0
    run, ekf = simulate(car.with_values({"sensors.imu.gyro_bias": BIAS}), u, 5), car.estimator()
    step = scan(ekf.row, ekf.init(), example_filter_tick(ekf))
    return step.run(make_ticks(run, ekf, len(run.t_ns)))[0], run


def test_an_unknown_bias_does_not_weaken_the_gyro():
    small, large = (followed(std, 0.0)[0] for std in (0.002, BIAS))
    assert large.mean[2] == pytest.approx(small.mean[2], abs=0.01)


def test_the_region_of_the_heading_contains_the_unknown_bias():
    belief, run = followed(BIAS, 0.0)
    error = np.remainder(belief.mean[2] - run.truth.eta[-1, 2] + np.pi, 2.0 * np.pi) - np.pi
    assert 0.5 * BIAS * DRIVE_S < abs(error) < 1.96 * np.sqrt(belief.cov[2, 2])
    assert np.sqrt(belief.cov[2, 2]) < 1.3 * BIAS * DRIVE_S


def test_a_rest_measures_a_bias_that_looks_like_a_turn():
    belief, _ = followed(BIAS, REST_S)
    assert belief.mean[-1] == pytest.approx(BIAS, abs=4.0 * np.sqrt(belief.cov[-1, -1]))
    assert np.sqrt(belief.cov[-1, -1]) < 0.1 * BIAS
