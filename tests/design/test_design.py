"""Experiments in a room: every possible vehicle stays inside, and the designed signal is the most informative."""

import numpy as np
import pytest

from baqueano.design import plan as planning
from baqueano.design.compose import (
    GENTLE_FACTOR,
    MotionPrimitive,
    PrimitiveShape,
    gentler_primitive,
    map_poses,
)
from baqueano.design.containment import (
    chunk_alternatives,
    contain_in_room,
    respects_speed_limits,
    wall_margin,
)
from baqueano.design.information import DriveInformation, mean_error
from baqueano.design.plan import design_plan
from baqueano.design.vehicle_cloud import VehicleCloud, VehicleDistribution, possible_vehicles
from baqueano.errors import AnswerNo, UsageError
from baqueano.identify import excitation
from baqueano.routes.room import MAX_LATERAL_M_S2, Room, body_radius, vehicle_room
from baqueano.vehicle_file import load
from baqueano.vehicle_file.provenance import ParameterCov
from tests.codes import of_code

SECONDS = 15.0


@pytest.fixture(scope="module")
def plan(small):
    return design_plan(small, vehicle_room(small, "2x2"), SECONDS)


def test_a_designed_experiment_is_more_informative_than_other_signals_in_its_room(small, plan):
    room, drive_information = vehicle_room(small, "2x2"), DriveInformation(small)
    cloud = VehicleCloud(small, possible_vehicles(small))
    for kind, options in (("random_steps", {}), ("multisine", {"low_hz": 0.2}), ("prbs", {}), ("ramps", {})):
        signal = excitation(kind, small.command.limit, SECONDS, small.rate_hz, 3, **options)
        u = contain_in_room(signal, small, room, cloud=cloud).u
        assert plan.mean_error < mean_error(
            drive_information.relative_std(drive_information.information(u))
        ), kind


def test_a_designed_experiment_respects_limits_room_and_duration(small, plan):
    assert plan.u.shape == (round(SECONDS * small.rate_hz), 3)
    assert np.all(np.abs(plan.u) <= small.command.limit)
    assert np.all(plan.u[:100] == 0.0)
    assert plan.margin_m >= 0.0
    half = 1.0 - small.geometry.radius_m
    mean = plan.eta[..., :2].mean(axis=0)
    corridor = np.abs(mean) + 3.0 * plan.eta[..., :2].std(axis=0)
    furthest = np.max(np.abs(mean + 1.5 * (plan.eta[..., :2] - mean)))
    assert max(np.max(corridor), furthest) <= half
    assert plan.margin_m == pytest.approx(half - max(np.max(corridor), furthest))
    assert "cm from the walls" in plan.table()


def test_the_same_seed_gives_the_same_plan(small, monkeypatch):
    for name, number in (("FIRST_PRIMITIVES", 40), ("ROUNDS", 1), ("PRIMITIVES_PER_ROUND", 10)):
        monkeypatch.setattr(planning, name, number)
    room = vehicle_room(small, "2x2")
    first, repetition, other_seed = (design_plan(small, room, 4.0, seed=seed).u for seed in (1, 1, 2))
    assert np.array_equal(first, repetition)
    assert not np.array_equal(first, other_seed)


def test_a_stopped_search_returns_its_best_plan_so_far(small, monkeypatch):
    monkeypatch.setattr(planning, "FIRST_PRIMITIVES", 40)
    texts = []
    plan = design_plan(
        small, vehicle_room(small, "2x2"), 5.0, progress=lambda text: texts.append(text) or True
    )
    assert len(texts) == 1
    assert f"0 of {planning.ROUNDS} rounds: standard errors of " in texts[0]
    assert np.any(plan.u != 0.0)
    assert plan.margin_m >= 0.0


def test_a_motion_in_which_the_derivatives_diverge_is_not_used(small, monkeypatch):
    monkeypatch.setattr(planning, "ROUNDS", 1)
    information, fast = DriveInformation.information, 0.9

    def diverging(self, u, theta=None):
        F = information(self, u, theta)
        return F if theta is None or np.max(u[:, 0]) < fast else np.full_like(F, np.inf)

    monkeypatch.setattr(DriveInformation, "information", diverging)
    plan = design_plan(small, vehicle_room(small, "2x2"), 4.0)
    assert np.max(plan.u[:, 0]) < fast
    assert np.isfinite(plan.relative_std).all()


def test_vehicles_outside_the_planned_set_stay_inside_the_room(small, plan):
    truth = possible_vehicles(small, 0.17, vehicle_count=100, seed=77)
    cloud = VehicleCloud(small, truth, seed=5)
    _, eta = cloud.drive(cloud.state_at(plan.room.start), plan.u)
    assert np.all(np.abs(eta[..., :2]) <= plan.room.free_half_width_m)


@pytest.mark.parametrize(("name", "size"), [("small", "1.2x1.2"), ("case-study-1", "2x3"), ("car", "3x3")])
def test_a_signal_that_leaves_the_room_is_changed_without_stopping_the_vehicle(name, size):
    file = load(name)
    room = vehicle_room(file, size)
    signal = excitation("random_steps", file.command.limit, SECONDS, file.rate_hz, 1)
    cloud = VehicleCloud(file, possible_vehicles(file))
    _, free = cloud.drive(cloud.state_at(room.start), signal)
    contained_drive = contain_in_room(signal, file, room, cloud=cloud)
    assert wall_margin(room, free) < 0.0 <= contained_drive.margin_m
    assert 0.0 < contained_drive.replaced_fraction < 1.0
    assert np.mean(np.any(contained_drive.u != 0.0, axis=1)) > 0.7
    assert np.all(np.abs(contained_drive.u) <= file.command.limit)


def test_a_signal_that_stays_inside_is_not_changed(small):
    signal = 0.4 * excitation("multisine", small.command.limit, SECONDS, small.rate_hz, 1, low_hz=0.3)
    contained_drive = contain_in_room(signal, small, vehicle_room(small, "4x4"))
    assert contained_drive.replaced_fraction == 0.0
    assert np.array_equal(contained_drive.u, signal)


def test_alternatives_to_a_command_never_exceed_it_and_include_zero():
    signal = np.array([[0.8, 0.0, -0.4]])
    options = chunk_alternatives(signal)
    assert np.array_equal(options[0], signal)
    assert np.all(np.abs(options) <= np.abs(signal))
    assert np.all(options[-1] == 0.0)
    assert any(np.array_equal(o, [[-0.8, 0.0, -0.4]]) for o in options)  # a car drives back on its own arc


def test_the_information_matrix_equals_finite_differences(small):
    drive_information, rng = DriveInformation(small), np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1.0, 1.0, (6, 3)), 50, axis=0) * small.command.limit
    F = drive_information.information(u)
    k = drive_information.unknowns.names.index("model.friction.linear[2]")
    theta, h = drive_information.nominal, 1e-4 * drive_information.nominal[k]
    ends = []
    for sign in (-1.0, 1.0):
        shifted_theta = theta.copy()
        shifted_theta[k] += sign * h
        ends.append(np.asarray(drive_information.kernel.run(u, shifted_theta)[1]))
    slope = (ends[1] - ends[0]) / (2.0 * h) * drive_information.unknowns.size[k]
    assert F[k, k] == pytest.approx(np.sum(slope**2), rel=1e-4)


def test_more_data_never_reduce_the_information(small):
    drive_information = DriveInformation(small)
    u = excitation("random_steps", small.command.limit, 10.0, small.rate_hz, 0)
    short, long = (drive_information.relative_std(drive_information.information(x)) for x in (u[:500], u))
    assert np.all(long <= short * (1.0 + 1e-9))
    assert np.all(short <= 1.0)


def test_a_segment_and_its_return_path_end_at_the_start(small):
    out = np.zeros((300, 3))
    out[:, 0] = 0.8
    u = MotionPrimitive(out, 0).u(400, small.command.limit)
    even = small.with_values({f"model.drivetrain.dead_zone_{d}": [0.3, 0.3] for d in ("forward", "backward")})
    even = even.with_values({"model.drivetrain.gain": [1.0, 1.0], "model.process_noise_std": [0.0, 0.0, 0.0]})
    cloud = VehicleCloud(even, possible_vehicles(even, vehicle_count=2))
    _, eta = cloud.drive(cloud.state_at(np.zeros(3)), u)
    assert np.hypot(*eta[0, 149, :2]) > 0.2
    assert np.hypot(*eta[0, -1, :2]) < 0.03


def test_a_pose_relative_to_the_vehicle_is_transformed_to_the_map():
    pose = map_poses(np.array([1.0, 2.0, np.pi / 2]), np.array([0.5, 0.0, 0.1]))
    np.testing.assert_allclose(pose, [1.0, 2.5, np.pi / 2 + 0.1])


def test_possible_vehicles_of_a_fit_are_drawn_from_its_covariance(small):
    fitted_file = possible_vehicles(small, 0.2)
    assert np.std(np.log(fitted_file.theta[1:] / fitted_file.theta[0])) == pytest.approx(0.2, rel=0.1)
    np.testing.assert_allclose(
        np.mean(np.log(fitted_file.theta[1:] / fitted_file.theta[0]), axis=0), 0.0, atol=1e-12
    )


def test_possible_vehicles_have_the_measured_total_friction(small):
    """A short drive identifies the stopping distance but not the kind of friction: the errors are correlated."""
    names = ("model.friction.linear[0]", "model.friction.quadratic[0]", "model.friction.coulomb[0]")
    values = dict(zip(names, (0.5, 1.0, 0.1), strict=True))
    speed = 0.5
    force = np.array([speed, speed**2, 1.0])  # N of each at this speed
    shape = np.diag([1.0, 2.0, 0.5]) ** 2
    variance = force @ shape @ force + 0.01**2  # the sum is known to 0.01 N
    cov = shape - np.outer(shape @ force, force @ shape) / variance
    measured_file = small.with_values(values, parameter_cov=ParameterCov(names, cov))
    theta = possible_vehicles(measured_file, vehicle_count=200).theta[:, :3]
    assert np.all(theta >= 0.0)
    assert np.any(theta == 0.0)  # drawn values beyond a bound
    assert np.all(np.std(theta, axis=0) > 0.1 * theta[0])
    np.testing.assert_allclose(theta @ force, 0.6, atol=0.05)


def test_a_parameter_that_a_fit_did_not_determine_is_uncertain_by_a_half(small):
    fitted_file = small.with_values({}, parameter_cov=ParameterCov(("model.friction.linear[1]",), np.eye(1)))
    draws = possible_vehicles(fitted_file, vehicle_count=200)
    column = draws.paths.index("model.friction.linear[0]")
    drag = draws.theta[:, column]
    assert np.std(np.log(drag[1:] / drag[0])) == pytest.approx(0.5, rel=0.15)


def test_the_body_radius_covers_the_whole_vehicle():
    assert body_radius(load("small")) == 0.07
    assert body_radius(load("car")) == pytest.approx(np.hypot(0.22, 0.107) / 2.0)
    assert body_radius(load("case-study-1")) == 0.0


@pytest.mark.parametrize("size", ["2", "axb", "2x", "2x2x2", "..x1"])
def test_an_unreadable_room_is_refused_with_an_example(small, size):
    with pytest.raises(UsageError, check=of_code("room.unreadable")):
        vehicle_room(small, size)


def test_a_room_smaller_than_the_body_is_refused(small):
    with pytest.raises(UsageError, check=of_code("room.small", radius_m=0.07)):
        vehicle_room(small, "0.1x2")


def test_the_room_margin_includes_the_furthest_vehicle():
    """Nine vehicles are at rest, one is 0.5 m away: 0.45 m from their mean of 0.05 m; three deviations are also 0.45
    m."""
    ways = np.zeros((10, 2, 3))
    ways[0, 1, 1] = 0.5
    assert wall_margin(Room(2.0, 2.0), ways) == pytest.approx(1.0 - (0.05 + 1.5 * 0.45))


@pytest.mark.parametrize(("speed_m_s", "slides"), [(1.6, False), (1.9, True)])
def test_a_curve_beyond_tyre_grip_is_too_fast(speed_m_s, slides):
    """On a circle of 1 m: 2.6 and 3.6 m/s²."""
    room = vehicle_room(load("car"), "4x4")
    distance = speed_m_s * np.arange(100) / 50.0
    eta = np.stack([np.sin(distance), 1.0 - np.cos(distance), distance], axis=1)
    assert room.lateral_m_s2 == MAX_LATERAL_M_S2
    assert bool(respects_speed_limits(room, eta[None], 50.0)) == (not slides)
    assert bool(respects_speed_limits(Room(4.0, 4.0), eta[None], 50.0))


def test_a_gentler_segment_has_smaller_turns_at_the_same_speed():
    shape = PrimitiveShape(20, 4, np.array([1.0, 0.0, 0.5]))
    primitive = MotionPrimitive(np.tile([1.0, 0.0, -0.6], (16, 1)), 0)
    np.testing.assert_allclose(
        gentler_primitive(primitive, shape).outbound, np.tile([1.0, 0.0, -0.6 * GENTLE_FACTOR], (16, 1))
    )
    plain_shape = PrimitiveShape(20, 4, np.array([1.0]))
    np.testing.assert_allclose(
        gentler_primitive(MotionPrimitive(np.ones((16, 1)), 0), plain_shape).outbound, GENTLE_FACTOR
    )


def test_a_start_inside_a_wall_is_refused():
    with pytest.raises(UsageError, check=of_code("room.start")):
        Room(2.0, 2.0, 0.1, (0.95, 0.0, 0.0))


def test_a_start_from_which_vehicles_leave_the_room_is_reported(car_like):
    file, room = car_like
    with pytest.raises(AnswerNo, check=of_code("room.too-small")):
        contain_in_room(np.zeros((200, 3)), file, room)


@pytest.fixture(scope="module")
def car_like(small):
    """Return the small vehicle on a steep slope, where it rolls out of the room with any command, and the room."""
    data = {"model.slope_rad": 0.5, "model.friction.coulomb": [0.0, 0.0, 0.0]}
    return small.with_values(data), vehicle_room(small, "1x1")


def test_an_experiment_too_short_to_move_is_refused(small):
    with pytest.raises(UsageError, check=of_code("design.short")):
        design_plan(small, vehicle_room(small, "2x2"), 1.5)


def test_a_signal_of_the_wrong_shape_is_refused(small):
    with pytest.raises(UsageError, check=of_code("signal.shape", commands=3)):
        contain_in_room(np.zeros((100, 2)), small, vehicle_room(small, "2x2"))


def test_a_draw_that_diverges_only_in_fast_straight_motion_is_replaced(small):
    """With this drag the integrator diverges at full speed, but not when one wheel is at rest."""
    draws = VehicleDistribution(("model.friction.quadratic[0]",), np.array([[0.8], [9000.0]]))
    cloud = VehicleCloud(small, draws)
    _, eta = cloud.drive(cloud.state_at(np.zeros(3)), np.tile([1.0, 0.0, 0.0], (100, 1)))
    assert np.all(np.isfinite(eta))
