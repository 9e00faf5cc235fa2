"""Begin and end faults of a drive, list the checks that detected them, and repeat the drive without some faults.

  shake {kind, …}              begins a fault with the next tick; the fields are in worlds/faults/fault.py
  shake {end: number}          ends the fault with this number
  again {from_s, without}      repeats the mission with the same seed, without the faults of these numbers, or without
                               any fault; until `from_s` as fast as it can be computed. The present drive ends first
  ledger {rows}                sent when something changes: number, t_s, until_s, ended, message, detections
                               [detector, after_s, message], missed_by, undetected

`message`, `detector` and `undetected` are diagnostics.
"""

import json
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.drive.observers import EventLine, Observer
from baqueano.errors import SafetyStop, UsageError
from baqueano.loop import Blocks, Record
from baqueano.signals import seconds
from baqueano.worlds.faults.ledger import Ledger, LedgerRow

if TYPE_CHECKING:
    from baqueano.door.operator import Operator
    from baqueano.door.simulated.missions import MissionPlan
    from baqueano.worlds.faulty_world import FaultyWorld

LEDGER_PERIOD_S = 0.5  # drive time between two messages `ledger` while a fault is active


class FaultRequests:
    """The handler of the messages about faults, for one service."""

    def __init__(self, operator: "Operator", broadcast: Callable[[JsonObject], None]) -> None:
        self._operator, self._broadcast = operator, broadcast
        self._world: FaultyWorld | None = None  # the world of the present drive, None without one
        self._last: tuple[JsonObject, bool, FaultyWorld] | None = None  # mission, attended, its world
        self._is_manual = False
        self._next_mission: tuple[object, JsonObject, bool] | None = None

    def begin(
        self, plan: "MissionPlan", world: "FaultyWorld", mission_json: str, is_attended: bool
    ) -> Observer:
        """Store a drive that begins, and return the observer that keeps its record of faults."""
        mission = {k: v for k, v in json.loads(mission_json).items() if k != "fast_until_s"} | {
            "seed": plan.seed
        }
        self._is_manual = plan.mission.is_manual
        self._world, self._last = world, (mission, is_attended, world)
        return _LedgerObserver(self, plan, world)

    def end(self) -> None:
        """Record that the drive has ended."""
        self._world = None

    def handle(self, request: JsonObject) -> None:
        """Begin or end a fault. Raise UsageError if no drive is in progress, or for an invalid fault."""
        if (world := self._world) is None:
            raise UsageError.of("shake.no-drive")
        if "end" in request:
            world.end_fault(int(request["end"]))
        else:
            world.begin_fault(
                {name: value for name, value in request.items() if name not in ("type", "start_s")}
            )

    def repeat_mission(self, client: object, request: JsonObject) -> None:
        """Request the last mission again, and end the present drive first.

        Raise UsageError without a previous mission, or if a person drove it.
        """
        if self._last is None:
            raise UsageError.of("shake.no-mission")
        if self._is_manual:
            raise UsageError.of("shake.manual")
        mission, is_attended, world = self._last
        omitted_numbers = {int(n) for n in request["without"]} if request.get("without") is not None else None
        faults = [
            fault_.to_json() for number, fault_ in enumerate(world.faults, 1)
            if omitted_numbers is not None and number not in omitted_numbers
        ]  # fmt: skip
        fast_part = {"fast_until_s": max(0.0, float(request.get("from_s", 0.0)))}
        self._next_mission = client, mission | fast_part | {"shake": faults}, is_attended
        if self._operator.is_busy:
            self._operator.request_end(client)
        else:
            self.queue_repetition()

    def queue_repetition(self) -> None:
        """Queue the mission to repeat, if one is requested; call this when no mission is in progress."""
        if self._next_mission is None:
            return
        (client, mission, is_attended), self._next_mission = self._next_mission, None
        if not self._operator.is_holder(client) and self._operator.is_busy:
            return
        try:
            self._operator.queue_mission(client, json.dumps(mission), attended=is_attended, name="again")
        except SafetyStop as error:
            self._broadcast({"type": "event", "level": str(Severity.ERROR), "message": error.diagnostic})

    def broadcast_ledger(self, ledger: Ledger) -> None:
        """Send the record of faults to all clients as the message `ledger`."""
        self._broadcast({"type": "ledger", "rows": [_fault_row(ledger, row) for row in ledger.rows]})


class _LedgerObserver(Observer):
    """Observer that keeps the record of the faults of a drive, and sends it after each change."""

    def __init__(self, faults: FaultRequests, plan: "MissionPlan", world: "FaultyWorld") -> None:
        self._faults, self._file, self._world = faults, plan.vehicle_file, world
        self._ledger: Ledger | None = None
        self._published_s, self._has_changed = 0.0, True

    def begin(self, blocks: Blocks) -> Blocks:
        self._ledger = Ledger(self._file, blocks.estimator)
        return blocks

    def on_event(self, t_ns: int, source: str, event: Diagnostic | str) -> None:
        if self._ledger is not None:
            self._ledger.on_event(t_ns, source, event)
            self._has_changed = self._has_changed or bool(self._ledger.rows)

    def on_record(self, record: Record) -> None:
        ledger, estimate = self._ledger, record.estimate
        if ledger is None:
            return
        previous_count = sum(len(row.notices) for row in ledger.rows)
        ledger.record_tick(
            record.tick.t_ns, estimate.innovation, estimate.innovation_cov, estimate.weight, estimate.eta,
            estimate.cov, self._world.truth.eta,
        )  # fmt: skip
        t_s = float(seconds(record.tick.t_ns))
        due = t_s - self._published_s >= LEDGER_PERIOD_S and any(row.includes(t_s) for row in ledger.rows)
        if self._has_changed or due or previous_count != sum(len(row.notices) for row in ledger.rows):
            self._has_changed, self._published_s = False, t_s
            self._faults.broadcast_ledger(ledger)

    def end(self, reason: Diagnostic | None) -> Iterable[EventLine]:
        self._faults.end()
        if self._ledger is not None and self._ledger.rows:
            self._faults.broadcast_ledger(self._ledger)
        return ()


def _fault_row(ledger: Ledger, row: LedgerRow) -> JsonObject:
    until_s = None if row.until_s == float("inf") else row.until_s
    return {
        "number": row.number, "t_s": row.fault.start_s, "until_s": until_s, "ended": row.until_s <= ledger.now_s,
        "fault": row.fault.to_json(), "message": row.message,
        "detections": [
            {"detector": note(f"ledger.who-{notice.witness}"), "after_s": notice.after_s, "message": notice.message}
            for notice in row.notices
        ],
        "missed_by": [note(f"ledger.who-{source}") for source in row.silent_witnesses()],
        "undetected": ledger.unnoticed_diagnostic(row),
    }  # fmt: skip
