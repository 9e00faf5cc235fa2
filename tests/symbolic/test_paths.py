"""get and put: dotted paths into trees, copies that share unchanged parts, without range checks."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pytest

from baqueano.diagnostics import note
from baqueano.symbolic import function, value_at_path, with_value, with_values
from tests.codes import refused


@dataclass(frozen=True, slots=True, eq=False)
class Friction:
    linear: np.ndarray = field(default_factory=lambda: np.zeros(3))
    dry: float = 0.1

    def __post_init__(self) -> None:
        if self.dry < 0.0:
            raise ValueError("dry")


@dataclass(frozen=True, eq=False)
class Body:
    friction: Friction
    mass: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "computed", 2.0)


class System(NamedTuple):
    model: Body
    sensors: dict[str, list[float]]
    noise: np.ndarray | None = None


SYSTEM = System(Body(Friction(), 1.5), {"imu": [1.0, 2.0]})


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("model.mass", 3.0),
        ("model.friction.dry", -1.0),
        ("model.friction.linear[1]", 7.0),
        ("sensors.imu[0]", 5.0),
        ("sensors.imu[-1]", 6.0),
        ("noise", np.eye(2)),
    ],
)
def test_put_returns_a_changed_copy_and_preserves_the_original(path, value):
    before = value_at_path(SYSTEM, path)
    new = with_value(SYSTEM, path, value)
    assert np.all(value_at_path(new, path) == value)
    assert value_at_path(SYSTEM, path) is before or value_at_path(SYSTEM, path) == before
    assert type(new) is System
    assert type(new.model) is Body


def test_only_objects_on_the_path_are_copied():
    new = with_value(SYSTEM, "model.mass", 3.0)
    assert new.model.friction is SYSTEM.model.friction
    assert new.sensors is SYSTEM.sensors
    assert new.model.computed == 2.0  # pyright: ignore[reportAttributeAccessIssue]


def test_put_preserves_the_shape_and_the_other_entries_of_an_array():
    T = {"T": np.arange(6.0).reshape(2, 3)}
    assert with_value(T, "T[1,2]", 9.0)["T"].tolist() == [[0.0, 1.0, 2.0], [3.0, 4.0, 9.0]]
    assert with_value(T, "T[1]", np.zeros(3))["T"].tolist() == [[0.0, 1.0, 2.0], [0.0, 0.0, 0.0]]
    assert with_value((1.0, 2.0), "[1]", 3.0) == (1.0, 3.0)


def test_many_values_give_the_same_tree_as_one_after_the_other():
    values = [("model.mass", 3.0), ("model.friction.linear[2]", 5.0), ("model.friction.linear[0]", 7.0)]
    new = with_values(SYSTEM, values)
    for path, value in values:
        assert value_at_path(new, path) == value
    assert value_at_path(new, "model.friction.linear[1]") == value_at_path(SYSTEM, "model.friction.linear[1]")
    assert new.sensors is SYSTEM.sensors
    assert with_values(SYSTEM, []) is SYSTEM


def test_traced_values_can_be_put_into_blocks_and_arrays():
    def loss(theta):
        system = with_value(SYSTEM, "model.friction.linear[2]", theta[0])
        system = with_value(system, "model.friction.dry", theta[1])
        system = with_value(system, "model.mass", theta[0] * 2.0)
        friction = system.model.friction
        return friction.linear @ np.array([1.0, 1.0, 3.0]) + friction.dry - system.model.mass

    assert function(loss, np.zeros(2), backend="python")(np.array([2.0, -0.5])) == 1.5


@pytest.mark.parametrize(
    ("path", "kind", "suggestion"),
    [
        ("model.friction.lineer", "Friction", note("name.near", match="linear", valid="linear, dry")),
        ("model.mass.x", "float", note("name.none")),
        ("sensors.gps", "dict", note("name.unknown-only", valid="imu")),
        ("model.computed", "Body", note("name.unknown", valid="friction, mass")),
    ],
)
def test_an_unknown_name_is_refused_with_valid_names(path, kind, suggestion):
    for call in (lambda: value_at_path(SYSTEM, path), lambda: with_value(SYSTEM, path, 1.0)):
        with refused("path.no-such-name", AttributeError, kind=kind, suggestion=suggestion):
            call()


def test_an_index_out_of_range_is_an_index_error():
    with pytest.raises(IndexError):
        with_value(SYSTEM, "sensors.imu[5]", 1.0)
    with pytest.raises(IndexError):
        with_value(SYSTEM, "model.friction.linear[3]", 1.0)
