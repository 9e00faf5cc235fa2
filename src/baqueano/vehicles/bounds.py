"""Check the parameters of a block: shape, finite values, and the bounds of each field.

The check runs once, when a block is built, and not while the vehicle moves or a step is traced.
"""

import numpy as np

from baqueano.contracts.values import Tree, Value
from baqueano.errors import Invalid
from baqueano.parameter import INF, Parameter, parameters


def check_bounds(block: Tree) -> None:
    """Raise Invalid with the block, the field, the value found and the value expected, if a parameter is not valid."""
    for name, p in parameters(block):
        value = getattr(block, name)
        # without arrays, which take most of the time
        is_sure = p.shape == () and isinstance(value, float) and p.low <= value <= p.high and abs(value) < INF
        if value is None or is_sure:
            continue
        field_name = f"{type(block).__name__}.{name}"
        _check_type(field_name, value, p)
        _check_values(field_name, np.asarray(value), p)


def check_commands(vehicle: Tree, names: str) -> None:
    """Raise Invalid if the drivetrain of a vehicle has another number of commands than the vehicle (`names`)."""
    model, drivetrain = type(vehicle).__name__, vehicle.drivetrain
    if drivetrain.commands != vehicle.commands:
        figures = {"commands": vehicle.commands, "names": names, "rows": drivetrain.commands}
        raise Invalid.of("vehicle.commands", model=model, **figures)


def check_limit(controller: Tree) -> None:
    """Raise Invalid if the number of limits of a controller is not the number of commands of its vehicle."""
    if controller.limit.shape != (controller.vehicle.commands,):
        shape, commands = str(controller.limit.shape), controller.vehicle.commands
        raise Invalid.of("field.limit", block=type(controller).__name__, value=shape, commands=commands)


def _check_type(field_name: str, value: Value, p: Parameter) -> None:
    figures = {"field": field_name, "unit_name": p.unit, "meaning": p.meaning}
    if p.shape == () and (np.ndim(value) != 0 or isinstance(value, bool | str)):
        raise Invalid.of("field.one-number", value=repr(value), **figures)
    if p.shape != () and not isinstance(value, np.ndarray):
        raise Invalid.of("field.not-array", field=field_name, value=repr(value), meaning=p.meaning)
    if p.shape is not None and np.shape(value) != p.shape:
        raise Invalid.of("field.shape", value=str(np.shape(value)), expected=str(p.shape), **figures)


def _check_values(field_name: str, value: np.ndarray, p: Parameter) -> None:
    figures = {"field": field_name, "unit_name": p.unit, "meaning": p.meaning}
    if np.isnan(value).any() or (p.high < INF and np.isinf(value).any()):
        raise Invalid.of("field.not-finite", value=str(value.tolist()), **figures)
    if (value < p.low).any() or (value > p.high).any():
        raise Invalid.of("field.range", value=str(value.tolist()), low=p.low, high=p.high, **figures)
