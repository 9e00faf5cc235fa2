"""An IMU whose axes differ from those of the model is named with a remedy if the data show it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.identify import excitation, fit as module, identify
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.diagnostics import file_consistency
from baqueano.identify.diagnostics.file_consistency import gain_findings
from baqueano.identify.parameters.free import default_free, free_parameters
from baqueano.sensors import Wheels
from baqueano.signals import sensor_slots
from baqueano.simulate import simulate
from baqueano.study import counterpart
from baqueano.study.identification.trials import draw_car, draw_robot, initial_file, quantised_commands
from baqueano.symbolic import with_value
from baqueano.vehicle_file import load


def with_imu(run, change):
    c = run.sensors["imu"]
    return replace(run, sensors={**run.sensors, "imu": c._replace(z=change(c.z))})


def codes(findings):
    return {finding.code for finding in findings}


@pytest.mark.parametrize("seed", range(4))
def test_swapped_imu_axes_of_an_omnidirectional_vehicle_are_refused_and_named(case, case_run, seed):
    """The gains compensate a swap, except the sign of the acceleration in a turn."""
    fit = identify(with_imu(case_run(seed, 20.0), lambda z: z[:, [1, 0, 2]]), case)
    assert fit.verdict == "REFUSED"
    assert "mount.swapped" in codes(fit.reasons)
    assert "axes.inverted" not in codes(fit.reasons)


@pytest.mark.parametrize(("axis", "ordinal"), [(0, "first"), (1, "second"), (2, "third")])
def test_an_inverted_imu_axis_is_named(case, case_run, axis, ordinal):
    sign = np.where(np.arange(3) == axis, -1.0, 1.0)
    fit = identify(with_imu(case_run(0, 20.0), lambda z: z * sign), case)
    assert fit.verdict == "REFUSED"
    assert f"mount.{ordinal}-inverted" in codes(fit.reasons)


def test_swapped_motors_are_not_reported_as_a_swapped_imu(case, case_run):
    """The model explains every channel; only the gains differ from the file."""
    run = case_run(0, 20.0)
    fit = identify(replace(run, applied_commands=run.applied_commands * [1.0, 1.0, -1.0]), case)
    assert "model.actuator_matrix[2,2]" in {reason.subject for reason in fit.reasons}
    assert not any(code.startswith("mount.") for code in codes(fit.reasons))


def test_an_unmodelled_dead_zone_is_not_reported_as_a_mounting_error(case, case_run):
    """A dead zone that the model lacks."""
    run, limit = case_run(0, 20.0), np.maximum(case.command.limit, 1e-9)
    part = run.applied_commands / limit
    signal = np.sign(part) * np.maximum(np.abs(part) - 0.2, 0.0) * limit
    fit = identify(replace(simulate(case, signal, 0), applied_commands=run.applied_commands), case)
    assert fit.verdict != "USABLE"
    assert not any(code.startswith("mount.") for code in codes(fit.reasons))


@pytest.mark.parametrize(("is_of_mount", "code"), [(True, "mount.swapped"), (False, None)])
def test_a_better_minimum_is_not_reported_as_a_mounting_error(case, case_run, monkeypatch, is_of_mount, code):
    """A simulated tank with the right IMU was refused as swapped, because the trial found a better fit of the gyro."""
    monkeypatch.setattr(module, "fit_by_simulation", lambda end: end)
    end = identify(case_run(0, 5.0), case)
    start, better, other_theta = np.full(3, 0.2), np.array([0.2, 0.2, 0.05]), end.task.start + 1e-9
    z = end.task.problem.records[0].sensors["imu"].z

    def search_from(task, blocks, records, theta):
        is_swapped = np.array_equal(records[0].sensors["imu"].z[:50], z[:50, [1, 0, 2]])
        is_better = is_swapped or (theta is other_theta and not is_of_mount)
        solution = SimpleNamespace(theta=other_theta, evaluation=SimpleNamespace(cost=1.0))
        return end.search._replace(sigma=better if is_better else start, solution=solution)

    monkeypatch.setattr(file_consistency, "_search_from", search_from)
    finding = file_consistency._better_mount(end, "imu")
    assert (finding[1].code if finding else None) == code


def test_an_imu_off_centre_in_a_turn_is_not_reported_as_swapped(small):
    names = ["model.actuator_matrix[1,2]", "model.actuator_matrix[2,2]"]
    turning = small.value("model.actuator_matrix[2,2]")
    sideways = 0.045 * turning * small.value("model.mass_kg") / small.vehicle.inertia_kg_m2
    blocks, std = FittedBlocks(small.vehicle, small.sensors), np.array([0.01, 0.001])
    findings = gain_findings(blocks, names, np.array([sideways, turning]), std)
    assert [finding.code for finding in findings] == ["file.lever-arm"]
    assert findings[0].fix == "--free +sensors.imu.lever_arm_m"
    no_imu = blocks._replace(sensors=sensor_slots(("wheels",))(Wheels(0.12)))
    assert gain_findings(no_imu, names, np.array([sideways, turning]), std)[0].fix == (
        "--free +model.centre_of_mass_x_m"
    )
    findings = gain_findings(blocks, names, np.array([sideways, 0.1 * turning]), std)
    assert [finding.code for finding in findings] == ["file.swapped"]
    assert {"expected", "value"} <= findings[0].figures.keys()  # fields of its template


def test_an_imu_3_cm_off_centre_is_not_reported_as_swapped():
    """A robot of the independent truth; the fit may not move the lever arm."""
    seed = 700
    q = draw_robot(seed)
    file = initial_file(q)
    u = quantised_commands(
        excitation("random_steps", file.command.limit, 15.0, file.rate_hz, seed, rest_s=2.0)
    )
    (run,) = counterpart.drive_runs([q], [u], [seed], [file])
    fit = identify(run, file, ["+model.centre_of_mass_x_m", "+model.drivetrain.delay_s"])
    k = fit.names.index("sensors.imu.heading_rad")
    assert abs(fit.estimate[k] - q.imu.turn_rad[0]) < 3.0 * fit.std[k]
    assert fit.verdict == "WARN"
    assert not {code for code in codes(fit.reasons) if "swapped" in code or code.startswith("mount.")}


@pytest.mark.parametrize("column", [0, 1])
def test_an_accelerometer_without_readings_is_not_reported_as_swapped(column):
    """A car of the independent truth whose log lacks one accelerometer."""
    seed = 1
    q = draw_car(seed, "understeer")
    file, rng = counterpart.car_file(q), np.random.default_rng([seed, 9])
    throttle, steering = np.repeat(rng.uniform(0.1, 0.5, 15), 100), rng.uniform(-0.4, 0.4, 25)
    u = np.stack([throttle, np.repeat(steering, 60)], axis=1)
    (run,) = counterpart.drive_runs([q], [u], [seed], [file])
    fit = identify(with_imu(run, lambda z: np.where(np.arange(3) == column, np.nan, z)), file)
    assert fit.verdict != "REFUSED"
    assert not {code for code in codes(fit.reasons) if "swapped" in code or code.startswith("mount.")}


def test_a_default_fit_frees_the_turn_of_an_imu_in_place_of_a_sideways_push_of_two_wheels(small):
    robot, car = (FittedBlocks(file.vehicle, file.sensors) for file in (small, load("car")))
    paths, turn, push = default_free(robot), "sensors.imu.heading_rad", "model.actuator_matrix[1,0]"
    assert turn in paths
    assert push not in paths
    assert turn not in default_free(robot, {"imu": [2]})  # a gyro does not show it
    assert push in default_free(with_value(robot, push, 0.1))  # the file states the push
    assert turn not in default_free(car)


def test_a_default_fit_searches_the_turn_of_an_imu_near_its_value_only(small):
    """A larger turn exchanges axes, and the message on a wrong mount names it."""
    blocks, turn = FittedBlocks(small.vehicle, small.sensors), "sensors.imu.heading_rad"
    ranges = [
        next(p.high for p in free_parameters(blocks, free, (), {}) if p.path == turn)
        for free in (None, [f"+{turn}"], [turn])
    ]
    assert ranges == [pytest.approx(0.35), 3.2, 3.2]
