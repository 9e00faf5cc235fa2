"""Energy and momentum: the possible effects of friction, centripetal terms and an eccentric mass."""

import casadi
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from baqueano.geometry import map_from_body
from baqueano.vehicles import Car, Friction, Planar, constant_effort

QUICK = settings(max_examples=30)

REST = np.zeros(3)
G = 9.80665


def vectors(low: float, high: float, n: int = 3):
    return arrays(float, n, elements=st.floats(low, high, allow_subnormal=False))


frictions = st.builds(
    Friction,
    linear=vectors(0.0, 10.0),
    quadratic=vectors(0.0, 5.0),
    coulomb=vectors(0.0, 2.0),
    coulomb_speed=vectors(0.05, 1.0),
    cornering=st.floats(0.0, 5.0),
)


def mass_matrix(p: Planar) -> np.ndarray:
    m, I, c = p.mass_kg, p.inertia_kg_m2, p.centre_of_mass_x_m
    return np.array([[m, 0.0, 0.0], [0.0, m, m * c], [0.0, m * c, I + m * c * c]])


def kinetic_energy(p: Planar, nu: np.ndarray) -> float:
    return 0.5 * nu @ mass_matrix(p) @ nu


def momentum(p: Planar, eta: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """Return the momentum in the map, and the spin about the origin of the map."""
    m, I, c = p.mass_kg, p.inertia_kg_m2, p.centre_of_mass_x_m
    J = map_from_body(eta[2])
    place = eta + J @ np.array([c, 0.0, 0.0])
    v = J @ np.array([nu[0], nu[1] + c * nu[2], 0.0])
    return np.array([m * v[0], m * v[1], I * nu[2] + m * (place[0] * v[1] - place[1] * v[0])])


@QUICK
@given(frictions, vectors(-5.0, 5.0))
def test_friction_always_opposes_the_motion(friction, nu):
    assert nu @ friction.force(nu) >= 0.0


@QUICK
@given(frictions, vectors(-5.0, 5.0))
def test_friction_changes_only_its_sign_if_the_velocity_is_reversed(friction, nu):
    assert friction.force(-nu) == pytest.approx(-friction.force(nu))


@QUICK
@given(frictions, vectors(-3.0, 3.0), st.floats(-0.3, 0.3))
def test_an_unforced_vehicle_never_gains_kinetic_energy(friction, nu, c):
    p = Planar(2.0, 0.5, np.eye(3), centre_of_mass_x_m=c, friction=friction)
    eta, energy = REST, kinetic_energy(p, nu)
    for _ in range(12):
        eta, nu, _ = p.advance(eta, nu, constant_effort(REST), 0.002)
        after = kinetic_energy(p, nu)
        assert after <= energy * (1.0 + 1e-9) + 1e-15
        energy = after


@QUICK
@given(frictions, vectors(-3.0, 3.0), vectors(-3.0, 3.0), st.floats(-0.3, 0.3))
def test_the_kinetic_power_equals_effort_power_minus_friction_power(friction, nu, effort, c):
    T = np.array([[2.0, 0.1, 0.2], [0.0, 1.0, 0.3], [-0.1, 0.2, 0.5]])
    p = Planar(2.0, 0.5, T, centre_of_mass_x_m=c, friction=friction)
    power = nu @ mass_matrix(p) @ p.nu_dot(nu, effort)
    given_ = nu @ (T @ effort) - nu @ friction.force(nu)
    assert power == pytest.approx(given_, abs=1e-9, rel=1e-9)


@QUICK
@given(vectors(-3.0, 3.0), vectors(-2.0, 2.0), st.floats(-0.3, 0.3))
def test_without_forces_momentum_and_spin_are_conserved(nu, eta, c):
    p = Planar(2.0, 0.5, np.eye(3), centre_of_mass_x_m=c)
    before = momentum(p, eta, nu)
    for _ in range(25):
        eta, nu, _ = p.advance(eta, nu, constant_effort(REST), 0.01)
    assert momentum(p, eta, nu) == pytest.approx(before, abs=1e-6)


@QUICK
@given(vectors(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-0.3, 0.3))
def test_total_energy_is_conserved_on_a_frictionless_slope(nu, heading, c):
    p = Planar(2.0, 0.5, np.eye(3), centre_of_mass_x_m=c, slope_rad=0.2, slope_heading_rad=heading)

    def total(eta, nu):
        place = eta + map_from_body(eta[2]) @ np.array([c, 0.0, 0.0])
        height = np.sin(0.2) * (place[0] * np.cos(heading) + place[1] * np.sin(heading))
        return kinetic_energy(p, nu) + p.mass_kg * G * height

    eta, before = REST, total(REST, nu)
    for _ in range(25):
        eta, nu, _ = p.advance(eta, nu, constant_effort(REST), 0.01)
    assert total(eta, nu) == pytest.approx(before, abs=1e-6)


def lagrange() -> casadi.Function:
    """Return q̈ of q = (x, y, ψ) from d/dt ∂L/∂q̇ − ∂L/∂q = J τ, with derivatives computed from L = kinetic −
    potential."""
    q, q_dot, tau = casadi.SX.sym("q", 3), casadi.SX.sym("v", 3), casadi.SX.sym("t", 3)
    m, I, c, alpha, chi = (casadi.SX.sym(s) for s in ("m", "I", "c", "alpha", "chi"))
    place = q[:2] + c * casadi.vertcat(casadi.cos(q[2]), casadi.sin(q[2]))
    speed = casadi.jtimes(place, q, q_dot)
    height = casadi.sin(alpha) * (place[0] * casadi.cos(chi) + place[1] * casadi.sin(chi))
    L = 0.5 * m * casadi.sumsqr(speed) + 0.5 * I * q_dot[2] ** 2 - m * G * height
    p = casadi.gradient(L, q_dot)
    C, S = casadi.cos(q[2]), casadi.sin(q[2])
    force = casadi.vertcat(C * tau[0] - S * tau[1], S * tau[0] + C * tau[1], tau[2])
    right = force + casadi.gradient(L, q) - casadi.jtimes(p, q, q_dot)
    q_ddot = casadi.solve(casadi.jacobian(p, q_dot), right)
    return casadi.Function("lagrange", [q, q_dot, tau, m, I, c, alpha, chi], [q_ddot])


LAGRANGE = lagrange()


@QUICK
@given(vectors(-3.0, 3.0), vectors(-3.0, 3.0), vectors(-5.0, 5.0), st.floats(-0.3, 0.3), st.floats(0.0, 0.5))
def test_the_newton_euler_equations_equal_the_lagrange_equations(eta, nu, tau, c, alpha):
    p = Planar(2.0, 0.5, np.eye(3), centre_of_mass_x_m=c, slope_rad=alpha, slope_heading_rad=0.7)
    J = map_from_body(eta[2])
    q_ddot = np.array(LAGRANGE(eta, J @ nu, tau, 2.0, 0.5, c, alpha, 0.7)).ravel()
    # q̈ = d/dt (J ν) = J (ν̇ + ν_ψ × ν)
    nu_dot = J.T @ q_ddot - nu[2] * np.array([-nu[1], nu[0], 0.0])
    assert p.nu_dot(nu, tau, eta[2]) == pytest.approx(nu_dot, abs=1e-9)


@QUICK
@given(st.floats(-3.0, 3.0), st.floats(-5.0, 5.0))
def test_an_unforced_car_never_gains_speed(v, r):
    car = Car(
        wheelbase_m=0.15,
        throttle_gain=4.0,
        steering_gain=0.3,
        linear_drag=1.0,
        quadratic_drag=0.5,
        coulomb_m_s2=0.5,
        cornering_drag=0.8,
    )
    eta, nu = REST, np.array([v, 0.0, r])
    for _ in range(12):
        eta, after, _ = car.advance(eta, nu, constant_effort(np.zeros(2)), 0.01)
        assert abs(after[0]) <= abs(nu[0]) * (1.0 + 1e-9) + 1e-15
        nu = after
