"""Throttle, servo → speed, yaw rate on the recordings of the CPM µCar: irregular ticks, a plastic gearbox, unknown true
parameters.

The other run, simulated only from its commands, judges each fit.
"""

import numpy as np
import pytest

from baqueano.identify import FitOptions, identify
from baqueano.runs.importing import import_run
from baqueano.vehicle_file import load


@pytest.fixture(scope="module")
def runs(cpm_recordings):
    return import_run("cpm_run_a").run, import_run("cpm_run_b").run


@pytest.fixture(scope="module")
def fits(runs):
    return [identify(run, load("car"), use=["odometer", "imu[2]"]) for run in runs]


def held_out(fit, run):
    """Return R² of speed and yaw rate on the other run, with only biases and start fitted."""
    names = [n for n in fit.names if np.isfinite(fit.value(n))]
    second = identify(
        run,
        fit.updated_file(),
        names[:1],
        use=["odometer", "imu[2]"],
        options=FitOptions(bounds=_pinned(fit, names[0])),
    )
    return {
        (c.sensor, c.entry): c.explained_fraction
        for c in second.channels
        if np.isfinite(c.explained_fraction)
    }


def _pinned(fit, name):
    x = fit.value(name)
    return {name: (x * (1.0 - 1e-9), x * (1.0 + 1e-9))}


def test_a_car_model_is_identified_from_either_run(fits):
    for fit in fits:
        assert fit.converged
        assert fit.verdict in ("USABLE", "WARN")
        assert 5.0 < fit.value("model.throttle_gain") < 12.0
        assert 0.4 < fit.value("model.steering_gain") < 0.6


def test_the_model_of_one_run_predicts_the_other_run(fits, runs):
    for fit, second_run in ((fits[0], runs[1]), (fits[1], runs[0])):
        r2 = held_out(fit, second_run)
        assert r2["odometer", 0] > 0.9
        assert r2["imu", 2] > 0.9


@pytest.mark.long
def test_a_repeated_imu_fit_of_a_recording_gives_the_same_estimate(runs):
    """With a raw gyro, a free delay and a servo of 8 ms, below the row period of 25 ms, the second fit identified
    nothing."""
    free = ["throttle_gain", "linear_drag", "coulomb_m_s2", "cornering_drag", "steering_gain",
            "steering_offset_rad", "yaw_lag_s", "drivetrain.delay_s"]  # fmt: skip
    raw = load("car").with_values({"sensors.imu.gyro_scale": 1.0})
    options = FitOptions(gyro_leads=True)
    first = identify(runs[0], raw, [f"model.{name}" for name in free], options=options)
    second = identify(runs[0], first.vehicle_file, [f"model.{name}" for name in free], options=options)
    assert np.isfinite(second.estimate).all()
    assert np.max(np.abs(second.estimate - first.estimate) / first.std) <= 0.3
