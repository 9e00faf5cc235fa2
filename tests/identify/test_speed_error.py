"""The lasting error of the model's speed follows from the errors of the fit, and the filter claims it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.estimators.augmented.motion import MIN_SPEED_M_S, reported_velocity_cov, velocity_error
from baqueano.estimators.augmented_ekf import SCALE_INDEX
from baqueano.identify import FitOptions, identify, random_steps
from baqueano.identify.covariance.information import FixedParameters
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.noise.covariances import measure_noise
from baqueano.identify.noise.speed_error import with_slope, with_speed_error
from baqueano.numerics.floor_push import slope_speed_error
from baqueano.signals import sensor_slots
from baqueano.simulate import simulate
from baqueano.vehicle_file import load
from tests.numerics.test_floor_push import DECAY_RATE, residuals

SMALL = load("small").with_values(
    {"model.friction.coulomb": [0.0, 0.0, 0.0], "model.friction.quadratic": [0.0, 0.0, 0.0]}
)
RUN = simulate(SMALL, random_steps([1.0, 0.0, 0.0], 60.0, SMALL.rate_hz, 1, hold_s=2.0))
FORCE = "model.actuator_matrix[0,0]"
CONSTANT_SPEED = 0.3  # m/s
PLAIN = FitOptions(diagnose=False)


def no_fixed_parameters(count):
    """Return no parameters beside `count` others."""
    return FixedParameters((), np.zeros((0, 0)), np.zeros((0, count)), np.zeros(0, bool))


def fit_with(names, std, shifts=(), speeds=()):
    """Return what `with_speed_error` reads of a fit with independent errors, and `shifts` (n, p) by lacking effects."""
    shifts, p = np.array(shifts).reshape(-1, len(names)), len(names)
    unmodelled_cov = shifts.T @ shifts
    return SimpleNamespace(
        names=tuple(names), std=np.array(std), cov=np.diag(np.square(std)) + unmodelled_cov, backend="auto",
        unmodelled_cov=unmodelled_cov, unmodelled_shifts=shifts,
        unmodelled_speeds=np.array(speeds).reshape(-1, 2, 3),
        always_unobservable=(), fixed=no_fixed_parameters(p),
        blocks=FittedBlocks(SMALL.vehicle, sensor_slots(())()), file=SMALL,
    )  # fmt: skip


def claimed_std(ekf, speed):
    """Return the claimed standard deviation of the speed at `speed` [m/s]."""
    kappa = np.eye(16)[SCALE_INDEX] * ekf.speed_error_std[1]
    return abs(velocity_error(ekf, kappa, np.array([speed, 0.0, 0.0]))[0])


def test_a_wrong_force_of_the_motors_is_a_wrong_scale_of_the_speed():
    force = SMALL.vehicle.actuator_matrix[0, 0]
    ekf = SMALL.estimator()
    sheet_std = np.sqrt(ekf.init().cov[SCALE_INDEX, SCALE_INDEX])
    ekf = with_speed_error(ekf, fit_with([FORCE], [0.05 * force]), [RUN])
    for speed in (0.2, 0.4, -0.3):
        assert claimed_std(ekf, speed) / abs(speed) == pytest.approx(np.hypot(0.05, sheet_std), rel=0.1)
    assert np.sqrt(ekf.init().cov[SCALE_INDEX, SCALE_INDEX]) == ekf.speed_error_std[1]


def test_a_lacking_effect_changes_the_speed_by_itself_and_by_its_shift():
    """A shift of 30 % that the effect cancels does not change the speed. Without the effect, it changes it by 30 %."""
    force, own = SMALL.vehicle.actuator_matrix[0, 0], np.array([[-0.3, 0.0, 0.0], [-0.3, 0.0, 0.0]])
    stds = []
    for speeds in (own, 0.0 * own, own + np.array([0.0, 0.02, 0.0])):
        fit = fit_with([FORCE], [0.05 * force], [[0.3 * force]], speeds)
        stds.append(claimed_std(with_speed_error(SMALL.estimator(), fit, [RUN]), CONSTANT_SPEED))
    without = claimed_std(with_speed_error(SMALL.estimator(), fit_with([FORCE], [0.05 * force]), [RUN]), 0.3)
    expected = [0.0, 0.3 * CONSTANT_SPEED, 0.02]
    np.testing.assert_allclose(stds, np.hypot(without, expected), rtol=0.1)


def test_wrong_dead_zones_are_an_offset_of_the_speed():
    """δν_x = (T/d) g δz at any speed, by pencil, for each wheel with half of the force."""
    zones = [f"model.drivetrain.dead_zone_forward[{k}]" for k in (0, 1)]
    zones += [f"model.drivetrain.dead_zone_backward[{k}]" for k in (0, 1)]
    ekf = with_speed_error(SMALL.estimator(), fit_with(zones, [0.02] * 4), [RUN])
    slope = SMALL.vehicle.actuator_matrix[0, 0] / SMALL.vehicle.friction.linear[0]
    assert claimed_std(ekf, CONSTANT_SPEED) == pytest.approx(slope * 0.02 / np.sqrt(2.0), rel=0.3)
    assert claimed_std(ekf, 0.1) / 0.1 > 1.5 * claimed_std(ekf, 0.4) / 0.4


def test_the_reported_speed_error_contains_the_errors_in_turns():
    """In turns, wheels cross their dead zones: over all rows the claim has the variance that the fit predicts."""
    commands = random_steps([1.0, 0.0, 1.0], 60.0, SMALL.rate_hz, 1, hold_s=1.0)
    zones = [f"model.drivetrain.dead_zone_forward[{k}]" for k in (0, 1)]
    fit, run, ekf = fit_with(zones, [0.02] * 2), simulate(SMALL, commands), SMALL.estimator()
    sheet_std = np.sqrt(ekf.init().cov[SCALE_INDEX, SCALE_INDEX])
    nu_x = run.truth.nu[:, 0]
    predicted_variance = (sheet_std * nu_x) ** 2
    for change in 1e-3 * np.eye(2):
        zone = SMALL.vehicle.drivetrain.dead_zone_forward + change
        second_run = simulate(SMALL.with_values({"model.drivetrain.dead_zone_forward": zone}), commands)
        predicted_variance += (0.02 * (second_run.truth.nu[:, 0] - nu_x) / 1e-3) ** 2
    ekf, rows = with_speed_error(ekf, fit, [run]), np.abs(nu_x) > MIN_SPEED_M_S
    claimed_variance = [claimed_std(ekf, v) ** 2 for v in nu_x[rows]]
    assert np.mean(claimed_variance) == pytest.approx(np.mean(predicted_variance[rows]), rel=0.1)


def test_an_error_that_changes_sign_with_the_turn_is_claimed_in_turns():
    """δν_x = δT u/d_x and ν_ψ = T_ψ u/d_ψ, by pencil: the centre of the turns is δT d_ψ/(T_ψ d_x) beside its place."""
    std, steps = 0.2, random_steps([1.0, 0.0, 1.0], 60.0, SMALL.rate_hz, 1, hold_s=1.0)
    fit = fit_with(["model.actuator_matrix[0,2]"], [std])
    ekf = with_speed_error(SMALL.estimator(), fit, [simulate(SMALL, steps)])
    T, d = SMALL.vehicle.actuator_matrix, SMALL.vehicle.friction.linear
    assert ekf.lateral_offset_std_m == pytest.approx(std * d[2] / (T[2, 2] * d[0]), rel=0.2)
    variances = [
        reported_velocity_cov(e, np.array([CONSTANT_SPEED, 0.0, 2.0]), 0.0)[0, 0]
        for e in (ekf, replace(ekf, lateral_offset_std_m=0.0))
    ]
    assert variances[0] - variances[1] == pytest.approx((2.0 * ekf.lateral_offset_std_m) ** 2)


def test_without_errors_of_a_fit_the_data_sheet_gives_the_speed_error():
    ekf = SMALL.estimator()
    assert with_speed_error(ekf, fit_with([FORCE], [np.nan]), [RUN]) is ekf
    kappa, nu = np.zeros(16), np.array([0.3, 0.1, 1.0])
    kappa[SCALE_INDEX : SCALE_INDEX + 3] = 0.02, 0.01, 0.03
    assert velocity_error(ekf, kappa, nu) == pytest.approx([0.006, 0.011, 0.01])
    by_fit = replace(ekf, speed_error_std=np.array([0.01, 0.02]))
    assert velocity_error(by_fit, kappa, 0.0 * nu)[0] == 0.0


@pytest.fixture(scope="module")
def drive():
    """Return a run of `small` with turns, and its fit by commands and IMU."""
    small = load("small")
    run = simulate(small, random_steps(small.command.limit, 40.0, small.rate_hz, 2), 1)
    run = replace(run, truth=None)
    return run, identify(run, small)


def test_the_effect_of_the_gyros_scale_on_a_fit_equals_another_fit(drive):
    run, fit = drive
    small = load("small")
    low, high = (
        identify(run, small.with_values({"sensors.imu.gyro_scale": 1.0 / (1.0 + kappa)}), options=PLAIN)
        for kappa in (-0.01, 0.01)
    )
    for name in ("model.friction.linear[0]", "model.friction.linear[2]", "model.actuator_matrix[2,2]"):
        k = fit.names.index(name)
        assert fit.fixed.gyro_shift()[k] == pytest.approx(
            (low.estimate[k] - high.estimate[k]) / 0.02, rel=0.2
        )


def test_a_gyro_that_reads_too_much_gives_a_speed_that_is_too_low(drive):
    """a_y = ν_x ν_ψ determines the speed: the filter claims both errors together, not twice."""
    run, fit = drive
    ekf = measure_noise(fit, run).updated_file(fit.vehicle_file).estimator()
    c, gyro_std = ekf.speed_per_gyro_scale, float(ekf.sensors.imu.gyro_scale_std)
    assert -1.1 < c < -0.05
    unscaled_ekf = with_speed_error(ekf, replace(fit, fixed=no_fixed_parameters(len(fit.names))), [run])
    assert unscaled_ekf.speed_error_std[1] ** 2 - ekf.speed_error_std[1] ** 2 == pytest.approx(
        gyro_std**2, rel=0.05
    )
    kappa = -gyro_std * np.eye(16)[SCALE_INDEX + 1]
    error = velocity_error(ekf, kappa, np.array([0.3, 0.0, 1.0]))
    assert error[0] == pytest.approx(-c * gyro_std * 0.3)
    assert error[2] == pytest.approx(-gyro_std)


def test_a_sloping_floor_is_an_error_of_the_speed():
    """The residuals are those of test_floor_push.py; the smaller of decay rate and 1/lag counts."""
    run, ekf = residuals(0.17), SMALL.estimator()
    lag_s, columns = float(np.max(ekf.vehicle.drivetrain.lag_s)), [*run.a.T, 0.0 * run.t_s]
    channels = [
        SimpleNamespace(sensor="imu", entry=k, t_s=run.t_s, residuals=r, measurements=run.yaw_rate)
        for k, r in enumerate(columns)
    ]
    fit = SimpleNamespace(vehicle_file=SMALL, channels_by_run=[channels])
    for decay_rate in (DECAY_RATE, 1.0 / lag_s + 1.0):
        expected = slope_speed_error([run], min(decay_rate, 1.0 / lag_s)) / np.sqrt(2.0)
        assert with_slope(ekf, fit, {"imu"}, decay_rate).slope_speed_std_m_s == pytest.approx(
            expected, rel=0.1
        )
    assert with_slope(ekf, fit, {"imu"}, 0.0).slope_speed_std_m_s == 0.0, (
        "a kinematic model does not know the push"
    )
