"""Define the optional attributes of blocks with their defaults. Only this module reads optional attributes of a block.

Your own class needs only the methods of its protocol (blocks.py, vehicles/state.py), not these attributes.
"""

import dataclasses
from collections.abc import Iterable, Iterator
from functools import lru_cache

from baqueano.contracts.values import Tree
from baqueano.errors import UsageError

INF = float("inf")
DEFAULTS: dict[str, object] = {
    # of a vehicle
    "nu_dot": None,  # its acceleration (3,); without this method a command is a velocity
    "turning_arm_m": None,  # ν̇_y per ν̇_ψ [m]: position of the origin forward of the centre of turning
    "viscous_effort": None,  # ν → effort (n,) that balances the viscous drag; without it, no back-EMF
    # of its drivetrain: axes along which a command acts: forward, sideways, turning
    "driven_axes": (0, 1, 2),
    # of a sensor
    "delay_slots": 0,  # number of past ticks that are stored for the delay
    "has_low_pass": False,
    "averages": False,  # True if a reading is the mean of h over the time between two readings
    "usual_std": None,  # (m,) usual standard deviation of the noise, if it was not measured
    "cov": None,  # Q (m, m); None for a sensor that is only recorded
    "limit": INF,  # full scale: largest absolute reading
    "rate_hz": INF,  # readings per second; INF: it measures only at some places
    "detects": None,  # motion → True if the sensor can measure; default: always
    "difference": None,  # z − expected (m,), for an angle; default: the plain difference
    "reads": "",  # the part of a real vehicle that it reads: imu, wheels, odometer, encoders, mark; default: none
    "mistakes": None,  # z → corrections (k, m) of z for each possible mistake of a tag; default: no mistakes
    # of an estimator
    "row": None,  # the step of one row, if `step` has a loop over time
    "row_errors": None,  # the same with RowErrors (smoother.py), if the gains are not Kalman's
    "stacks_innovations": False,  # True if the innovations are those of the sensors in `use`, one after the other
    # of a guide
    "laps": None,  # number of laps
    "entry_state": None,  # the state of a guide whose vehicle joins the route later, with a speed
    "set_pace": None,  # sets the pace that the operator requests during a drive
    # of any block
    "is_compiled": False,  # True if a step always returns the classes and shapes of its first step
    "is_interpreted": False,  # True if the step uses a person, a clock or a library: it is never compiled
    "inner_blocks": (),  # names of the fields with inner blocks, and of their states
    "diagnostic": None,  # state → the Diagnostic of this tick for the run, or None; default: always None
}


def attribute(block: object, name: str) -> Tree:
    """Return the optional attribute `name` of a block, or its default. Raise KeyError for a name without a default."""
    return getattr(block, name, DEFAULTS[name])


def nested_blocks(block: object) -> Iterator[Tree]:
    """Yield the block and the blocks that it contains, from outside to inside."""
    yield block
    for name in attribute(block, "inner_blocks"):
        yield from nested_blocks(getattr(block, name))


def is_dynamic(vehicle: object) -> bool:
    """Return True for a model with an acceleration; False for a model in which the command is a velocity."""
    return attribute(vehicle, "nu_dot") is not None


def turning_arm_m(vehicle: object) -> Tree:
    """Return b [m], the distance from the centre of turning forward to the origin; 0 if the model does not name it."""
    arm = attribute(vehicle, "turning_arm_m")
    return 0.0 if arm is None else arm


def check_noise_fields(sensors: Iterable[object]) -> None:
    """Raise UsageError for a sensor without a field for the noise that a fit measures."""
    for sensor in sensors:
        if not has_field(sensor, "measurement_noise_cov"):
            raise UsageError.of("noise.no-field", block=type(sensor).__name__)


def has_field(block: object, name: str) -> bool:
    """Return True for a dataclass with a field of this name: a gyro has the field `gyro_scale`."""
    return name in _field_names(block if isinstance(block, type) else type(block))


@lru_cache(maxsize=1000)
def _field_names(block_class: type) -> frozenset[str]:
    is_dataclass = dataclasses.is_dataclass(block_class)
    return frozenset(field.name for field in dataclasses.fields(block_class)) if is_dataclass else frozenset()
