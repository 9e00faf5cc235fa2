"""Check if a block can be compiled with the same results. Otherwise the block runs uncompiled, and more slowly."""

from typing import Any

import numpy as np

from baqueano.block_checks.loop_blocks import TICK_NS, circle_readings, default_sensors
from baqueano.block_checks.motion import DT_S, circle_motion
from baqueano.block_checks.source import method_place
from baqueano.contracts.blocks import SensorBlocks
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.errors import error_text, is_interruption
from baqueano.signals import Command, Estimate, Reference, Tick
from baqueano.symbolic import TraceError, function

# relative; back ends agree to 1e-12 per step, and an ill-conditioned block amplifies this
RELATIVE_TOLERANCE = 1e-9


def compilation_notes(
    role: str, block: Any, sensors: SensorBlocks | None = None, commands: int = 3, backend: str = "python"
) -> list[Diagnostic]:
    """Return notes on a block that fulfils its contract, but cannot be compiled or gives other results when compiled.

    Parameters
    ----------
    role : str
        Role of the block, as `role` of `check`.
    block : object
        The block.
    sensors : NamedTuple of Sensor, optional
        Sensors of the vehicle; the default is one IMU.
    commands : int
        Number of channels of the vehicle's command.
    backend : str
        "python", "c" or "numpy".

    Returns
    -------
    list of Diagnostic
        Empty if the block can be compiled with the same results.

    Examples
    --------
    >>> compilation_notes("controller", bq.load("small").controller())
    []
    """
    block_class = type(block)
    subject, place_text = f"{block_class.__name__}.step()", method_place(block_class, "step")
    arguments = _step_arguments(role, block, default_sensors() if sensors is None else sensors, commands)
    try:
        compiled_output = function(block.step, *arguments, backend=backend)(*arguments)
    except TraceError as error:
        return [
            note("check.slow", Severity.WARNING, subject=subject, place=place_text, cause=error.diagnostic)
        ]
    except BaseException as error:
        if is_interruption(error):
            raise
        return [
            note(
                "check.not-compiled",
                Severity.WARNING,
                subject=subject,
                place=place_text,
                error=error_text(error),
            )
        ]
    if not _are_close(block.step(*arguments), compiled_output):
        return [note("check.compiled-output", Severity.WARNING, subject=subject, place=place_text)]
    return []


def _step_arguments(role: str, block: Any, sensors: SensorBlocks, n: int) -> tuple[Any, ...]:
    """Return the arguments of a step of the block, at a tick in the middle of a circle."""
    estimate = Estimate(5 * TICK_NS, np.array([0.1, 0.2, 0.3]), np.array([0.3, 0.0, 0.5]), 1e-4 * np.eye(6))
    reference = Reference(5 * TICK_NS, np.array([0.12, 0.21, 0.35]), estimate.nu, 0.0)
    tick = Tick(5 * TICK_NS, np.full(n, 0.3), circle_readings(sensors, 4))
    state = block.init()
    return {
        "vehicle": (state, np.full(getattr(block, "commands", n), 0.3), DT_S, np.zeros(3)),
        "sensor": (state, circle_motion(3), DT_S, np.zeros(getattr(block, "noise_size", 0))),
        "estimator": (state, tick),
        "guide": (state, estimate),
        "controller": (state, reference, estimate),
        "supervisor": (state, Command(tick.t_ns, np.full(n, 0.2)), tick, estimate),
    }[role]


def _are_close(a: object, b: object) -> bool:
    if isinstance(a, tuple):
        return isinstance(b, tuple) and len(a) == len(b) and all(map(_are_close, a, b))
    if a is None or isinstance(a, str):
        return a == b
    x, y = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    return x.shape == y.shape and bool(
        np.allclose(x, y, rtol=RELATIVE_TOLERANCE, atol=RELATIVE_TOLERANCE, equal_nan=True)
    )
