"""An impossible parameter is refused at construction, with its name, its value and the valid range."""

import numpy as np
import pytest

from baqueano.parameter import parameter, parameters
from baqueano.vehicles import Car, Drivetrain, Friction, Kinematic, Planar
from tests.codes import refused

EYE = np.eye(3)
ERRORS = [
    (
        "field.range",
        {"field": "Planar.mass_kg", "value": "-0.61", "low": 0.001, "unit_name": "kg", "meaning": "mass m"},
        lambda: Planar(-0.61, 1.0, EYE),
    ),
    (
        "field.not-finite",
        {"field": "Planar.mass_kg", "value": "nan", "unit_name": "kg"},
        lambda: Planar(float("nan"), 1.0, EYE),
    ),
    ("field.not-finite", {"field": "Planar.mass_kg", "value": "inf"}, lambda: Planar(float("inf"), 1.0, EYE)),
    (
        "field.one-number",
        {"field": "Planar.mass_kg", "value": "'0.61'", "unit_name": "kg"},
        lambda: Planar("0.61", 1.0, EYE),
    ),
    ("field.one-number", {"field": "Planar.mass_kg", "value": "True"}, lambda: Planar(True, 1.0, EYE)),
    (
        "field.one-number",
        {"field": "Planar.inertia_kg_m2", "value": "array([1., 2.])"},
        lambda: Planar(1.0, np.array([1.0, 2.0]), EYE),
    ),
    (
        "field.shape",
        {"field": "Planar.actuator_matrix", "value": "(2, 2)", "expected": "(3, 3)"},
        lambda: Planar(1.0, 1.0, np.eye(2)),
    ),
    (
        "field.not-array",
        {"field": "Planar.actuator_matrix"},
        lambda: Planar(1.0, 1.0, [[1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    ),
    (
        "field.range",
        {"field": "Friction.linear", "value": "[1.0, -1.0, 0.0]", "low": 0.0},
        lambda: Friction(linear=np.array([1.0, -1.0, 0.0])),
    ),
    (
        "field.not-finite",
        {"field": "Friction.linear", "value": "[1.0, nan, 0.0]"},
        lambda: Friction(linear=np.array([1.0, np.nan, 0.0])),
    ),
    (
        "field.range",
        {"field": "Friction.coulomb_speed", "low": 0.0001},
        lambda: Friction(coulomb_speed=np.zeros(3)),
    ),
    ("field.range", {"field": "Car.wheelbase_m", "value": "0", "low": 0.001}, lambda: Car(0, 4.0, 0.3)),
    (
        "field.shape",
        {"field": "Kinematic.velocity_matrix", "value": "(3,)", "expected": "(3, 3)"},
        lambda: Kinematic(np.ones(3)),
    ),
]


@pytest.mark.parametrize(("code", "figures", "make"), ERRORS)
def test_impossible_parameters_are_refused(code, figures, make):
    with refused(code, ValueError, **figures):
        make()


@pytest.mark.parametrize("block", [Planar, Kinematic, Car, Friction, Drivetrain])
def test_every_parameter_has_a_unit_and_a_meaning(block):
    values = dict(parameters(block))
    assert values
    for name, p in values.items():
        assert p.unit, name
        assert p.meaning, name
        assert p.low < p.high, name


def test_an_unknown_parameter_role_is_refused_at_class_definition():
    with refused("field.role", ValueError, value="'guessed'"):
        parameter("m", "a length", role="guessed")
