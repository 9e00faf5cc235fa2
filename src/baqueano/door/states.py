"""Define the states of the vehicle, and the transitions between them.

  DISARMED ──ready──► READY ──mission──► MISSION ──done──► READY
      ▲                 │ └───manual───► MANUAL  ──done──► READY
      │                 └──not ready──► DISARMED
      └──clear── STOPPED ◄──stop── any state

A stop is latched with its reason. Only a person can clear it, by `clear`; then all checks are made again.
"""

from enum import StrEnum

from baqueano.diagnostics import Diagnostic, StopReason, note, stop
from baqueano.door.operator import STOP_COMMAND, Operator
from baqueano.errors import SafetyStop


class DoorState(StrEnum):
    """The states of the vehicle, by the names that are shown to people."""

    DISARMED = "DISARMED"
    READY = "READY"
    MANUAL = "MANUAL"
    MISSION = "MISSION"
    STOPPED = "STOPPED"


NEXT_STATE = {
    (DoorState.DISARMED, "ready"): DoorState.READY,
    (DoorState.READY, "not ready"): DoorState.DISARMED,
    (DoorState.READY, "mission"): DoorState.MISSION,
    (DoorState.READY, "manual"): DoorState.MANUAL,
    (DoorState.MISSION, "done"): DoorState.READY,
    (DoorState.MANUAL, "done"): DoorState.READY,
    (DoorState.STOPPED, "clear"): DoorState.DISARMED,
    **{(state, "stop"): DoorState.STOPPED for state in DoorState},
}


class StateMachine:
    """The present state; `reason` states why the vehicle does not drive, None if it is allowed to drive."""

    def __init__(self) -> None:
        self.state = DoorState.DISARMED
        self.reason: Diagnostic | None = stop(StopReason.NOT_CHECKED)

    def transition(self, event: str, reason: Diagnostic | None = None) -> None:
        """Change to the state that follows an event.

        A second stop does not replace the reason of the first. Raise SafetyStop if the present state does not allow the
        event.
        """
        target = NEXT_STATE.get((self.state, event))
        if target is None:
            values = {"state": self.state, "advice": self.advice}
            if self.reason is None:
                raise SafetyStop.of("door.state", **values)
            raise SafetyStop.of("door.state-because", **values, cause=self.reason)
        if self.state is not DoorState.STOPPED or event != "stop":
            self.reason = reason
        self.state = target

    def finish_mission(self, operator: Operator, reason: Diagnostic | None, code: int) -> Diagnostic | None:
        """Change the state after a mission, and return the reason of a stop, None if the vehicle is ready again.

        A stop that was requested while the drive was prepared, or its run closed, counts after a regular end.
        """
        is_regular = reason is None or code or operator.is_end_requested
        stop_reason = operator.stop_reason(attended=False) if is_regular else reason
        self.transition("done" if stop_reason is None else "stop", stop_reason)
        operator.discard_requests(stop_reason)
        return stop_reason

    @property
    def advice(self) -> Diagnostic:
        """Return the advice on how to leave the present state."""
        if self.state is DoorState.DISARMED:
            return note("door.correct-and-wait")
        if self.state is DoorState.STOPPED:
            return note("door.clear", fix="baqueano robot clear HOST")
        return note("door.wait", fix=STOP_COMMAND)
