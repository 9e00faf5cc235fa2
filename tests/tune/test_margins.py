"""Margins equal those of python-control, and a loop with more delay or gain becomes unstable at its margins."""

from functools import cache

import control
import numpy as np
import pytest

from baqueano.controllers.mpc import program
from baqueano.signals import Estimate, Reference
from baqueano.symbolic import compile_block, with_value
from baqueano.tune import margins as margins_module
from baqueano.tune.margins import (
    LinearSystem,
    has_stable_loop,
    linearise,
    loop_margins,
    loop_transfer,
    margins,
)
from baqueano.vehicle_file import load
from tests.papers_pd import with_papers_pd

DT_S = 0.01
LOOPS = {  # L(s) of textbooks: k / (s (s + a)), with a lead, conditionally stable
    "servo": control.tf([20.0], [1.0, 2.0, 0.0]),
    "lead": control.tf([40.0, 200.0], [1.0, 21.0, 40.0, 0.0]),
    "conditional": 60.0 * control.tf([1.0, 2.0, 1.0], [1.0, 0.5, 0.0, 0.0]) * control.tf([1.0], [0.05, 1.0]),
}


@pytest.mark.parametrize("name", LOOPS)
@pytest.mark.parametrize("delay", [0, 4])
def test_margins_equal_the_margins_of_python_control(name, delay):
    loop = control.ss(LOOPS[name].sample(DT_S)) * control.ss(control.tf([1.0], [1.0] + delay * [0.0], DT_S))
    omega = np.geomspace(0.02, np.pi / DT_S, 4000)
    response = control.frd(loop(np.exp(1j * omega * DT_S)), omega, smooth=True)
    gains, phases, _, _, crossings, _ = control.stability_margins(response, returnall=True)
    own_margins = margins(LinearSystem(loop.A, loop.B, loop.C, loop.D, DT_S))
    high, low = [g for g in gains if g > 1.0], [g for g in gains if g < 1.0]
    assert own_margins[0] == pytest.approx(min(high, default=np.inf), rel=1e-3)
    assert own_margins[1] == pytest.approx(max(low, default=0.0), rel=1e-3)
    smallest = np.argmin(np.abs(phases))
    assert np.degrees(own_margins[2]) == pytest.approx(phases[smallest], rel=1e-3)
    assert own_margins[3] == pytest.approx(np.min(np.radians(phases % 360.0) / crossings), rel=1e-3)


@pytest.fixture(scope="module")
def plant():
    file = load("small")
    return linearise(file, file.controller(), 0.2)[0]


def test_margins_of_a_vehicle_loop_equal_the_margins_of_python_control(plant):
    for channel in (0, 2):
        loop = loop_transfer(plant, channel)
        omega = np.geomspace(0.05, np.pi / plant.dt_s, 4000)
        response = control.frd(loop.frequency_response(omega), omega, smooth=True)
        reference = control.StateSpace(loop.A, loop.B, loop.C, loop.D, plant.dt_s)
        np.testing.assert_allclose(
            loop.frequency_response(omega[::200]),
            reference(np.exp(1j * omega[::200] * plant.dt_s)),
            rtol=1e-6,
        )
        gain, phase, _, _, crossover, _ = control.stability_margins(response)
        own_margins = margins(loop)
        assert own_margins[0] == pytest.approx(gain, rel=1e-3)
        assert np.degrees(own_margins[2]) == pytest.approx(phase, rel=1e-3)
        assert own_margins[3] == pytest.approx(np.radians(phase) / crossover, rel=1e-3)


@pytest.mark.parametrize("channel", [0, 2])
def test_the_loop_of_a_channel_has_the_response_of_all_states_with_the_other_channels_closed(plant, channel):
    others = [k for k in range(3) if k != channel]
    for omega in (0.1, 1.0, 10.0, 100.0):
        z = np.exp(1j * omega * plant.dt_s)
        G = plant.C @ np.linalg.solve(z * np.eye(len(plant.A)) - plant.A, plant.B) + plant.D
        closed = np.linalg.solve(z * np.eye(2) - G[np.ix_(others, others)], G[others, channel])
        expected = -(G[channel, channel] + G[channel, others] @ closed) / z
        assert loop_transfer(plant, channel).frequency_response(omega)[0] == pytest.approx(expected, rel=1e-9)


def closed_with(loop: LinearSystem, gain: float, ticks: int) -> float:
    """Return the largest eigenvalue of the loop with additional gain and delay."""
    A, B, C = loop.A, gain * loop.B, loop.C
    for _ in range(ticks):
        n = len(A)
        A = np.block([[A, np.zeros((n, 1))], [C, np.zeros((1, 1))]])
        B, C = np.vstack([B, [[0.0]]]), np.hstack([np.zeros((1, n)), [[1.0]]])
    return float(np.max(np.abs(np.linalg.eigvals(A - B @ C))))


@pytest.mark.parametrize("channel", [0, 2])
def test_a_loop_becomes_unstable_at_its_margins(plant, channel):
    loop = loop_transfer(plant, channel)
    gain, _, _, delay_s = margins(loop)
    assert closed_with(loop, 0.98 * gain, 0) < 1.0 + 1e-6 < closed_with(loop, 1.02 * gain, 0)
    ticks = int(delay_s / plant.dt_s)
    assert closed_with(loop, 1.0, ticks - 1) < 1.0 + 1e-6 < closed_with(loop, 1.0, ticks + 2)


@pytest.mark.parametrize("zone", [0.0, 0.05])
@pytest.mark.parametrize("kind", ["pd_feedforward", "lqr", "stanley"])
def test_a_servo_in_the_middle_has_the_margins_of_a_servo_beside_it(zone, kind):
    straight = load("car").with_values(
        {
            "model.steering_offset_rad": 0.0,
            "model.cornering_drag": 0.0,
            "model.drivetrain.dead_zone_forward": [0.03, zone],
            "model.drivetrain.dead_zone_backward": [0.03, zone],
            "controller.kind": kind,
        }
    )
    oblique = straight.with_values({"model.steering_offset_rad": 0.02})
    plant, is_stable = margins_module._linear_loop(straight, straight.controller(), 0.3)
    loop = loop_transfer(plant, 1)
    servo, other_servo = margins(loop), loop_margins(oblique, oblique.controller(), 0.3)[1]
    assert is_stable
    np.testing.assert_allclose(servo, other_servo[1:5], rtol=5e-3)
    omega = np.geomspace(0.05, np.pi / loop.dt_s, 4000)
    reference = control.StateSpace(loop.A, loop.B, loop.C, loop.D, loop.dt_s)
    response = control.frd(reference(np.exp(1j * omega * loop.dt_s)), omega, smooth=True)
    _, phase, _, _, crossover, _ = control.stability_margins(response)
    assert servo[3] == pytest.approx(np.radians(phase) / crossover, rel=1e-3)


def test_a_compiled_drive_ends_in_the_state_of_a_drive_as_written():
    file = load("small")
    system = margins_module._straight_loop(file, file.controller(), 0.3)
    t_ns, begin = (
        np.arange(1, margins_module.MIN_COMPILED_TICKS + 1) * 10_000_000,
        margins_module.begin(system),
    )
    states = [margins_module._drive_system(system, begin, DT_S, t_ns, x)[0] for x in (False, True)]
    rows = [margins_module._NumberRow(state).row(state) for state in states]
    np.testing.assert_allclose(*rows, rtol=1e-9, atol=1e-12)


def test_finite_differences_give_the_margins_of_the_exact_jacobian(monkeypatch):
    file = with_papers_pd()
    calm = with_value(with_value(file.controller(), "alpha", 4.0), "beta", 1.0)
    exact = [margins(loop_transfer(linearise(file, calm, 0.2)[0], k)) for k in (0, 2)]
    monkeypatch.setattr(margins_module, "_engine_jacobian", margins_module._finite_differences)
    differences = [margins(loop_transfer(linearise(file, calm, 0.2)[0], k)) for k in (0, 2)]
    np.testing.assert_allclose(differences, exact, rtol=1e-3)


@cache
def mpc_loops(name, speed):
    """Return L of each channel with mpc."""
    file = load(name)
    plant, is_stable = margins_module._linear_loop(file, file.controller("mpc"), speed)
    assert is_stable
    return [loop_transfer(plant, k) for k in np.flatnonzero(file.command.limit > 0.0)]


@pytest.mark.parametrize(("name", "speed"), [("small", 0.2), ("car", 0.8)])
def test_mpc_whose_step_calls_a_solver_has_the_margins_of_python_control(name, speed, monkeypatch):
    """They do not change if the solver is exact."""
    file, loops = load(name), mpc_loops(name, speed)
    usual = [margins(loop) for loop in loops]
    for loop, (gain_up, _, _, delay_s) in zip(loops, usual, strict=True):
        omega = np.geomspace(0.05, np.pi / loop.dt_s, 4000)
        reference = control.StateSpace(loop.A, loop.B, loop.C, loop.D, loop.dt_s)
        response = control.frd(reference(np.exp(1j * omega * loop.dt_s)), omega, smooth=True)
        gain, phase, _, _, crossover, _ = control.stability_margins(response)
        assert gain_up == pytest.approx(gain, rel=1e-3)
        assert delay_s == pytest.approx(np.radians(phase) / crossover, rel=1e-3)
    exact_settings = program.OSQP_SETTINGS | {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 4000}
    monkeypatch.setattr(program, "OSQP_SETTINGS", exact_settings)
    exact = loop_margins(file, file.controller("mpc"), speed)
    np.testing.assert_allclose(usual, [m[1:5] for m in exact], rtol=5e-3)


@pytest.mark.parametrize(("name", "speed"), [("small", 0.2), ("car", 0.8)])
def test_a_loop_with_mpc_keeps_to_its_line_with_less_delay_than_its_margin(name, speed):
    """The drive is the judge: with 0.8 of the delay margin more, a disturbance decays; with 1.3 of it, it grows."""
    file = load(name)
    mpc, vehicle = file.controller("mpc"), compile_block(file.vehicle)
    delay_s = margins(mpc_loops(name, speed)[-1])[3]
    rate = file.rate_hz
    unstable_range_m, stable_range_m = (
        _last_oscillation(mpc, vehicle, speed, rate, round(share * delay_s * rate)) for share in (1.3, 0.8)
    )
    assert stable_range_m < 0.002 < 0.01 < unstable_range_m


def _last_oscillation(mpc, vehicle, speed, rate, ticks) -> float:
    """Return the range of y [m] in the last 2 of 10 s along the x axis, with commands that are late by some ticks."""
    state, motion = mpc.init(), vehicle.init(eta=np.array([0.0, 0.005, 0.0]), nu=np.array([speed, 0.0, 0.0]))
    commands, y = [np.zeros(vehicle.commands)] * ticks, []
    for k in range(round(10.0 * rate)):
        t_ns = round(k * 1e9 / rate)
        reference = Reference(t_ns, np.array([speed * k / rate, 0.0, 0.0]), np.array([speed, 0.0, 0.0]), 0.0)
        state, command = mpc.step(state, reference, Estimate(t_ns, motion.eta, motion.nu, np.eye(6)))
        commands.append(command.u)
        motion, _ = vehicle.step(motion, commands[k], 1.0 / rate, np.zeros(3))
        y.append(motion.eta[1])
    return float(np.ptp(y[-round(2.0 * rate) :]))


# the channels are independent
EVEN = {
    "model.drivetrain.gain": [1.0, 1.0],
    "model.drivetrain.dead_zone_forward": [0.3, 0.3],
    "model.centre_of_mass_x_m": 0.0,
}


def test_additional_delay_reduces_the_delay_margin_by_its_amount():
    file = load("small").with_values(EVEN)
    delayed_file, controller = file.with_values({"model.drivetrain.delay_s": 0.05}), file.controller()
    margin, margin_2 = (loop_margins(f, controller, 0.2)[1].delay_s for f in (file, delayed_file))
    assert margin - margin_2 == pytest.approx(0.04, abs=1e-3)


def test_a_gain_that_makes_the_loop_oscillate_has_no_margin():
    file = with_papers_pd()
    calm = with_value(with_value(file.controller(), "alpha", 4.0), "beta", 1.0)
    wild = with_value(calm, "beta", 200.0)
    assert all(m.stable for m in loop_margins(file, calm, 0.2))
    assert not any(m.stable for m in loop_margins(file, wild, 0.2))
    assert has_stable_loop(file, calm, 0.2)
    assert not has_stable_loop(file, wild, 0.2)


def test_without_forward_speed_no_margins_are_computed():
    assert loop_margins(load("small"), load("small").controller(), 0.0) == ()


def test_a_newton_step_to_where_the_model_diverges_gives_no_steady_state_and_no_warning():
    def tick(x):
        return 1e200 * x * np.abs(x)

    with np.errstate(over="raise", invalid="raise"):
        steady = margins_module._steady_state(tick, np.array([1e200, 1.0]), np.array([0.0, 0.1]))[2]
    assert not steady


def test_a_fast_iteration_to_the_steady_state_computes_few_jacobians():
    calls = []

    def derivative(tick, x):
        calls.append(x)
        return np.diag(0.5 + 0.06 * np.cos(x))

    x, J, is_steady = margins_module._steady_state(
        lambda x: 0.5 * x + 0.06 * np.sin(x), np.array([0.5, -0.3]), np.array([0.1, 0.0]), derivative
    )
    assert is_steady
    np.testing.assert_allclose(0.5 * x + 0.06 * np.sin(x), x + np.array([0.1, 0.0]), atol=1e-7)
    np.testing.assert_allclose(J, np.diag(0.5 + 0.06 * np.cos(x)), atol=1e-12)
    assert len(calls) == 2
