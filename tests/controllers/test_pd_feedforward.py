"""PD with feed-forward: the model's own command, weak feedback, an even drive."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baqueano.blocks import check_controller
from baqueano.compare.errors import cross_track, rms
from baqueano.compare.evenness import limits_of, pace, share_at_limit, sign_changes
from baqueano.controllers import PdFeedforward
from baqueano.geometry import compose, map_from_body
from baqueano.guides.shapes import circle, eight, rectangle, sinuous_circle
from baqueano.signals import Estimate, Reference
from baqueano.simulate import simulate_loop
from baqueano.simulate.closed_loop import as_run, closed, closed_loop, ticks_of
from baqueano.simulate.open_loop import times
from baqueano.simulate.system import Input, begin
from baqueano.symbolic import function
from baqueano.vehicle_file import load

SMALL = load("small")
T0 = 1_700_000_000_000_000_000
SHAPES = {
    "sinuous": lambda v: sinuous_circle(0.6, 0.08, 5, v),
    "eight": lambda v: eight(0.6, v),
    "rectangle": lambda v: rectangle(1.2, 0.8, 0.2, v),
}


def estimate(eta, nu=(0.0, 0.0, 0.0), tick=0):
    return Estimate(T0 + 10_000_000 * tick, np.array(eta, float), np.array(nu, float), np.eye(6))


def reference(eta, nu=(0.0, 0.0, 0.0), tick=0):
    return Reference(T0 + 10_000_000 * tick, np.array(eta, float), np.array(nu, float), 0.0)


def settled(controller, eta_r, nu_r, eta, nu, ticks=200):
    """The command where reference and estimate have been like this for long."""
    state = controller.init()
    for k in range(ticks):
        state, command = controller.step(state, reference(eta_r, nu_r, k), estimate(eta, nu, k))
    return command.u


@pytest.mark.parametrize("name", ["small", "car"])
@pytest.mark.parametrize(("v", "w"), [(0.3, 0.0), (0.4, 0.6), (0.3, -0.8)])
def test_the_command_of_a_steady_circle_makes_the_model_drive_it(name, v, w):
    file = load(name)
    controller = file.controller(k_i=0.0)
    late_s = controller.late_s
    vehicle, nu_y = file.vehicle, 0.0
    for _ in range(3):  # the sideslip of the model at this circle
        nu = np.array([v, nu_y, w])
        there = map_from_body(0.5 * w * late_s) @ (late_s * nu)  # where it is T from now
        u = settled(controller, there, nu, np.zeros(3), nu)
        state = vehicle.init()
        for _ in range(400):
            state, _ = vehicle.step(state, u, 1.0 / file.rate_hz, np.zeros(3))
        nu_y = state.nu[1]
    assert state.nu[[0, 2]] == pytest.approx([v, w], rel=0.01, abs=0.004)


def test_a_vehicle_at_rest_on_its_reference_gets_no_command():
    assert settled(
        SMALL.controller(), [1.0, 2.0, 0.5], [0, 0, 0], [1.0, 2.0, 0.5], [0, 0, 0]
    ) == pytest.approx(0.0)


def test_a_vehicle_beside_its_path_steers_back():
    plain = settled(SMALL.controller(), [0.03, 0, 0], [0.2, 0, 0], [0, 0, 0], [0.2, 0, 0], 2)
    left = settled(SMALL.controller(), [0.03, 0, 0], [0.2, 0, 0], [0, 0.05, 0], [0.2, 0, 0], 2)
    right = settled(SMALL.controller(), [0.03, 0, 0], [0.2, 0, 0], [0, -0.05, 0], [0.2, 0, 0], 2)
    assert left[2] < plain[2] < right[2]


def test_it_keeps_every_promise_of_a_controller():
    assert check_controller(SMALL.controller()) == []
    assert check_controller(load("car").controller(), 2) == []


def test_compiled_and_as_written_it_gives_the_same_command():
    controller = SMALL.controller()
    now, asked = estimate([0.1, -0.2, 3.1], [0.2, 0.01, 0.3]), reference([0.15, -0.2, -3.1], [0.2, 0.0, 0.4])
    plain = controller.step(controller.init(), asked, now)
    for backend in ("c", "python"):
        step = function(controller.step, controller.init(), asked, now, backend=backend)
        np.testing.assert_allclose(
            step(controller.init(), asked, now)[1].u, plain[1].u, rtol=1e-12, atol=1e-14
        )


angle, place = st.floats(-3.1, 3.1), st.floats(-50.0, 50.0)


@settings(max_examples=25, deadline=None)
@given(st.tuples(place, place, angle), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), angle, st.integers(-3, 3))
def test_moving_and_turning_the_world_changes_no_command(move, x, y, psi, turns):
    controller, nu, move = SMALL.controller(), [0.2, 0.0, 0.3], np.array(move)
    e, r = np.array([x, y, psi]), np.array([0.0, 0.1, 0.2])
    here = controller.step(controller.init(), reference(r, nu), estimate(e, nu))[1].u
    full = np.array([0.0, 0.0, 2.0 * np.pi * turns])
    there = controller.step(
        controller.init(), reference(compose(move, r) + full, nu), estimate(compose(move, e), nu)
    )
    np.testing.assert_allclose(there[1].u, here, atol=1e-8)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("perfect", [True, False])
def test_the_garages_vehicle_drives_evenly(shape, perfect):
    """The paper's PD with the gains of before: 51 to 124 % of speed error, 1 to 3 changes of sign a second."""
    run = simulate_loop(SMALL, SHAPES[shape](0.2), perfect=perfect)
    kept = pace(run.t_ns, run.truth.nu[:, 0], run.reference.nu[:, 0])
    assert kept.error < 0.05
    assert kept.uneven < 0.03
    assert share_at_limit(run.sent, limits_of(SMALL.text)) == 0.0
    assert sign_changes(run.t_ns, run.sent[:, 0]) == 0.0


def test_it_bears_a_tenth_of_a_second_of_delay_that_nobody_told_it():
    route, across = SHAPES["sinuous"](0.2), []
    for delay_s in (0.01, 0.11):
        late = SMALL.with_values({"model.drivetrain.delay_s": delay_s})
        system = closed(late, route, perfect=True, controller=SMALL.controller())
        t_ns = times(ticks_of(system, SMALL.rate_hz) - 1, SMALL.rate_hz)
        kernel = closed_loop(system, SMALL.rate_hz, noise=False)
        run = as_run("late", t_ns, kernel.run(Input(t_ns, None), carry=begin(system, route.eta[0]))[1], {})
        across.append(rms(cross_track(t_ns, run.truth.eta[:, :2], t_ns, run.reference.eta[:, :2])))
        assert pace(t_ns, run.truth.nu[:, 0], run.reference.nu[:, 0]).uneven < 0.02
    assert across[0] < 0.003
    assert across[1] < 0.006


@pytest.mark.parametrize(("aside", "turned"), [(0.2, -0.5), (-0.2, 0.5), (0.2, 0.5)])
def test_it_joins_its_route_from_beside_within_a_metre(aside, turned):
    route = circle(1.0, 0.2)
    run = simulate_loop(SMALL, route, perfect=True, eta0=np.array([0.0, aside, turned]), noise=False)
    off = np.abs(np.hypot(run.truth.eta[:, 0], run.truth.eta[:, 1] - 1.0) - 1.0)
    travelled = np.cumsum(np.abs(run.truth.nu[:, 0])) / 100.0
    assert off[travelled > 1.0].max() < 0.03


def test_a_limit_of_another_length_is_refused():
    with pytest.raises(ValueError, match=r"PdFeedforward.limit has shape \(2,\): expected \(3,\)"):
        PdFeedforward(SMALL.vehicle, limit=np.ones(2))


def test_a_wheel_that_cannot_do_both_turns_and_gives_up_speed():
    """At its limit a wheel turns the vehicle off its path; so no wheel gets there, and the turn is what it was."""
    eased, limit = load("small").controller(), SMALL.vehicle.drivetrain.limit
    calm = settled(eased, np.zeros(3), (0.3, 0.0, 1.0), np.zeros(3), (0.3, 0.0, 1.0))
    hasty = settled(eased, np.array([0.3, 0.0, 0.0]), (1.5, 0.0, 1.0), np.zeros(3), (0.3, 0.0, 1.0))
    wheels = np.array([hasty[0] - hasty[2], hasty[0] + hasty[2]])
    assert np.max(np.abs(wheels) / limit) == pytest.approx(0.98, abs=1e-9)
    assert hasty[0] > calm[0]
    alone = SMALL.vehicle.drivetrain.turn_first(np.array([0.9, 0.0, 0.4]))
    np.testing.assert_allclose(alone, [0.58, 0.0, 0.4], atol=1e-12)
    car = load("car").vehicle.drivetrain
    np.testing.assert_array_equal(car.turn_first(np.array([0.9, 0.4])), [0.9, 0.4])
