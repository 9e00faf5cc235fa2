"""Every derivative compared with central differences, over random states off the kinks (|ν| ≥ 0.1, channels off their
dead zones).

These tests prove consistency, not physics; test_pencil tests the physics.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from baqueano.symbolic import function, jacobian, value_at_path, with_value
from baqueano.vehicles import Car, Friction, Kinematic, Planar, constant_effort
from tests.vehicles.test_back_ends import MOTORS

QUICK = settings(max_examples=30)

T = np.array([[2.0, 0.1, 0.2], [0.05, 1.0, 0.3], [-0.1, 0.2, 0.5]])
FRICTION = Friction(
    linear=np.array([1.0, 3.0, 0.2]),
    quadratic=np.array([0.5, 0.4, 0.1]),
    coulomb=np.array([0.3, 0.2, 0.05]),
    coulomb_speed=np.array([0.2, 0.3, 0.6]),
    cornering=0.4,
    coulomb_forward=np.array([0.2, 0.3]),
    coulomb_backward=np.array([0.25, 0.1]),
    track_m=0.15,
)
VEHICLES = {
    "planar": Planar(2.0, 0.5, T, centre_of_mass_x_m=0.05, friction=FRICTION, slope_rad=0.1),
    "kinematic": Kinematic(T, slide_s=0.2),
    "car": Car(
        wheelbase_m=0.15,
        throttle_gain=4.0,
        steering_gain=0.3,
        rear_axle_m=0.07,
        linear_drag=2.0,
        quadratic_drag=0.5,
        motor_drag=1.5,
        coulomb_m_s2=0.4,
        coulomb_speed_m_s=0.2,
        cornering_drag=0.8,
        understeer=0.02,
    ),
}
signed_floats = st.floats(0.1, 2.0).flatmap(lambda x: st.sampled_from([x, -x]))
velocities = arrays(float, 3, elements=signed_floats)
efforts = arrays(float, 2, elements=signed_floats)
names = pytest.mark.parametrize("name", VEHICLES)


def differences(f, x, h=1e-5):
    return np.stack([(f(x + h * e) - f(x - h * e)) / (2.0 * h) for e in np.eye(len(x))], axis=-1)


def effort_of(vehicle, effort):
    return np.array([effort[0], 0.1, effort[1]]) if vehicle.commands == 3 else 0.5 * effort


def advanced(vehicle, effort):
    """Return the function (η, ν) → (η, ν, ν̇) after 10 ms, flat."""
    return lambda x: np.concatenate(vehicle.advance(x[:3], x[3:], constant_effort(effort), 0.01))


@names
@QUICK
@given(nu=velocities, effort=efforts)
def test_step_derivatives_by_dual_numbers_match_differences(name, nu, effort):
    vehicle = VEHICLES[name]
    f = advanced(vehicle, effort_of(vehicle, effort))
    x = np.concatenate([[0.3, -0.2, 0.9], nu])
    assert jacobian(f)(x) == pytest.approx(differences(f, x), abs=1e-6, rel=1e-6)


@names
@pytest.mark.parametrize("backend", ["python", "c"])
def test_compiled_step_derivatives_equal_dual_numbers(name, backend):
    vehicle, rng = VEHICLES[name], np.random.default_rng(7)
    effort = effort_of(vehicle, np.array([0.5, -0.4]))
    f = advanced(vehicle, effort)
    G = function(jacobian(f), np.zeros(6), backend=backend)
    for _ in range(20):
        x = rng.uniform(0.1, 1.5, 6) * rng.choice([-1.0, 1.0], 6)
        assert np.asarray(G(x)) == pytest.approx(jacobian(f)(x), abs=1e-12, rel=1e-12)


PARAMETERS = {
    "planar": [
        "mass_kg",
        "inertia_kg_m2",
        "centre_of_mass_x_m",
        "slope_rad",
        "slope_heading_rad",
        "actuator_matrix[0,2]",
        "friction.linear[0]",
        "friction.quadratic[1]",
        "friction.coulomb[2]",
        "friction.coulomb_speed[0]",
        "friction.cornering",
        "friction.coulomb_forward[1]",
        "friction.coulomb_backward[0]",
        "friction.track_m",
    ],
    "kinematic": ["velocity_matrix[0,0]", "velocity_matrix[2,1]"],
    "car": [
        "wheelbase_m",
        "throttle_gain",
        "steering_gain",
        "rear_axle_m",
        "steering_offset_rad",
        "linear_drag",
        "quadratic_drag",
        "coulomb_m_s2",
        "coulomb_speed_m_s",
        "cornering_drag",
        "understeer",
        "yaw_lag_s",
    ],
}


def shift(block, paths, change):
    """Return the block with these parameters changed by these amounts."""
    new = block
    for path, amount in zip(paths, change, strict=True):
        new = with_value(new, path, float(value_at_path(block, path)) + amount)
    return new


@names
def test_every_parameter_of_a_vehicle_has_a_derivative(name):
    vehicle, paths = VEHICLES[name], PARAMETERS[name]
    effort = effort_of(vehicle, np.array([0.7, -0.6]))
    x = np.array([0.3, -0.2, 0.9, 0.8, -0.3, 1.1])

    def f(change):
        return advanced(shift(vehicle, paths, change), effort)(x)

    zero = np.zeros(len(paths))
    slope = jacobian(f)(zero)
    assert slope == pytest.approx(differences(f, zero), abs=1e-6, rel=1e-6)
    assert np.all(np.abs(slope).max(axis=0) > 0.0), "each parameter has an effect"


def test_every_parameter_of_a_drivetrain_has_a_derivative():
    """Two ticks at full command with each effect active, off the kinks."""
    d = replace(MOTORS, limit=np.array([0.9, 1.5]))
    paths = ["limit[0]", "dead_zone_forward[1]", "dead_zone_backward[0]", "gain[1]", "delay_s", "lag_s"]
    paths += ["battery_v", "battery_nominal_v", "battery_effect", "sag"]

    def f(change):
        drivetrain = shift(d, paths, change)
        state, efforts = drivetrain.init(), []
        for u in ([-0.7, 0.0, 0.6], [0.5, 0.0, 0.5], [0.2, 0.0, 0.6]):
            state, effort = drivetrain.step(state, np.array(u), 0.01)
            efforts += effort
        return np.concatenate(efforts)

    zero = np.zeros(len(paths))
    slope = jacobian(f)(zero)
    assert slope == pytest.approx(differences(f, zero, h=1e-6), abs=1e-6, rel=1e-6)
    assert np.all(np.abs(slope).max(axis=0) > 0.0), "each parameter has an effect"
