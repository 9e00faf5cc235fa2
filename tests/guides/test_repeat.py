"""A guide that repeats a route by time."""

import numpy as np
import pytest

from baqueano.errors import UsageError
from baqueano.geometry import wrap
from baqueano.guides import Repeat, RepeatByProgress, Route, SinuousCircle
from baqueano.guides.repeat import with_laps
from baqueano.guides.route import end_gap, move_route, with_closed_gap
from baqueano.guides.shapes import circle
from baqueano.signals import Estimate
from tests.codes import refused

T0 = 7_000_000_000
LINE = Route(np.array([0.0, 2.0]), np.array([[0.0, 0, 0], [1.0, 0, 0]]), np.array([[0.5, 0, 0]] * 2), False)


def at(t_s):
    return Estimate(T0 + round(t_s * 1e9), np.zeros(3), np.zeros(3), np.eye(6))


def references(guide, times):
    state, out = guide.init(), []
    for t in times:
        state, reference = guide.step(state, at(t))
        out.append(reference)
    return out


def test_the_reference_equals_the_taught_pose_at_each_time():
    r = references(Repeat.along(LINE), [0.0, 0.5, 1.0])
    assert [x.eta[0] for x in r] == [0.0, 0.25, 0.5]
    assert [x.nu[0] for x in r] == [0.5, 0.5, 0.5]
    assert r[1].t_ns == T0 + 500_000_000
    assert [x.done for x in r] == [0.0, 0.0, 0.0]


def test_an_open_route_is_driven_once_for_any_number_of_laps():
    for laps in (0, 1, 3):
        r = references(Repeat.along(LINE, laps), [0.0, 2.82, 2.84, 5.0])
        assert [x.done for x in r] == [0.0, 0.0, 1.0, 1.0]
        np.testing.assert_allclose(r[-1].eta, [1.0, 0.0, 0.0])
        np.testing.assert_allclose(r[-1].nu, 0.0)


def test_three_laps_of_a_circle_pass_the_start_three_times():
    route = circle(0.5, 0.25)
    lap_s = route.t_s[-1]
    assert lap_s == pytest.approx(2.0 * np.pi * 0.5 / 0.25, rel=1e-12)
    r = references(Repeat.along(route, 3), [0.0, lap_s, 2.0 * lap_s, 2.5 * lap_s, 3.0 * lap_s + 0.42])
    for x in (r[0], r[1], r[2], r[4]):
        np.testing.assert_allclose(x.eta[:2], 0.0, atol=1e-8)
    np.testing.assert_allclose(r[3].eta[:2], [0.0, 1.0], atol=1e-6)  # half a lap: across the circle
    assert [x.done for x in r] == [0.0, 0.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize("speed", [0.25, -0.25])
@pytest.mark.parametrize("kind", [Repeat, RepeatByProgress])
def test_a_drawn_route_brakes_evenly_to_rest_at_the_end_of_its_last_lap(kind, speed):
    """Before, the reference had its full speed in the last tick, and stopped in the next one."""
    route = circle(0.5, abs(speed))
    route = route._replace(nu=np.sign(speed) * route.nu)
    guide, dt = kind.along(route, 2), 0.01
    state, eta, r = guide.init(), route.eta[0], []
    while not r or not r[-1].done:
        state, reference = guide.step(state, at(len(r) * dt)._replace(eta=eta))
        r.append(reference)
        eta = reference.eta  # a vehicle on its reference
    v = np.array([x.nu[0] for x in r])
    steps_m = np.hypot(*np.diff([x.eta[:2] for x in r], axis=0).T)
    assert np.abs(np.diff(v))[:-1].max() <= 0.34 * dt
    assert np.abs(v[-2]) < 0.02
    assert steps_m == pytest.approx(np.abs(0.5 * (v[1:] + v[:-1])) * dt, abs=1e-4)
    np.testing.assert_allclose(r[-1].eta[:2], route.eta[0, :2], atol=1e-6)
    assert len(r) * dt == pytest.approx(2.0 * route.t_s[-1] + 0.5 * 0.25 / 0.3, abs=0.1)


def test_zero_laps_mean_endless_repetition():
    r = references(Repeat.along(circle(0.5, 0.25), 0), [0.0, 1e5])
    assert r[-1].done == 0.0
    assert r[-1].nu[0] == pytest.approx(0.25)


def test_heading_is_interpolated_across_pi_and_wrapped():
    psi = wrap(np.array([3.0, 3.4]))
    route = Route(np.array([0.0, 1.0]), np.column_stack([np.zeros((2, 2)), psi]), np.zeros((2, 3)), False)
    r = references(Repeat.along(route), [0.0, 0.5])
    assert r[1].eta[2] == pytest.approx(wrap(3.2))


def test_closing_a_route_distributes_the_drift_along_the_route():
    route = circle(0.5, 0.25)
    drifted = route._replace(
        eta=route.eta + np.outer(route.t_s / route.t_s[-1], [0.03, -0.02, 0.1]), closed=False
    )
    assert end_gap(drifted) == pytest.approx((np.hypot(0.03, 0.02), 0.1))
    np.testing.assert_allclose(with_closed_gap(drifted).eta, route.eta, atol=1e-12)
    assert with_closed_gap(drifted).closed


def test_a_route_is_placed_at_the_vehicle_pose():
    route = move_route(circle(0.5, 0.25), np.array([1.0, 2.0, np.pi / 2]))
    np.testing.assert_allclose(route.eta[0], [1.0, 2.0, np.pi / 2])
    middle = route.eta[len(route.t_s) // 2]
    np.testing.assert_allclose(middle[:2], [0.0, 2.0], atol=1e-9)  # the vehicle points along y: to its left


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"t_s": np.array([0.0, 0.0])}, ("guide.times", {})),
        ({"t_s": np.array([1.0, 2.0])}, ("guide.times", {})),
        ({"eta": np.zeros((3, 3))}, ("route.shapes", {})),
        ({"nu": np.full((2, 3), np.nan)}, ("route.not-finite", {})),
        ({"laps": -1}, ("route.laps", {"value": -1})),
    ],
)
def test_a_bad_route_is_refused_with_a_reason(change, words):
    with refused(words[0], ValueError, **words[1]):
        Repeat(**(LINE._asdict() | {"laps": 1} | change))


class Plain:
    """A guide as a student writes it."""

    def __init__(self, laps=1):
        self.laps = laps

    def init(self):
        return None

    def step(self, state, estimate):
        return state, Repeat.along(circle(0.3, 0.2), self.laps).step(Repeat.along(LINE).init(), estimate)[1]


class SlottedGuide(Plain):
    __slots__ = ("laps",)


class Without:
    def init(self):
        return None


@pytest.mark.parametrize("guide", [Plain(), SlottedGuide(), Repeat.along(LINE), SinuousCircle()])
def test_setting_the_number_of_laps_copies_a_guide_of_any_class(guide):
    guide_of_laps = with_laps(guide, 3)
    assert (type(guide_of_laps), guide_of_laps.laps, guide.laps) == (type(guide), 3, 1)
    assert with_laps(guide, 1) is guide


def test_setting_laps_does_not_change_a_guide_without_laps():
    guide = Without()
    assert with_laps(guide, 3) is guide


def test_invalid_laps_are_refused_with_a_reason():
    class GuideOfConstantLaps:
        laps = property(lambda self: 1)

    with refused("route.laps-kept", UsageError, kind="GuideOfConstantLaps", before=1, laps=3):
        with_laps(GuideOfConstantLaps(), 3)
    with refused("route.laps-kept", UsageError):
        with_laps(Repeat.along(LINE), -1)
