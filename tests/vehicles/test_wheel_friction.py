"""Dry friction of each wheel, forward and backward: its force on the body, and its energy loss."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from baqueano.vehicles import Friction
from tests.codes import refused

QUICK = settings(max_examples=50)
FAST = 5.0  # m/s, where tanh is 1


def wheels(forward, backward, track_m=0.2):
    return Friction(coulomb_forward=np.array(forward), coulomb_backward=np.array(backward), track_m=track_m)


def test_unequal_wheel_friction_brakes_and_turns_the_vehicle():
    """3 N left and 1 N right at ± 0.1 m: 4 N backward, and (1 − 3) · 0.1 N m against ν_ψ, which turns it left."""
    assert wheels([3.0, 1.0], [0.5, 0.5]).force(np.array([FAST, 0.0, 0.0])) == pytest.approx([4.0, 0.0, -0.2])


def test_backward_rolling_has_a_separate_friction():
    assert wheels([3.0, 1.0], [0.5, 0.7]).force(np.array([-FAST, 0.0, 0.0])) == pytest.approx(
        [-1.2, 0.0, -0.02]
    )


def test_a_turn_in_place_uses_backward_and_forward_friction():
    """Left wheel backward with 0.5 N, right wheel forward with 1 N: 0.5 N backward, 0.15 N m against the turn."""
    force = wheels([3.0, 1.0], [0.5, 0.7]).force(np.array([0.0, 0.0, 100.0]))
    assert force == pytest.approx([0.5, 0.0, 0.15])


@QUICK
@given(
    arrays(float, 2, elements=st.floats(0.0, 5.0)),
    arrays(float, 2, elements=st.floats(0.0, 5.0)),
    arrays(float, 3, elements=st.floats(-1.0, 1.0)),
    st.floats(0.01, 1.0),
)
def test_wheel_friction_never_adds_energy(forward, backward, nu, track_m):
    assert nu @ wheels(forward, backward, track_m).force(nu) >= -1e-15


def test_wheel_friction_is_smooth_through_rest():
    """At 0 the slope from the left and from the right is (d_f + d_b) / 2 ν_k."""
    friction, h = wheels([3.0, 0.0], [1.0, 0.0]), 1e-6
    right = friction.force(np.array([h, 0.0, 0.0]))[0] / h
    left = friction.force(np.array([-h, 0.0, 0.0]))[0] / -h
    assert right == pytest.approx(left, rel=1e-4) == pytest.approx(2.0 / 0.05, rel=1e-4)


def test_wheel_friction_without_a_track_is_refused():
    with refused("friction.track", ValueError):
        Friction(coulomb_forward=np.array([1.0, 1.0]))


def test_wheels_without_friction_add_no_operations_to_a_kernel():
    from baqueano.symbolic import scan
    from baqueano.vehicles import Planar

    def text(friction):
        planar = Planar(1.0, 1.0, np.eye(3), friction=friction)
        return scan(
            lambda s, u: planar.step(s, u, 0.01, np.zeros(3)), planar.init(), np.zeros(3), backend="python"
        )

    without_wheels, on = text(Friction(track_m=0.2)), text(wheels([1.0, 1.0], [1.0, 1.0]))
    assert without_wheels.operations == text(Friction()).operations < on.operations
