"""Wheel encoders: rounded to counts, averaged over the time between two readings, with counter overflow."""

import numpy as np
import pytest

from baqueano.block_checks import check_sensor
from baqueano.sensors import Encoders
from baqueano.signals import Motion
from baqueano.vehicle_file import load, parse


def rolling(speed, turning=0.0):
    return Motion(np.zeros(3), np.array([speed, 0.0, turning]), np.zeros(3), np.zeros(2))


def readings_of(encoders, motions, dt_s=0.01):
    """Return readings (M, 2) and ages (M,)."""
    state, z, age_s = encoders.init(), [], []
    for motion in motions:
        state, slot = encoders.step(state, motion, dt_s, np.zeros(2))
        if slot.is_new:
            z.append(slot.z)
            age_s.append(slot.age_s)
    return np.array(z), np.array(age_s)


def test_a_reading_is_a_whole_number_of_counts_divided_by_time():
    """5 mm per count, read at 20 Hz: 0.23 m/s are 2.3 counts in 50 ms, so 2, 2, 2, 3 …"""
    z, age_s = readings_of(Encoders(track_m=0.1, count_m=0.005, rate_hz=20.0), [rolling(0.23)] * 100)
    counts = z[:, 0] * 0.05 / 0.005
    assert counts == pytest.approx(np.round(counts))
    assert counts[:4] == pytest.approx([2.0, 2.0, 2.0, 3.0])
    assert age_s == pytest.approx(np.full(20, 0.025))


def test_the_counted_distance_has_at_most_one_count_of_error():
    speeds = 0.3 + 0.25 * np.sin(np.linspace(0.0, 12.0, 1000))
    z, _ = readings_of(Encoders(track_m=0.1, count_m=0.005, rate_hz=100.0), [rolling(v) for v in speeds])
    assert np.abs(np.cumsum(z[:, 0]) - np.cumsum(speeds)).max() * 0.01 <= 0.005


@pytest.mark.parametrize("speed", [0.4, -0.4])
def test_a_counter_overflow_causes_no_jump_of_the_speed(speed):
    """A counter of 16: 0.4 m/s are 4 counts of 1 mm in 10 ms, so it overflows every 40 ms."""
    z, _ = readings_of(
        Encoders(track_m=0.1, count_m=0.001, counter=16.0, rate_hz=100.0), [rolling(speed)] * 60
    )
    assert z[1:] == pytest.approx(np.full((59, 2), speed))


def test_the_covariance_is_that_of_a_tick_that_is_longer_than_a_reading():
    """At ticks of 10 ms, the error is that of a reading of 100 Hz, although rate_hz is 1000."""
    table = '[sensors.wheels]\nkind = "encoders"\ntrack_m = 0.12\ncount_m = 0.004\nrate_hz = 1000.0\n'
    encoders = parse(f"{load('small').text}\n{table}", "x.toml").sensors.wheels
    speeds = np.linspace(0.0, 0.8, 20_000)
    z, age_s = readings_of(encoders, [rolling(v) for v in speeds])
    assert age_s == pytest.approx(np.full(20_000, 0.005))
    assert np.var(z[:, 0] - speeds) == pytest.approx(encoders.cov[0, 0], rel=0.05)


def test_in_a_left_turn_the_right_wheel_counts_more():
    z, _ = readings_of(Encoders(track_m=0.12, count_m=1e-5), [rolling(0.5, 2.0)] * 100)
    assert z[-1] == pytest.approx([0.38, 0.62], abs=1e-3)


def test_encoder_noise_has_rounding_covariance_and_negative_correlation():
    """Speeds drift through the counts: variance c²/(6 δ²), correlation of neighbours −½, as in (3)."""
    encoders = Encoders(track_m=0.1, count_m=0.004, rate_hz=50.0)
    speeds = np.linspace(0.0, 0.8, 20_000)
    z, _ = readings_of(encoders, [rolling(v) for v in speeds])
    error = z[:, 0] - speeds.reshape(-1, 2).mean(axis=1)
    assert error.var() == pytest.approx(encoders.cov[0, 0], rel=0.05)
    assert np.mean(error[1:] * error[:-1]) / error.var() == pytest.approx(-0.5, abs=0.05)


def test_encoders_pass_the_sensor_check():
    assert check_sensor(Encoders(track_m=0.12, count_m=0.001)) == []
