"""A guide that repeats a route by time."""

import numpy as np
import pytest

from baqueano.errors import UsageError
from baqueano.geometry import wrap
from baqueano.guides import Repeat, RepeatByProgress, Route, SinuousCircle
from baqueano.guides.repeat import with_laps
from baqueano.guides.route import end_gap, move_route, with_closed_gap
from baqueano.guides.shapes import circle
from baqueano.signals import Estimate, seconds
from tests.codes import refused

T0 = 7_000_000_000
LINE = Route(np.array([0.0, 2.0]), np.array([[0.0, 0, 0], [1.0, 0, 0]]), np.array([[0.5, 0, 0]] * 2), False)


def estimate_at(t_s):
    return Estimate(T0 + round(t_s * 1e9), np.zeros(3), np.zeros(3), np.eye(6))


def references(guide, times):
    state, out = guide.init(), []
    for t in times:
        state, reference = guide.step(state, estimate_at(t))
        out.append(reference)
    return out


def test_the_reference_equals_the_taught_pose_at_each_time():
    """A taught route begins and ends with at most 1 cm/s, one tick before and after its motion."""
    t_s, v = np.linspace(0.0, 2.0, 41), 0.5 * np.sin(np.pi * np.linspace(0.0, 1.0, 41)) + 0.01
    route = Route(t_s, np.outer(np.cumsum(v) * 0.05, [1.0, 0, 0]), np.outer(v, [1.0, 0, 0]), False)
    times = seconds(np.arange(200) * 10_000_000)
    r = references(Repeat.along(route), times)
    assert [x.eta[0] for x in r] == np.interp(times, t_s, route.eta[:, 0]).tolist()
    assert [x.nu[0] for x in r] == np.interp(times, t_s, v).tolist()
    assert r[50].t_ns == T0 + 500_000_000
    assert not any(x.at_end for x in r)


def test_an_open_route_is_driven_once_for_any_number_of_laps():
    for laps in (0, 1, 3):
        r = references(Repeat.along(LINE, laps), [0.0, 3.66, 3.67, 5.0])
        assert [x.at_end for x in r] == [0.0, 0.0, 1.0, 1.0]
        np.testing.assert_allclose(r[-1].eta, [1.0, 0.0, 0.0])
        np.testing.assert_allclose(r[-1].nu, 0.0)


def test_three_laps_of_a_circle_pass_the_start_three_times():
    route = circle(0.5, 0.25)
    lap_s = route.t_s[-1]
    assert lap_s == pytest.approx(2.0 * np.pi * 0.5 / 0.25, rel=1e-12)
    begin_s = end_s = 0.5 * 0.25 / 0.3
    times = [
        0.0,
        begin_s + lap_s,
        begin_s + 2.0 * lap_s,
        begin_s + 2.5 * lap_s,
        begin_s + 3.0 * lap_s + end_s + 1e-6,
    ]
    r = references(Repeat.along(route, 3), times)
    for x in (r[0], r[1], r[2], r[4]):
        np.testing.assert_allclose(x.eta[:2], 0.0, atol=1e-8)
    np.testing.assert_allclose(r[3].eta[:2], [0.0, 1.0], atol=1e-6)  # half a lap: across the circle
    assert [x.at_end for x in r] == [0.0, 0.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize("speed", [0.25, -0.25])
@pytest.mark.parametrize("kind", [Repeat, RepeatByProgress])
@pytest.mark.parametrize("length_m", [1.2, 0.1])
def test_a_drawn_route_is_driven_evenly_from_rest_to_rest(kind, speed, length_m):
    """Before, the reference had its full speed in the first tick, and on the short route it does not reach it."""
    route = circle(length_m / (2.0 * np.pi), abs(speed))
    route = route._replace(nu=np.sign(speed) * route.nu)
    guide, dt = kind.along(route, 2 if length_m > 1.0 else 1), 0.01
    acceleration = max(0.3, abs(speed) / route.t_s[-1])
    state, eta, r = guide.init(), route.eta[0], []
    while not r or not r[-1].at_end:
        state, reference = guide.step(state, estimate_at(len(r) * dt)._replace(eta=eta))
        r.append(reference)
        eta = reference.eta  # a vehicle on its reference
    v = np.array([x.nu[0] for x in r])
    steps_m = np.hypot(*np.diff([x.eta[:2] for x in r], axis=0).T)
    assert np.abs(np.diff(v))[:-1].max() <= 1.25 * acceleration * dt
    assert v[0] == 0.0
    assert np.abs(v[-2]) < 0.025
    assert steps_m == pytest.approx(np.abs(0.5 * (v[1:] + v[:-1])) * dt, abs=1e-4)
    np.testing.assert_allclose(r[-1].eta[:2], route.eta[0, :2], atol=1e-6)
    assert len(r) * dt == pytest.approx(guide.duration_s, abs=0.1)
    assert guide.duration_s == pytest.approx(guide.laps * route.t_s[-1] + 0.25 / acceleration)


@pytest.mark.parametrize("speed", [0.25, -0.25])
@pytest.mark.parametrize("kind", [Repeat, RepeatByProgress])
def test_a_route_begins_at_the_speed_of_its_vehicle(kind, speed):
    route = circle(0.5, abs(speed))
    guide, k = kind.along(route._replace(nu=np.sign(speed) * route.nu)), np.arange(60)
    for share in (0.0, 0.4, 1.0):
        state, v, eta = guide.init(), [], route.eta[0]
        for t_s in k * 0.01:
            rolling = estimate_at(t_s)._replace(eta=eta, nu=np.array([share * speed, 0.0, 0.0]))
            state, reference = guide.step(state, rolling)
            v.append(abs(reference.nu[0]))
            eta = reference.eta
        assert v == pytest.approx(np.minimum(share * 0.25 + 0.3 * 0.01 * k, 0.25), abs=1e-9)


@pytest.mark.parametrize("kind", [Repeat, RepeatByProgress])
def test_a_vehicle_that_joins_at_rest_accelerates_to_the_speed_at_its_entry(kind):
    """A taught route begins at rest, but a vehicle at rest can join it where the teacher was moving."""
    t_s, v = np.linspace(0.0, 8.0, 161), np.minimum(np.linspace(0.0, 8.0, 161), 1.0) * 0.3
    x = np.append(0.0, np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t_s)))
    guide = kind.along(Route(t_s, np.outer(x, [1.0, 0, 0]), np.outer(v, [1.0, 0, 0]), False))
    for speed, rise_s in ((0.0, 1.0), (0.3, 0.0)):
        state, r = guide.entry_state(T0, 3.0, speed), []
        for k in range(150):
            eta = r[-1].eta if r else np.array([np.interp(3.0, t_s, x), 0.0, 0.0])
            state, reference = guide.step(state, estimate_at(k * 0.01)._replace(eta=eta))
            r.append(reference)
        assert r[0].eta[0] == pytest.approx(np.interp(3.0, t_s, x), abs=1e-9)
        assert r[0].nu[0] == pytest.approx(speed)
        assert r[50].nu[0] == pytest.approx(0.3 if rise_s == 0.0 else 0.15)
        assert r[-1].eta[0] == pytest.approx(np.interp(4.49 - 0.5 * rise_s, t_s, x), abs=2e-3)


def test_zero_laps_mean_endless_repetition():
    r = references(Repeat.along(circle(0.5, 0.25), 0), [0.0, 1e5])
    assert r[-1].at_end == 0.0
    assert r[-1].nu[0] == pytest.approx(0.25)


def test_heading_is_interpolated_across_pi_and_wrapped():
    psi = wrap(np.array([3.0, 3.4]))
    route = Route(np.array([0.0, 1.0]), np.column_stack([np.zeros((2, 2)), psi]), np.zeros((2, 3)), False)
    r = references(Repeat.along(route), [0.0, 0.5])
    assert r[1].eta[2] == pytest.approx(wrap(3.2))


def test_closing_a_route_distributes_the_drift_along_the_route():
    route = circle(0.5, 0.25)
    drifted_route = route._replace(
        eta=route.eta + np.outer(route.t_s / route.t_s[-1], [0.03, -0.02, 0.1]), closed=False
    )
    assert end_gap(drifted_route) == pytest.approx((np.hypot(0.03, 0.02), 0.1))
    np.testing.assert_allclose(with_closed_gap(drifted_route).eta, route.eta, atol=1e-12)
    assert with_closed_gap(drifted_route).closed


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

    with refused("route.laps-kept", UsageError, kind="GuideOfConstantLaps", former_laps=1, laps=3):
        with_laps(GuideOfConstantLaps(), 3)
    with refused("route.laps"):
        with_laps(Repeat.along(LINE), -1)
