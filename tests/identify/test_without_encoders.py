"""A vehicle from commands and IMU alone: simulated ones, whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.errors import UsageError
from baqueano.identify.envelope import envelope_of
from baqueano.identify.systematic import of_tolerance, scales_of
from baqueano.identify.without_encoders import without_encoders
from baqueano.simulate import simulate
from baqueano.vehicle_file import load

LONGITUDINAL = ("model.throttle_gain", "model.linear_drag", "model.coulomb_m_s2", "model.cornering_drag")
YAW = ("model.steering_gain", "model.steering_offset_rad", "model.yaw_lag_s")
QUIET = {"sensors.imu.accel_noise_std": [0.0, 0.0], "sensors.imu.gyro_noise_std": 0.0}
EXACT = {"gyro": 0.0, "accel": 0.0}


def steps(rng, low, high, hold_s, seconds, rate_hz):
    """A command that jumps every `hold_s`."""
    count = int(np.ceil(seconds / hold_s))
    return np.repeat(rng.uniform(low, high, count), int(hold_s * rate_hz))[: int(seconds * rate_hz)]


def driven(seed, seconds=60.0, changes=None):
    """A car whose IMU is shaken the more, the faster it drives; only its IMU is recorded."""
    file, rng = load("car").with_values({"model.quadratic_drag": 0.0}), np.random.default_rng(seed)
    u = np.c_[steps(rng, 0.1, 0.55, 2.0, seconds, 50.0), steps(rng, -0.8, 0.8, 1.2, seconds, 50.0)]
    run = simulate(file.with_values(QUIET | (changes or {})), u, seed)
    channel = run.sensors["imu"]
    v = np.abs(np.interp(channel.t_ns, run.truth.t_ns, run.truth.nu[:, 0]))
    sd = np.stack([0.05 + 0.6 * v, 0.05 + 1.2 * v, 0.02 + 0.03 * v], axis=1)
    noisy = channel._replace(z=channel.z + sd * rng.normal(size=channel.z.shape))
    return file, replace(run, sensors={"imu": noisy})


@pytest.fixture(scope="module")
def fitted():
    """One car, and what was found of it."""
    file, run = driven(3)
    return file, run, without_encoders(run, file, LONGITUDINAL + YAW)


def test_a_car_is_found_from_its_commands_and_its_imu(fitted):
    file, _, fit = fitted
    assert fit.converged
    for name in ("throttle_gain", "linear_drag", "steering_gain"):
        truth = getattr(file.vehicle, name)
        assert fit.value(f"model.{name}") == pytest.approx(truth, rel=0.08), name


def test_what_no_imu_can_know_is_said(fitted):
    _, _, fit = fitted
    assert any(
        "gyro scale not identifiable" in said and "turn it twice" in said.lower() for said in fit.never
    )
    assert any("throttle from" in note and "servo from" in note for note in fit.notes)


def test_a_scale_that_nobody_measured_widens_the_errors_by_what_it_moves(fitted):
    file, run, fit = fitted
    exact = without_encoders(run, file, LONGITUDINAL + YAW, tolerance=EXACT)
    wide = without_encoders(run, file, LONGITUDINAL + YAW, tolerance={"gyro": 0.1, "accel": 0.0})
    np.testing.assert_allclose(exact.estimate, fit.estimate, rtol=1e-6)
    part = np.sqrt(np.maximum(wide.sd**2 - exact.sd**2, 0.0)) / of_tolerance(0.1)
    moved = []
    for factor in (1.02, 0.98):
        scale = file.sensors.imu.gyro_scale * factor
        other = file.with_values({"sensors.imu.gyro_scale": scale})
        moved.append(without_encoders(run, other, LONGITUDINAL + YAW, tolerance=EXACT).estimate)
    slope = np.abs(moved[0] - moved[1]) / 0.04
    gain = fit.names.index("model.steering_gain")
    assert part[gain] == pytest.approx(slope[gain], rel=0.2)
    assert np.all(np.abs(part - slope) < 0.2 * slope + 2.0 * exact.sd)


def test_a_measured_scale_is_believed_before_a_data_sheet():
    from baqueano.vehicle_file import Provenance

    file = load("car")
    np.testing.assert_allclose(scales_of(file, "imu"), np.array([0.02, 0.02, 0.03]) / np.sqrt(3.0))
    path = "sensors.imu.gyro_scale"
    known = file.with_values({path: 1.035}, {path: Provenance("two turns", None, 0.005, "USABLE")})
    assert scales_of(known, "imu")[2] == pytest.approx(0.005 / 1.035)
    assert scales_of(known, "imu", {"gyro": 0.02})[2] == pytest.approx(0.02 / np.sqrt(3.0))
    with pytest.raises(UsageError, match="parts of 1 for accel and gyro"):
        scales_of(file, "imu", {"compass": 0.1})


def test_a_run_that_leaves_the_envelope_is_flagged(fitted):
    file, run, _ = fitted
    inside = envelope_of(run, file.command.names)
    assert inside.flags(run) == ()
    faster = replace(run, applied=run.applied * np.array([1.4, 1.0]))
    said = inside.flags(faster)
    assert len(said) == 1
    assert "leaves the envelope of the fit: throttle" in said[0]
    with pytest.raises(UsageError, match="same kind of vehicle"):
        inside.flags(replace(run, applied=run.applied[:, :1]))
    with pytest.raises(UsageError, match="no run holds a command"):
        envelope_of(replace(run, applied=np.full_like(run.applied, np.nan)), file.command.names)


def test_what_cannot_be_fitted_by_an_imu_is_told_so(fitted):
    file, run, _ = fitted
    with pytest.raises(UsageError, match="expected one IMU"):
        without_encoders(run, file, imu="compass")
    with pytest.raises(UsageError, match="no command moved"):
        without_encoders(replace(run, applied=np.zeros_like(run.applied)), file)
    silent = run.sensors["imu"]._replace(z=run.sensors["imu"].z * np.array([1.0, 1.0, np.nan]))
    with pytest.raises(UsageError, match="the gyro said nothing"):
        without_encoders(replace(run, sensors={"imu": silent}), file)
