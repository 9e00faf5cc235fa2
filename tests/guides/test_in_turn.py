"""A lead-in and its route, and a route with a return path."""

import numpy as np
import pytest

from baqueano.guides import GuideSequence, Idle, Repeat, RepeatByProgress
from baqueano.guides.shapes import circle, eight, line
from tests.guides.test_drive_to import DT, estimate_at, followed


@pytest.mark.parametrize("kind", [Repeat, RepeatByProgress])
@pytest.mark.parametrize("start", [(0.1, 0.2, 0.5), (-0.5, -0.3, 1.5)])
def test_the_reference_does_not_jump_between_lead_in_and_route(kind, start):
    route = eight(0.6, 0.2)
    guide = GuideSequence.with_lead_in(kind.along(route), route)
    state, out = followed(guide, start)
    eta = np.array([r.eta for r in out])
    assert np.max(np.hypot(*np.diff(eta[:, :2], axis=0).T)) < 1.5 * 0.2 * DT
    np.testing.assert_allclose(eta[-1, :2], route.eta[-1, :2], atol=1e-6)
    assert 0.0 < state.first.goal[0] < 6.0 or start[0] < 0.0
    assert out[-1].at_end == 1.0


@pytest.mark.parametrize("kind", [Repeat, RepeatByProgress])
def test_a_lead_in_shorter_than_the_route_works(kind):
    """From inside a circle the vehicle joins the route at a route time later than the drive time."""
    route = circle(0.4, 0.25)
    state, out = followed(
        GuideSequence.with_lead_in(kind.along(route), route, radius_m=0.15), (0.0, 0.2, 0.5)
    )
    eta = np.array([r.eta for r in out])
    assert state.first.goal[0] > 1.5
    assert np.max(np.hypot(*np.diff(eta[:, :2], axis=0).T)) < 1.5 * 0.25 * DT
    assert len(out) * DT < route.t_s[-1] + 1.5  # no part is driven twice


def test_a_vehicle_at_the_route_start_needs_no_lead_in():
    route = circle(0.5, 0.2)
    guide, lead_in = Repeat.along(route, 2), GuideSequence.with_lead_in(Repeat.along(route, 2), route)
    state, led_state = guide.init(), lead_in.init()
    for k in range(60):
        estimate = estimate_at(route.eta[0], k)
        (state, a), (led_state, b) = guide.step(state, estimate), lead_in.step(led_state, estimate)
        assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


class Counts:
    """A custom guide without `entry_state`: it moves along x by the time since its first tick."""

    def init(self):
        return -1

    def step(self, state, estimate):
        start_ns = np.where(state < 0, estimate.t_ns, state)
        reference = Repeat.along(line(2.0, 0.2)).step(Repeat.along(line(2.0, 0.2)).init(), estimate)[1]
        x = 0.2e-9 * (estimate.t_ns - start_ns)
        return start_ns, reference._replace(eta=np.array([x, 0.0, 0.0]), at_end=np.where(x >= 2.0, 1.0, 0.0))


def test_a_custom_guide_begins_at_the_join_point():
    _, out = followed(GuideSequence.with_lead_in(Counts(), line(2.0, 0.2)), (0.0, 0.2, 0.0))
    eta = np.array([r.eta for r in out])
    assert np.max(np.hypot(*np.diff(eta[:, :2], axis=0).T)) < 1.1 * 0.2 * DT
    assert eta[-1, 0] == pytest.approx(2.0, abs=0.2 * DT)


def test_the_guide_returns_to_its_start_after_the_route():
    route = line(1.0, 0.2)
    state, out = followed(GuideSequence.with_way_back(Repeat.along(route), route), np.zeros(3))
    assert state.is_first_done == 1.0
    assert max(r.eta[0] for r in out) > 1.0
    np.testing.assert_allclose(out[-1].eta, np.zeros(3), atol=1e-6)
    assert [r.at_end for r in out[:-1]] == [0.0] * (len(out) - 1)


@pytest.mark.parametrize("offset", [(0.02, -0.03, 0.1), (-0.04, 0.01, -0.15)])
def test_a_vehicle_that_ends_its_lap_at_the_start_does_not_drive_a_loop_back(offset):
    route = circle(0.5, 0.2)
    _, out = followed(GuideSequence.with_way_back(Idle(0.0), route), offset)
    eta = np.array([r.eta for r in out])
    assert np.max(np.hypot(*(eta - offset)[:, :2].T)) < 1e-6
