"""A lag of the motors and play in the gears look like a delay: a fit with a free delay shows them all the same."""

import numpy as np
import pytest

from baqueano.identify import identify
from baqueano.study.faults.subject import subject
from baqueano.study.truth.transmission import Transmission

DELAY = "model.drivetrain.delay_s"
BACK_EMF = "model.drivetrain.back_emf_share"


def fits_of(seed, gears, seconds=30.0):
    """Return a fit of a robot of the truth for each play of its gears and factor of its IMU's noise, and its truth."""
    case, robots = subject("robot", seed), []
    for play_m, noise in gears:
        transmission = Transmission(np.zeros(1), np.full(1, play_m), np.full(1, np.inf))
        imu = case.vehicle.imu.with_parameters(noise=noise * case.vehicle.imu.noise)
        robots.append(case.vehicle.with_parameters(transmission=transmission, imu=imu))
    signals, fits = [case.signal(seconds)] * len(robots), []
    for robot, run in zip(robots, case.runs(robots, signals, signals), strict=True):
        std = robot.imu.noise[0].tolist()
        values = {"sensors.imu.accel_noise_std": std[:2], "sensors.imu.gyro_noise_std": std[2]}
        fits.append(identify(run, case.vehicle_file.with_values(values), case.free))
    return fits, case.truth


def errors(fit, truth):
    """Return the errors of the fit in standard errors, by path."""
    pairs = zip(fit.names, fit.estimate, fit.std, strict=True)
    return {path: (x - truth[path]) / std for path, x, std in pairs if path in truth and np.isfinite(std)}


@pytest.mark.parametrize("lag_s", [0.08, 0.16])
def test_a_lag_outside_the_model_is_named_though_the_delay_is_free(lag_s):
    case = subject("car", 901)
    free = [path for path in case.free if not path.endswith("lag_s")]
    u = case.signal(30.0)
    (run,) = case.runs([case.vehicle.with_parameters(lag_s=np.full(1, lag_s))], [u], [u])
    fit = identify(run, case.vehicle_file.with_values({"model.drivetrain.lag_s": 0.0}), free)
    assert fit.verdict == "WARN"
    assert "--free +model.drivetrain.lag_s" in {reason.fix for reason in fit.reasons}
    assert abs(errors(fit, case.truth)["model.throttle_gain"]) < 3.0


@pytest.mark.parametrize("emf", [1.0, 0.0])
def test_a_back_emf_behind_the_lag_is_named_and_then_identified(emf):
    """The first fit takes it for a delay, which was wrong by 5 to 12 ms."""
    case = subject("robot", 502)
    u = case.signal(40.0)
    (run,) = case.runs([case.vehicle.with_parameters(lagging_emf=np.full(1, emf))], [u], [u])
    fit = identify(run, case.vehicle_file, case.free)
    advice = "--free +model.drivetrain.back_emf_share"
    assert (advice in {reason.fix for reason in fit.reasons}) == bool(emf)
    fit = identify(run, case.vehicle_file, [*case.free, advice.split()[1]])
    assert max(map(abs, errors(fit, case.truth | {BACK_EMF: emf}).values())) < 5.0
    k = fit.names.index(BACK_EMF)
    assert fit.std[k] < 0.1


def test_error_bars_of_the_delay_include_play_in_the_gears():
    """Without the score of this play the delay was wrong by 9 standard errors."""
    fits, truth = fits_of(501, [(0.001, 3.0), (0.002, 8.0)])
    assert max(abs(errors(fit, truth)[DELAY]) for fit in fits) < 5.0


def test_an_optional_drag_along_an_axis_without_a_command_does_not_lower_the_verdict():
    (fit,), truth = fits_of(501, [(0.0, 6.0)], seconds=15.0)
    assert "model.friction.quadratic[1]" in {message.subject for message in fit.always_unobservable}
    assert fit.verdict == "USABLE", fit.reasons
    assert max(map(abs, errors(fit, truth).values())) < 5.0


def under_load(u, loss, lag_s, dt_s=0.02):
    """Return the commands u (N, 2) that motors receive from a battery which falls behind its load with a lag."""
    effective_u, load = u.copy(), 0.0
    for k, throttle in enumerate(u[:, 0]):
        load += (abs(throttle) - load) * -np.expm1(-dt_s / lag_s)
        effective_u[k, 0] = throttle * (1.0 - loss * load)
    return effective_u


@pytest.mark.parametrize(
    ("loss", "lag_s", "effect", "fix"),
    [(0.3, 1e-6, "term.sag", "--free +model.drivetrain.sag"), (0.4, 0.7, "term.slow-sag", "")],
)
def test_a_battery_that_falls_under_load_is_named_and_widens_the_error_bars(loss, lag_s, effect, fix):
    """A slow one was USABLE, with a throttle gain wrong by 9 standard errors."""
    case = subject("car", 901)
    u = case.signal(30.0)
    (run,) = case.runs([case.vehicle], [under_load(u, loss, lag_s)], [u])
    fit = identify(run, case.vehicle_file, case.free)
    assert fit.verdict == "WARN"
    fixes = {cause.figures["effect"].code: cause.fix for cause in fit.reasons if "effect" in cause.figures}
    assert fixes[effect] == fix
    assert max(map(abs, errors(fit, case.truth).values())) < 3.0
