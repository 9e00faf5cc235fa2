"""The vehicle's supervisor, and beside it what arithmetic on signals cannot see: a silent link, a tilt, a hand."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from baqueano.diagnostics import Diagnostic
from baqueano.signals import Command, Estimate, Tick
from baqueano.supervisor import stop_reason


class WatchdogState(NamedTuple):
    """What the supervisor remembers, and why there is no motion any more."""

    supervisor: Any
    why: Diagnostic | None  # None while it goes on


@dataclass(frozen=True, slots=True, eq=False)
class Watchdog:
    """Stops for the reasons of `supervisor` and for those of `reasons`. Latched like those."""

    supervisor: Any
    reasons: Callable[[int], Diagnostic | None]  # why to stop at t_ns; None to go on

    def init(self) -> WatchdogState:
        """Not stopped."""
        return WatchdogState(self.supervisor.init(), None)

    def step(
        self, state: WatchdogState, command: Command, tick: Tick, estimate: Estimate
    ) -> tuple[WatchdogState, Command]:
        """The command (n,) that may reach the motors."""
        inner, allowed = self.supervisor.step(state.supervisor, command, tick, estimate)
        why = (
            state.why or self.reasons(tick.t_ns) or stop_reason(inner)
        )  # the cause before what follows from it
        if why is not None:
            allowed = allowed._replace(u=np.zeros(len(tick.u)))
        return WatchdogState(inner, why), allowed
