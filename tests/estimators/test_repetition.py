"""A gyro that repeats its last reading is not used; outliers do not keep a vehicle from its rest."""

import numpy as np
import pytest

from baqueano.estimators.readings.repetition import MIN_REVERSALS, next_repetition, no_repetition
from baqueano.geometry import wrap
from tests.monitor.driven import FROM_S, damaged_run, drives, kind_of

STUCK_S = 2.0
MAX_ERROR_DEG = 12.0


def estimate_of(kind, run):
    """Return η (N, 3), ν (N, 3), covariance (N, 6, 6) and the weights of the gyro (N,)."""
    file, filter_, _ = kind_of(kind)
    belief, out = filter_.init(), []
    for tick in run.ticks():
        slots = [getattr(tick.sensors, name) for name in file.sensors._fields]
        belief, estimate = filter_.step(belief, tick._replace(sensors=type(file.sensors)(*slots)))
        out.append((estimate.eta, estimate.nu, estimate.cov, estimate.weight[2]))
    return tuple(np.array(column) for column in zip(*out, strict=True))


@pytest.mark.parametrize("kind", ["robot", "wheels", "car"])
@pytest.mark.parametrize("fault", ["frozen", "zero"])
def test_a_stuck_gyro_changes_the_heading_by_less_than_the_model_errs(kind, fault):
    for run in drives(kind, 3):
        eta, nu, cov, weight = estimate_of(kind, damaged_run(run, "imu", [2], fault))
        mask = (run.t_s >= FROM_S) & (run.t_s < FROM_S + STUCK_S)
        error = wrap(eta[:, 2] - run.truth.eta[:, 2])[mask]
        error = np.abs(error - error[0])
        assert np.degrees(error.max()) < MAX_ERROR_DEG
        assert np.mean(error <= 1.96 * np.sqrt(cov[mask, 2, 2])) >= 0.95
        assert np.mean(weight[mask] == 0.0) > 0.95
        assert np.max(np.abs(nu[mask, 0] - run.truth.nu[mask, 0])) <= 0.2


@pytest.mark.parametrize("copies", [1, 4])
def test_a_sound_gyro_is_used_although_its_readings_repeat(copies):
    """A log can contain each reading several times, and a coarse converter repeats its readings."""
    noise, step = np.random.default_rng(3).standard_normal(4000), 0.7
    z = np.repeat(step * np.round(noise / step), copies)
    state, omission_count, stuck_count = no_repetition(1), 0, 0
    for reading in z:
        state = next_repetition(state, np.array([reading]), np.array([True]))
        omission_count += bool(state.is_longest[0])
        stuck_count += bool(state.is_stuck[0])
    assert state.reversal_count[0] > MIN_REVERSALS
    assert omission_count < 0.01 * len(z)
    assert stuck_count == 0


def test_a_reading_without_noise_may_stay_constant():
    """A simulation without noise: the yaw rate goes up and down, and is then constant but for its rounding."""
    t_s = np.arange(2000) * 0.01
    z = 0.5 + np.where(t_s < 10.0, np.sin(3.0 * t_s), 0.0)
    z[1200:1400] += 1e-16 * np.resize([0.0, 3.0], 200)
    state = no_repetition(1)
    for reading in z:
        state = next_repetition(state, np.array([reading]), np.array([True]))
        assert not state.is_longest[0]
    assert state.repeat_count[0] > 500.0


def test_outliers_of_a_gyro_do_not_keep_its_bias_from_being_estimated_at_rest():
    """An outlier in each tenth reading: the bias at rest is subtracted as without outliers."""
    run, file = drives("robot", 1)[0], kind_of("robot").file
    at_rest, bias = np.zeros(300, dtype=int), 0.02
    z = run.sensors["imu"].z[at_rest] + np.outer(
        np.random.default_rng(1).standard_normal(300), [0.0, 0.0, 0.005]
    )
    z[:, 2] += bias
    z[np.random.default_rng(2).random(300) < 0.1, 2] += 3.0
    filter_, tick = kind_of("robot").estimator, next(iter(run.ticks()))
    belief, estimate = filter_.init(), None
    for k in range(300):
        imu = tick.sensors.imu._replace(is_new=1.0, z=z[k], age_s=0.0)
        now = tick._replace(t_ns=tick.t_ns + 10_000_000 * k, u=0.0 * tick.u)
        belief, estimate = filter_.step(belief, now._replace(sensors=file.sensors._replace(imu=imu)))
    assert abs(np.degrees(estimate.eta[2])) < 1.0
    assert belief.mean[-1] == pytest.approx(np.median(z[:, 2]) - file.sensors.imu.gyro_bias, abs=0.002)
