"""Parameters that are free on demand: a vehicle has the effect, and the fit begins without it.

Each truth must lie within 3.5 of its standard errors, over two seeds. With 50 numbers a false alarm has a
probability of 2 %; the seeds are fixed.
"""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.identify import FitOptions, identify, random_steps
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.estimation import search
from baqueano.identify.parameters.free import default_free, enable_parameters, free_parameters
from baqueano.messages import texts
from baqueano.simulate import simulate
from baqueano.vehicle_file import load, override
from baqueano.vehicles import Kinematic, constant_effort
from tests.codes import of_code

SIGMAS = 3.5
USUAL = (
    "model.friction.linear[0]",
    "model.friction.linear[2]",
    "model.actuator_matrix[0,0]",
    "model.actuator_matrix[2,2]",
)
# free parameters: {key: (truth, start of the search)}
WHEELS = {
    "model.friction.coulomb_forward": ("[0.15, 0.10]", "[0, 0]"),
    "model.friction.coulomb_backward": ("[0.12, 0.20]", "[0, 0]"),
    "model.friction.cornering": ("0.15", "0"),
}
MOTORS = {
    "model.drivetrain.dead_zone_forward": ("[0.32, 0.27]", "[0.1, 0.1]"),
    "model.drivetrain.dead_zone_backward": ("[0.34, 0.29]", "[0.1, 0.1]"),
    "model.drivetrain.lag_s": ("0.06", "0"),
    "model.drivetrain.limit": ("[1.1, 0.9]", "[inf, inf]"),
}
PLACES = {
    "model.drivetrain.sag": ("0.2", "0"),
    "model.centre_of_mass_x_m": ("0.012", "0"),
    "sensors.imu.lever_arm_m": ("[0.03, -0.02]", "[0, 0]"),
    "sensors.imu.heading_rad": ("0.1", "0"),
}
TILT = {"sensors.imu.tilt_rad": ("[0.02, -0.03]", "[0, 0]")}


@pytest.fixture(scope="module")
def small():
    """Return the small vehicle without dry friction of the body, which has the same effect as that of the wheels."""
    return override(load("small"), ["model.friction.coulomb=[0, 0, 0.01]"])


def test_the_drag_of_cornering_is_free_by_default_only_if_nothing_pushes_sideways():
    def free(name):
        robot = load(name)
        return default_free(FittedBlocks(robot.vehicle, robot.sensors))

    assert "model.friction.cornering" in free("small")
    assert "model.friction.cornering" not in free("case-study-1")


def fitted(small, values, seed, **options):
    truth = override(small, [f"{key}={value}" for key, (value, _) in values.items()])
    begin = override(truth, [f"{key}={start}" for key, (_, start) in values.items()])
    run = simulate(truth, random_steps(truth.command.limit, 20.0, truth.rate_hz, seed, hold_s=0.5), seed)
    return truth, identify(run, begin, [*USUAL, *values], options=FitOptions(**options))


def error_of(truth, fit):
    """Return (estimate − truth) / std by name."""
    return {
        name: (x - truth.value(name)) / std
        for name, x, std in zip(fit.names, fit.estimate, fit.std, strict=True)
    }


@pytest.mark.parametrize("values", [WHEELS, MOTORS, PLACES], ids=["wheels", "motors", "places"])
def test_a_freed_effect_that_the_file_lacks_is_identified(small, values):
    for seed in (1, 2):
        truth, fit = fitted(small, values, seed)
        assert fit.converged
        assert fit.verdict == "USABLE", fit.reasons
        assert max(map(abs, error_of(truth, fit).values())) < SIGMAS, error_of(truth, fit)


def test_a_tilt_is_identified_if_the_bias_is_constant(small):
    for seed in (1, 2):
        truth, fit = fitted(override(small, ["sensors.imu.accel_bias_walk=0"]), TILT, seed, biases=False)
        assert max(map(abs, error_of(truth, fit).values())) < SIGMAS, error_of(truth, fit)


def test_tilt_and_bias_together_are_reported_as_unobservable(small):
    """Both have the effect of gravity; only the cosine of the tilt separates them."""
    _, fit = fitted(small, TILT, 1)
    assert fit.verdict == "WARN"
    tilts = [k for k, name in enumerate(fit.names) if "tilt" in name and np.isfinite(fit.estimate[k])]
    assert all(fit.poorly_identified[k] for k in tilts)
    assert len(tilts) < 2
    assert any("a known bias: fix accel_bias" in line for line in texts(fit.unobservable))


def test_an_unreached_motor_limit_is_at_least_the_largest_command(small):
    """The fit reports a bound and not an estimate."""
    run = simulate(small, 0.4 * random_steps(small.command.limit, 20.0, small.rate_hz, 1, hold_s=0.5), 1)
    fit = identify(run, override(small, ["model.drivetrain.limit=[inf]"]), [*USUAL, "model.drivetrain.limit"])
    left = run.applied_commands[:, 0] - run.applied_commands[:, 2]
    right = run.applied_commands[:, 0] + run.applied_commands[:, 2]
    largest = max(np.abs(left).max(), np.abs(right).max())
    limit = fit.names.index("model.drivetrain.limit[0]")
    assert largest < small.value("model.drivetrain.limit[0]")
    assert fit.estimate[limit] == pytest.approx(largest, rel=1e-6)
    assert fit.bound[limit] == 1
    assert any(
        finding.code.startswith("bound.high") and "limit[0]" in finding.subject
        for finding in (*fit.notes, *fit.reasons)
    )


def test_dry_friction_of_wheels_is_free_by_default_if_the_file_has_it(small):
    robot = override(small, ["model.friction.coulomb_forward=[0.2, 0]"])
    free = default_free(FittedBlocks(robot.vehicle, robot.sensors))
    assert [path for path in free if "coulomb_" in path] == ["model.friction.coulomb_forward[0]"]


def test_wheel_friction_is_not_fitted_with_an_unknown_track(small):
    from baqueano.errors import UsageError

    without_track = override(small, ["model.friction.track_m=0"])
    run = simulate(small, random_steps(small.command.limit, 5.0, small.rate_hz, 1), 1)
    with pytest.raises(UsageError, check=of_code("parameter.no-track")):
        identify(run, without_track, [*USUAL, "model.friction.coulomb_forward"])


CAR_USUAL = ["model.throttle_gain", "model.linear_drag", "model.steering_gain", "model.yaw_lag_s"]
CAR_WAYS = {"model.coulomb_forward_m_s2": ("0.15", "0"), "model.coulomb_backward_m_s2": ("0.4", "0")}


@pytest.mark.parametrize("seed", [0, 1])
def test_dry_friction_of_a_car_is_identified_forward_and_backward(seed):
    car = override(load("car"), ["model.coulomb_m_s2=0"])
    truth = override(car, [f"{key}={value}" for key, (value, _) in CAR_WAYS.items()])
    run = simulate(truth, random_steps(truth.command.limit, 40.0, truth.rate_hz, seed, hold_s=1.0), seed)
    fit = identify(run, car, [*CAR_USUAL, *CAR_WAYS], options=FitOptions(diagnose=False))
    errors = error_of(truth, fit)
    assert all(abs(errors[name]) < SIGMAS for name in CAR_WAYS), errors
    assert all(fit.std[fit.names.index(name)] < 0.1 for name in CAR_WAYS)


def test_bounds_of_free_friction_are_valid_in_a_vehicle_file(small):
    """A vehicle on rubber tyres stops sideways faster than one tick can resolve."""
    blocks = FittedBlocks(small.vehicle, small.sensors)
    paths = ["model.friction.linear", "model.friction.coulomb[1]", "model.friction.quadratic[0]"]
    _, free = enable_parameters(
        blocks, free_parameters(blocks, paths, (), {}), small.rate_hz, np.zeros((1, 3)), lambda delay_s: 25
    )
    high = {parameter.path.removeprefix("model.friction."): parameter.high for parameter in free}
    assert high["quadratic[0]"] == 1e6  # as the field states: a drive forward shows it
    assert high["linear[1]"] / 0.61 < 1.5 * small.rate_hz
    for i in range(3):
        values = small.vehicle.friction.linear.copy()
        values[i] = high[f"linear[{i}]"]
        small.with_values({"model.friction.linear": values.tolist()})  # this value would be refused
    friction = small.vehicle.friction.linear.copy(), small.vehicle.friction.coulomb.copy()
    friction[0][1], friction[1][1] = high["linear[1]"], high["coulomb[1]"]
    small.with_values(
        {f"model.friction.{k}": x.tolist() for k, x in zip(("linear", "coulomb"), friction, strict=True)}
    )


@pytest.mark.parametrize(
    ("gains", "is_free"),
    [((1.0, 0.0, 2.0), False), ((1.0, 1.0, 2.0), True), ((0.0, 0.0, 0.0), True)],
    ids=["undriven", "driven", "no gain is known"],
)
def test_a_row_of_zeros_states_that_no_command_drives_sideways(small, gains, is_free):
    """A turned IMU looks like a sideways velocity, and the estimated position of such a fit drifts to the side."""
    blocks = FittedBlocks(Kinematic(np.diag(gains)), small.sensors)
    assert ("model.velocity_matrix[1,0]" in default_free(blocks)) is is_free


def test_the_largest_sideways_friction_of_a_fit_is_integrable_in_a_fast_turn(small):
    """Two wheels do not slide, so a fit drives the sideways friction to its bound. A row has 20 ms, and v r 3 m/s²."""
    paths = ["model.friction.linear[1]", "model.friction.quadratic[1]"]
    blocks = FittedBlocks(small.vehicle, small.sensors)
    _, free = enable_parameters(
        blocks, free_parameters(blocks, paths, (), {}), 50.0, np.zeros((1, 3)), lambda delay_s: 25
    )
    friction = small.vehicle.friction
    linear, quadratic = friction.linear.copy(), friction.quadratic.copy()
    linear[1], quadratic[1] = (parameter.high for parameter in free)
    stiff = replace(small.vehicle, friction=replace(friction, linear=linear, quadratic=quadratic))
    sideways, effort = [0.0], constant_effort(np.zeros(3))
    for _ in range(50):
        nu = np.array([1.0, sideways[-1], 3.0])
        sideways.append(stiff.advance(np.zeros(3), nu, effort, 0.02)[1][1])
    assert -0.05 < sideways[-1] < 0.0
    assert sideways[-1] == pytest.approx(sideways[-2], rel=1e-6)


def test_a_search_without_convergence_names_the_parameter_that_still_moved(small, monkeypatch):
    monkeypatch.setattr(search, "MAX_EVALUATIONS", 5)
    run = simulate(small, random_steps(small.command.limit, 6.0, 100.0, 0), 0)
    fit = identify(
        run,
        small,
        options=FitOptions(start={"model.actuator_matrix[2,2]": 0.15}, sigma={"imu": [0.1, 0.1, 0.01]}),
    )
    assert not fit.converged
    (moving,) = (reason for reason in fit.reasons if reason.code == "fit.not-converged-moving")
    assert moving.subject in fit.names


@pytest.mark.parametrize(("bounds", "high_s"), [({}, 0.25), ({"model.drivetrain.delay_s": (0.0, 0.6)}, 0.6)])
def test_the_user_can_state_a_longer_delay_than_the_default_bound(small, bounds, high_s):
    blocks, buffers_s = FittedBlocks(small.vehicle, small.sensors), []
    _, free = enable_parameters(
        blocks,
        free_parameters(blocks, ["model.drivetrain.delay_s"], (), bounds),
        small.rate_hz,
        np.zeros((1, 3)),
        lambda delay_s: buffers_s.append(delay_s) or 25,
    )
    assert free[0].high == high_s
    assert max(buffers_s) == high_s
