"""Implement `--robot emulated`: the real firmware on an emulated Uno, the drivers of the vehicle, a simulated body.

The emulator is simavr under the GPL. It is therefore not part of the package and works only from the source tree, where
tests/emulated connects it to the rest.
"""

import importlib
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import baqueano
from baqueano.contracts.values import JsonObject
from baqueano.errors import UsageError
from baqueano.symbolic.c_code.compile import user_cache

if TYPE_CHECKING:
    from baqueano.vehicle_file.file import VehicleFile

REPOSITORY = Path(baqueano.__file__).resolve().parents[2]


@contextmanager
def emulate_vehicle(
    vehicle_file: "VehicleFile", truth: object, seed: int = 0
) -> Iterator[Callable[[], JsonObject]]:
    """Yield a function that returns the options `world` and `tick_times_ns` for the next drive on the emulated vehicle.

    `truth` is the vehicle file of the simulated body. Raise UsageError outside a source tree, or if Debian packages are
    missing; the error names these packages.

    >>> from baqueano.drive import experiment
    >>> from baqueano.vehicle_file import load
    >>> with emulate_vehicle(load("small"), load("small")) as one_drive:
    ...     run = experiment(load("small"), [[0.0, 0.0, 0.6]] * 50, **one_drive())
    >>> print(f"{run.applied_commands[-1, 2]:.1f} reached the motors, {run.truth.nu[-1, 2]:.0f} rad/s")
    0.6 reached the motors, 4 rad/s
    """
    if not (REPOSITORY / "tests" / "emulated" / "robot.py").is_file():
        raise UsageError.of("emulated.no-source")
    if str(REPOSITORY) not in sys.path:
        sys.path.append(str(REPOSITORY))
    rig = importlib.import_module("tests.emulated.rig")
    if lacking := rig.missing():
        raise UsageError.of("emulated.no-packages", f"sudo apt-get install {' '.join(lacking)}")
    robot = importlib.import_module("tests.emulated.robot")
    world, _ = robot.make_world(rig.build(user_cache() / "emulated"), vehicle_file, truth, seed)
    try:
        yield lambda: {"world": world, "tick_times_ns": world.ticks(vehicle_file.rate_hz)}
    finally:
        world.robot.close()
