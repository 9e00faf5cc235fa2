"""A guide that waits for its vehicle along the route."""

import numpy as np
import pytest

from baqueano.block_checks import check_guide
from baqueano.guides import RepeatByProgress
from baqueano.guides.repeat_by_progress import END_WAIT_S
from baqueano.guides.route import Route
from baqueano.guides.shapes import circle, eight, rectangle
from baqueano.signals import Estimate
from baqueano.simulate import simulate_loop
from baqueano.symbolic import function
from baqueano.symbolic.graph.node import nodes_below
from baqueano.symbolic.graph.trace import trace_function
from baqueano.symbolic.graph.tree import tree_shape
from baqueano.vehicle_file import load

SMALL = load("small")
DT = 0.01


def estimate_at(eta, tick=0):
    return Estimate(round(1e9 * DT) * tick, np.array(eta, float), np.zeros(3), np.zeros((6, 6)))


def coarse(route, step):
    """Return the route with only one point in `step`."""
    return route._replace(t_s=route.t_s[::step], eta=route.eta[::step], nu=route.nu[::step])


def drive_guide(guide, place, ticks):
    """Return the references to a vehicle whose pose is place(tick, previous reference)."""
    state, reference, out = guide.init(), None, []
    for k in range(ticks):
        state, reference = guide.step(state, estimate_at(place(k, reference), k))
        out.append(reference)
    return out


def on_it(k, reference):
    return np.zeros(3) if reference is None else reference.eta


def test_a_vehicle_on_schedule_gets_the_reference_by_time():
    route = eight(0.6, 0.2)
    references = drive_guide(RepeatByProgress.along(route), on_it, 400)
    want = [np.interp(399 * DT - 0.5 * 0.2 / 0.3, route.t_s, route.eta[:, i]) for i in range(2)]
    np.testing.assert_allclose(references[-1].eta[:2], want, atol=2e-3)
    assert references[200].nu[0] == pytest.approx(0.2)


def test_the_reference_waits_for_a_blocked_vehicle():
    guide = RepeatByProgress.along(circle(1.0, 0.2))
    last = drive_guide(guide, lambda k, _: np.zeros(3), 1000)[-1]
    path_m = np.arctan2(last.eta[0], 1.0 - last.eta[1])
    assert path_m == pytest.approx(guide.slack_m + 0.2 * guide.slack_s + guide.wait_m, abs=0.01)
    assert last.nu == pytest.approx(np.zeros(3), abs=1e-3)
    assert last.at_end == 0.0


def test_the_waiting_reference_keeps_its_speed_for_a_vehicle_beside_the_route():
    """Before, its speed fell to 0, and a law that steers only in motion stopped there for ever."""
    guide, pose = RepeatByProgress.along(circle(1.0, 0.2)), np.array([0.0, -0.3, 0.0])
    references = drive_guide(guide, lambda k, _: pose, 400)
    assert references[-1].nu[0] == pytest.approx(0.2)
    np.testing.assert_allclose(references[-1].eta, references[-50].eta, atol=0.01)


def test_the_reference_returns_to_a_vehicle_that_was_pushed_back():
    guide, pose = RepeatByProgress.along(circle(1.0, 0.2)), np.array([0.4, 1.0 - np.cos(0.41), 0.41])

    def push(k, reference):
        return on_it(k, reference) if k < 400 else pose

    references = drive_guide(guide, push, 1000)
    path_m = [np.arctan2(r.eta[0], 1.0 - r.eta[1]) for r in references]
    assert path_m[399] > 0.7
    assert 0.41 < path_m[-1] < 0.65
    assert all(r.nu[0] >= 0.0 for r in references)


def test_the_reference_advances_to_a_vehicle_placed_ahead():
    guide, lead_m = RepeatByProgress.along(circle(1.0, 0.2)), 0.4
    pose = np.array([np.sin(lead_m), 1.0 - np.cos(lead_m), lead_m])
    references = drive_guide(guide, lambda k, _: pose, 150)
    assert references[-1].eta[2] > 0.9 * 0.2 * 150 * DT
    assert max(r.nu[0] for r in references) == pytest.approx(0.2 * guide.fastest)


def test_the_reference_does_not_jump_at_the_crossing_of_an_eight():
    """A vehicle on schedule passes the crossing twice a lap; each time the reference stays on the branch of the
    vehicle."""
    route = coarse(eight(0.6, 0.2), 20)
    run = simulate_loop(SMALL, RepeatByProgress.along(route), laps=2, perfect=True)
    heading = np.unwrap(run.reference.eta[:, 2])
    assert run.duration_s == pytest.approx(2 * route.t_s[-1], rel=0.05)
    assert np.abs(np.diff(heading)).max() < 0.05


def test_a_route_that_comes_back_over_the_same_poses_is_driven_to_its_end():
    """Before, the vehicle was found on both pieces at once: it oscillated behind the cusp and never finished."""
    s, v, kappa = np.linspace(0.0, 0.6, 61), 0.2, 0.8
    expected = np.column_stack([np.sin(kappa * s) / kappa, (1.0 - np.cos(kappa * s)) / kappa, kappa * s])
    speed = np.where(np.arange(121) <= 60, v, -v)
    nu = np.column_stack([speed, np.zeros(121), kappa * speed])
    route = Route(np.arange(121) * 0.01 / v, np.vstack([expected, expected[-2::-1]]), nu, False)
    run = simulate_loop(SMALL, RepeatByProgress.along(route), perfect=True, duration_s=8.0)
    assert run.reference.at_end[-1] == 1.0
    assert run.reference.eta[:, 0].max() > 0.56
    np.testing.assert_allclose(run.truth.eta[-1, :2], 0.0, atol=0.02)


def test_the_guide_is_done_after_its_last_lap():
    route = rectangle(1.2, 0.8, 0.2, 0.2)
    last = drive_guide(RepeatByProgress.along(route), on_it, round((route.t_s[-1] + 0.7) / DT) + 5)[-1]
    assert last.at_end == 1.0
    assert last.nu == pytest.approx(np.zeros(3))


def test_repeat_by_progress_passes_the_guide_check():
    assert check_guide(RepeatByProgress.along(eight(0.6, 0.2))) == []


def test_compiled_and_uncompiled_guides_give_the_same_reference():
    guide, now = RepeatByProgress.along(coarse(eight(0.6, 0.2), 40), 2), estimate_at([0.1, 0.2, 0.7], 3)
    state = guide.entry_state(20_000_000, 3.0, 0.1)
    reference = guide.step(state, now)[1]
    for backend in ("c", "python"):
        compiled_reference = function(guide.step, state, now, backend=backend)(state, now)[1]
        np.testing.assert_allclose(compiled_reference.eta, reference.eta, rtol=1e-12)
        np.testing.assert_allclose(compiled_reference.nu, reference.nu, rtol=1e-12)


class LookAtAll(RepeatByProgress):
    """The same guide, which examines every point of its route."""

    __slots__ = ()

    def _window(self, s):
        return 10**6, 10**6


@pytest.mark.parametrize("is_closed", [True, False])
@pytest.mark.parametrize("shape", [eight(0.6, 0.2), circle(1.0, 0.2), rectangle(4.0, 3.0, 0.2, 0.2)])
def test_distant_points_do_not_change_the_progress(shape, is_closed):
    route, random = shape._replace(closed=is_closed), np.random.default_rng(0)
    local, full = (kind.along(route, 2) for kind in (RepeatByProgress, LookAtAll))
    for _ in range(100):
        pose = route.eta[random.integers(len(route.t_s))] + random.normal(size=3) * [0.1, 0.1, 0.5]
        state = local.entry_state(20_000_000, random.uniform(0.0, (1 + is_closed) * route.t_s[-1]), 0.2)
        (near_state, reference), (full_state, expected) = (
            guide.step(state, estimate_at(pose, 3)) for guide in (local, full)
        )
        assert near_state.tau_s == pytest.approx(full_state.tau_s, abs=1e-12)
        np.testing.assert_allclose(reference.eta, expected.eta, atol=1e-12)
        np.testing.assert_allclose(reference.nu, expected.nu, atol=1e-12)


def test_the_compiled_program_grows_neither_with_the_route_nor_with_its_density():
    """Before, a circle of 0.1 m with 1441 poses needed 12 s to compile; now it needs 0.5 s."""
    sizes = []
    for route in (circle(0.1, 0.2), *(rectangle(length_m, 3.0, 0.2, 0.2) for length_m in (4.0, 16.0, 64.0))):
        guide, now = RepeatByProgress.along(route), estimate_at([0.1, 0.2, 0.7], 3)
        state = guide.entry_state(20_000_000, 3.0, 0.1)
        trace = trace_function(guide.step, [tree_shape(state, "state"), tree_shape(now, "estimate")])
        sizes.append((len(guide.t_s), len(nodes_below(trace.outputs))))
    (_, dense_nodes), *sizes = sizes
    points, nodes = zip(*sizes, strict=True)
    assert points[2] > 4 * points[0]
    assert max(nodes) < 1.02 * min(nodes), sizes
    assert dense_nodes < 1.2 * max(nodes)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_reference_that_waits_follows_an_even_motion_evenly(sign):
    """Before, the pace jumped by half at each of the points that are searched, 5 cm apart on this route."""
    poses = np.diag([sign * 2.0, 0.0, 0.0])[[1, 0]]
    guide = RepeatByProgress(np.array([0.0, 8.0]), poses, np.tile([sign * 0.25, 0.0, 0.0], (2, 1)))
    ways_m = np.arange(0.6, 1.0, 0.001)
    paces, lateral_m, _ = zip(
        *(guide._pace(4.0, estimate_at([sign * x, 0.05, 0.0])) for x in ways_m), strict=True
    )
    assert np.abs(np.diff(paces)).max() < 1.01 * 0.001 / guide.wait_m
    assert (paces[0], paces[-1]) == (-1.0, 1.0)
    assert np.array(lateral_m) == pytest.approx(0.05, abs=1e-9)


def test_a_closed_turn_on_the_spot_advances_with_time():
    psi, turn = np.linspace(0.0, 2.0 * np.pi, 61), np.tile([0.0, 0.0, 1.0], (61, 1))
    guide = RepeatByProgress(psi, np.outer(psi, [0.0, 0.0, 1.0]), turn, closed=True)
    for reference in drive_guide(guide, on_it, 3):
        assert reference.nu.tolist() == [0.0, 0.0, 1.0]


def test_the_reference_advances_along_a_route_of_two_poses():
    route = Route(
        np.array([0.0, 8.0]), np.diag([2.0, 0.0, 0.0])[[1, 0]], np.tile([0.25, 0.0, 0.0], (2, 1)), False
    )
    references = drive_guide(RepeatByProgress.along(route), on_it, 900)
    x = np.array([reference.eta[0] for reference in references])
    assert np.all(np.diff(x) >= 0.0)
    assert x[-1] == 2.0


def test_a_vehicle_blocked_before_the_end_is_awaited_for_a_bounded_time():
    route = Route(
        np.array([0.0, 8.0]), np.diag([2.0, 0.0, 0.0])[[1, 0]], np.tile([0.25, 0.0, 0.0], (2, 1)), False
    )

    def place(k, reference):
        return np.array([min(on_it(k, reference)[0], 1.9), 0.0, 0.0])

    references = drive_guide(RepeatByProgress.along(route), place, 1400)
    end = next(k for k, reference in enumerate(references) if reference.eta[0] == 2.0)
    done = next(k for k, reference in enumerate(references) if reference.at_end > 0.0)
    assert (done - end) * DT == pytest.approx(END_WAIT_S, abs=3.0 * DT)
    assert references[done].nu.tolist() == [0.0, 0.0, 0.0]
