"""Check the world of a user and its ticks, so that an error names the world and not a block of the loop."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from baqueano.contracts.blocks import World
from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, fault
from baqueano.errors import UsageError
from baqueano.signals import Tick

MEMBERS = ("commands", "read", "write")  # of each world


def check_world(world: object) -> None:
    """Raise UsageError for a class, or for an object without MEMBERS."""
    name = world.__name__ if isinstance(world, type) else type(world).__name__
    if isinstance(world, type):
        raise UsageError.of("world.is-class", f"world={name}()", world=name)
    if missing_names := [member for member in MEMBERS if member not in dir(world)]:
        raise UsageError.of("world.incomplete", "help(bq.worlds.World)", world=name, names=missing_names)


def with_checked_ticks(world: World, example: Tick) -> World:
    """Return the world of a user; its `read` raises UsageError for ticks unlike the tick `example`."""
    checked_world: Tree = _CheckedWorld(world, example)
    return checked_world


class _CheckedWorld:
    """The world of a user with checks of its ticks; everything else comes from the user's world."""

    def __init__(self, world: World, example: Tick) -> None:
        self._world, self._example, self._last_ns = world, example, -1

    def __getattr__(self, name: str) -> Tree:
        """Return the attribute `name` of the user's world."""
        return getattr(self._world, name)

    def read(self, t_ns: int) -> list[Tick]:
        """Return the ticks of the user's world. Raise UsageError for other values than a list of such ticks."""
        ticks = self._world.read(t_ns)
        reason = self._tick_fault(ticks, t_ns)
        if reason is not None:
            raise UsageError(reason)
        self._last_ns = t_ns
        return ticks

    def _tick_fault(self, ticks: Sequence[Tick], t_ns: int) -> Diagnostic | None:
        figures: dict[str, Any] = {"world": type(self._world).__name__}
        if not isinstance(ticks, list | tuple) or not all(isinstance(tick, Tick) for tick in ticks):
            return fault("world.ticks", **figures, value=type(ticks).__name__)
        times_ns = [self._last_ns, *(tick.t_ns for tick in ticks)]
        if times_ns[-1] != t_ns or any(b <= a for a, b in pairwise(times_ns)):
            return fault("world.times", **figures, value=str(times_ns[1:]), expected=t_ns)
        for tick in ticks:
            expected_u, expected_slots = self._example.u, self._example.sensors._asdict()
            if np.shape(tick.u) != expected_u.shape:
                return fault(
                    "world.command", **figures, value=str(np.shape(tick.u)), expected=str(expected_u.shape)
                )
            if {*tick.sensors._fields} != {*expected_slots}:
                names = {"value": ", ".join(tick.sensors._fields), "expected": ", ".join(expected_slots)}
                return fault("world.sensors", **figures, **names)
            for name, slot in tick.sensors._asdict().items():
                shape, expected_shape = np.shape(slot.z), expected_slots[name].z.shape
                if shape != expected_shape:
                    shapes = {"value": str(shape), "expected": str(expected_shape)}
                    return fault("world.reading", subject=name, **figures, **shapes)
        return None
