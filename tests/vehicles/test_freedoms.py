"""The possible motions of a vehicle are derived from its equations and compared with hand calculations."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from baqueano.parameter import all_parameters, parameter
from baqueano.vehicle_file import load
from baqueano.vehicles import Car, Drivetrain, Friction, Kinematic, Planar
from baqueano.vehicles.freedoms import (
    coasting_axes,
    damping_derivatives,
    decay_rates,
    dry_friction_speeds,
    is_steered,
    is_turned_by_last_command,
    quadratic_damping,
)

SMALL, CAR, KINEMATIC = load("small").vehicle, load("car").vehicle, Kinematic(np.eye(3))
OMNI = load(Path(__file__).parents[2] / "examples" / "omni_robot.toml").vehicle


@pytest.mark.parametrize(("vehicle", "entries"), [(SMALL, (0, 1, 2)), (CAR, (0, 2)), (KINEMATIC, ())])
def test_the_velocities_that_persist_without_effort_depend_on_the_vehicle(vehicle, entries):
    assert coasting_axes(vehicle) == entries


@dataclass(frozen=True, slots=True, eq=False)
class Cart(Car):
    """A car with rails instead of a road: a user's own friction."""

    rail: float = parameter("m/s²", "dry friction of the rail", default=0.0, sign_speed="rail_speed")
    rail_speed: float = parameter("m/s", "speed over which it changes its sign", default=0.01)


@pytest.mark.parametrize(
    ("vehicle", "speeds"),
    [
        (SMALL, [0.05, np.inf, 0.5]),
        (KINEMATIC, [np.inf] * 3),
        (Cart(1.0, 0.3, 0.4), [np.inf] * 3),
        (Cart(1.0, 0.3, 0.4, rail=2.0), [0.01, np.inf, np.inf]),
        (Car(1.0, 0.3, 0.4, coulomb_backward_m_s2=0.2), [0.05, np.inf, np.inf]),
    ],
)
def test_the_metadata_names_the_speed_of_dry_friction(vehicle, speeds):
    np.testing.assert_array_equal(dry_friction_speeds(vehicle), speeds)


@pytest.mark.parametrize(("vehicle", "does"), [(SMALL, False), (CAR, True), (KINEMATIC, False)])
def test_only_a_car_is_classified_as_steered(vehicle, does):
    assert is_steered(vehicle) is does


def test_a_vehicle_with_a_large_dead_zone_is_not_classified_as_steered():
    zones = {f"model.drivetrain.dead_zone_{direction}": [2.0, 2.0] for direction in ("forward", "backward")}
    limits = {"model.drivetrain.limit": [6.0], "command.limit": [6.0, 0.0, 6.0]}
    blunt = load("small").with_values(zones | limits)
    assert not is_steered(blunt.vehicle)
    assert is_turned_by_last_command(blunt.vehicle)


@pytest.mark.parametrize(("vehicle", "does"), [(SMALL, True), (CAR, True), (OMNI, False)])
def test_vehicles_that_can_turn_are_recognised(vehicle, does):
    assert is_turned_by_last_command(vehicle) is does


def test_the_decay_rate_is_friction_over_mass():
    friction = Friction(linear=np.array([3.0, 4.0, 0.01]), coulomb=np.array([0.2, 0.0, 0.0]))
    vehicle = Planar(0.5, 0.002, np.eye(3), friction=friction)
    assert decay_rates(vehicle) == pytest.approx([(3.0 + 0.2 / 0.05) / 0.5, 8.0, 5.0], rel=1e-6)
    fields = [path for path, _ in all_parameters(vehicle, "model")]
    slope_by_path = dict(damping_derivatives(vehicle, fields))
    assert slope_by_path["model.friction.linear[1]"] == pytest.approx([0.0, 2.0, 0.0])
    assert slope_by_path["model.friction.coulomb[0]"] == pytest.approx([1.0 / 0.5 / 0.05, 0.0, 0.0])
    assert not {"model.mass_kg", "model.friction.quadratic[0]", "model.actuator_matrix[0,0]"} & set(
        slope_by_path
    )


def test_the_yaw_decay_rate_of_a_car_is_one_over_its_lag():
    car = Car(0.15, 7.0, 0.4, linear_drag=2.0, yaw_lag_s=0.05, drivetrain=Drivetrain(commands=2))
    assert decay_rates(car) == pytest.approx([2.0, 0.0, 20.0], rel=1e-6)
    assert decay_rates(KINEMATIC).tolist() == [0.0, 0.0, 0.0]


def test_a_friction_with_the_square_of_the_speed_is_distinguished_from_a_linear_friction():
    friction = Friction(linear=np.array([3.0, 4.0, 0.01]), quadratic=np.array([0.0, 6.0, 0.0]))
    vehicle = Planar(0.5, 0.002, np.eye(3), friction=friction)
    k_by_path = dict(quadratic_damping(vehicle, [path for path, _ in all_parameters(vehicle, "model")]))
    assert set(k_by_path) == {f"model.friction.quadratic[{i}]" for i in range(3)}
    assert k_by_path["model.friction.quadratic[1]"] == pytest.approx([0.0, 2.0, 0.0])
