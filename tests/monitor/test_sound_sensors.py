"""Thirty drives of the independent truth with sound sensors and a correct model: no fault is reported."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.monitor import rejection_event
from tests.monitor.driven import drives, watch


@pytest.mark.parametrize("kind", ["robot", "wheels", "pose", "car"])
def test_sound_sensors_give_no_fault_report(kind):
    for run in drives(kind, 10):
        findings, sensors = watch(kind, run)
        assert [finding.diagnostic for finding in findings] == []
        assert sensors.degraded_sensors == ()


@pytest.mark.parametrize(("begins", "names"), [(0, []), (600, ["imu[0]", "imu[1]"])])
def test_a_gyro_alone_is_sound_and_accelerometers_that_stop_are_reported(begins, names):
    run = drives("robot", 10)[0]
    z = run.sensors["imu"].z.copy()
    z[begins:, :2] = np.nan
    sensors = run.sensors | {"imu": run.sensors["imu"]._replace(z=z)}
    findings, _ = watch("robot", replace(run, sensors=sensors))
    assert sorted({finding.name for finding in findings}) == names


def test_rejections_are_counted_for_each_channel():
    run = drives("robot", 10)[0]
    z = run.sensors["imu"].z.copy()
    z[200:1200:100, 2] += 8.0  # ten single spikes of the gyro
    z[1500, 2] = np.nan
    spiked_sensors = run.sensors | {"imu": run.sensors["imu"]._replace(z=z)}
    _, sensors = watch(
        "robot", run.__class__(run.name, None, run.t_ns, run.applied_commands, sensors=spiked_sensors)
    )
    assert [refusal.name for refusal in sensors.rejections] == ["imu[0]", "imu[1]", "imu[2]"]
    assert [refusal.rejected_count for refusal in sensors.rejections] == [0, 0, 10]
    assert rejection_event(sensors.rejections).figures["imu[2].refused"] == 10
    assert rejection_event(sensors.rejections).figures["reasons"] == f"imu[2]: 10/{len(z) - 1}"
    # an accelerometer does not correct the estimate
    assert [refusal.reading_count for refusal in sensors.rejections] == [0, 0, len(z) - 1]
