"""Routes are cut, joined, reversed, scaled, and made from points: the same positions in another order or size."""

import numpy as np
import pytest

from baqueano.errors import UsageError
from baqueano.geometry import map_from_body
from baqueano.guides.route import Route, move_route
from baqueano.guides.shapes import circle, eight, line, rectangle, slalom
from baqueano.routes import at_speed, cut, fastest, join, reverse, scale, smooth, through_points
from baqueano.routes.path import distances_along
from baqueano.vehicle_file import load
from tests.codes import refused


def with_slip(route, slip_rad):
    """Return the route of a body that moves in a direction to the left of its heading, as the origin of a car does."""
    nu = np.column_stack(
        [np.cos(slip_rad) * route.nu[:, 0], np.sin(slip_rad) * route.nu[:, 0], route.nu[:, 2]]
    )
    return route._replace(eta=route.eta - [0.0, 0.0, slip_rad], nu=nu)


ROUTES = {
    "circle": circle(0.5, 0.2), "eight": eight(0.6, 0.25), "slalom": slalom(2.0, 0.3, 3, 0.2),
    "circle of a car": with_slip(circle(0.5, 0.2), 0.15),
}  # fmt: skip


def drives_itself(route, atol=2e-3):
    """Check that each pose follows from the previous pose by the velocity between them."""
    dt = np.diff(route.t_s)
    psi = 0.5 * (route.eta[1:, 2] + route.eta[:-1, 2])
    nu = 0.5 * (route.nu[1:] + route.nu[:-1])
    step = np.array([map_from_body(p) @ v * t for p, v, t in zip(psi, nu, dt, strict=True)])
    np.testing.assert_allclose(np.diff(route.eta, axis=0)[:, :2], step[:, :2], atol=atol * 0.01)


def test_joining_the_parts_of_a_cut_gives_the_whole_route():
    route = ROUTES["slalom"]
    parts = (
        cut(route, 0.0, 1.0),
        cut(route, distances_along(route.eta[:, :2])[len(cut(route, 0.0, 1.0).t_s) - 1]),
    )
    whole_again = join(*parts)
    np.testing.assert_allclose(whole_again.eta, route.eta, atol=1e-12)
    np.testing.assert_allclose(whole_again.t_s, route.t_s, atol=1e-12)
    np.testing.assert_array_equal(whole_again.nu, route.nu)


def test_a_joined_route_that_returns_is_closed():
    quarter = cut(circle(0.5, 0.2), 0.0, 0.7854)
    half = join(quarter, quarter)
    assert not half.closed
    assert join(half, half).closed


@pytest.mark.parametrize("name", ROUTES)
@pytest.mark.parametrize("backing", [False, True])
def test_a_reversed_route_passes_the_same_points(name, backing):
    route = move_route(ROUTES[name], np.array([1.0, -2.0, 0.7]))
    reversed_route = reverse(route, backing)
    np.testing.assert_allclose(reversed_route.eta[::-1, :2], route.eta[:, :2])
    assert reversed_route.t_s[0] == 0.0
    assert reversed_route.t_s[-1] == route.t_s[-1]
    drives_itself(route)
    drives_itself(reversed_route)
    np.testing.assert_allclose(reverse(reversed_route, backing).nu, route.nu)


def test_a_scaled_route_has_the_same_speed_and_shape():
    route = scale(ROUTES["eight"], 2.5)
    assert distances_along(route.eta[:, :2])[-1] == pytest.approx(
        2.5 * distances_along(ROUTES["eight"].eta[:, :2])[-1]
    )
    np.testing.assert_array_equal(route.nu[:, 0], ROUTES["eight"].nu[:, 0])
    drives_itself(route)


def test_a_route_through_points_is_drivable_and_passes_near_the_points():
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    for is_closed in (False, True):
        route = through_points(corners, 0.2, closed=is_closed)
        distance = np.min(np.hypot(*(route.eta[:, None, :2] - corners).transpose(2, 0, 1)), axis=0)
        assert np.max(distance) < 0.05
        assert route.closed == is_closed
        drives_itself(route, atol=0.05)
    assert np.round((route.eta[-1, 2] - route.eta[0, 2]) / (2.0 * np.pi)) == 1.0
    np.testing.assert_allclose(route.eta[-1, :2], route.eta[0, :2], atol=1e-9)


def test_the_curvature_of_a_wide_corner_is_even():
    """Before, it alternated every 6 cm, and the servo of a car that drove it moved from end to end."""
    route = through_points([(0.0, 0.0), (3.0, 0.0), (3.0, 3.0)], 0.6, corner_m=1.5)
    kappa = route.nu[:, 2] / 0.6
    assert kappa.max() == pytest.approx(np.sqrt(2.0) / 1.35, rel=0.01)  # of a parabola over 45 % of the leg
    assert np.abs(np.diff(kappa, 2)).max() < 0.35  # where the bend begins and ends
    assert np.abs(np.diff(kappa[170:280], 2)).max() < 0.02


@pytest.mark.parametrize("is_closed", [False, True])
def test_a_log_of_points_with_stops_gives_the_route_without_stops(is_closed):
    """Before, each of the equal points had to be removed by hand."""
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    log = (
        points[[0, 0, 1, 1, 1, 2, 2] + [0, 0] * is_closed]
        + 1e-5 * np.arange(7 + 2 * is_closed)[:, None] % 2e-5
    )
    expected, route = (through_points(xy, 0.2, closed=is_closed) for xy in (points, log))
    assert route.eta == pytest.approx(expected.eta, abs=1e-3)
    assert route.closed is is_closed


def test_setting_a_constant_speed_removes_stops_from_a_route():
    route = line(1.0, 0.2)
    stop = Route(
        np.concatenate([route.t_s[:50], route.t_s[49] + 3.0 + route.t_s[: len(route.t_s) - 49]]),
        np.concatenate([route.eta[:50], route.eta[49:]]),
        np.concatenate([route.nu[:50], route.nu[49:]]),
        closed=False,
    )
    assert at_speed(stop, 0.5).t_s[-1] == pytest.approx(2.0, rel=1e-3)


def test_an_impossible_route_edit_is_refused():
    route = circle(0.5, 0.2)
    backward = route._replace(nu=np.where(np.arange(1441)[:, None] < 700, route.nu, -route.nu))
    for code, make_route in {
        "route.cut": lambda: cut(route, 2.0, 1.0),
        "route.factor": lambda: scale(route, 0.0),
        "route.speed": lambda: at_speed(route, float("nan")),
        "route.both-ways": lambda: at_speed(backward, 0.2),
        "route.no-way": lambda: at_speed(route._replace(eta=0.0 * route.eta), 0.2),
        "route.points": lambda: through_points(np.zeros((1, 2)), 0.2),
        "route.point-not-finite": lambda: through_points(np.array([[0.0, 0.0], [np.nan, 1.0]]), 0.2),
        "route.points-far": lambda: through_points(np.array([[0.0, 0.0], [1000.0, 0.0]]), 0.2),
        "route.join-reverses": lambda: join(
            cut(route, 0.0, 1.0), reverse(cut(route, 0.0, 1.0), backing=True)
        ),
    }.items():
        with refused(code, UsageError):
            make_route()
    with refused("route.no-way", UsageError, length_m=0.0):
        through_points(np.zeros((3, 2)), 0.2)
    with refused("route.points-far", UsageError, first=3, second=4):
        through_points([(0.0, 0.0), (0.0, 0.0), (1.0, 0.0), (1000.0, 0.0)], 0.2)
    assert rectangle(1.0, 1.0, 0.2, 0.2).closed


@pytest.mark.parametrize("backing", [False, True])
def test_a_new_speed_keeps_the_slip_of_the_route(backing):
    """The origin of a car moves in another direction than its heading: a controller follows the direction of both."""
    route = reverse(ROUTES["circle of a car"], backing)
    edited_routes = (at_speed(route, 0.4), fastest(route, load("car")), smooth(route))
    for edited_route in edited_routes:
        drives_itself(edited_route)
        slip = np.arctan(edited_route.nu[:, 1] / edited_route.nu[:, 0])
        np.testing.assert_allclose(slip, 0.15, atol=2e-3)
