"""Identify the lag of a servo from a simulated bicycle on tyres, which stops and starts with turned wheels."""

import numpy as np
import pytest

from baqueano.identify import FitOptions, identify
from baqueano.simulate.open_loop import tick_times
from baqueano.study.counterpart import car_file, drive_group, vehicle_run
from baqueano.study.counterpart.cars import FREE_CAR
from baqueano.study.truth import draw_cars

DELAY, LAG, SERVO_LAG = (f"model.drivetrain.{name}" for name in ("delay_s", "lag_s", "servo_lag_s"))
FREE = (*FREE_CAR, "+model.understeer")
STARTS, HELD_S, SEED = 16, 0.7, 4


@pytest.fixture(scope="module")
def log():
    """Return a car with quiet sensors, its file, and a run: each start is after a stop in which the servo turned."""
    car = draw_cars(1, SEED)
    car = car.with_parameters(imu=car.imu.with_parameters(noise=0.2 * car.imu.noise))
    file = car_file(car)
    row_count, angles = round(HELD_S * file.rate_hz), np.random.default_rng(SEED).uniform(-0.6, 0.6, STARTS)
    pieces = [
        [(0.0, angle)] * row_count + [(0.3 + 0.3 * (k % 2), angle)] * row_count
        for k, angle in enumerate(angles)
    ]
    u = np.array([(0.0, 0.0)] * row_count + [row for piece in pieces for row in piece])
    motion = drive_group(car, u[:, None], [SEED], tick_times(len(u), file.rate_hz))
    return car, file, vehicle_run(motion, 0, u, file, "stops", SEED)


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
