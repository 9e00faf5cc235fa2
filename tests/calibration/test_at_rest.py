"""A sensor at rest: its noise, its bias with a correct error, the effect of temperature, and timestamp errors."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.calibration.at_rest import measure_at_rest
from baqueano.errors import UsageError
from baqueano.runs.run import Channel
from baqueano.simulate import simulate
from tests.codes import of_code


@pytest.fixture(scope="module")
def resting_run(small):
    """Return two minutes of the small vehicle with its motors off, on a floor without vibration."""
    smooth_floor = small.with_values({"model.process_noise_std": [0.0, 0.0, 0.0]})
    return simulate(smooth_floor, np.zeros((12_000, 3)), 3)


def test_noise_and_bias_of_a_simulated_imu_are_identified(resting_run, small):
    rest = measure_at_rest(resting_run)
    imu = small.sensors.imu
    truth = np.array([*imu.accel_noise_std, imu.gyro_noise_std])
    np.testing.assert_allclose([c.std for c in rest.channels], truth, rtol=0.05)
    np.testing.assert_allclose(
        [c.coefficients.value[0] for c in rest.channels], truth / np.sqrt(imu.rate_hz), rtol=0.1
    )
    gyro = rest.channels[2]
    assert abs(gyro.mean - imu.gyro_bias) < 5.0 * gyro.mean_std
    assert rest.verdict == "USABLE"


def test_the_vehicle_file_receives_the_measured_noise_and_bias(resting_run, small):
    file = measure_at_rest(resting_run).updated_file(small.with_values({"sensors.imu.gyro_noise_std": 0.5}))
    assert file.sensors.imu.gyro_noise_std == pytest.approx(small.sensors.imu.gyro_noise_std, rel=0.05)
    assert file.sensors.imu.gyro_bias == pytest.approx(small.sensors.imu.gyro_bias, abs=1e-3)


def test_the_first_second_of_each_rest_is_discarded(small):
    u = np.zeros((3000, 3))
    u[200:500, 0] = 0.6
    rest = measure_at_rest(simulate(small, u, 1))
    assert rest.duration_s == pytest.approx(24.0, abs=0.05)


def test_a_temperature_dependence_of_the_bias_is_reported(resting_run):
    t = resting_run.t_s
    warm = 20.0 + 8.0 * t / t[-1]
    imu = resting_run.sensors["imu"]
    z = imu.z.copy()
    z[:, 2] += 1e-3 * (np.interp(imu.t_ns, resting_run.t_ns, warm) - 20.0)
    heat = Channel(resting_run.t_ns[::100], resting_run.t_ns[::100], warm[::100, None])
    rest = measure_at_rest(
        replace(resting_run, sensors={"imu": Channel(imu.t_ns, imu.arrival_ns, z), "temperature": heat})
    )
    gyro = rest.channels[2]
    assert gyro.slope == pytest.approx(1e-3, abs=4.0 * gyro.slope_std)
    assert gyro.slope_std < 1e-4
    assert [c.sensor for c in rest.channels] == ["imu"] * 3


def test_timestamps_in_bursts_are_reported(resting_run):
    imu = resting_run.sensors["imu"]
    t = imu.t_ns[np.minimum(np.arange(len(imu.t_ns)) // 10 * 10 + 9, len(imu.t_ns) - 1)]
    t = t + np.arange(len(t)) % 10 * 1_000_000
    rest = measure_at_rest(replace(resting_run, sensors={"imu": Channel(t, np.maximum.accumulate(t), imu.z)}))
    assert rest.verdict == "WARN"
    assert rest.findings[0].code == "at-rest.bursts"
    assert rest.findings[0].figures["median_ms"] == pytest.approx(1.0)
    assert rest.findings[0].figures["mean_ms"] == pytest.approx(10.0, rel=0.01)


def test_repeated_samples_touches_and_dead_channels_are_reported(resting_run):
    imu = resting_run.sensors["imu"]
    z = imu.z.copy()
    z[1::2] = z[:-1:2]
    z[5000:5100, 0] += 30.0
    z[:, 1] = 0.0
    findings = measure_at_rest(
        replace(resting_run, sensors={"imu": Channel(imu.t_ns, imu.arrival_ns, z)})
    ).findings
    figures_by_code = {(finding.code, finding.subject): finding.figures for finding in findings}
    assert figures_by_code["at-rest.repeats", "imu"]["percent"] == pytest.approx(50.0, abs=0.5)
    assert figures_by_code["at-rest.touched", "imu[0]"]["percent"] == pytest.approx(0.8, abs=0.05)
    assert figures_by_code["at-rest.dead", "imu[1]"] == {"value": 0.0}


def test_a_run_that_never_rests_is_refused(small):
    run = simulate(small, np.full((500, 3), [0.5, 0.0, 0.1]), 0)
    with pytest.raises(UsageError, check=of_code("at-rest.driven")):
        measure_at_rest(run)


def test_a_rest_with_too_few_samples_is_refused(small):
    with pytest.raises(UsageError, check=of_code("at-rest.few-samples", minimum=200)):
        measure_at_rest(simulate(small, np.zeros((100, 3)), 0))


def test_a_rest_of_a_sensor_that_the_file_lacks_is_refused(resting_run, small):
    rest = measure_at_rest(replace(resting_run, sensors={"gyro": resting_run.sensors["imu"]}))
    with pytest.raises(UsageError, check=of_code("at-rest.no-imu")):
        rest.updated_file(small)
