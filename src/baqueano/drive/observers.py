"""Observers of a drive: each is called at every tick, and may stop the vehicle by what its signals do not show."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from baqueano.contracts.blocks import Supervision
from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic
from baqueano.loop import Blocks, Record
from baqueano.signals import Command, Estimate, Tick
from baqueano.supervisor import stop_reason

LastLine = tuple[str, str, Diagnostic | str]  # source, level, message


class Observer:
    """Watches and asks for nothing; a subclass overrides what it cares for.

    >>> class Loud(Observer):
    ...     def progress(self, done_s: float) -> None:
    ...         print(f"{done_s:.2f} s")
    """

    def begin(self, blocks: Blocks) -> Blocks:
        """Return the blocks that are to drive, those given or others around them, before the first tick."""
        return blocks

    def stop_reason(self, t_ns: int) -> Diagnostic | None:
        """Return why the vehicle must stop at `t_ns`; None if it may go on."""
        return None

    def marked(self) -> int:
        """Return how often a person said since the last tick that the vehicle is on its mark."""
        return 0

    def events(self) -> Iterable[LastLine]:
        """Return the events of the run since the last tick."""
        return ()

    def happened(self, t_ns: int, source: str, what: Diagnostic | str) -> None:
        """Hear an event of the run, once it is written."""

    def look(self, record: Record) -> None:
        """Take the record of a tick, once it is written."""

    def progress(self, done_s: float) -> None:
        """Take the seconds of the drive that are done, from time to time."""

    def unlogged(self, what: Diagnostic) -> None:
        """Hear that the disk takes no more of the run; a live drive goes on."""

    def ended(self, reason: Diagnostic | None) -> Iterable[LastLine]:
        """Return the last events of the run; `reason` is None if nothing stopped it."""
        return ()


@dataclass(frozen=True, eq=False)
class Progress(Observer):
    """Tells a function the seconds that are done."""

    tell: Callable[[float], object]

    def progress(self, done_s: float) -> None:
        """Tell them."""
        self.tell(done_s)


class WatchdogState(NamedTuple):
    """State of the watchdog: the supervisor's, and the reason for stopped motors."""

    supervisor: Tree
    reason: Diagnostic | None  # None while it goes on


@dataclass(frozen=True, slots=True, eq=False)
class Watchdog:
    """Stops for the reasons of `supervisor` and for those of the observers. Latched like those."""

    goes_around: ClassVar[tuple[str, ...]] = ("supervisor",)

    supervisor: Supervision
    observers: Sequence[Observer]

    def init(self) -> WatchdogState:
        """Not stopped."""
        return WatchdogState(self.supervisor.init(), None)

    def step(
        self, state: WatchdogState, command: Command, tick: Tick, estimate: Estimate
    ) -> tuple[WatchdogState, Command]:
        """The command (n,) that may reach the motors."""
        inner, safe_command = self.supervisor.step(state.supervisor, command, tick, estimate)
        # the cause before what follows from it
        reason = state.reason or self._reason(tick.t_ns) or stop_reason(inner)
        if reason is not None:
            safe_command = safe_command._replace(u=np.zeros(len(tick.u)))
        return WatchdogState(inner, reason), safe_command

    def _reason(self, t_ns: int) -> Diagnostic | None:
        reasons = [observer.stop_reason(t_ns) for observer in self.observers]
        return next((reason for reason in reasons if reason is not None), None)
