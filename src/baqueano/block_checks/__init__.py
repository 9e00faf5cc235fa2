"""Checks of the promises of blocks: `check_estimator(block)` and its sisters return diagnostics for
the author, and none if all is well.

    pure            an argument, or the block itself, never changes
    deterministic   the same call gives the same numbers, bit for bit
    stamped         an output carries the time of what it answers
    wrapped         angles that leave a block lie within [−π, π]
    positive        covariances are symmetric, and have no negative eigenvalue
    anywhere        a clock that begins at an epoch gives what one gives that begins at 0
    alone           no clock, file, random number or print

`notes` says beside them whether a block can be compiled.
"""

from collections.abc import Callable

from baqueano.block_checks.compiling import notes
from baqueano.block_checks.motion import check_sensor, check_vehicle
from baqueano.block_checks.rooms import check_controller, check_estimator, check_guide, check_supervisor
from baqueano.contracts.blocks import SensorBlocks
from baqueano.diagnostics import Diagnostic

__all__ = [
    "CHECKS",
    "check",
    "check_controller",
    "check_estimator",
    "check_guide",
    "check_sensor",
    "check_supervisor",
    "check_vehicle",
    "notes",
]

CHECKS: dict[str, Callable[..., list[Diagnostic]]] = {
    "vehicle": check_vehicle,
    "sensor": check_sensor,
    "estimator": check_estimator,
    "guide": check_guide,
    "controller": check_controller,
    "supervisor": check_supervisor,
}


def check(
    room: str, block: object, sensors: SensorBlocks | None = None, commands: int = 3
) -> list[Diagnostic]:
    """Return what is wrong with a block, as its author reads it.

    Parameters
    ----------
    room : str
        "vehicle", "sensor", "estimator", "guide", "controller" or "supervisor".
    block : object
        The block, not its class.
    sensors : NamedTuple of Sensor, optional
        Sensors of the vehicle, for an estimator or a supervisor; else one IMU.
    commands : int
        Channels of the vehicle's command.

    Returns
    -------
    list of Diagnostic
        Empty where the block keeps its promises.

    Examples
    --------
    >>> check("sensor", bq.load("small").sensors.imu)
    []
    """
    if room in ("estimator", "supervisor"):
        return CHECKS[room](block, sensors, commands)
    return CHECKS[room](block, commands) if room == "controller" else CHECKS[room](block)
