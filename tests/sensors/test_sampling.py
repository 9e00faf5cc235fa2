"""The answer times of a sensor: rate and delay, equal for every sensor of the package."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from baqueano.sensors import Beacon, Compass, Imu, Odometer, Pose, Rangefinder, Wheels
from baqueano.signals import Motion, seconds

QUICK = settings(max_examples=30)

SENSORS = {
    "imu": lambda **f: Imu(**f),
    "wheels": lambda **f: Wheels(track_m=0.12, **f),
    "odometer": lambda **f: Odometer(**f),
    "pose": lambda **f: Pose(**f),
    "beacon": lambda **f: Beacon(point_m=np.array([-1000.0, 0.0]), **f),
    "rangefinder": lambda **f: Rangefinder(
        wall_point_m=np.array([1000.0, 0.0]), wall_heading_rad=0.0, max_range_m=2000.0, **f
    ),
    "compass": lambda **f: Compass(**f),
}
names = pytest.mark.parametrize("name", SENSORS)


def moving(t_s: float) -> Motion:
    """Return a speed that contains the time: ν = (t, 0, t), at the pose (t, 0, 0)."""
    return Motion(np.array([t_s, 0.0, 0.0]), np.array([t_s, 0.0, t_s]), np.zeros(3), np.zeros(2))


def answers(sensor, ticks=200, dt_ns=10_000_000):
    """Return (is_new (N,), z (N, m)) at ticks of dt_ns, the first one dt_ns after the start."""
    state, is_new, z = sensor.init(), [], []
    for k in range(1, ticks + 1):
        t_ns = k * dt_ns
        noise = np.zeros(sensor.noise_size)
        state, slot = sensor.step(state, moving(seconds(t_ns)), seconds(t_ns, t_ns - dt_ns), noise)
        is_new.append(slot.is_new)
        z.append(slot.z)
    return np.array(is_new), np.array(z)


@names
def test_a_sensor_at_the_tick_rate_answers_at_each_tick(name):
    is_new, _ = answers(SENSORS[name](rate_hz=100.0), ticks=2000)
    assert np.all(is_new == 1.0)


@names
def test_a_sensor_at_half_the_rate_answers_at_every_second_tick(name):
    is_new, z = answers(SENSORS[name](rate_hz=50.0))
    assert np.array_equal(is_new, np.tile([0.0, 1.0], 100))
    assert not z[is_new == 0.0].any()


@QUICK
@given(st.integers(1, 400), st.integers(1, 400))
def test_a_sensor_answers_at_its_rate_and_never_twice_a_tick(rate_hz, tick_hz):
    is_new, _ = answers(Odometer(rate_hz=float(rate_hz)), ticks=150, dt_ns=round(1e9 / tick_hz))
    expected = 150 * min(rate_hz / tick_hz, 1.0)
    assert abs(is_new.sum() - expected) <= 1.0
    assert set(is_new) <= {0.0, 1.0}


def test_a_sensor_maintains_its_rate_with_irregular_ticks():
    sensor, t_ns, count = Odometer(rate_hz=40.0), 0, 0.0
    state = sensor.init()
    for dt_ns in np.random.default_rng(5).integers(5_000_000, 15_000_000, 1000).tolist():
        t_ns += dt_ns
        state, slot = sensor.step(state, moving(0.0), seconds(dt_ns), np.zeros(1))
        count += slot.is_new
    assert abs(count - 40.0 * seconds(t_ns)) <= 1.0


@names
@pytest.mark.parametrize("delay_s", [0.0049, 0.01, 0.0275])
def test_a_delayed_sensor_reads_the_past_and_is_silent_before(name, delay_s):
    sensor = SENSORS[name](rate_hz=100.0, delay_s=delay_s, delay_slots=3)
    is_new, z = answers(sensor, ticks=50)
    t_s = 0.01 * np.arange(1, 51)
    silent = int(np.ceil(delay_s / 0.01 - 1e-6))
    assert np.array_equal(is_new, t_s > silent * 0.01 + 1e-6)
    column = 2 if name == "imu" else 0  # those that are linear in time
    expected = [sensor.h(moving(t))[column] for t in t_s[silent:] - delay_s]
    assert z[silent:, column] == pytest.approx(expected, abs=1e-12)


@names
def test_delay_and_slow_rate_of_a_sensor_can_be_combined(name):
    sensor = SENSORS[name](rate_hz=20.0, delay_s=0.02, delay_slots=2)
    is_new, z = answers(sensor, ticks=30)
    assert np.flatnonzero(is_new).tolist() == [4, 9, 14, 19, 24, 29]
    assert z[4] == pytest.approx(sensor.h(moving(0.05 - 0.02)))


@names
def test_a_tick_of_zero_duration_gives_no_second_reading(name):
    sensor = SENSORS[name](rate_hz=100.0, delay_s=0.01, delay_slots=1)
    state = sensor.init()
    for _ in range(3):
        state, _ = sensor.step(state, moving(0.1), 0.01, np.zeros(sensor.noise_size))
    state, slot = sensor.step(state, moving(0.1), 0.0, np.zeros(sensor.noise_size))
    assert slot.is_new == 0.0
    assert np.all(np.isfinite(slot.z))
    _, slot = sensor.step(state, moving(0.1), 0.01, np.zeros(sensor.noise_size))
    assert slot.is_new == 1.0


@names
def test_reading_and_covariance_have_the_stated_size(name):
    sensor = SENSORS[name]()
    assert sensor.h(moving(0.3)).shape == (sensor.size,)
    assert sensor.cov.shape == (sensor.size, sensor.size)
    _, slot = sensor.step(sensor.init(), moving(0.3), 0.01, np.zeros(sensor.noise_size))
    assert slot.z.shape == (sensor.size,)
