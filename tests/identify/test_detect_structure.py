"""An unmodelled effect is named with the parameter shift that it causes; a modelled effect is not.

The study of faults shows the rates over many seeds (tests/study/test_faults.py, `baqueano study faults`). By chance
1 of 40,000 test results is significant. A fit has 250 such tests, so 0.6 % of the fits contain one."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.diagnostics import note
from baqueano.identify import FitOptions, identify, random_steps
from baqueano.identify.diagnostics import residual_checks
from baqueano.identify.diagnostics.residual_checks import fit_residuals
from baqueano.identify.diagnostics.unmodelled_terms import Effect
from baqueano.numerics.score_test import ScoreTest, score_test
from baqueano.simulate import simulate
from baqueano.study.counterpart import FREE_CAR, FREE_ROBOT, car_file, car_values, drive_runs, robot_values
from baqueano.study.counterpart.world import ROBOT_STEP_S
from baqueano.study.identification import trials
from baqueano.study.identification.trials import draw_robot, initial_file, quantised_commands
from baqueano.vehicle_file import load
from tests.identify.true_drives import robot_on_floor

PLAIN = FitOptions(diagnose=False)


def driven_as(file, u, effective, seed=0):
    limit = np.asarray(file.command.limit)
    return replace(simulate(file, np.clip(effective, -limit, limit), seed), applied_commands=u)


@pytest.fixture(scope="module")
def u(case):
    return random_steps(case.command.limit, 30.0, 100.0, 3)


def codes(findings):
    return {finding.code for finding in findings}


@pytest.mark.parametrize("kind", ["random_steps", "prbs"])
@pytest.mark.parametrize("seed", range(3))
def test_a_sound_fit_gives_no_warning(case, seed, kind):
    from baqueano.identify import excitation

    fit = identify(simulate(case, excitation(kind, case.command.limit, 30.0, 100.0, seed), seed), case)
    assert fit.verdict == "USABLE", fit.reasons


def test_a_delayed_command_is_detected(case, u):
    delayed_u = np.concatenate([np.zeros((3, 3)), u[:-3]])
    fit = identify(driven_as(case, u, delayed_u), case)
    assert fit.verdict == "WARN"
    assert "--free +model.drivetrain.delay_s" in {
        r.fix for r in fit.reasons if r.code == "residual.late-readings"
    }


def test_a_delayed_sensor_is_reported_with_its_clock_and_the_delay_of_the_commands():
    car = load("car")
    run = simulate(car, random_steps([0.3, 0.3], 30.0, 50.0, 3, hold_s=0.5), 3)
    z = run.sensors["odometer"].z
    run = replace(
        run, sensors=run.sensors | {"odometer": run.sensors["odometer"]._replace(z=np.roll(z, 6, axis=0))}
    )
    fit = identify(run, car)
    assert {reason.fix for reason in fit.reasons if reason.code == "residual.late-readings"} <= {
        "--free +model.drivetrain.delay_s"
    }
    assert "--free +model.drivetrain.delay_s --clock odometer" in {reason.fix for reason in fit.reasons}
    delay, clock = ["+model.drivetrain.delay_s"], FitOptions(clocks=("odometer",))
    second_fit = identify(run, car, delay, options=clock)
    assert second_fit.value("model.drivetrain.delay_s") == pytest.approx(0.08, abs=0.01)
    assert second_fit.run_entries[0, second_fit.run_entry_names.index("clock.odometer")] == pytest.approx(
        -0.12, abs=0.01
    )
    assert not {"residual.late-readings", "residual.missing-free"} & codes(second_fit.reasons)


def test_dry_friction_that_is_not_in_the_file_is_named(case, u):
    rough_file = case.with_values({"model.friction.coulomb": [2.0, 0.0, 180.0]})
    fit = identify(simulate(rough_file, u, 0), case)
    assert fit.verdict == "WARN"
    missing = [reason for reason in fit.reasons if reason.code == "residual.missing"]
    assert "term.dry-friction" in {reason.figures["effect"].code for reason in missing}


def test_a_wrong_speed_of_the_dry_friction_is_reported_with_its_key(case, u):
    coulomb, speed = {"model.friction.coulomb": [0.3, 0.0, 0.0]}, "model.friction.coulomb_speed"
    run = simulate(case.with_values(coulomb | {speed: [0.2, 0.05, 0.5]}), u, 0)
    in_file = case.with_values(coulomb | {speed: [0.02, 0.05, 0.5]})
    fit = identify(run, in_file)
    fixes = {reason.fix for reason in fit.reasons if reason.code == "residual.missing-free"}
    assert f"--free +{speed}" in fixes
    assert identify(run, in_file, [f"+{speed}"], options=PLAIN).value(f"{speed}[0]") == pytest.approx(
        0.2, rel=0.2
    )


def test_error_bars_contain_a_wrong_speed_of_the_dry_friction():
    """The speed is 0.05 m/s; the file has 0.02 m/s. Half of these fits are USABLE, so only the error bars show it.

    The robots share the parameters that are fixed, so their fits share the compiled code."""
    first, z = draw_robot(0), []
    imus = [draw_robot(seed).imu.with_parameters(tilt_rad=first.imu.tilt_rad) for seed in range(4)]
    robots = [
        draw_robot(seed).with_parameters(inertia_kg_m2=first.inertia_kg_m2, imu=imu)
        for seed, imu in enumerate(imus)
    ]
    file = initial_file(first).with_values({"model.friction.coulomb_speed": [0.02, 0.02, 0.2]})
    signals = [quantised_commands(random_steps([1.0, 0.0, 1.0], 40.0, 100.0, seed)) for seed in range(4)]
    for robot, run in zip(
        robots, drive_runs(robots, signals, range(4), [file] * 4, ROBOT_STEP_S), strict=True
    ):
        fit, truth = identify(run, file, FREE_ROBOT), robot_values(robot)
        for name in (
            f"model.friction.{name}[{k}]" for name in ("linear", "quadratic", "coulomb") for k in (0, 2)
        ):
            k = fit.names.index(name)
            z.append((fit.estimate[k] - truth[name][0]) / fit.std[k])
    assert np.sqrt(np.mean(np.square(z))) < 1.5


def test_an_imu_that_is_turned_on_its_mount_is_reported_with_its_key():
    small, key = load("small"), "sensors.imu.heading_rad"
    u = random_steps(small.command.limit, 15.0, 100.0, 3, hold_s=0.5)
    run = simulate(small.with_values({key: 0.06}), u, 3)
    pushes = [f"+model.actuator_matrix[1,{j}]" for j in (0, 2)]
    fit = identify(run, small, pushes, options=FitOptions(fixed=(key,)))
    assert f"--free +{key}" in {reason.fix for reason in fit.reasons}
    assert abs(identify(run, small, options=PLAIN).value(key) - 0.06) < 0.02


def test_a_wrong_inertia_is_named_as_its_ratio_to_the_centre_of_mass():
    drive = robot_on_floor(3, 40.0)
    inertia = 1.5 * drive.file.value("model.inertia_kg_m2")
    fit = identify(drive.run, drive.file.with_values({"model.inertia_kg_m2": inertia}))
    missing = [
        reason for reason in fit.reasons if reason.code in ("residual.missing", "residual.missing-free")
    ]
    assert missing[0].figures["effect"].code == "term.turning-about"
    assert missing[0].fix == "--free +model.centre_of_mass_x_m"
    assert "term.turning" not in [reason.figures["effect"].code for reason in missing]


def test_a_wrong_centre_of_mass_is_named_first_and_the_advice_ends_the_warnings():
    """The file has 3 mm less than the robot. Drag of cornering is a smaller part of the residuals."""
    key = "model.centre_of_mass_x_m"
    small = load("small")
    run = simulate(small, random_steps(small.command.limit, 40.0, 100.0, 3, hold_s=0.5), 3)
    in_file = small.with_values({key: small.value(key) - 0.003})
    fit = identify(run, in_file)
    fixes = [reason.fix for reason in fit.reasons if reason.code.startswith("residual.missing")]
    assert fixes[0] == f"--free +{key}"
    second_fit = identify(run, in_file, [f"+{key}"])
    assert not any(reason.code.startswith("residual.") for reason in second_fit.reasons)
    k = second_fit.names.index(key)
    assert abs(second_fit.estimate[k] - small.value(key)) < 3.0 * second_fit.std[k]


def test_wheels_of_unequal_size_are_named_first():
    """The radii differ by 4 %. A smaller wheel is stronger and its motor brakes more, which pulls to its side."""
    robot = draw_robot(5)
    wheels = replace(robot, wheel=np.array([[1.02, 0.98]]))
    u = quantised_commands(random_steps([1.0, 0.0, 1.0], 40.0, 100.0, 5))
    file = initial_file(robot)
    fit = identify(drive_runs([wheels], [u], [5], [file], ROBOT_STEP_S), file, FREE_ROBOT)
    missing = [reason for reason in fit.reasons if reason.code == "residual.missing"]
    assert fit.verdict == "WARN"
    assert missing[0].figures["effect"].code == "term.unequal-drag"


@pytest.mark.parametrize("drives_backward", [True, False])
def test_the_backward_dead_zone_of_a_car_is_free_if_it_drives_backward(drives_backward):
    """A wrong fixed value biased the forward dead zone by 10 standard errors, and the verdict was USABLE."""
    car, path = load("car"), "model.drivetrain.dead_zone_backward"
    u = random_steps([0.4, 0.5], 40.0, 50.0, 3, hold_s=0.7)
    u[:, 0] = u[:, 0] if drives_backward else np.abs(u[:, 0])
    fit = identify(simulate(car.with_values({path: [0.05, 0.0]}), u, 3), car)
    assert (f"{path}[0]" in fit.names) == drives_backward
    assert not any(path in finding.subject for finding in fit.findings)
    for name, truth in ((f"{path}[0]", 0.05), ("model.drivetrain.dead_zone_forward[0]", 0.03)):
        if name in fit.names:
            k = fit.names.index(name)
            assert abs(fit.estimate[k] - truth) < 4.0 * fit.std[k]


@pytest.mark.parametrize("seed", [3, 4])
def test_uneven_timestamps_are_not_a_clock_offset_or_a_filter(seed):
    """The stamps of all rows are late by 1 ms (rms)."""
    small = load("small").with_values({"sensors.wheels.kind": "wheels", "sensors.wheels.noise_std": 0.01})
    run = simulate(small, random_steps(small.command.limit, 40.0, 100.0, seed, hold_s=0.5), seed)
    late_ns = np.abs(np.random.default_rng(seed).normal(0.0, 1e6, len(run.t_ns))).astype(np.int64)
    sensors = {
        name: channel._replace(t_ns=channel.t_ns + late_ns, arrival_ns=channel.arrival_ns + late_ns)
        for name, channel in run.sensors.items()
    }
    run = replace(run, t_ns=run.t_ns + late_ns, sensors=sensors, truth=None)
    fit = identify(run, small, ["+model.drivetrain.delay_s"])
    effects = [reason.figures["effect"].code for reason in fit.reasons if "effect" in reason.figures]
    assert not {"term.delay-of-sensor", "term.low-pass"} & {*effects}


def test_the_errors_by_a_missing_effect_are_correlated(case, u):
    """Linear and quadratic drag share the error of a missing dry friction; their sum at this speed is accurate."""
    rough_file = case.with_values({"model.friction.coulomb": [0.15, 0.0, 0.0]})
    fit = identify(simulate(rough_file, u, 0), case)
    i, j = (fit.names.index(f"model.friction.{name}[0]") for name in ("linear", "quadratic"))
    assert fit.cov[i, j] < -0.9 * fit.std[i] * fit.std[j]


def test_a_parameter_change_within_a_run_is_reported(case, u):
    worn_case = case.with_values({"model.friction.linear": [9.0, 7.0, 500.553]})
    first = simulate(case, u, 0)
    second = simulate(worn_case, u[1500:], 1, nu0=first.truth.nu[1499])
    z = first.sensors["imu"].z.copy()
    z[1500:] = second.sensors["imu"].z
    mixed_run = replace(first, sensors={"imu": first.sensors["imu"]._replace(z=z)}, truth=None)
    fit = identify(mixed_run, case)
    assert fit.verdict == "WARN"
    assert "residual.parts-differ" in codes(fit.reasons)
    k = fit.names.index("model.friction.linear[0]")
    # it includes the result of the halves
    assert fit.interval[k, 0] < 7.0 < 9.0 < fit.interval[k, 1] or fit.std[k] > 0.5


def test_a_difference_between_two_runs_of_two_vehicles_is_reported(case, u):
    worn_case = case.with_values({"model.friction.linear": [9.0, 7.0, 500.553]})
    runs = [replace(simulate(file, u, k), name=f"run {k}") for k, file in enumerate((case, worn_case))]
    fit = identify(runs, case)
    assert fit.verdict == "WARN"
    differences = [x for x in fit.reasons if x.code == "residual.parts-differ"]
    assert differences
    # in a later drive the value is uniform between those of the parts
    for reason in differences:
        steps = np.diff(fit.unmodelled_shifts[:, fit.names.index(reason.subject)])
        assert np.isclose(steps, reason.figures["difference"] / np.sqrt(3.0)).any()


def test_a_probe_estimates_an_unmodelled_term_and_its_parameter_shift(case, u):
    """The result of a probe equals the fit with this term, to first order."""
    from baqueano.identify.diagnostics.unmodelled_terms import fitted_motion, term_columns

    rough_file = case.with_values({"model.friction.coulomb": [0.15, 0.0, 0.0]})
    run, scores = simulate(rough_file, u, 0), {}

    def look(end):
        problem, theta = end.task.problem, end.search.solution.theta
        residuals = fit_residuals(problem, theta, end.identifiability.mask)
        for words, D in term_columns(end.blocks, problem, fitted_motion(end.blocks, problem, theta))():
            scores.update(zip((term.code for term in words), score_test(residuals, D), strict=True))
        scores["names"], scores["theta"] = problem.shape.shared_paths, theta

    from baqueano.identify import prediction_error_fit as module

    function = module.assemble_fit
    try:
        module.assemble_fit = lambda end, *args: (look(end), function(end, *args))[1]
        identify(run, case)
    finally:
        module.assemble_fit = function
    answer = scores["dry friction, x"]
    assert answer.z < -5.0  # a push against the motion
    k = scores["names"].index("model.friction.linear[0]")
    before, after = scores["theta"][k] - 7.0, scores["theta"][k] + answer.shift[k] - 7.0
    assert abs(after) < 0.5 * abs(before)


def test_a_parameter_at_its_bound_by_chance_gives_only_a_note(small):
    notes, reasons = [], []
    for seed in range(4, 7):
        run = simulate(small, random_steps(small.command.limit, 20.0, 100.0, seed), seed)
        fit = identify(run, small)
        notes += fit.notes
        reasons += fit.reasons
    assert ("bound.low-by-chance", "model.friction.quadratic[1]") in [(n.code, n.subject) for n in notes]
    assert "bound.low-held" not in codes(reasons)


SECONDS = 30.0
DRAG = "model.linear_drag"


@pytest.fixture(scope="module")
def soft_tyres():
    """A car of the independent truth that understeers, a run, and its fit without the understeer."""
    car = trials.draw_car(703, "understeer")
    file = car_file(car)
    u = trials._car_steps(703, file.rate_hz, SECONDS, trials.STEERING_AMPLITUDE["understeer"])
    (run,) = drive_runs([car], [u], [703], [file])
    return car, run, identify(run, file, FREE_CAR)


def test_unmodelled_tyre_slip_drag_widens_the_errors(soft_tyres):
    """The estimate of the rolling drag is too low, because slip explains a part of it."""
    car, _, fit = soft_tyres
    k = fit.names.index(DRAG)
    error = fit.estimate[k] - float(car_values(car)[DRAG][0])
    assert fit.verdict == "WARN"
    assert "slip, x" in [reason.figures.get("term") for reason in fit.reasons]
    assert abs(error) < 1.96 * fit.std[k]
    assert np.isfinite(fit.std[k])
    assert "--free +model.understeer" in [reason.fix for reason in fit.reasons]


def test_understeer_explains_a_steering_gain_that_falls_with_the_speed(soft_tyres):
    car, run, fit = soft_tyres
    understeering_fit = identify(run, car_file(car), (*FREE_CAR, "+model.understeer"), options=PLAIN)
    true_gain = float(car.servo_rad[0])
    error, error_before = (
        abs(x.value("model.steering_gain") / true_gain - 1.0) for x in (understeering_fit, fit)
    )
    assert error < 0.02 < error_before


@pytest.mark.parametrize(("z", "fix"), [(-9.0, "--free +model.understeer"), (9.0, "")])
def test_understeer_is_advised_only_if_the_yaw_rate_is_too_small(z, fix):
    """A car that oversteers turns faster than the model."""
    gain, std, infinite = np.array([0.4]), np.array([0.01]), np.array([np.inf])
    without_biases, names, shift = SimpleNamespace(nuisances=[]), ["model.steering_gain"], np.array([0.1])
    fit = residual_checks._FitEvidence(without_biases, names, gain, std, -infinite, infinite, 0, {})
    tests = [(Effect("cornering, psi", note("term.cornering")), ScoreTest(z, z, 58.0, shift, [], 1.0))]
    (result,) = residual_checks._missing_terms(fit, tests, load("car").vehicle)
    assert result.message.fix == fix
