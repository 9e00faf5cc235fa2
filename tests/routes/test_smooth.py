"""A jerky drive becomes smooth within its tolerance; a smooth drive is unchanged."""

import numpy as np
import pytest

from baqueano.errors import UsageError
from baqueano.guides.route import Route
from baqueano.guides.shapes import circle, eight, slalom
from baqueano.routes import smooth
from baqueano.routes.path import distances_along
from tests.codes import refused


def by_keys(seed, seconds=25.0, turn=2.0, slow=0.25):
    """Simulate a driver who steers fully or not at all, round a circle of 0.8 m, with one stop of three seconds. A
    driver who reduces the speed to `slow` while steering nearly turns in place."""
    rng, dt = np.random.default_rng(seed), 0.02
    x = y = psi = v = r = target = 0.0
    rows, hold = [], 0
    for k in range(round(seconds / dt)):
        rows.append((k * dt, x, y, psi, v, 0.0, r))
        error = np.arctan2(y - 0.8, x) + np.pi / 2.0 + 1.5 * (0.8 - np.hypot(x, y - 0.8)) - psi
        error = (error + np.pi) % (2.0 * np.pi) - np.pi
        hold -= 1
        if hold <= 0:
            target, hold = turn * np.sign(error) * (abs(error) > 0.12), int(rng.uniform(5, 15))
        stands = 500 <= k < 650
        v += ((0.0 if stands else slow if target else 0.25) - v) * dt / 0.15
        r += ((0.0 if stands else target) - r) * dt / 0.1
        x, y, psi = x + v * np.cos(psi) * dt, y + v * np.sin(psi) * dt, psi + r * dt
    table = np.array(rows)
    return Route(table[:, 0], table[:, 1:4], table[:, 4:], closed=False)


def off_path(route, points):
    """Return the distance of each point from the route, by the nearest of many points between its poses."""
    s = distances_along(route.eta[:, :2])
    fine = np.linspace(0.0, s[-1], 20 * len(s))
    xy = np.column_stack([np.interp(fine, s, column) for column in route.eta[:, :2].T])
    return np.array([np.min(np.hypot(*(xy - point).T)) for point in points])


def bend(route):
    return float(np.max(np.abs(route.nu[:, 2] / route.nu[:, 0])))


@pytest.mark.parametrize("seed", range(3))
def test_a_jerky_drive_is_smooth_within_two_centimetres(seed):
    taught_route = by_keys(seed)
    route = smooth(taught_route, 0.02)
    error = off_path(route, taught_route.eta[::5, :2])
    assert np.sqrt(np.mean(error**2)) <= 0.02
    assert np.max(error) <= 0.05
    assert bend(route) <= 8.0
    assert bend(route) < 0.4 * np.max(np.abs(taught_route.nu[50:480, 2] / taught_route.nu[50:480, 0]))
    assert np.min(route.nu[:, 0]) > 0.03  # the vehicle never rests


@pytest.mark.parametrize("seed", range(3))
def test_smoothing_makes_very_tight_turns_of_a_route_feasible(seed):
    """Raw curvatures of 28 to 43 1/m, as three simulated drivers with keys had: 2 cm rms, 5 cm at most, 8 1/m."""
    taught_route = by_keys(seed, turn=3.0, slow=0.09)
    moves = np.abs(taught_route.nu[:, 0]) > 0.05
    assert 28.0 < np.max(np.abs(taught_route.nu[moves, 2] / taught_route.nu[moves, 0])) < 45.0
    route = smooth(taught_route, 0.02)
    error = off_path(route, taught_route.eta[::5, :2])
    assert np.sqrt(np.mean(error**2)) <= 0.02
    assert np.max(error) <= 0.05
    assert bend(route) <= 8.0


@pytest.mark.parametrize("seed", range(3))
def test_no_smoothed_point_exceeds_the_largest_distance(seed):
    taught_route = by_keys(seed)
    assert np.max(off_path(smooth(taught_route, 0.005, "max"), taught_route.eta[::5, :2])) <= 0.0051


@pytest.mark.parametrize(
    "drawn_route", [circle(0.5, 0.2), slalom(6.0, 0.3, 2, 0.2)], ids=["circle", "slalom"]
)
def test_a_smooth_path_is_unchanged(drawn_route):
    route = smooth(drawn_route, 0.02)
    middle = off_path(route, drawn_route.eta[200:-200:20, :2])
    assert np.max(middle) < 1e-3
    np.testing.assert_allclose(np.ptp(route.eta[:, 2]), np.ptp(drawn_route.eta[:, 2]), rtol=0.02)
    assert route.closed == drawn_route.closed


def test_a_drive_that_returns_becomes_a_closed_route():
    drawn_route = eight(0.6, 0.2)
    assert smooth(drawn_route._replace(closed=False)).closed


def test_the_velocity_is_the_derivative_of_the_poses():
    route = smooth(by_keys(0))
    dt = np.diff(route.t_s)
    np.testing.assert_allclose(
        np.diff(route.eta[:, 2]) / dt, 0.5 * (route.nu[1:, 2] + route.nu[:-1, 2]), atol=0.05
    )


@pytest.mark.parametrize("tolerance_m", [0.0, 1.0, float("nan")])
def test_a_tolerance_out_of_range_is_refused(tolerance_m):
    with refused("route.tolerance", UsageError):
        smooth(circle(0.5, 0.2), tolerance_m)


def test_a_route_without_speeds_cannot_keep_them():
    with refused("route.speed", UsageError, value=0.0):
        smooth(circle(0.5, 0.2)._replace(nu=np.zeros((1441, 3))))
