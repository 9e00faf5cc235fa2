"""Identify the lag of a servo from a simulated bicycle on tyres, which stops and starts with turned wheels."""

import numpy as np
import pytest

from baqueano.identify import FitOptions, identify
from baqueano.runs.run import Channel, Run
from baqueano.simulate.open_loop import tick_times
from baqueano.study.counterpart import car_file, drive_runs
from baqueano.study.counterpart.cars import FREE_CAR
from baqueano.study.truth import draw_cars
from baqueano.vehicle_file import load

DELAY, LAG, SERVO_LAG = (f"model.drivetrain.{name}" for name in ("delay_s", "lag_s", "servo_lag_s"))
FREE = (*FREE_CAR, "+model.understeer")
STARTS, TEST_DRIVE_S, SEED = 16, 0.7, 4


@pytest.fixture(scope="module")
def log():
    """Return a car with quiet sensors, its file, and a run: each start is after a stop in which the servo turned."""
    car = draw_cars(1, SEED)
    car = car.with_parameters(imu=car.imu.with_parameters(noise=0.2 * car.imu.noise))
    file = car_file(car)
    row_count, angles = (
        round(TEST_DRIVE_S * file.rate_hz),
        np.random.default_rng(SEED).uniform(-0.6, 0.6, STARTS),
    )
    pieces = [
        [(0.0, angle)] * row_count + [(0.3 + 0.3 * (k % 2), angle)] * row_count
        for k, angle in enumerate(angles)
    ]
    u = np.array([(0.0, 0.0)] * row_count + [row for piece in pieces for row in piece])
    return car, file, *drive_runs([car], [u], [SEED], [file])


def test_the_lag_of_a_servo_is_identified_from_starts_with_turned_wheels(log):
    car, file, run = log
    before, fit = (
        identify(run, file, free, options=FitOptions(diagnose=False))
        for free in (FREE, (*FREE, f"+{SERVO_LAG}"))
    )
    delay_error_s, error_s = (abs(f.value(DELAY) - car.delay_s[0]) for f in (before, fit))
    assert delay_error_s > 5e-3
    assert error_s < 2e-3
    assert fit.value(LAG) == pytest.approx(car.lag_s[0], abs=2e-3)
    assert fit.value(SERVO_LAG) == pytest.approx(
        car.servo_lag_s[0], rel=0.15
    )  # slip is not a lag of first order


def readings_without_tyres(u, rate_hz, delay_s):
    """Return IMU and odometer (N, 4) of a car that rolls without slip: servo of 50 ms, motor of 30 ms, at 1 kHz."""
    x, rows, previous = np.zeros(3), [], np.zeros(2)  # v, motor, servo

    def dot(x, w):
        r = x[0] * np.tan(0.45 * x[2]) / 0.15
        v_dot = 7.0 * x[1] - 1.8 * x[0] - 0.6 * np.tanh(x[0] / 0.05) - 0.25 * abs(r) * x[0]
        return np.array([v_dot, (w[0] - x[1]) / 0.03, (w[1] - x[2]) / 0.05])

    for row in u:
        for k in range(round(1e3 / rate_hz)):
            w = row if k >= round(1e3 * delay_s) else previous
            first = dot(x, w)
            second = dot(x + 5e-4 * first, w)
            third = dot(x + 5e-4 * second, w)
            x = x + 1e-3 / 6.0 * (first + 2.0 * second + 2.0 * third + dot(x + 1e-3 * third, w))
        previous, (v_dot, _, servo_dot), v = row, dot(x, row), x[0]
        tan = np.tan(0.45 * x[2])
        r, r_dot = v * tan / 0.15, (v_dot * tan + v * 0.45 * servo_dot * (1.0 + tan**2)) / 0.15
        rows.append([v_dot - 0.075 * r * r, 0.075 * r_dot + v * r, r, v])
    return np.array(rows)


def test_the_lag_of_a_servo_is_identified_on_a_car_whose_tyres_have_no_lag():
    rng, rate_hz, delay_s = np.random.default_rng(3), 50.0, 0.013
    blocks = [[(0.25 * (k % 3) + 0.1 * (k % 2), rng.uniform(-0.6, 0.6))] * 30 for k in range(40)]
    u = np.array([(0.0, 0.0)] * 30 + [row for block in blocks for row in block])
    z = readings_without_tyres(u, rate_hz, delay_s) + rng.standard_normal((len(u), 4)) * [
        0.2,
        0.3,
        0.02,
        0.01,
    ]
    t_ns = tick_times(len(u), rate_hz)
    file = load("car").with_values({
        "model.drivetrain.dead_zone_forward": [0.0, 0.0], "model.drivetrain.dead_zone_backward": [0.0, 0.0],
        "sensors.imu.gyro_scale": 1.0, "sensors.odometer.scale": 1.0, "sensors.imu.accel_bias": [0.0, 0.0],
    })  # fmt: skip
    channels = {"imu": Channel(t_ns, t_ns, z[:, :3]), "odometer": Channel(t_ns, t_ns, z[:, 3:])}
    run = Run("rolling", None, t_ns, u, sensors=channels, vehicle_text=file.text)
    fit = identify(run, file, (*FREE_CAR, f"+{SERVO_LAG}"), options=FitOptions(diagnose=False))
    assert fit.value("model.yaw_lag_s") < 1e-3
    for path, value in ((DELAY, delay_s), (LAG, 0.03), (SERVO_LAG, 0.05)):
        assert fit.value(path) == pytest.approx(value, abs=1.5e-3)
