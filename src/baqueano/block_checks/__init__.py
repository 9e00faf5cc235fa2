"""Check the contracts of blocks: `check_estimator(block)` and the similar functions return diagnostics for the author.

    pure            arguments and the block itself never change
    deterministic   the same call gives the same results, bit for bit
    stamped         an output has the timestamp of its input
    wrapped         angles in outputs are within [−π, π]
    positive        covariances are symmetric, without a negative eigenvalue
    anywhere        a clock that begins at the epoch 1970 gives the same results as one that begins at 0
    alone           the block does not use a clock, file, random number or print

The list is empty if a block passes. `compilation_notes` reports if a block can be compiled.
"""

from collections.abc import Callable

from baqueano.block_checks.compiling import compilation_notes
from baqueano.block_checks.loop_blocks import check_controller, check_estimator, check_guide, check_supervisor
from baqueano.block_checks.motion import check_sensor, check_vehicle
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
    "compilation_notes",
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
    role: str, block: object, sensors: SensorBlocks | None = None, commands: int = 3
) -> list[Diagnostic]:
    """Return the faults of a block, as diagnostics for its author.

    Parameters
    ----------
    role : str
        Role of the block: "vehicle", "sensor", "estimator", "guide", "controller" or "supervisor".
    block : object
        The block, not its class.
    sensors : NamedTuple of Sensor, optional
        Sensors of the vehicle, for an estimator or a supervisor; the default is one IMU.
    commands : int
        Number of channels of the vehicle's command.

    Returns
    -------
    list of Diagnostic
        Empty if the block fulfils its contract.

    Examples
    --------
    >>> check("sensor", bq.load("small").sensors.imu)
    []
    """
    if role in ("estimator", "supervisor"):
        return CHECKS[role](block, sensors, commands)
    return CHECKS[role](block, commands) if role == "controller" else CHECKS[role](block)
