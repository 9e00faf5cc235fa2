"""Samples that are not measurements are detected by statistical limits and excluded; sound samples are not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from baqueano.diagnostics import Severity, note
from baqueano.runs.diagnostics.samples import channel_resolution, check_samples
from baqueano.runs.run import Channel
from baqueano.sensors import Imu, Odometer, Wheels

IMU = Imu(accel_noise_std=np.array([0.1, 0.1]), gyro_noise_std=0.01)


def channel(z):
    t_ns = np.arange(1, len(z) + 1) * 10_000_000
    return Channel(t_ns, t_ns, np.asarray(z, float))


def motion(n=4000, seed=0, step=0.0):
    rng = np.random.default_rng(seed)
    t = np.arange(n) / 100.0
    z = np.stack([2.0 * np.sin(t), np.cos(1.7 * t), 0.5 * np.sin(0.9 * t)], axis=1)
    z += rng.standard_normal(z.shape) * [0.1, 0.1, 0.01]
    return z if step == 0.0 else step * np.round(z / step)


def codes(findings):
    return {finding.code for finding in findings}


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("step", [0.0, 1e-3])
def test_sound_samples_are_not_changed(seed, step):
    z = motion(seed=seed, step=step)
    after, findings = check_samples("imu", IMU, channel(z))
    assert findings == []
    assert np.array_equal(after.z, z)


def test_readings_with_rounding_errors_are_not_reported_or_changed():
    z = motion(step=6e-4, n=8000)
    z[:, 2] = motion(n=8000)[:, 0]
    last = np.random.default_rng(3).integers(0, 3, z.shape)
    rounded_z = z + last * np.spacing(z)
    assert channel_resolution(rounded_z[:, 0]).step == pytest.approx(6e-4)
    after, findings = check_samples("imu", IMU, channel(rounded_z))
    assert findings == []
    assert np.array_equal(after.z, rounded_z)


@pytest.mark.parametrize("period", [2, 5, 8])
def test_only_the_first_of_repeated_samples_is_retained(period):
    z = motion()
    repeated_z = z[np.arange(len(z)) // period * period]
    after, findings = check_samples("imu", IMU, channel(repeated_z))
    new = np.isfinite(after.z).all(axis=1)
    assert np.array_equal(np.flatnonzero(new), np.arange(0, len(z), period))
    assert "data.repeats" in codes(findings)
    assert findings[0].subject == "imu"  # all channels are equal, so reported once


def test_id7_a_stuck_channel_loses_only_the_time_of_the_fault():
    z = motion()
    z[1000:1500, 2] = z[1000, 2]
    after, findings = check_samples("imu", IMU, channel(z))
    lost_rows = ~np.isfinite(after.z)
    assert not lost_rows[:, :2].any()
    assert np.array_equal(np.flatnonzero(lost_rows[:, 2]), np.arange(1001, 1500))
    assert findings[0].figures["longest"] == 499


@pytest.mark.parametrize("part", [0.02, 0.3])
def test_id9_frames_that_were_logged_as_zero_are_removed(part):
    z = motion()
    zero = np.random.default_rng(1).random(len(z)) < part
    z[zero] = 0.0
    after, findings = check_samples("imu", IMU, channel(z))
    assert "data.zeros" in codes(findings)
    assert not np.isfinite(after.z[zero]).any()
    assert np.isfinite(after.z[~zero]).all()


def test_encoder_zeros_at_rest_are_retained_and_isolated_zeros_are_removed():
    wheels, rng = Wheels(track_m=0.1, noise_std=0.01), np.random.default_rng(0)
    v = np.concatenate([np.zeros(300), 0.5 + 0.01 * rng.standard_normal(700)])
    lost_rows = np.arange(400, 900, 37)
    v[lost_rows] = 0.0
    after, findings = check_samples("wheels", wheels, channel(np.stack([v, v], axis=1)))
    assert np.array_equal(np.flatnonzero(~np.isfinite(after.z[:, 0])), lost_rows)
    assert codes(findings) == {"data.zeros"}


def test_many_samples_at_the_largest_value_are_reported_as_clipped():
    z = motion()
    clipped_z = np.clip(z, -1.2, 1.2)
    after, findings = check_samples("imu", IMU, channel(clipped_z))
    assert "data.clipped" in codes(findings)
    assert findings[0].subject == "imu[0]"
    is_clipped = np.abs(2.0 * np.sin(np.arange(len(z)) / 100.0)) > 1.3
    assert np.isfinite(after.z[is_clipped, 0]).mean() < 0.05
    assert np.isfinite(after.z[:, 2]).all()  # the signal never reached the end of the range


def test_one_visit_to_a_full_scale_of_chips_in_use_is_enough():
    z, pulse = motion(), 5.0 * np.exp(-(((np.arange(4000) - 2000) / 60.0) ** 2))
    for end, is_known in ((32767 / 131, True), (245.0, False)):
        turning = z[:, 2] + pulse
        clipped_z = np.column_stack([z[:, :2], np.clip(turning, -np.radians(end), np.radians(end))])
        after, findings = check_samples("imu", IMU, channel(clipped_z))
        assert ("data.clipped" in codes(findings)) == is_known
        assert np.isnan(after.z[turning > np.radians(end), 2]).all() == is_known
        assert np.isfinite(after.z[turning < np.radians(end) - 0.1]).all()


def test_one_reading_beyond_the_range_of_the_file_is_excluded():
    z = motion()
    z[1000, 1] = -19.0
    after, findings = check_samples("imu", replace(IMU, accel_limit=19.0), channel(z))
    assert np.argwhere(np.isnan(after.z)).tolist() == [[1000, 1]]
    assert codes(findings) == {"data.clipped"}


def test_zeros_at_rest_of_a_vehicle_that_turns_one_way_are_no_end_of_range():
    z = motion()
    z[:, 2] = np.minimum(z[:, 2] - 0.6, 0.0) * (np.arange(4000) % 1000 > 200)
    _, findings = check_samples("imu", IMU, channel(z))
    assert "data.clipped" not in codes(findings)


def test_id6_clipped_samples_are_removed_without_biasing_the_fit():
    t = np.arange(20_000) / 100.0
    truth = 1.5 * np.sin(t)
    z = truth + 0.1 * np.random.default_rng(3).standard_normal(len(t))
    after, _ = check_samples("imu", IMU, channel(np.stack([np.clip(z, -1.2, 1.2), z, z], axis=1)))
    identifiable = np.isfinite(after.z[:, 0])
    error = np.mean(np.sign(truth[identifiable]) * (after.z[identifiable, 0] - truth[identifiable]))
    is_within = np.abs(np.clip(z, -1.2, 1.2)) < 1.2
    pull = np.mean(np.sign(truth[is_within]) * (z[is_within] - truth[is_within]))
    assert abs(error) < 0.5 * abs(pull)


def test_a_constant_channel_is_excluded_with_a_warning():
    z = motion()
    z[:, 1] = 0.0
    after, findings = check_samples("imu", IMU, channel(z))
    assert not np.isfinite(after.z[:, 1]).any()
    message = note("data.dead-channel", Severity.WARNING, subject="imu[1]", value=0.0, samples=4000)
    assert findings[0] == message


def test_the_noise_estimate_ignores_repeated_values():
    z = motion()[:, 0]
    repeated_z = np.repeat(z, 4)
    assert channel_resolution(repeated_z).sigma == pytest.approx(0.1, rel=0.05)
    assert channel_resolution(np.zeros(100)).sigma == 0.0


@pytest.mark.parametrize("period_s", [64e-6, 4e-6])
def test_encoders_that_measure_step_times_are_not_reported_as_stuck(period_s):
    """A wheel with 12 steps a turn follows commands with a lag of 50 ms and then rolls evenly."""
    rng = np.random.default_rng(0)
    speed = np.repeat(np.minimum(rng.uniform(0.1, 0.9, 60), 0.6), 100)  # 0.6 m/s is its top speed
    v = lfilter([0.2], [1.0, -0.8], speed)
    step_m = 2.0 * np.pi * 0.0325 / 12
    z = step_m / (period_s * np.round(step_m / np.maximum(v, 0.02) / period_s))
    after, findings = check_samples("odometer", Odometer(noise_std=0.01), channel(z[:, None]))
    assert np.isfinite(after.z).all()
    assert findings == []
    noisy_z = z + rng.normal(0.0, 0.01, len(z))
    _, findings = check_samples(
        "odometer", Odometer(noise_std=0.01), channel(noisy_z[np.arange(len(z)) // 2 * 2, None])
    )
    assert "data.repeats" in codes(findings)
