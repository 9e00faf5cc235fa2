"""Drawn routes are drivable: pose, heading and velocity agree with each other."""

import numpy as np
import pytest

from baqueano.geometry import wrap
from baqueano.guides import SinuousCircle
from baqueano.guides.route import end_gap
from baqueano.guides.shapes import SHAPE_NAMES, circle, eight, rectangle, shape, sinuous_circle
from baqueano.signals import Estimate
from tests.codes import refused

ROUTES = {
    "circle": circle(0.5, 0.25),
    "sinuous circle": sinuous_circle(0.5, 0.05, 6, 0.25),
    "eight": eight(0.6, 0.25),
    "rectangle": rectangle(2.0, 1.0, 0.2, 0.25),
}


@pytest.mark.parametrize("name", ROUTES)
def test_a_route_starts_at_the_origin_along_x_and_closes(name):
    route = ROUTES[name]
    np.testing.assert_allclose(route.eta[0], 0.0, atol=1e-12)
    assert end_gap(route) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert route.closed
    assert np.all(np.diff(route.t_s) > 0.0)


@pytest.mark.parametrize("name", ROUTES)
def test_the_position_is_the_integral_of_heading_and_speed(name):
    """ẋ = v cos ψ, ẏ = v sin ψ by the trapezoid rule; ψ̇ = ν_ψ off the corners of a rectangle."""
    route = ROUTES[name]
    dt, (x, y, psi), v = np.diff(route.t_s), route.eta.T, route.nu[:, 0]
    vx, vy = v * np.cos(psi), v * np.sin(psi)
    np.testing.assert_allclose(np.diff(x) / dt, 0.5 * (vx[1:] + vx[:-1]), atol=2e-4)
    np.testing.assert_allclose(np.diff(y) / dt, 0.5 * (vy[1:] + vy[:-1]), atol=2e-4)
    rate = 0.5 * (route.nu[1:, 2] + route.nu[:-1, 2])
    smooth = np.abs(np.diff(route.nu[:, 2])) < 0.2
    np.testing.assert_allclose((np.diff(psi) / dt)[smooth], rate[smooth], atol=2e-3)
    np.testing.assert_allclose(v, 0.25)
    np.testing.assert_allclose(route.nu[:, 1], 0.0)


@pytest.mark.parametrize(
    ("name", "turns"), [("circle", 1), ("sinuous circle", 1), ("eight", 0), ("rectangle", 1)]
)
def test_each_shape_has_the_expected_net_turn_per_lap(name, turns):
    assert ROUTES[name].eta[-1, 2] == pytest.approx(2.0 * np.pi * turns, abs=1e-9)


def test_circle_yaw_rate_and_rectangle_length_match_hand_calculations():
    np.testing.assert_allclose(ROUTES["circle"].nu[:, 2], 0.25 / 0.5)
    assert ROUTES["rectangle"].t_s[-1] * 0.25 == pytest.approx(2.0 * (1.6 + 0.6) + 2.0 * np.pi * 0.2)


def test_the_sinuous_circle_has_the_requested_waves_and_amplitude():
    p, psi = ROUTES["sinuous circle"].eta[:, :2], ROUTES["sinuous circle"].eta[:, 2]
    r = np.hypot(*(p - 0.5 * (p.max(axis=0) + p.min(axis=0))).T)
    assert np.ptp(r) == pytest.approx(0.1, abs=0.01)
    curvature_waves = np.sum(np.diff(np.sign(np.gradient(psi) - np.gradient(psi).mean())) > 0)
    assert curvature_waves == 6


def test_the_sinuous_circle_can_be_used_as_a_guide():
    guide = SinuousCircle(radius_m=0.5, amplitude_m=0.05, speed_m_s=0.25, laps=2)
    state, reference = guide.step(guide.init(), Estimate(10, np.zeros(3), np.zeros(3), np.eye(6)))
    np.testing.assert_allclose(reference.eta, 0.0, atol=1e-12)
    lap_s = sinuous_circle(0.5, 0.05, 6, 0.25).t_s[-1]
    for part, is_over in ((1.5, 0.0), (2.08, 1.0)):
        estimate = Estimate(10 + round(part * lap_s * 1e9), np.zeros(3), np.zeros(3), np.eye(6))
        _, reference = guide.step(state, estimate)
        assert reference.at_end == is_over
    assert abs(wrap(reference.eta[2])) < 1e-9


def test_impossible_shapes_are_refused_with_a_reason():
    with refused("shape.corners", ValueError):
        rectangle(2.0, 1.0, 0.5, 0.25)
    with refused("shape.amplitude", ValueError, amplitude_m=0.6, radius_m=0.5):
        SinuousCircle(radius_m=0.5, amplitude_m=0.6)


@pytest.mark.parametrize("name", SHAPE_NAMES)
def test_a_shape_needs_a_positive_size_and_speed(name):
    for size_m, speed_m_s, code in (
        (0.0, 0.2, "shape.length"),
        (1.0, 0.0, "route.speed"),
        (1.0, np.nan, "route.speed"),
    ):
        with refused(code, ValueError):
            shape(name, size_m, speed_m_s)
