"""A lasting disagreement widens the region until it covers the truth; the estimate follows neither side."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.estimators.augmented.correction import _next_dispute_cov
from baqueano.estimators.kalman import correct
from baqueano.estimators.readings.inconsistency import (
    MIN_INCONSISTENT_S,
    added_covariances,
    track_inconsistency,
)
from baqueano.geometry import wrap
from baqueano.runs import Run
from baqueano.signals import Slot, Tick
from baqueano.simulate import simulate
from baqueano.symbolic import compile_block
from baqueano.vehicle_file import load, parse
from tests.monitor.driven import drives, kind_of

SMALL = load("small").with_values(  # the model equals the vehicle
    {"estimator.velocity_walk_std": [0.005, 0.002, 0.005], "estimator.disturbance_std": [0.02, 0.05]}
)
FAULT_S, END_S = (3.0, 8.0), 12.0
REGION_95 = 1.96
t_s = 0.01 * np.arange(round(100 * END_S))
U = np.outer(t_s >= 1.0, [0.5, 0.0, 0.0]) + np.outer(
    (t_s >= 1.0) * np.sign(np.sin(1.2 * t_s)), [0.0, 0.0, 0.4]
)
AT = (t_s >= FAULT_S[0]) & (t_s < FAULT_S[1])


@cache
def run() -> Run:
    return simulate(SMALL, U, 0)


@cache
def block():
    return compile_block(SMALL.estimator())


def estimates(z: np.ndarray, is_new: np.ndarray | None = None):
    """Return η, ν and covariance at each tick, with the readings z (N, 3) of an IMU that answers if `has` (N,) is 1."""
    belief, out = block().init(), []
    for k, t_ns in enumerate(run().t_ns.tolist()):
        slot = Slot(1.0 if is_new is None else float(is_new[k]), z[k], 0.0)
        belief, estimate = block().step(
            belief, Tick(t_ns, run().applied_commands[k], SMALL.sensors._replace(imu=slot))
        )
        out.append((estimate.eta, estimate.nu, estimate.cov))
    return tuple(np.array(column) for column in zip(*out, strict=True))


def readings(fault: str) -> np.ndarray:
    z, truth = run().sensors["imu"].z.copy(), run().truth
    assert truth is not None
    if fault == "stuck":
        z[AT, 2] = z[np.argmax(AT), 2]
    elif fault == "zero":
        z[AT, 2] = 0.0
    elif fault == "off":
        z[AT, 2] += 1.0
    return z


@pytest.mark.parametrize("fault", ["stuck", "zero", "off"])
def test_the_heading_region_covers_the_truth_during_and_after_a_gyro_fault(fault):
    eta, nu, cov = estimates(readings(fault))
    truth = run().truth
    e = wrap(eta[:, 2] - truth.eta[:, 2])
    is_inside = np.abs(e) <= REGION_95 * np.sqrt(cov[:, 2, 2])
    is_late = t_s >= FAULT_S[0] + MIN_INCONSISTENT_S + 0.1
    assert np.mean(is_inside[is_late]) >= 0.95
    turning = np.abs(nu[:, 2] - truth.nu[:, 2]) <= REGION_95 * np.sqrt(cov[:, 5, 5])
    assert np.mean(turning[AT & is_late]) >= 0.95


@cache
def wheeled_block():
    """Return the filter of SMALL with two wheels and a model that allows almost any motion."""
    text = SMALL.text + '\n[sensors.wheels]\nkind = "wheels"\ntrack_m = 0.12\nnoise_std = 0.02\n'
    file = parse(text, SMALL.name).with_values(
        {"estimator.use": ["imu", "wheels"], "estimator.disturbance_std": [1.0, 10.0]}
    )
    return file, compile_block(file.estimator())


@pytest.mark.parametrize(("fault", "signal"), [("gyro", [3, 5]), ("bias", [5]), ("wheel", [3]), ("none", [])])
def test_wheels_and_gyro_widen_the_region_of_the_signal_that_the_model_contradicts(fault, signal):
    file, filter_ = wheeled_block()
    imu, truth = run().sensors["imu"].z.copy(), run().truth
    speed = 0.06 * truth.nu[:, 2]
    noise = 0.02 * np.random.default_rng(5).standard_normal((len(t_s), 2))
    wheels = np.stack([truth.nu[:, 0] - speed, truth.nu[:, 0] + speed], axis=1) + noise
    if fault == "gyro":
        imu[AT, 2] *= 2.0
    elif fault == "bias":
        imu[AT, 2] += 0.6  # 2.5 standard deviations of a reading of the wheels
    elif fault == "wheel":
        wheels[AT, 0] = -0.3
    belief, nu, cov = filter_.init(), [], []
    for k, t_ns in enumerate(run().t_ns.tolist()):
        slots = file.sensors._replace(imu=Slot(1.0, imu[k], 0.0), wheels=Slot(1.0, wheels[k], 0.0))
        belief, estimate = filter_.step(belief, Tick(t_ns, run().applied_commands[k], slots))
        nu.append(estimate.nu)
        cov.append(np.diag(estimate.cov))
    mask = AT & (t_s >= FAULT_S[0] + 1.0)
    is_inside = np.abs(np.array(nu) - truth.nu)[mask] <= REGION_95 * np.sqrt(np.array(cov)[mask, 3:])
    assert np.all(np.mean(is_inside[:, [2] if fault == "bias" else [0, 2]], axis=0) >= 0.9)
    before = np.median(np.array(cov)[(t_s > 1.5) & (t_s < FAULT_S[0])], axis=0)
    is_wide = np.median(np.array(cov)[mask], axis=0) > 30.0 * before
    assert [k for k in (3, 5) if is_wide[k]] == signal


def test_the_region_covers_the_truth_if_the_model_turns_half_as_much():
    gain = 0.5 * SMALL.vehicle.actuator_matrix[2, 2]
    heavier = simulate(SMALL.with_values({"model.actuator_matrix[2,2]": gain}), U, 0)
    eta, _, cov = estimates(heavier.sensors["imu"].z)
    e = wrap(eta[:, 2] - heavier.truth.eta[:, 2])
    assert np.mean(np.abs(e) <= REGION_95 * np.sqrt(cov[:, 2, 2])) >= 0.95


@pytest.mark.parametrize("weight", [1.0, 0.7])
def test_the_dispute_is_what_the_correction_of_the_wider_covariance_says(weight):
    """Compared with the equations of a correction by all channels at once, which invert S."""
    random = np.random.default_rng(0)
    A, B, H = random.normal(size=(5, 5)), random.normal(size=(3, 2)), random.normal(size=(2, 5))
    H[:, 3:], q, y = 0.0, np.array([0.3, 0.5]), np.array([0.4, -0.9])
    P, W = A @ A.T, B @ B.T
    update = correct(P, y, H, q, weight=lambda c, e, s: weight)
    next_W = _next_dispute_cov(SimpleNamespace(pose_groups=((0, 1),)), W, update)
    noise = update.s / weight - np.array([H[0] @ P @ H[0], 0.0])  # a smaller weight is a larger noise
    P_1 = P - update.gain[0][:, None] * update.gain[0] * update.s[0] / weight
    noise[1] -= H[1] @ P_1 @ H[1]

    def corrected(P):
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + np.diag(noise))
        return (P - K @ H @ P)[:3, :3], (K @ y)[:3]

    (cov, change), (wide_cov, wide_change) = corrected(P), corrected(P + np.pad(W, (0, 2)))
    c = wide_change - change
    np.testing.assert_allclose(next_W, wide_cov - cov + np.outer(c, c), rtol=1e-9, atol=1e-12)


@cache
def block_with_tags():
    tags = '[sensors.tags]\nkind = "tags"\npoints_m = [[0.0, 0.0]]\nradius_m = 9.0\nnoise_std = 0.01\n'
    file = parse(f"{SMALL.text}\n{tags}", "small.toml").with_values(
        {
            "estimator.use": ["imu", "tags"],
            "estimator.disturbance_std": [0.02, 0.15],
            "estimator.disturbance_fade_s": [1.0, 4.0],
        }
    )
    return file.sensors, compile_block(file.estimator())


@pytest.mark.parametrize(
    ("gain", "bias", "max_error"), [(0.96, 0.0, 0.07), (1.0, 0.4, np.pi)], ids=["model", "gyro"]
)
def test_tags_decide_whether_the_model_or_the_gyro_is_wrong(gain, bias, max_error):
    """A tag that agrees with the gyro leaves the heading; one that contradicts it corrects the heading."""
    turn = gain * SMALL.vehicle.actuator_matrix[2, 2]
    recording = simulate(SMALL.with_values({"model.actuator_matrix[2,2]": turn}), U, 0)
    z, places = recording.sensors["imu"].z + np.outer(AT, [0.0, 0.0, bias]), recording.truth.eta[:, :2]
    places = places + np.random.default_rng(0).normal(0.0, 0.01, places.shape)
    sensors, ekf = block_with_tags()
    belief, errors, std = ekf.init(), [], []
    for k, t_ns in enumerate(recording.t_ns.tolist()):
        slots = sensors._replace(imu=Slot(1.0, z[k], 0.0), tags=Slot(float(k % 100 == 99), places[k], 0.0))
        belief, estimate = ekf.step(belief, Tick(t_ns, recording.applied_commands[k], slots))
        errors.append(abs(wrap(estimate.eta[2] - recording.truth.eta[k, 2])))
        std.append(np.sqrt(estimate.cov[2, 2]))
    is_late = t_s >= FAULT_S[0] + MIN_INCONSISTENT_S
    assert np.mean((np.array(errors) <= REGION_95 * np.array(std))[is_late]) >= 0.95
    assert max(errors) <= max_error
    assert errors[-1] <= 0.07


@cache
def block_with_lag_error():
    return compile_block(SMALL.with_values({"estimator.motor_lag_std_s": 0.03}).estimator())


@pytest.mark.parametrize(
    ("bias", "is_wide"), [pytest.param(0.0, False, id="sound"), pytest.param(0.8, True, id="bias")]
)
def test_a_lag_error_within_its_error_is_no_disagreement_and_a_gyro_bias_is_one(bias, is_wide):
    u = np.outer(t_s >= 1.0, [0.62, 0.0, 0.0])
    u[:, 2] = 0.3 * (t_s >= 1.0) * np.sign(np.sin(20.0 * t_s + 2.0 * np.sin(2.0 * t_s)))
    slow = simulate(SMALL.with_values({"model.drivetrain.lag_s": 0.09}), u, 0)
    belief, errors, std = block_with_lag_error().init(), [], []
    for k, t_ns in enumerate(slow.t_ns.tolist()):
        z = slow.sensors["imu"].z[k] + np.array([0.0, 0.0, bias * AT[k]])
        tick = Tick(t_ns, slow.applied_commands[k], SMALL.sensors._replace(imu=Slot(1.0, z, 0.0)))
        belief, estimate = block_with_lag_error().step(belief, tick)
        errors.append(wrap(estimate.eta[2] - slow.truth.eta[k, 2]))
        std.append(np.sqrt(estimate.cov[2, 2]))
    assert (std[-1] > 0.3) == is_wide
    assert np.mean(np.abs(errors) <= REGION_95 * np.array(std)) >= 0.9


def test_consistent_sensors_cause_no_lasting_disagreement():
    """The duration of a disagreement stays below the threshold that widens the region."""
    belief = block().init()
    for k, t_ns in enumerate(run().t_ns.tolist()):
        slot = Slot(1.0, run().sensors["imu"].z[k], 0.0)
        belief, _ = block().step(
            belief, Tick(t_ns, run().applied_commands[k], SMALL.sensors._replace(imu=slot))
        )
        assert belief.memory.inconsistency[1].max() < MIN_INCONSISTENT_S


def test_a_frozen_imu_causes_a_speed_error_below_20_cm_s():
    z = run().sensors["imu"].z.copy()
    for begin_s in (2.0, 3.3, 5.1, 8.4):
        mask, damaged_z = (t_s >= begin_s) & (t_s < begin_s + 2.0), z.copy()
        damaged_z[mask] = z[np.argmax(mask)]
        _, nu, _ = estimates(damaged_z)
        assert np.max(np.abs(nu[:, 0] - run().truth.nu[:, 0])) <= 0.2


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_single_nan_reading_has_no_effect(value):
    """The estimate equals, bit by bit, the estimate of an IMU that was silent in this tick."""
    z, is_new = run().sensors["imu"].z.copy(), np.ones(len(t_s))
    z[500], is_new[500] = value, 0.0
    for estimate, silent in zip(estimates(z), estimates(run().sensors["imu"].z, is_new), strict=True):
        assert np.array_equal(estimate, silent)


def test_position_uncertainty_grows_by_velocity_uncertainty_times_time():
    doubt, pose = np.zeros((2, 2)), np.zeros((3, 3))
    for _ in range(300):
        now = track_inconsistency(doubt, np.array([0.2, 0.0]), np.zeros(2), np.array([True, True]), 0.01)
        of_pose, of_nu = added_covariances(now[0], doubt[1], now[1], 0.5 * np.pi, 0.01)
        doubt, pose = now, pose + of_pose
    assert np.sqrt(pose[1, 1]) == pytest.approx(0.2 * 3.0)
    assert pose[0, 0] == pytest.approx(0.0, abs=1e-12)
    assert pose[2, 2] == 0.0
    assert np.sqrt(of_nu[0, 0]) == pytest.approx(0.2)


def test_one_rejected_reading_in_ten_does_not_widen_the_region():
    doubt = np.zeros((2, 2))
    for k in range(1000):
        error = np.full(2, 1.0 if k % 10 == 0 else 0.0)
        doubt = track_inconsistency(doubt, error, np.zeros(2), np.array([True, True]), 0.01)
        assert np.all(doubt[1] < MIN_INCONSISTENT_S)


@pytest.mark.parametrize("fault", ["stuck", "absent", "zero"])
@pytest.mark.parametrize("factor", [0.8, 1.2])
def test_wheels_replace_a_lost_gyro(fault, factor):
    """Robots of the independent truth; the file turns 20 % too little or too much. The model alone turned their
    headings by 70° to 180° in 7 s."""
    estimator = kind_of("wheels", (("model.actuator_matrix[2,2]", factor),)).estimator
    for run in drives("wheels", 3):
        z = run.sensors["imu"].z.copy()
        z[1000:1700, 2] = {"stuck": z[1000, 2], "absent": np.nan, "zero": 0.0}[fault]
        sensors = run.sensors | {"imu": run.sensors["imu"]._replace(z=z)}
        belief, errors, stds = estimator.init(run.truth.eta[0]), [], []
        for tick, eta in zip(replace(run, sensors=sensors).ticks(), run.truth.eta, strict=True):
            belief, estimate = estimator.step(belief, tick)
            errors.append(abs(wrap(estimate.eta[2] - eta[2])))
            stds.append(np.sqrt(estimate.cov[2, 2]))
        assert max(errors) < np.radians(40.0)
        assert np.mean(np.array(errors) <= REGION_95 * np.array(stds)) >= 0.95
