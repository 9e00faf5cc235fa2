"""A servo with its own lag, which also turns at rest."""

import numpy as np
import pytest

from baqueano.estimators import AugmentedEkf, DeadReckoning, Ekf, Unscented
from baqueano.sensors import Imu
from baqueano.signals import Slot, Tick, sensor_slots
from baqueano.vehicles import Car, Drivetrain

TICK_S, SERVO_LAG_S = 0.01, 0.06


def car(**changes):
    motors = Drivetrain(commands=2, delay_s=0.014, delay_slots=2, **changes)
    return Car(
        wheelbase_m=0.15,
        throttle_gain=4.0,
        steering_gain=0.4,
        linear_drag=2.0,
        yaw_lag_s=0.02,
        drivetrain=motors,
    )


def yaw_rates(model, commands):
    """Return the yaw rate after each command."""
    state, rates = model.init(), []
    for u in commands:
        state, _ = model.step(state, np.array(u), TICK_S, np.zeros(3))
        rates.append(state.nu[2])
    return np.array(rates)


@pytest.mark.parametrize("lag_s", [0.0, 0.05])
def test_each_channel_has_its_own_lag(lag_s):
    drivetrain = car(lag_s=lag_s, servo_lag_s=SERVO_LAG_S).drivetrain
    state, u = drivetrain.init(), np.array([0.4, 0.4])
    for _ in range(2):
        state, effort = drivetrain.step(state, u, TICK_S)
    fades = [0.0 if lag == 0.0 else np.exp(-0.006 / lag) for lag in (lag_s, SERVO_LAG_S)]
    np.testing.assert_allclose(effort.last, 0.4 * (1.0 - np.array(fades)), rtol=1e-12)
    steady = drivetrain.steady_state(u)
    np.testing.assert_allclose(drivetrain.step(steady, u, TICK_S)[1].last, u, rtol=1e-12)


@pytest.mark.parametrize("lag_s", [0.0, 0.05])
def test_a_servo_without_a_lag_follows_its_command_at_once(lag_s):
    commands = [(0.5, 0.3 if k % 7 < 4 else -0.4) for k in range(30)]
    neutral, default = (car(lag_s=lag_s, **servo) for servo in ({"servo_lag_s": 0.0}, {}))
    assert not neutral.drivetrain.has_servo_lag
    assert np.array_equal(yaw_rates(neutral, commands), yaw_rates(default, commands))
    _, effort = neutral.drivetrain.step(
        neutral.drivetrain.steady_state(np.zeros(2)), np.array([0.0, 0.3]), 0.02
    )
    assert effort.last[1] == 0.3


def test_a_servo_turns_while_the_car_stands():
    """After a stop with turned wheels, the lag of the servo does not delay the yaw rate of the start."""
    model, start = car(servo_lag_s=SERVO_LAG_S), [(0.5, 0.4)] * 12
    left, straight = (yaw_rates(model, [(0.0, servo)] * 60 + start)[-1] for servo in (0.4, 0.0))
    direct = yaw_rates(car(), [(0.0, 0.4)] * 60 + start)[-1]
    assert left == pytest.approx(direct, rel=1e-3)
    assert straight < 0.9 * direct


@pytest.mark.parametrize("filter_class", [AugmentedEkf, DeadReckoning, Ekf, Unscented])
def test_a_filter_without_readings_moves_as_the_car(filter_class):
    model, slots = car(servo_lag_s=SERVO_LAG_S), sensor_slots(("imu",))
    noise = Imu(accel_noise_std=np.array([0.1, 0.1]), gyro_noise_std=0.01)
    options = {} if filter_class is AugmentedEkf else {"process_noise_cov": 1e-6 * np.eye(6)}
    estimator = filter_class(model, slots(noise), **options)
    belief, state, silent = estimator.init(), model.init(), slots(Slot(0.0, np.zeros(3)))
    for k in range(40):
        u = np.array([0.6 if k > 10 else 0.0, 0.3 if k < 25 else -0.3])
        state, _ = model.step(state, u, TICK_S, np.zeros(3))
        belief, estimate = estimator.step(belief, Tick((k + 1) * 10_000_000, u, silent))
    assert estimate.nu == pytest.approx(state.nu, abs=1e-3)
