"""The loop in one kernel equals the clocked loop over a simulated world."""

import numpy as np
import pytest

from baqueano import loop
from baqueano.controllers import Pd
from baqueano.diagnostics import StopReason
from baqueano.errors import UsageError
from baqueano.guides import Repeat, RepeatByProgress, SinuousCircle
from baqueano.guides.route import move_route
from baqueano.guides.shapes import circle, rectangle
from baqueano.simulate import simulate_loop, simulate_loops
from baqueano.simulate.closed_loop import (
    closed_loop,
    loop_system,
    reference_duration,
    sample_references,
    start_pose,
)
from baqueano.supervisor import Supervisor
from baqueano.vehicle_file import load
from baqueano.worlds import SimulatedWorld, clock
from tests.codes import refused

ROUTE = circle(0.5, 0.3)


def test_the_compiled_loop_equals_the_clocked_loop(vehicle):
    run = simulate_loop(vehicle, ROUTE, seed=4, duration_s=1.5)
    world = SimulatedWorld(vehicle.vehicle, vehicle.sensors, 100.0, seed=4)
    blocks = loop_system(vehicle, ROUTE).blocks
    records = []
    loop.run(blocks, world, clock.simulated_ticks(100.0, 1.5), on_record=records.append, eta=np.zeros(3))
    assert len(records) >= 150
    for k, record in enumerate(records[:150]):
        np.testing.assert_allclose(record.tick.u, run.applied_commands[k], atol=1e-9)
        np.testing.assert_allclose(record.estimate.eta, run.estimate.eta[k], atol=1e-9)
        np.testing.assert_allclose(record.estimate.cov, run.estimate.cov[k], atol=1e-9)
        np.testing.assert_allclose(record.requested_command.u, run.requested_commands[k], atol=1e-9)


def test_a_command_is_applied_one_tick_later(vehicle):
    run = simulate_loop(vehicle, ROUTE, seed=4, duration_s=1.0)
    assert np.array_equal(run.applied_commands[1:], run.sent_commands[:-1])
    assert np.array_equal(run.applied_commands[0], np.zeros(3))


def test_with_perfect_pose_the_estimate_is_the_truth(vehicle):
    run = simulate_loop(vehicle, ROUTE, perfect=True, duration_s=2.0)
    np.testing.assert_allclose(run.estimate.eta, run.truth.eta, atol=1e-12)
    assert list(run.sensors) == ["truth"]


def test_the_simulation_ends_when_the_guide_is_done(vehicle):
    system = loop_system(vehicle, ROUTE, laps=2)
    ramp_s = 0.3 / 0.3  # half of the time between rest and 0.3 m/s, at both ends
    assert reference_duration(system) == pytest.approx(2 * 2 * np.pi * 0.5 / 0.3 + ramp_s, abs=0.02)
    run = simulate_loop(vehicle, rectangle(0.3, 0.2, 0.05, 0.5), perfect=True)
    assert run.reference.at_end[-1] == 1.0
    assert run.reference.at_end[-2] == 0.0


def test_the_duration_of_a_route_by_progress_does_not_depend_on_its_place(vehicle):
    for start in (np.zeros(3), np.array([0.4, 0.1, 0.0]), np.array([-0.3, -0.1, 0.0])):
        system = loop_system(vehicle, RepeatByProgress.along(move_route(ROUTE, start)))
        assert reference_duration(system) == pytest.approx(ROUTE.t_s[-1], abs=0.02)
        references = sample_references(system, [0, 10**9, 2 * 10**9])[1:]
        assert [reference.nu[0] for reference in references] == pytest.approx([0.3] * 2)


def test_a_shape_is_accepted_as_a_route(vehicle):
    run = simulate_loop(vehicle, SinuousCircle(0.3, 0.03, 0.4), perfect=True, duration_s=1.5)
    assert run.reference.nu[-1, 0] == pytest.approx(0.4)


def test_the_vehicle_starts_at_the_start_of_the_route(vehicle):
    system = loop_system(vehicle, move_route(ROUTE, np.array([1.0, 2.0, 0.5])))
    np.testing.assert_allclose(start_pose(system), [1.0, 2.0, 0.5], atol=1e-12)
    run = simulate_loop(vehicle, move_route(ROUTE, np.array([1.0, 2.0, 0.5])), perfect=True, duration_s=0.1)
    np.testing.assert_allclose(run.truth.eta[0], [1.0, 2.0, 0.5], atol=1e-3)


def test_commands_are_invariant_under_motions_of_the_world(vehicle):
    moved_route = move_route(ROUTE, np.array([3.0, -2.0, 3.1]))
    a, b = (simulate_loop(vehicle, r, seed=2, duration_s=2.0) for r in (ROUTE, moved_route))
    np.testing.assert_allclose(a.requested_commands, b.requested_commands, atol=1e-7)


def test_each_seed_gives_a_different_run(vehicle):
    a, b = simulate_loops(vehicle, ROUTE, [1, 2], duration_s=0.5)
    assert a == simulate_loop(vehicle, ROUTE, seed=1, duration_s=0.5)
    assert a != b
    assert a.metadata["seed"] == "1"


def test_a_stop_of_the_supervisor_is_logged_in_the_run(vehicle):
    vehicle.supervisor = lambda: Supervisor(np.array([1.0, 0.0, 1.0]), max_speed_m_s=0.05)
    run = simulate_loop(vehicle, ROUTE, perfect=True, duration_s=2.0)
    assert run.events[0].diagnostic.code == StopReason.SPEED
    assert not run.sent_commands[-1].any()


def test_a_guide_that_is_never_done_needs_a_duration(vehicle):
    with refused("simulate.never-done", UsageError):
        simulate_loop(vehicle, ROUTE, laps=0)


class Twice:
    """A guide that is not a dataclass."""

    laps = 1

    def init(self):
        return Repeat.along(circle(0.3, 0.2)).init()

    def step(self, state, estimate):
        return Repeat.along(circle(0.3, 0.2), self.laps).step(state, estimate)


def test_a_guide_of_a_plain_class_drives_the_requested_laps(vehicle):
    single, twice = (
        simulate_loop(vehicle, Twice(), laps=n, perfect=True, noise=False).duration_s for n in (1, 2)
    )
    assert twice - single == pytest.approx(2 * np.pi * 0.3 / 0.2, abs=0.02)


class OwnPd(Pd):
    """A controller of the user, whose code can change."""


def test_equal_systems_share_one_kernel_and_others_do_not():
    def kernel(mass_kg=None, controller=None):
        file = load("small") if mass_kg is None else load("small").with_values({"model.mass_kg": mass_kg})
        return closed_loop(loop_system(file, ROUTE, controller=controller), file.rate_hz)

    assert kernel() is kernel()
    assert kernel(mass_kg=0.7) is kernel(mass_kg=0.7)
    assert kernel(mass_kg=0.7) is not kernel()
    own_controller = OwnPd(3.0, 1.5)
    assert kernel(controller=own_controller) is kernel(controller=own_controller)
    assert kernel(controller=own_controller) is not kernel(controller=OwnPd(3.0, 1.5))
