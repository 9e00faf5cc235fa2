"""The dynamic model of the paper with the numbers of its case study I, except for errata 1, 2 and 6."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from baqueano.vehicles import Friction, Planar
from tests.codes import refused

QUICK = settings(max_examples=30)

M_KG, I = 1.47, 810.44
DL, DC = np.array([7.0, 7.0, 500.553]), np.array([3.5, 3.5, 250.0])  # the paper prints them with a minus
T = np.diag([1.0, 1.0, 29.99])
CASE_I = Planar(M_KG, I, T, friction=Friction(linear=DL, quadratic=DC))
states = arrays(float, 3, elements=st.floats(-5.0, 5.0))


@QUICK
@given(states, states)
def test_the_model_equals_the_movement_equation_of_the_paper(nu, u):
    """M ν̇ + C(ν)ν + D(ν)ν = T u with M, C, D as `equ:M`, `equ:C`, `equ:D` print them."""
    M = np.diag([M_KG, M_KG, I])
    C = M_KG * np.array([[0.0, 0.0, -nu[1]], [0.0, 0.0, nu[0]], [nu[1], -nu[0], 0.0]])
    D = np.diag(DL + DC * np.abs(nu))
    forces = M @ CASE_I.nu_dot(nu, 20.0 * u) + C @ nu + D @ nu
    assert forces == pytest.approx(T @ (20.0 * u), rel=1e-9, abs=1e-8)


@QUICK
@given(states, states)
def test_the_corrected_phi_matrix_of_the_paper_gives_the_model_acceleration(nu, u):
    """ν̇ = Φν + M⁻¹τ, `equ:dinamic_model`; the ±mν/I of Φ's third row cancel in Φν (errata 2)."""
    phi = np.diag(-(DL + DC * np.abs(nu)) / np.array([M_KG, M_KG, I]))
    phi[0, 2], phi[1, 2] = nu[1], -nu[0]
    phi[2, :2] = -M_KG * nu[1] / I, M_KG * nu[0] / I
    tau = T @ u
    assert CASE_I.nu_dot(nu, u) == pytest.approx(
        phi @ nu + tau / np.array([M_KG, M_KG, I]), rel=1e-9, abs=1e-9
    )


@QUICK
@given(arrays(float, 3, elements=st.floats(0.1, 5.0)), st.sampled_from([(1, 1, 1), (-1, 1, -1), (1, -1, 1)]))
def test_the_g_matrix_of_the_paper_is_correct_except_its_last_row(speed, sign):
    """∂ν̇/∂ν as the paper's G_t, with dissipative friction and a third row without ±mν/I (errata 1, 2)."""
    nu, h = speed * sign, 1e-6
    response = np.stack(
        [
            (CASE_I.nu_dot(nu + h * e, np.zeros(3)) - CASE_I.nu_dot(nu - h * e, np.zeros(3))) / (2 * h)
            for e in np.eye(3)
        ],
        axis=1,
    )
    G = np.diag(-(DL + 2.0 * DC * np.abs(nu)) / np.array([M_KG, M_KG, I]))
    G[0, 1], G[0, 2] = nu[2], nu[1]
    G[1, 0], G[1, 2] = -nu[2], -nu[0]
    assert response == pytest.approx(G, abs=1e-6)


def test_case_study_one_reaches_its_computed_final_speed():
    """T u = (d_l + d_c v) v with u_x = 20: v = (−7 + √(49 + 4·3.5·20)) / 7 = 1.5913 m/s."""
    state = CASE_I.init()
    for _ in range(1000):
        state, _ = CASE_I.step(state, np.array([20.0, 0.0, 0.0]), 0.01, np.zeros(3))
    assert state.nu == pytest.approx([(-7.0 + np.sqrt(49.0 + 280.0)) / 7.0, 0.0, 0.0], abs=1e-9)


def test_case_study_one_responds_within_0_2_s():
    """m/d_l = 0.21 s and I/d_lψ = 1.62 s: the first explains why a kinematic model works well there."""
    state = CASE_I.init()
    for _ in range(21):
        state, _ = CASE_I.step(state, np.array([0.7, 0.0, 0.0]), 0.01, np.zeros(3))
    assert state.nu[0] == pytest.approx(0.1 * (1.0 - np.exp(-1.0)), rel=0.03)


def test_the_printed_negative_d_cx_is_refused():
    """d_cx = +3.4398 of the paper is −3.4398 here: a vehicle that accelerates by friction (errata 6)."""
    with refused("field.range", ValueError, field="Friction.quadratic", low=0.0):
        Friction(quadratic=np.array([-3.4398, 4.6451, 313.1575]))
