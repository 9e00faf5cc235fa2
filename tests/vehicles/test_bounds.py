"""A parameter that cannot be is refused when the block is made: which, what was found, what fits."""

import numpy as np
import pytest

from baqueano.parameter import parameter, parameters
from baqueano.vehicles import Car, Drivetrain, Friction, Kinematic, Planar

EYE = np.eye(3)
ERRORS = {
    r"Planar.mass_kg = -0.61: expected values from 0.001 to 100000 \[kg\], mass m.": lambda: Planar(
        -0.61, 1.0, EYE
    ),
    r"Planar.mass_kg = nan: expected finite numbers \[kg\]": lambda: Planar(float("nan"), 1.0, EYE),
    r"Planar.mass_kg = inf: expected finite numbers": lambda: Planar(float("inf"), 1.0, EYE),
    r"Planar.mass_kg = '0.61': expected one number \[kg\]": lambda: Planar("0.61", 1.0, EYE),
    r"Planar.mass_kg = True: expected one number": lambda: Planar(True, 1.0, EYE),
    r"Planar.inertia_kg_m2 = array\(\[1., 2.\]\): expected one number": lambda: Planar(
        1.0, np.array([1.0, 2.0]), EYE
    ),
    r"Planar.actuator_matrix has shape \(2, 2\): expected \(3, 3\)": lambda: Planar(1.0, 1.0, np.eye(2)),
    r"Planar.actuator_matrix = \[\[1, 0, 0\].*: expected a NumPy array, .*write np.array": lambda: Planar(
        1.0, 1.0, [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    ),
    r"Friction.linear = \[1.0, -1.0, 0.0\]: expected values from 0": lambda: Friction(
        linear=np.array([1.0, -1.0, 0.0])
    ),
    r"Friction.linear = \[1.0, nan, 0.0\]: expected finite": lambda: Friction(
        linear=np.array([1.0, np.nan, 0.0])
    ),
    r"Friction.coulomb_speed = .*: expected values from 0.0001": lambda: Friction(coulomb_speed=np.zeros(3)),
    r"Car.wheelbase_m = 0: expected values from 0.001": lambda: Car(0, 4.0, 0.3),
    r"Kinematic.velocity_matrix has shape \(3,\): expected \(3, 3\)": lambda: Kinematic(np.ones(3)),
}


@pytest.mark.parametrize("message", ERRORS)
def test_what_cannot_be_is_refused_in_words(message):
    with pytest.raises(ValueError, match=message):
        ERRORS[message]()


@pytest.mark.parametrize("block", [Planar, Kinematic, Car, Friction, Drivetrain])
def test_every_parameter_says_its_unit_and_its_meaning(block):
    found = dict(parameters(block))
    assert found
    for name, p in found.items():
        assert p.unit, name
        assert p.meaning, name
        assert p.low < p.high, name


def test_a_role_that_is_none_is_refused_where_the_class_is_written():
    with pytest.raises(ValueError, match="role = 'guessed': expected one of fitted, gain, offset, term"):
        parameter("m", "a length", role="guessed")
