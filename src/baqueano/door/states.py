"""The states of the vehicle, and the transitions between them.

    DISARMED ──ready──► READY ──mission──► MISSION ──done──► READY
        ▲                 │ └───manual───► MANUAL  ──done──► READY
        │                 └──not ready──► DISARMED
        └──clear── STOPPED ◄──stop── any state

A stop is latched with its reason: only a person takes it away, by `clear`, and then everything is checked again.
"""

from enum import StrEnum

from baqueano.diagnostics import Diagnostic, StopReason, stop
from baqueano.errors import SafetyStop
from baqueano.messages import text


class DoorState(StrEnum):
    """Names as people read them."""

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
    """The state, and why the vehicle does not drive; `why` is None where nothing is in the way."""

    def __init__(self) -> None:
        self.state = DoorState.DISARMED
        self.why: Diagnostic | None = stop(StopReason.NOT_CHECKED)

    def go(self, event: str, why: Diagnostic | None = None) -> None:
        """The next state. A stop keeps its first reason. SafetyStop where this state does not know the event."""
        target = NEXT.get((self.state, event))
        if target is None:
            because = f": {text(self.why)}" if self.why is not None else ""
            raise SafetyStop(f"the vehicle is {self.state}{because}. {self.advice}", self.why)
        if self.state is not DoorState.STOPPED or event != "stop":
            self.why = why
        self.state = target

    @property
    def advice(self) -> str:
        """Return the line by which a person can continue."""
        return {
            DoorState.DISARMED: "Mend that; it is checked again by itself.",
            DoorState.STOPPED: "Look at the vehicle, then type: baqueano robot clear",
        }.get(self.state, "Wait until it is done, or stop it: baqueano robot stop")
