"""Define observers of a drive, which are called at every tick and can stop the vehicle."""

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

EventLine = tuple[str, str, Diagnostic | str]  # source, level, message


class Observer:
    """An observer that does nothing; a subclass overrides the methods that it needs.

    >>> class Loud(Observer):
    ...     def progress(self, done_s: float) -> None:
    ...         print(f"{done_s:.2f} s")
    """

    def begin(self, blocks: Blocks) -> Blocks:
        """Return the blocks that will drive, unchanged or wrapped; called before the first tick."""
        return blocks

    def stop_reason(self, t_ns: int) -> Diagnostic | None:
        """Return the reason to stop the vehicle at `t_ns`, or None to continue."""
        return None

    def pop_mark_count(self) -> int:
        """Return how often a person has reported since the last tick that the vehicle is on the mark."""
        return 0

    def events(self) -> Iterable[EventLine]:
        """Return the events since the last tick, to be written into the run."""
        return ()

    def on_event(self, t_ns: int, source: str, event: Diagnostic | str) -> None:
        """Receive an event of the run, once it is written."""

    def on_record(self, record: Record) -> None:
        """Receive the record of a tick, once it is written."""

    def progress(self, done_s: float) -> None:
        """Receive the duration [s] of the drive so far, from time to time."""

    def on_disk_full(self, reason: Diagnostic) -> None:
        """Receive the message that the disk is full and the rest of the run is not stored; a live drive continues."""

    def end(self, reason: Diagnostic | None) -> Iterable[EventLine]:
        """Return the last events of the run; `reason` is the reason of the stop, None if the drive was not stopped."""
        return ()


def select_observers(observers: Sequence[Observer], method: str) -> list[Observer]:
    """Return the observers that override a method; in the others it does nothing."""
    default = getattr(Observer, method)
    return [x for x in observers if getattr(getattr(x, method), "__func__", None) is not default]


@dataclass(frozen=True, eq=False)
class Progress(Observer):
    """An observer that passes the duration of the drive so far to a function."""

    callback: Callable[[float], object]

    def progress(self, done_s: float) -> None:
        """Pass the duration [s] to `callback`."""
        self.callback(done_s)


class WatchdogState(NamedTuple):
    """State of the watchdog: the supervisor's state, and the reason why the motors are stopped."""

    supervisor: Tree
    reason: Diagnostic | None  # None while the vehicle is not stopped


@dataclass(frozen=True, slots=True, eq=False)
class Watchdog:
    """A supervisor that also stops for the reasons of the observers; both kinds of stop are latched."""

    inner_blocks: ClassVar[tuple[str, ...]] = ("supervisor",)

    supervisor: Supervision
    observers: Sequence[Observer]

    def init(self) -> WatchdogState:
        """Return the state of a vehicle that is not stopped."""
        return WatchdogState(self.supervisor.init(), None)

    def step(
        self, state: WatchdogState, command: Command, tick: Tick, estimate: Estimate
    ) -> tuple[WatchdogState, Command]:
        """Return the new state, and the command (n,) for the motors, which is zero once a stop is latched."""
        inner_state, safe_command = self.supervisor.step(state.supervisor, command, tick, estimate)
        # the first cause has priority over its consequences
        reason = state.reason or self._reason(tick.t_ns) or stop_reason(inner_state)
        if reason is not None:
            safe_command = safe_command._replace(u=np.zeros(len(tick.u)))
        return WatchdogState(inner_state, reason), safe_command

    def _reason(self, t_ns: int) -> Diagnostic | None:
        reasons = [observer.stop_reason(t_ns) for observer in self.observers]
        return next((reason for reason in reasons if reason is not None), None)
