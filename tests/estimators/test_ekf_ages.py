"""A delayed measurement is compared with the past state; the file or the timestamp states the delay."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.compare import compare
from baqueano.drive import experiment, replay
from baqueano.identify import excitation
from baqueano.vehicle_file import load
from tests.ekf_file import with_ekf

DELAY_S = 0.01


@pytest.fixture(scope="module")
def small():
    return load("small")


@pytest.fixture(scope="module")
def run(small):
    """Return 20 s of an IMU with 10 ms of delay, as behind a filter of 42 Hz whose samples are averaged over a tick."""
    u = excitation("random_steps", small.command.limit, 20.0, small.rate_hz)
    return experiment(small.with_values({"sensors.imu.delay_s": DELAY_S}), u)


def yaw_rate_error(run):
    truth = np.interp(run.estimate.t_ns, run.truth.t_ns, run.truth.nu[:, 2])
    return np.sqrt(np.mean((run.estimate.nu[:, 2] - truth) ** 2))


def nees(run):
    (row,) = compare(run).rows()
    return row["nees_velocity"]


def test_a_filter_with_the_declared_sensor_delay_does_not_lag(run, small):
    assert yaw_rate_error(run) < 0.25 * yaw_rate_error(replay(run, small))
    assert nees(run) < 2.0


def test_the_filter_of_the_paper_is_consistent_only_with_the_declared_delay(run, small):
    unaware = with_ekf(small)
    aware = replay(run, unaware.with_values({"sensors.imu.delay_s": DELAY_S}))
    assert yaw_rate_error(aware) < 0.25 * yaw_rate_error(replay(run, unaware))
    assert nees(aware) < 2.0 < 20.0 < nees(replay(run, unaware))


def test_a_sensor_timestamp_compensates_the_delay_like_the_declared_delay(run, small):
    channel = run.sensors["imu"]
    stamped_channel = channel._replace(t_ns=np.maximum(channel.arrival_ns - round(1e9 * DELAY_S), 0))
    replayed_run = replay(replace(run, sensors=run.sensors | {"imu": stamped_channel}), small)
    np.testing.assert_allclose(replayed_run.estimate.nu, run.estimate.nu, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("off_s", [-0.01, 10.0])
def test_a_timestamp_of_another_clock_is_not_used_as_a_delay(run, small, off_s):
    channel = run.sensors["imu"]
    stamped_channel = channel._replace(t_ns=channel.arrival_ns - round(1e9 * off_s))
    replayed_run = replay(replace(run, sensors=run.sensors | {"imu": stamped_channel}), small)
    np.testing.assert_array_equal(replayed_run.estimate.nu, replay(run, small).estimate.nu)
