"""A vehicle identified from commands and IMU only: simulated vehicles with a known truth."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.calibration.tolerances import assumed_gyro_bias_std, scale_stds, tolerance_std, with_tolerance
from baqueano.errors import UsageError
from baqueano.identify import FitOptions, Residuals, identify
from baqueano.identify.covariance.clusters import with_jackknife
from baqueano.identify.covariance.information import Information
from baqueano.identify.imu_only import is_imu_only
from baqueano.numerics.noise_level import slow_noise_profile
from baqueano.numerics.slow_part import slow_part
from baqueano.simulate import simulate
from baqueano.study.counterpart import car_file, car_values, drive_runs
from baqueano.study.identification.trials import draw_car
from baqueano.vehicle_file import load, parse
from tests.codes import of_code
from tests.validation.test_validation import KINEMATIC

LONGITUDINAL = ("model.throttle_gain", "model.linear_drag", "model.coulomb_m_s2", "model.cornering_drag")
YAW = ("model.steering_gain", "model.steering_offset_rad", "model.yaw_lag_s")
QUIET = {"sensors.imu.accel_noise_std": [0.0, 0.0], "sensors.imu.gyro_noise_std": 0.0}
EXACT = {"sensors.imu.gyro_scale": 0.0, "sensors.imu.accel_scale": 0.0}


def fit_imu_only(run, file, free=None, tolerance=None, use=None):
    """Return the gyro-aided fit of a run."""
    return identify(
        run, with_tolerance(file, tolerance or {}), free, use=use, options=FitOptions(gyro_leads=True)
    )


def steps(rng, low, high, hold_s, seconds, rate_hz):
    """Return a command that changes every `hold_s`."""
    count = int(np.ceil(seconds / hold_s))
    return np.repeat(rng.uniform(low, high, count), int(hold_s * rate_hz))[: int(seconds * rate_hz)]


def drive_seed(seed, seconds=60.0, changes=None):
    """Return a car whose IMU noise grows with speed; only its IMU is recorded."""
    file, rng = load("car").with_values({"model.quadratic_drag": 0.0}), np.random.default_rng(seed)
    u = np.c_[steps(rng, 0.1, 0.55, 2.0, seconds, 50.0), steps(rng, -0.8, 0.8, 1.2, seconds, 50.0)]
    run = simulate(file.with_values(QUIET | (changes or {})), u, seed)
    channel = run.sensors["imu"]
    v = np.abs(np.interp(channel.t_ns, run.truth.t_ns, run.truth.nu[:, 0]))
    std = np.stack([0.05 + 0.6 * v, 0.05 + 1.2 * v, 0.02 + 0.03 * v], axis=1)
    noisy = channel._replace(z=channel.z + std * rng.normal(size=channel.z.shape))
    return file, replace(run, sensors={"imu": noisy})


def drive_separate_car(car, seed, seconds, steering, values=None):
    """Return the file of a car of the separate simulator, and its run."""
    file, rng = car_file(car).with_values(values or {}), np.random.default_rng([seed, 50])
    kinds = (0.1, 0.55, 2.0), (-steering, steering, 1.2)
    u = np.stack([steps(rng, *kind, seconds, 50.0) for kind in kinds], axis=1)
    u[:150] = 0.0
    return file, *drive_runs([car], [u], [seed], [file])


@pytest.fixture(scope="module")
def imu_fit():
    """Return one car, its run and its fit."""
    file, run = drive_seed(3)
    return file, run, fit_imu_only(run, file, LONGITUDINAL + YAW)


def test_a_car_is_identified_from_its_commands_and_imu(imu_fit):
    file, _, fit = imu_fit
    assert fit.converged
    for name in ("throttle_gain", "linear_drag", "steering_gain"):
        truth = getattr(file.vehicle, name)
        assert fit.value(f"model.{name}") == pytest.approx(truth, rel=0.08), name


def test_parameters_that_no_imu_can_identify_are_reported(imu_fit):
    _, _, fit = imu_fit
    assert "identifiability.gyro-scale" in [reason.code for reason in fit.always_unobservable]
    assert "fit.envelope" in [note.code for note in fit.notes]


def test_an_unmeasured_scale_widens_the_errors_by_its_effect(imu_fit):
    file, run, fit = imu_fit
    exact = fit_imu_only(run, file, LONGITUDINAL + YAW, tolerance=EXACT)
    fit_with_tolerance = fit_imu_only(
        run, file, LONGITUDINAL + YAW, tolerance={**EXACT, "sensors.imu.gyro_scale": 0.1}
    )
    np.testing.assert_allclose(exact.estimate, fit.estimate, rtol=1e-6)
    part = np.sqrt(np.maximum(fit_with_tolerance.std**2 - exact.std**2, 0.0)) / tolerance_std(0.1)
    changes_by_scale = []
    for factor in (1.02, 0.98):
        scale = file.sensors.imu.gyro_scale * factor
        scaled_file = file.with_values({"sensors.imu.gyro_scale": scale})
        changes_by_scale.append(fit_imu_only(run, scaled_file, LONGITUDINAL + YAW, tolerance=EXACT).estimate)
    slope = np.abs(changes_by_scale[0] - changes_by_scale[1]) / 0.04
    gain = fit.names.index("model.steering_gain")
    assert part[gain] == pytest.approx(slope[gain], rel=0.2)
    assert np.all(np.abs(part - slope) < 0.2 * slope + 2.0 * exact.std)


def test_a_measured_scale_has_priority_over_a_data_sheet():
    from baqueano.vehicle_file import Provenance

    file = load("car")
    np.testing.assert_allclose(scale_stds(file, "imu"), np.full(3, 0.03) / np.sqrt(3.0))
    path = "sensors.imu.gyro_scale"
    measured_file = file.with_values({path: 1.035}, {path: Provenance("two turns", None, 0.005, "USABLE")})
    assert scale_stds(measured_file, "imu")[2] == pytest.approx(0.005 / 1.035)


def test_an_uncertain_gyro_bias_widens_the_errors_by_its_effect(imu_fit):
    from baqueano.vehicle_file import Provenance

    file, run, _ = imu_fit
    path, origin = "sensors.imu.gyro_bias", Provenance("rest", None, 0.02, "USABLE")
    values = [file.value(path) + shift for shift in (0.0, 0.005, -0.005)]
    narrow, higher, lower = (
        fit_imu_only(
            run,
            file.with_values({path: x}, {path: origin._replace(std=0.0)}),
            LONGITUDINAL + YAW,
            tolerance=EXACT,
        )
        for x in values
    )
    fit = fit_imu_only(
        run, file.with_values({path: values[0]}, {path: origin}), LONGITUDINAL + YAW, tolerance=EXACT
    )
    part = np.sqrt(np.maximum(fit.std**2 - narrow.std**2, 0.0))
    slope = 0.02 * np.abs(higher.estimate - lower.estimate) / 0.01
    offset = narrow.names.index("model.steering_offset_rad")
    assert part[offset] > 3.0 * narrow.std[offset]
    assert part[offset] == pytest.approx(slope[offset], rel=0.1)


def test_the_error_of_the_gyro_bias_equals_its_measurement_error():
    from baqueano.vehicle_file import Provenance

    file, path = load("car"), "sensors.imu.gyro_bias"
    # the value of a data sheet
    assert assumed_gyro_bias_std(file, "imu") == pytest.approx(np.radians(20.0) / np.sqrt(3.0))
    measured_file = file.with_values({path: 0.002}, {path: Provenance("rest", None, 0.001, "USABLE")})
    assert assumed_gyro_bias_std(measured_file, "imu") == pytest.approx(0.001)


def test_a_fit_started_at_its_estimate_returns_the_same_estimate():
    file, run = drive_seed(5, 30.0)
    free = (*LONGITUDINAL, *YAW, "model.drivetrain.delay_s")
    first = fit_imu_only(run, file.with_values({"model.drivetrain.delay_s": 0.0}), free)
    second = fit_imu_only(run, first.vehicle_file, free)
    assert np.nanmax(np.abs(second.estimate - first.estimate) / first.std) <= 0.3
    assert first.value("model.drivetrain.delay_s") == pytest.approx(
        0.08, abs=3.0 * first.std[first.names.index(free[-1])]
    )


def test_a_run_that_leaves_the_envelope_is_flagged(imu_fit):
    _, run, fit = imu_fit
    envelope = fit.envelope
    assert envelope.range_warnings(run) == ()
    faster_run = replace(run, applied_commands=run.applied_commands * np.array([1.4, 1.0]))
    flags = envelope.range_warnings(faster_run)
    assert len(flags) == 1
    assert (flags[0].code, flags[0].subject) == ("envelope.left", "throttle")
    with pytest.raises(UsageError, check=of_code("vehicle.commands-differ")):
        envelope.range_warnings(replace(run, applied_commands=run.applied_commands[:, :1]))
    with pytest.raises(UsageError, check=of_code("runs.no-command")):
        identify(replace(run, applied_commands=np.full_like(run.applied_commands, np.nan)), fit.file)


def test_an_imu_fit_refuses_a_run_without_motion_or_gyro_data(imu_fit):
    file, run, _ = imu_fit
    with pytest.raises(UsageError, check=of_code("imu-only.not-an-imu")):
        fit_imu_only(run, file, use=("compass",))
    with pytest.raises(UsageError, check=of_code("runs.all-still")):
        fit_imu_only(replace(run, applied_commands=np.zeros_like(run.applied_commands)), file)
    silent = run.sensors["imu"]._replace(z=run.sensors["imu"].z * np.array([1.0, 1.0, np.nan]))
    with pytest.raises(UsageError, check=of_code("imu-only.silent-gyro")):
        fit_imu_only(replace(run, sensors={"imu": silent}), file)


def test_a_car_with_only_an_imu_uses_the_gyro_fit_by_default(imu_fit):
    file, run, fit = imu_fit
    by_default = identify(run, file, LONGITUDINAL + YAW)
    np.testing.assert_allclose(by_default.estimate, fit.estimate, rtol=1e-9)
    assert is_imu_only(file, [run], None, None)
    assert is_imu_only(file, [run], ("imu",), LONGITUDINAL)
    assert not is_imu_only(file, [run], ("imu[2]",), None)
    assert not is_imu_only(file, [run], ("imu", "odometer"), None)
    assert not is_imu_only(file, [run], None, ("sensors.imu.gyro_scale",))
    assert not is_imu_only(load("small"), [run], None, None)


def test_the_lag_of_the_motor_of_a_car_does_not_bias_its_gain_and_drag():
    car = draw_car(1, "matched").with_parameters(lag_s=np.full(1, 0.1))
    values = {"model.drivetrain.lag_s": 0.05, "model.drivetrain.delay_s": 0.05}
    file, run = drive_separate_car(car, 1, 30.0, 0.3, values)
    fit = identify(run, file, use=("imu",))
    truth = {**car_values(car), "model.drivetrain.lag_s": car.lag_s}
    names = ("model.throttle_gain", "model.linear_drag", "model.drivetrain.lag_s")
    errors = [(fit.value(n) - float(truth[n][0])) / fit.std[fit.names.index(n)] for n in names]
    assert np.all(np.abs(errors) < 2.5), errors


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_delay_of_a_car_with_soft_tyres_and_a_slow_servo_is_within_its_error(seed):
    """Tyres and servo are two lags; the model has one, and its delay contains a part of the other."""
    car = draw_car(seed, "understeer").with_parameters(servo_lag_s=np.full(1, 0.12))
    file, run = drive_separate_car(car, seed, 30.0, 0.3)
    fit = identify(run, file, use=("imu",))
    error = fit.value("model.drivetrain.delay_s") - car.delay_s[0]
    assert abs(error) < 3.0 * fit.std[fit.names.index("model.drivetrain.delay_s")] < 0.04
    assert "delay.sum" in [message.code for message in fit.notes]
    assert not any("+sensors." in message.fix for message in fit.reasons)


@pytest.mark.parametrize("seed", [700, 701, 703])
def test_understeer_is_not_taken_for_drag_of_a_car_with_soft_tyres(seed):
    """A yaw rate that grows less than the speed looks like a speed that grows less. Without the understeer, the drags
    of two of these cars are wrong by 4 to 5 standard errors. The error of the third is 11 %."""
    car = draw_car(seed, "understeer")
    file, run = drive_separate_car(car, seed, 60.0, 0.6)
    fit = identify(run, file, use=("imu",))
    truth = car_values(car)
    z, std = {}, {}
    for path in ("model.linear_drag", "model.quadratic_drag"):
        std[path] = fit.std[fit.names.index(path)]
        z[path] = (fit.value(path) - truth[path][0]) / std[path]
    assert max(map(abs, z.values())) < 3.0, z
    assert std["model.linear_drag"] < 0.06 * truth["model.linear_drag"][0]


def test_a_free_parameter_added_with_plus_does_not_remove_default_parameters():
    file, run = drive_seed(3, 20.0)
    fit, with_drag = (fit_imu_only(run, file, free) for free in (None, ["+model.motor_drag"]))
    assert "model.drivetrain.delay_s" in fit.names
    assert set(with_drag.names) == {*fit.names, "model.motor_drag"}


def test_the_gyro_fit_of_a_two_wheeled_vehicle_identifies_the_true_parameters():
    file, rng = load("case-study-1"), np.random.default_rng(0)
    limit = file.command.limit
    forward = steps(rng, 0.1, 0.8, 2.0, 30.0, file.rate_hz) * limit[0]
    turning = steps(rng, -0.5, 0.5, 1.0, 30.0, file.rate_hz) * limit[2]
    run = simulate(file, np.stack([forward, np.zeros_like(forward), turning], axis=1), 0)
    free = ["model.friction.linear", "model.actuator_matrix[0,0]", "model.actuator_matrix[2,2]"]
    fit = identify(run, file, free, use=("imu",), options=FitOptions(gyro_leads=True))
    truth = np.array([*file.vehicle.friction.linear, *np.diagonal(file.vehicle.actuator_matrix)[[0, 2]]])
    assert np.all(np.abs(fit.estimate[:5] - truth) < 3.0 * fit.std[:5])
    np.testing.assert_allclose(fit.estimate[:5], truth, rtol=0.03)


def test_the_gyro_fit_uses_the_given_solver(imu_fit):
    class SolverCall(Exception):
        pass

    def solver(*args, **options):
        raise SolverCall

    file, run, _ = imu_fit
    with pytest.raises(SolverCall):
        identify(run, file, use=("imu",), solver=solver)


class OwnResiduals(Residuals):
    """Residuals of a user."""


def test_options_that_the_gyro_fit_ignores_are_refused(imu_fit):
    file, run, _ = imu_fit
    with pytest.raises(UsageError, check=of_code("imu-only.others", others="clocks, sigma")):
        identify(
            run, file, options=FitOptions(gyro_leads=True, sigma={"imu": (1.0, 1.0, 1.0)}, clocks=("imu",))
        )
    with pytest.raises(UsageError, check=of_code("imu-only.others", others="segment_s")):
        identify(run, file, options=FitOptions(gyro_leads=True, segment_s=5.0))
    with pytest.raises(UsageError, check=of_code("imu-only.others", others="residuals")):
        identify(run, file, residuals=OwnResiduals, options=FitOptions(gyro_leads=True))
    with pytest.raises(UsageError, check=of_code("imu-only.not-an-imu")):
        identify(run, file, use=("imu", "odometer"), options=FitOptions(gyro_leads=True))
    with pytest.raises(UsageError, match="odometer"):
        identify(run, file, use=("odometer",), options=FitOptions(gyro_leads=True))


def test_autocorrelated_residuals_weigh_less_than_white_residuals():
    rng, n = np.random.default_rng(1), 6000
    white = rng.normal(size=(n, 2))
    slow = np.convolve(rng.normal(size=n + 49), np.ones(50) / np.sqrt(50.0), "valid")
    residuals = [np.stack([white[:, 0], 0.6 * white[:, 1] + 0.8 * slow], axis=1)]
    masks, v, dt = [np.ones((n, 2))], [np.full(n, 1.0)], [np.full(n, 0.02)]
    sigma, profile = slow_noise_profile(residuals, masks, v, dt, np.zeros(2))
    assert sigma[0] == pytest.approx(1.0, abs=0.12)
    expected = np.sqrt(0.6**2 + 0.8**2 * (50 - (50**2 - 1) / (3 * 50)))  # of sums over their correlation time
    assert sigma[1] == pytest.approx(expected, rel=0.15)
    np.testing.assert_allclose(profile[0], 1.0, atol=1e-9)


def test_samples_are_weighted_by_speed_if_noise_grows_with_speed():
    rng, n = np.random.default_rng(2), 8000
    v = np.repeat(rng.uniform(0.1, 2.0, n // 100), 100)
    residuals = [(v * rng.normal(size=n))[:, None]]
    sigma, profile = slow_noise_profile(residuals, [np.ones((n, 1))], [v], [np.full(n, 0.02)], np.zeros(1))
    ratio = (sigma[0] * profile[0][:, 0] / v)[v > 0.5]
    assert np.all((ratio > 0.8) & (ratio < 1.3))
    assert np.sqrt(np.mean(profile[0] ** 2)) == pytest.approx(1.0)


def test_block_errors_replace_the_errors_only_if_larger_and_are_reported():
    rng = np.random.default_rng(3)
    root = rng.normal(size=(4, 4))
    A = root @ root.T + 4.0 * np.eye(4)
    info = Information(A, A, np.zeros((1, 4)), False, np.zeros(1), 100)
    kept_indices = np.array([0, 2, 3])
    k = np.ix_(kept_indices, kept_indices)
    inverse = np.linalg.inv(A[k])
    np.testing.assert_allclose(with_jackknife(info, kept_indices, inverse).meat, A, rtol=1e-10)
    np.testing.assert_allclose(
        with_jackknife(info, kept_indices, 3.0 * inverse).meat[k], 3.0 * A[k], rtol=1e-10
    )
    np.testing.assert_allclose(with_jackknife(info, kept_indices, 0.1 * inverse).meat[k], A[k], rtol=1e-10)
    autocorrelated_info = info._replace(meat=2.0 * A)
    np.testing.assert_allclose(
        with_jackknife(autocorrelated_info, kept_indices, inverse).meat[k], 2.0 * A[k], rtol=1e-10
    )


def test_a_slow_disturbance_is_separated_from_white_noise():
    rng, n = np.random.default_rng(4), 3000
    white, slow = rng.normal(size=n), np.zeros(n)
    assert np.all(slow_part(white) == 0.0)
    for k in range(1, n):
        slow[k] = 0.98 * slow[k - 1] + np.sqrt(1.0 - 0.98**2) * rng.normal()
    slow_estimate = slow_part(0.5 * white + slow)
    assert np.std(slow_estimate - slow) < 0.6 * 0.5
    # its error is independent of the signal
    assert abs(np.mean((slow_estimate - slow) * slow_estimate)) < 0.02
    np.testing.assert_array_equal(slow_part(white[:20]), white[:20])


def test_gyro_noise_does_not_bias_lever_arm_or_speed_towards_zero():
    errors = []
    for seed in range(4):
        file, run = drive_seed(seed)
        fit = fit_imu_only(run, file, LONGITUDINAL + YAW, tolerance=EXACT)
        k = [fit.names.index(name) for name in ("sensors.imu.lever_arm_m[0]", "model.throttle_gain")]
        errors.append((fit.estimate - np.array([file.value(name) for name in fit.names]))[k] / fit.std[k])
    # the lever arm was 4 standard errors too short
    assert np.all(np.abs(np.mean(errors, axis=0)) < 3.0 / np.sqrt(4.0)), errors


def test_a_kinematic_vehicle_cannot_use_the_gyro_fit():
    file = parse(KINEMATIC.partition("[sensors")[0] + '[sensors.imu]\nkind = "imu"\n', "cart")
    u = np.tile([0.5, 0.0, 0.3], (200, 1))
    with pytest.raises(UsageError, check=of_code("imu-only.no-dynamics")):
        fit_imu_only(simulate(file, u, 0), file)


def test_error_bars_contain_an_effect_that_all_parts_of_the_run_share():
    """Tyres that slip bias the steering gain alike in all parts of the run, so the jackknife does not show it."""
    z = []
    for seed in (100, 103):
        car = draw_car(seed, "understeer")
        file, run = drive_separate_car(car, seed, 60.0, 0.6)
        fit = fit_imu_only(run, file, LONGITUDINAL + YAW, EXACT, ("imu",))
        k = fit.names.index("model.steering_gain")
        z.append((fit.estimate[k] - car_values(car)[fit.names[k]][0]) / fit.std[k])
    assert "residual.missing-free" in [
        reason.code for reason in fit.reasons if reason.subject == fit.names[k]
    ]
    assert fit.unmodelled_cov[k, k] > 0.5 * fit.cov[k, k]
    assert np.max(np.abs(z)) < 2.0, z
