"""The states of the vehicle, and the transitions between them.

  DISARMED ──ready──► READY ──mission──► MISSION ──done──► READY
      ▲                 │ └───manual───► MANUAL  ──done──► READY
      │                 └──not ready──► DISARMED
      └──clear── STOPPED ◄──stop── any state

A stop is latched with its reason: only a person clears it, by `clear`, and then everything is checked again.
"""

from enum import StrEnum

from baqueano.diagnostics import Diagnostic, StopReason, fault, note, stop
from baqueano.errors import SafetyStop


class DoorState(StrEnum):
    """The names of the states as people read them."""

    DISARMED = "DISARMED"
    READY = "READY"
    MANUAL = "MANUAL"
    MISSION = "MISSION"
    STOPPED = "STOPPED"


NEXT = {
    (DoorState.DISARMED, "ready"): DoorState.READY,
    (DoorState.READY, "not ready"): DoorState.DISARMED,
    (DoorState.READY, "mission"): DoorState.MISSION,
    (DoorState.READY, "manual"): DoorState.MANUAL,
    (DoorState.MISSION, "done"): DoorState.READY,
    (DoorState.MANUAL, "done"): DoorState.READY,
    (DoorState.STOPPED, "clear"): DoorState.DISARMED,
    **{(state, "stop"): DoorState.STOPPED for state in DoorState},
}


class Machine:
    """The state, and the reason why the vehicle does not drive; `reason` is None if it may drive."""

    def __init__(self) -> None:
        self.state = DoorState.DISARMED
        self.reason: Diagnostic | None = stop(StopReason.NOT_CHECKED)

    def go(self, event: str, reason: Diagnostic | None = None) -> None:
        """Change to the next state.

        A stop keeps its first reason. Raise SafetyStop if this state does not allow the event.
        """
        target = NEXT.get((self.state, event))
        if target is None:
            figures = {"state": self.state, "advice": self.advice}
            if self.reason is None:
                raise SafetyStop(fault("door.state", **figures))
            raise SafetyStop(fault("door.state-because", **figures, cause=self.reason), self.reason)
        if self.state is not DoorState.STOPPED or event != "stop":
            self.reason = reason
        self.state = target

    @property
    def advice(self) -> Diagnostic:
        """Return the advice to a person for leaving this state."""
        if self.state is DoorState.DISARMED:
            return note("door.mend")
        if self.state is DoorState.STOPPED:
            return note("door.clear", fix="baqueano robot clear")
        return note("door.wait", fix="baqueano robot stop")
