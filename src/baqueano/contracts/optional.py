"""The optional attributes of blocks with their defaults: the one module that asks a block for its attributes.

A class of yours needs the methods of its room's protocol (blocks.py, vehicles/vehicle.py) and none of these names.
"""

import dataclasses
from collections.abc import Iterator

from baqueano.contracts.values import Tree

INF = float("inf")
NEUTRAL: dict[str, object] = {
    # of a vehicle
    "nu_dot": None,  # its acceleration (3,); without one a command is a velocity
    "turning_arm_m": None,  # by which a push turns it
    # of a sensor
    "delay_slots": 0,  # past ticks that it keeps for its delay
    "has_low_pass": False,
    "usual_std": None,  # (m,) of the noise of such a sensor, where nobody measured it
    "cov": None,  # Q (m, m); a sensor that is only read has none
    "limit": INF,  # end of its range
    "detects": None,  # whether it has something to measure there; it always has
    "difference": None,  # z − expected (m,) of an angle; it is plain
    "reads": "",  # the part of a real vehicle that it shows: imu, wheels, odometer, encoders, mark; none of them
    "mistakes": None,  # what z lacks if it took one thing for another (k, m); it never does
    # of an estimator
    "has_kalman_gains": True,
    "row": None,  # the step of one row, where `step` has a loop over time
    "stacks_innovations": False,  # whether its innovations are those of the sensors in `use`, one after the other
    # of a guide
    "laps": None,  # how often it goes round
    "joined": None,  # its state where the vehicle joins its route at a time of it; it has begun so much before
    "want": None,  # takes the pace that somebody wants, while it is driven
    # of any block
    "as_written": False,  # it asks a person, a clock or a library, so its step is never compiled
    "goes_around": (),  # names of its fields with the blocks that it goes around, and of their states in its own
    "diagnostic": None,  # state → the Diagnostic that the run is to hold of this tick, or None; it never has one
}


def of(block: object, name: str) -> Tree:
    """Return what the block has of this name, else what stands for it; KeyError for a name that is not above."""
    return getattr(block, name, NEUTRAL[name])


def nested(block: object) -> Iterator[Tree]:
    """Yield the block and those that it goes around, from outside to inside."""
    yield block
    for name in of(block, "goes_around"):
        yield from nested(getattr(block, name))


def is_dynamic(vehicle: object) -> bool:
    """Return True for a model with an acceleration, False for one in which the command is a velocity."""
    return of(vehicle, "nu_dot") is not None


def has_field(block: object, name: str) -> bool:
    """Return True for a block whose author gave it a parameter of this name: a gyro has a `gyro_scale`."""
    return dataclasses.is_dataclass(block) and name in (field.name for field in dataclasses.fields(block))
