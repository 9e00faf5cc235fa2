"""Thirty drives of the independent truth with sound sensors and a correct model: no fault is reported."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.monitor import rejection_event
from baqueano.monitor.findings import SENSOR
from tests.monitor.driven import damaged_run, drives, watch

TURNING_GAIN = "model.actuator_matrix[2,2]"


@pytest.mark.parametrize("kind", ["robot", "wheels", "pose", "car"])
def test_sound_sensors_give_no_fault_report(kind):
    for run in drives(kind, 10):
        findings, sensors = watch(kind, run)
        assert [finding.diagnostic for finding in findings] == []
        assert sensors.degraded_sensors == ()


@pytest.mark.parametrize("gain", [0.7, 1.4])
def test_an_error_of_the_model_that_its_fit_states_is_not_reported_and_a_frozen_gyro_still_is(gain):
    errors, stds = {TURNING_GAIN: gain}, {TURNING_GAIN: abs(1.0 / gain - 1.0)}
    for run in drives("robot", 4):
        assert watch("robot", run, errors)[0] != []  # a fit that states no error
        assert watch("robot", run, errors, stds)[0] == []
        frozen_run = damaged_run(run, "imu", [2], "frozen")
        findings, _ = watch("robot", frozen_run, errors, stds)
        assert {(finding.name, finding.faulty_part) for finding in findings} == {("imu[2]", SENSOR)}
        assert findings[-1].is_degraded


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
