"""The PD controller of the paper, compared with hand calculations."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from baqueano.controllers import Pd
from baqueano.geometry import compose
from baqueano.signals import Estimate, Reference
from tests.codes import refused

T0 = 5_000_000_000


def estimate(x, y, psi, t_s=0.0):
    return Estimate(T0 + round(t_s * 1e9), np.array([x, y, psi], dtype=float), np.zeros(3), np.eye(6))


def reference(x, y, psi):
    return Reference(T0, np.array([x, y, psi], dtype=float), np.zeros(3), 0.0)


PD = Pd(alpha=2.0, beta=3.0, gamma=0.5)


def test_a_reference_one_metre_ahead_gives_the_command_alpha():
    _, command = PD.step(PD.init(), reference(1.0, 0.0, 0.0), estimate(0.0, 0.0, 0.0))
    np.testing.assert_allclose(command.u, [2.0, 0.0, 0.0])
    assert command.t_ns == T0


def test_the_error_is_rotated_into_the_vehicle_frame():
    # ψ = 90°: the map's x is the body's −y, so e = (0, −1, 0) and the command of the paper's PD is 0
    _, command = PD.step(PD.init(), reference(1.0, 0.0, np.pi / 2), estimate(0.0, 0.0, np.pi / 2))
    np.testing.assert_allclose(command.u, [0.0, 0.0, 0.0], atol=1e-15)


def test_the_paper_pd_does_not_correct_a_sideways_error():
    _, command = PD.step(PD.init(), reference(0.0, 1.0, 0.0), estimate(0.0, 0.0, 0.0))
    np.testing.assert_allclose(command.u, 0.0)


def test_the_heading_command_has_gain_beta_and_rate_gain_gamma():
    state, first = PD.step(PD.init(), reference(0.0, 0.0, 0.2), estimate(0.0, 0.0, 0.0))
    assert first.u[2] == pytest.approx(3.0 * 0.2)  # ė is 0 on the first tick
    _, second = PD.step(state, reference(0.0, 0.0, 0.2), estimate(0.0, 0.0, 0.05, t_s=0.1))
    assert second.u[2] == pytest.approx(3.0 * 0.15 + 0.5 * (0.15 - 0.2) / 0.1)


def test_heading_error_crosses_pi_without_a_jump_of_the_command():
    state, _ = PD.step(PD.init(), reference(0.0, 0.0, 3.1), estimate(0.0, 0.0, -0.04))
    _, command = PD.step(state, reference(0.0, 0.0, -3.13), estimate(0.0, 0.0, -0.04, t_s=0.1))
    before = 3.1 + 0.04  # just below π
    now = -3.13 + 0.04 + 2.0 * np.pi  # just above it, wrapped to −π + …
    e_dot = (now - before) / 0.1
    assert command.u[2] == pytest.approx(3.0 * (now - 2.0 * np.pi) + 0.5 * e_dot)
    assert abs(0.5 * e_dot) < 1.0


def test_a_repeated_timestamp_gives_no_derivative_term():
    state, _ = PD.step(PD.init(), reference(0.0, 0.0, 0.2), estimate(0.0, 0.0, 0.0))
    _, command = PD.step(state, reference(0.0, 0.0, 0.3), estimate(0.0, 0.0, 0.0))
    assert command.u[2] == pytest.approx(0.9)


def test_pd_commands_respect_their_limits():
    pd = Pd(alpha=2.0, beta=3.0, limit=np.array([1.0, 0.0, 0.5]))
    _, command = pd.step(pd.init(), reference(9.0, 9.0, 1.0), estimate(0.0, 0.0, 0.0))
    np.testing.assert_allclose(command.u, [1.0, 0.0, 0.5])


def test_a_car_receives_throttle_and_servo_commands():
    pd = Pd(alpha=2.0, beta=3.0, limit=np.array([9.0, 9.0]))
    _, command = pd.step(pd.init(), reference(1.0, 0.0, 0.1), estimate(0.0, 0.0, 0.0))
    np.testing.assert_allclose(command.u, [2.0, 0.3])


angle = st.floats(-3.1, 3.1)
place = st.floats(-50.0, 50.0)


@given(place, place, angle, place, place, angle, st.tuples(place, place, angle), st.integers(-3, 3))
def test_commands_are_invariant_under_motions_of_the_world(x, y, psi, xr, yr, psir, move, turns):
    move = np.array(move)
    e, r = np.array([x, y, psi]), np.array([xr, yr, psir])
    state, command = PD.step(PD.init(), reference(*r), estimate(*e))
    _, here_next = PD.step(state, reference(*r), estimate(*e, t_s=0.01))
    full = np.array([0.0, 0.0, 2.0 * np.pi * turns])
    r2, e2 = compose(move, r) + full, compose(move, e)
    state, moved_command = PD.step(PD.init(), reference(*r2), estimate(*e2))
    _, there_next = PD.step(state, reference(*r2), estimate(*e2, t_s=0.01))
    at_the_cut = abs(abs(command.u[2] / 3.0) - np.pi) < 1e-6  # ±π is one heading but gives two errors
    if not at_the_cut:
        np.testing.assert_allclose(moved_command.u, command.u, atol=1e-9)
        np.testing.assert_allclose(there_next.u, here_next.u, atol=1e-9)


def test_a_limit_of_the_wrong_length_is_refused():
    with refused("pd.limit", ValueError, value="(4,)"):
        Pd(alpha=1.0, beta=1.0, limit=np.ones(4))
