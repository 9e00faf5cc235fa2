"""Apply changes of gains and pace during a drive: between two ticks, each with an event in the run.

The client that drives, the holder, requests the changes. The run also records, at its first tick, the blocks that a
mission uses instead of the blocks of its vehicle file. Two kinds of parameters can be set: numeric parameters of the
controller, and `guide.pace` of a repetition, from 0 to 1. At pace 0 the vehicle brakes and waits, at 1 it drives at
full pace. The limits of the supervisor clip each command of a controller. A changed controller runs as Python code, in
about 0.1 ms per tick, because compiling it would delay the loop.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.time_limit import within
from baqueano.contracts.values import JsonObject, Tree
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.door.frames.descriptions import adjustable_names
from baqueano.drive.budget import BudgetedBlock
from baqueano.drive.observers import EventLine, Observer
from baqueano.errors import DiagnosticError, Invalid, error_text
from baqueano.loop import Blocks
from baqueano.signals import Command, Estimate, Reference

if TYPE_CHECKING:
    from baqueano.door.operator import Operator

SOURCE, SWAP, ROOM = "set", "swap", "controller"
PACE, HOLDER = "guide.pace", "holder"
MAX_INTEGER = 2**53  # every smaller integer is exact as a float


class AdjustableController:
    """A wrapper of a controller whose parameters can change between two ticks."""

    def __init__(self, block: Tree) -> None:
        self.block = block

    def init(self) -> Tree:
        """Return the initial state of the wrapped controller."""
        return self.block.init()

    def step(self, state: Tree, reference: Reference, estimate: Estimate) -> tuple[Tree, Command]:
        """Return the new state and the command of the wrapped controller."""
        return self.block.step(state, reference, estimate)

    def change(self, path: str, value: object) -> Diagnostic:
        """Set a parameter by its path, and return the message about the change.

        Raise Invalid if the path or the value is not allowed.
        """
        inner_block = getattr(self.block, "block", self.block)
        role, _, name = path.partition(".")
        paths = [f"{ROOM}.{name}" for name in adjustable_names(inner_block)]
        if role != ROOM or path not in paths:
            raise Invalid.of("door.not-settable", path=repr(path), valid=paths)
        old_value = np.asarray(getattr(inner_block, name))
        try:
            new_value = np.asarray(value, dtype=float)
        except (TypeError, ValueError, OverflowError):
            new_value = np.array(np.nan)
        if new_value.shape != old_value.shape or not np.all(np.isfinite(new_value)):
            raise Invalid.of("door.not-a-number", name=path, value=repr(value)[:80])
        if old_value.dtype.kind == "i":
            if np.any(new_value != np.round(new_value)) or np.any(np.abs(new_value) > MAX_INTEGER):
                raise Invalid.of("door.not-an-integer", name=path, value=repr(value)[:80])
            new_value = new_value.astype(old_value.dtype)
        number = new_value.item() if new_value.ndim == 0 else new_value
        try:
            self.block = self._replace_gains(inner_block, {name: number})
        except DiagnosticError as error:
            raise Invalid(error.diagnostic) from error
        except Exception as error:  # code of the user, which must not end the drive
            figures = {
                "value": repr(value)[:80],
                "former_value": str(old_value.tolist()),
                "error": error_text(error),
            }
            raise Invalid.of("door.gain-refused", name=path, **figures) from error
        return note(
            "door.set", path=path, former_value=str(old_value.tolist()), value=str(new_value.tolist())
        )

    def _replace_gains(self, inner_block: Tree, values: dict[str, object]) -> Tree:
        """Return the controller with new values; a block of the user is made within its budget of time."""
        if not isinstance(self.block, BudgetedBlock):
            return replace(inner_block, **values)
        new_block = within(self.block.budget_s, lambda: replace(inner_block, **values))
        return replace(self.block, block=new_block)


class ChangeObserver(Observer):
    """Observer of one drive that applies the holder's changes; each change is recorded and sent to the clients."""

    def __init__(
        self,
        operator: "Operator",
        broadcast: Callable[[JsonObject], None],
        blocks: "dict[str, str] | None" = None,
    ) -> None:
        self._operator, self._broadcast = operator, broadcast
        self._blocks = dict(blocks or {})  # role → kind that replaces the file's, not recorded yet
        self._controller = AdjustableController(None)
        self._set_pace: Callable[[str, float], None] | None = None
        self._pace = 1.0
        operator.pop_changes()  # drop changes from before this drive

    def begin(self, blocks: Blocks) -> Blocks:
        self._controller = AdjustableController(blocks.controller)
        self._set_pace = optional.attribute(blocks.guide, "set_pace")
        return blocks._replace(controller=self._controller)

    def events(self) -> list[EventLine]:
        lines: list[EventLine] = []
        while self._blocks:
            role, kind = self._blocks.popitem()
            lines.append((SWAP, str(Severity.INFO), note("door.block-replaced", role=role, kind=kind)))
        for path, value in self._operator.pop_changes():
            try:
                diagnostic, level = self._change(path, value), Severity.INFO
            except Invalid as error:
                diagnostic, level = error.diagnostic, Severity.WARNING
            self._broadcast({"type": "event", "level": str(level), "message": diagnostic})
            lines.append((SOURCE, str(level), diagnostic))
        return lines

    def _change(self, path: str, value: object) -> Diagnostic:
        """Set the pace or a parameter of the controller, and return the message about the change.

        Raise Invalid if the path or the value is not allowed.
        """
        if path != PACE or self._set_pace is None:
            return self._controller.change(path, value)
        try:
            pace = float(value)  # pyright: ignore[reportArgumentType]
        except (TypeError, ValueError, OverflowError):
            pace = float("nan")
        if not 0.0 <= pace <= 1.0:
            raise Invalid.of("door.guide-pace", value=repr(value)[:80])
        self._set_pace(HOLDER, pace)
        old_pace, self._pace = self._pace, pace
        return note("door.set", path=path, former_value=str(old_pace), value=str(pace))
