"""A path from the pose of the vehicle: it reaches its goal within its radius and its speed."""

import itertools

import numpy as np
import pytest

from baqueano.block_checks import check_guide
from baqueano.guides import DriveTo
from baqueano.guides.clothoids import pose_at, shortest_path
from baqueano.guides.route import Route
from baqueano.guides.shapes import circle, eight, line
from baqueano.routes import reverse
from baqueano.signals import Estimate

DT = 0.04
SMALL, CAR = (0.25, 0.2), (1.0, 0.5)  # radius [m], speed [m/s]


def estimate_at(eta, tick=0, v=0.0):
    return Estimate(round(1e9 * DT) * tick, np.array(eta, float), np.array([v, 0.0, 0.0]), np.zeros((6, 6)))


def followed(guide, start, ticks=1500):
    """Return the references of a vehicle that follows them exactly, until the end."""
    state, out, pose = guide.init(), [], np.array(start, float)
    for k in range(ticks):
        state, reference = guide.step(state, estimate_at(pose, k))
        out.append(reference)
        pose = reference.eta
        if reference.at_end > 0.0:
            break
    return state, out


def test_a_path_ends_at_its_goal_with_continuous_limited_curvature():
    rng = np.random.default_rng(0)
    for _ in range(300):
        start, goal = rng.uniform(-2.0, 2.0, (2, 3)) * [1.0, 1.0, 3.0]
        radius_m, ramp_m = rng.uniform(0.1, 1.0, 2)
        kappa_0, kappa_g = rng.uniform(-1.0, 1.0, 2) / radius_m
        path, _ = shortest_path(start, kappa_0, goal[None], np.array([kappa_g]), radius_m, ramp_m)
        end, kappa_end = pose_at(path, path.length_m)
        np.testing.assert_allclose(end[:2], goal[:2], atol=1e-7)
        assert abs(np.sin(0.5 * (end[2] - goal[2]))) < 1e-7
        assert path.length_m >= np.hypot(*(goal - start)[:2]) - 1e-9
        np.testing.assert_allclose([*path.kappa[0], kappa_end], [kappa_0, *path.kappa[1]], atol=1e-9)
        assert kappa_end == pytest.approx(kappa_g)
        assert np.max(np.abs(path.kappa)) <= 1.0 / radius_m + 1e-9
        assert np.all(np.abs(np.diff(path.kappa, axis=0)) <= path.piece_m / (radius_m * ramp_m) + 1e-9)


def test_paths_with_short_clothoids_match_hand_calculations():
    zero = np.zeros(3)
    for goal, radius_m, length_m in (
        ([2.0, 0.0, 0.0], 0.5, 2.0), ([1.0, 1.0, np.pi / 2], 0.99, np.pi / 2), ([0.0, 2.0, np.pi], 0.99, np.pi)
    ):  # fmt: skip
        path, _ = shortest_path(zero, 0.0, np.array([goal]), np.zeros(1), radius_m, 1e-3)
        assert path.length_m == pytest.approx(length_m, rel=0.01)


def test_a_path_from_rest_begins_with_its_arc():
    """A vehicle at rest has time to steer: arc, clothoid and line; before, it was a clothoid longer."""
    radius_m, ramp_m, arc_m, line_m = 0.5, 0.3, 0.4, 0.2
    s = np.linspace(0.0, arc_m + ramp_m + line_m, 20001)
    psi = np.append(
        0.0, np.cumsum(np.diff(s) * np.interp(s[1:], [arc_m, arc_m + ramp_m], [1 / radius_m, 0.0]))
    )
    x, y = (np.sum(np.diff(s) * f(0.5 * (psi[1:] + psi[:-1]))) for f in (np.cos, np.sin))
    goal = np.array([[x, y, psi[-1]]])
    path, _ = shortest_path(np.zeros(3), None, goal, np.zeros(1), radius_m, ramp_m)
    assert path.length_m == pytest.approx(s[-1], rel=0.01)
    np.testing.assert_allclose(path.kappa[0, np.argmax(path.piece_m > 0.0)], 1 / radius_m, rtol=1e-6)
    assert shortest_path(np.zeros(3), 0.0, goal, np.zeros(1), radius_m, ramp_m)[0].length_m > 1.05 * s[-1]


@pytest.mark.parametrize(("y", "psi"), [(0.2, 0.52), (0.2, -0.52), (-0.2, 0.52), (-0.2, -0.52)])
def test_a_car_with_a_slow_servo_joins_its_route_soon_from_rest(y, psi):
    """Its curvature needs 0.4 s to change. Before, the longest path was 1.77 m."""
    radius_m, ramp_s, speed_m_s = 0.51, 0.4, 1.0
    route = circle(3.0, speed_m_s)
    guide = DriveTo.to_route(route, radius_m=radius_m, ramp_m=ramp_s * speed_m_s, speed_m_s=speed_m_s)
    state, out = followed(guide, (0.0, y, psi))
    assert state.path.length_m < 1.3
    v, r = np.array([reference.nu[::2] for reference in out[1:-1]]).T
    kappa_change = np.abs(np.diff(r / v)) / DT
    assert np.max(kappa_change) < 1.01 / (radius_m * ramp_s)
    assert len(out) * DT < 3.5


@pytest.mark.parametrize("ramp_ratio", [0.6, 1.0, 2.0])
def test_a_moving_car_with_a_slow_servo_joins_its_route_without_a_loop(ramp_ratio):
    """Before, the goals ended three radii ahead, which is too near for slow changes of the curvature."""
    radius_m, v = 0.5, 1.0
    route = circle(4.0, v)
    guide = DriveTo.to_route(route, radius_m=radius_m, ramp_m=ramp_ratio * radius_m, speed_m_s=v)
    for x, y, psi in itertools.product((-0.2, 0.0, 0.2), (0.2, -0.2), (0.52, -0.52)):
        state, _ = guide.step(guide.init(), estimate_at((x, y, psi), v=v))
        turn_rad = np.sum(np.abs(np.mean(state.path.kappa, axis=0)) * state.path.piece_m)
        assert turn_rad < np.pi, (x, y, psi)


def test_a_slight_offset_is_not_driven_in_a_loop():
    for offset_m in (0.0, 1e-9, 1e-6, 1e-3, 0.05, 0.2):
        goal = np.array([[1.0, offset_m, 0.0]])
        path, _ = shortest_path(np.zeros(3), 0.0, goal, np.zeros(1), 0.25, 0.1)
        assert path.length_m < 1.03
        np.testing.assert_allclose(pose_at(path, path.length_m)[0], goal[0], atol=1e-5)


@pytest.mark.parametrize(("radius_m", "speed_m_s"), [SMALL, CAR], ids=["small", "car"])
@pytest.mark.parametrize("start", [(0.1, 0.2, 0.5), (-1.0, -0.3, 2.5), (0.0, -0.4, -0.5)])
def test_the_guide_joins_a_route_within_radius_and_speed(start, radius_m, speed_m_s):
    route = circle(2.0, speed_m_s)
    guide = DriveTo.to_route(route, radius_m=radius_m, speed_m_s=speed_m_s)
    state, out = followed(guide, start)
    eta, nu = np.array([r.eta for r in out]), np.array([r.nu for r in out])
    np.testing.assert_allclose(eta[0], start, atol=1e-9)
    steps = np.hypot(*np.diff(eta[:, :2], axis=0).T)
    assert np.max(steps) <= 1.01 * speed_m_s * DT
    assert np.max(np.abs(nu[:, 2])) <= 1.001 * speed_m_s / radius_m
    tau_s, v, distance = state.goal
    start_eta = [np.interp(tau_s, route.t_s, route.eta[:, i]) for i in range(3)]
    np.testing.assert_allclose(eta[-1, :2], start_eta[:2], atol=1e-6)
    assert (v, distance) == pytest.approx((speed_m_s, 1.0))
    assert out[-1].at_end == 1.0


def test_the_reference_velocity_is_the_derivative_of_its_poses():
    _, out = followed(DriveTo([[1.0, 0.8, 2.0]]), (0.0, 0.0, 0.0))
    eta, nu = np.array([r.eta for r in out[1:-1]]), np.array([r.nu for r in out[1:-1]])
    error = np.abs(np.diff(np.unwrap(eta[:, 2])) / DT - 0.5 * (nu[1:, 2] + nu[:-1, 2]))
    assert np.max(error) < 0.02
    assert np.max(np.abs(nu[:, 2])) == pytest.approx(0.2 / 0.25)
    speeds = np.hypot(*np.diff(eta[:, :2], axis=0).T) / DT
    np.testing.assert_allclose(speeds, 0.5 * (nu[1:, 0] + nu[:-1, 0]), atol=2e-3)


def test_the_guide_begins_at_the_vehicle_speed_and_ends_at_rest():
    guide = DriveTo([[2.0, 0.0, 0.0]], speed_m_s=0.5, acceleration_m_s2=0.25)
    _, first = guide.step(guide.init(), estimate_at(np.zeros(3), v=0.4))
    assert first.nu[0] == pytest.approx(0.4)
    _, out = followed(guide, np.zeros(3))
    v = np.array([r.nu[0] for r in out])
    assert np.max(v) == pytest.approx(0.5)
    assert np.max(np.abs(np.diff(v))) <= 0.25 * DT + 0.021  # and stops from its slowest speed
    assert v[-1] == 0.0


def test_the_guide_is_done_if_the_vehicle_is_at_its_goal():
    guide = DriveTo.to_route(eight(0.6, 0.2))
    state, reference = guide.step(guide.init(), estimate_at([0.004, 0.004, np.radians(1.0)]))
    assert reference.at_end == 1.0
    assert state.goal[0] == 0.0


def test_a_backward_route_is_reached_backward():
    route = reverse(line(2.0, 0.2), backing=True)  # from x = 2 to 0, heading along x
    _, out = followed(DriveTo.to_route(route), (2.4, 0.1, 0.1))
    assert all(r.nu[0] <= 0.0 for r in out)
    assert np.ptp([r.eta[2] for r in out]) < 1.0
    assert 1.0 <= out[-1].eta[0] <= 2.001


def test_drive_to_passes_the_guide_check():
    assert check_guide(DriveTo([[1.0, 0.5, 1.0]])) == []


def test_the_turn_rate_of_the_reference_is_continuous_from_a_moving_start_to_the_route():
    """Neither the servo of a car nor the wheels of a robot can follow a jump of the curvature."""
    route, speed_m_s, (radius_m, ramp_m) = circle(2.0, 0.5), 0.5, (1.0, 0.4)
    guide = DriveTo.to_route(route, radius_m=radius_m, ramp_m=ramp_m, speed_m_s=speed_m_s)
    moving = estimate_at((0.1, 0.4, 0.5))._replace(nu=np.array([0.4, 0.0, -0.2]))  # a curvature of −0.5 1/m
    state, first = guide.step(guide.init(), moving)
    assert first.nu == pytest.approx([0.4, 0.0, -0.2])
    rates, k = [first.nu], 0
    while rates[-1][0] > 0.0 and not first.at_end:
        k += 1
        state, first = guide.step(state, estimate_at(first.eta, k))
        rates.append(first.nu)
    v, _, r = np.array(rates[:-1]).T
    steepest = speed_m_s * DT / (radius_m * ramp_m)
    assert np.max(np.abs(np.diff(r / v))) <= 1.01 * steepest
    assert r[-1] / v[-1] == pytest.approx(0.5, abs=steepest)  # of the circle


def test_a_goal_at_rest_is_reached_only_with_a_resting_vehicle():
    guide, k = DriveTo([[1.0, 0.5, 1.0]]), 0
    state, reference = guide.step(guide.init(), estimate_at(np.zeros(3)))
    while state.goal_ns < 0:
        k += 1
        state, reference = guide.step(state, estimate_at(reference.eta, k, v=0.05))
    turning = estimate_at(reference.eta, k + 1)._replace(nu=np.array([0.0, 0.0, 0.33]))
    assert guide.step(state, turning)[1].at_end == 0.0
    assert guide.step(state, estimate_at(reference.eta, k + 1))[1].at_end == 1.0
    assert (
        guide.step(state, turning._replace(t_ns=turning.t_ns + 2_000_000_000))[1].at_end == 1.0
    )  # it cannot rest


def test_a_sparse_route_is_joined_at_the_same_place_as_a_dense_route():
    """A line of two poses: the end of the line is not the only place to join it ahead of its start."""
    starts = []
    for count in (2, 201):
        s = np.linspace(0.0, 2.0, count)
        route = Route(s / 0.2, np.outer(s, [1.0, 0.0, 0.0]), np.tile([0.2, 0.0, 0.0], (count, 1)), False)
        state, _ = followed(DriveTo.to_route(route), (0.3, 0.1, 0.0))
        starts.append(state.goal[0])
    assert starts[0] == pytest.approx(starts[1])
    assert 1.0 < starts[0] <= 5.0


@pytest.mark.parametrize("radius_m", [0.25, 0.8, 2.5])
@pytest.mark.parametrize("psi", [0.52, -0.52])
def test_a_vehicle_beside_a_route_joins_it_without_a_loop_at_any_turning_radius(radius_m, psi):
    guide = DriveTo.to_route(line(20.0, 0.5), radius_m=radius_m, ramp_m=0.1)
    state, out = followed(guide, (0.2, 0.2, psi), ticks=5000)
    heading = np.unwrap([r.eta[2] for r in out])
    assert np.ptp(heading) < 0.5 * np.pi
    assert state.path.length_m < max(1.0, 3.0 * radius_m)
