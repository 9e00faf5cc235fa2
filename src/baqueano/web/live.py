"""Pass messages between browsers and the service of a vehicle, in both directions.

The page does not create heartbeats: each valid heartbeat of the driver is sent to the service as one `hand`.
"""

import asyncio
import math
import secrets
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from uuid import uuid4

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, Severity, StopReason, fault, note, stop
from baqueano.door import VERSION
from baqueano.errors import BaqueanoError, SafetyStop, UsageError
from baqueano.messages import list_item, text
from baqueano.messages.language import use_language
from baqueano.messages.printable import one_line
from baqueano.web.feed import Feed, field_rows
from baqueano.web.foxglove.bridge import FoxgloveServer
from baqueano.web.guard import MAX_OPTION_LETTERS, Role, is_finite_number, requested_mission
from baqueano.web.lab.live_identification import LiveIdentification
from baqueano.web.lab.local_files import LocalFiles
from baqueano.web.lease import Lease, lease_messages
from baqueano.web.sentence import ledger_rows, state_message
from baqueano.web.service import DoorLink
from baqueano.web.visitor import Visitor, binary_frame

FRAME_RATE_HZ = 20.0
STATE_PERIOD_S = 0.4  # between states
WARNING_DISPLAY_S = 15.0  # drive time for which an event stays in the sentence
PACE = "guide.pace"  # 0 if the vehicle waits
MAX_EVENTS, MAX_COMMANDS = 40, 8  # sent to a new browser, fewer than its queue accepts; in a heartbeat


class Live:
    """A vehicle that many browsers watch and one browser drives."""

    def __init__(self, link: DoorLink, visitors: Callable[[], Iterable[Visitor]]) -> None:
        self._link, self._visitors = link, visitors
        self.identifying = LiveIdentification(self._browsers)
        self.feed, self.lease, self.foxglove = Feed(), Lease(), FoxgloveServer(self._vehicle_description)
        self.robot = secrets.token_hex(4)  # id that the messages of the driver must contain
        self.description_event = asyncio.Event()  # vehicle and columns have arrived
        self.on_done: Callable[[], None] = lambda: None
        self._local_files: LocalFiles | None = None  # of a robot
        self.send_hello: Callable[[Visitor], None] = lambda visitor: None
        self._state: JsonObject = {"type": "state", "state": "DISARMED"}
        self._vehicle: JsonObject = {}
        self._fields: list[JsonObject] = []
        self._route: JsonObject | None = None
        self._routes: list[JsonObject] = []
        self._events: deque[tuple[float, Diagnostic]] = deque(maxlen=MAX_EVENTS)
        self._last_sender: Visitor | None = None  # sender of the last message that the service can refuse
        self._last_lease: tuple[object, int] = (None, 0)  # holder and number of watchers last sent
        self._has_changed = True
        self.over = asyncio.Event()  # all drives have ended regularly, and so has the service
        self._ledger: list[JsonObject] = []  # the rows, with diagnostics
        self._blocks: dict[str, str] = {}  # role → kind, instead of the file's blocks

    def _vehicle_description(self) -> JsonObject:
        blocks = self._vehicle.get("blocks", {})
        return {"vehicle": self._vehicle, "blocks": blocks, "fields": self._fields, "route": self._route}

    def begin(self) -> None:
        """Request frames from the service, and the routes if they are not on this computer."""
        self._link.send("watch", hz=FRAME_RATE_HZ)
        if self._local_files is None:
            self._link.send("routes")

    def use_local_files(self, files: LocalFiles, about: JsonObject) -> None:
        """Use the local files of a robot, and their description `about` until the robot sends its own."""
        self._local_files = files
        self._vehicle, self._routes = self._vehicle or about["vehicle"], about["routes"]

    async def run(self) -> None:
        """Process the messages of the service until it ends, then report the end to every browser."""
        tick_task = asyncio.create_task(self._send_states_periodically())
        try:
            await self._link.receive(self._receive)
        finally:
            tick_task.cancel()
            if not self.over.is_set():
                self._state = {"type": "state", "state": "STOPPED", "reason": fault("web.service-ended")}
            self._send_state()

    # from the browser

    def hello(self, visitor: Visitor) -> JsonObject:
        """Return the part of `hello` that describes the vehicle."""
        with use_language(visitor.language):
            state = self._description()
        description = {k: v for k, v in self._vehicle.items() if k not in ("type", "blocks", "file")}
        return {
            "robot": self.robot, "vehicle": description or None, "blocks": self._vehicle.get("blocks", {}),
            "swapped": self._blocks, "fields": self._fields,
            "driver": getattr(self.lease.holder, "name", None), "state": state, "route": self._route,
            "routes": [route["name"] for route in self._routes],
        }  # fmt: skip

    def send_backlog(self, visitor: Visitor) -> None:
        """Send a new browser the events, the record of faults, and the stored rows of the drive."""
        for t_s, message in self._events:
            self._send_event(visitor, t_s, message)
        if self._ledger:
            self._send_ledger(visitor)
        visitor.send_history(self.feed.history())

    async def receive(self, visitor: Visitor, message: JsonObject) -> None:
        """Execute a message of a browser. Raise UsageError if the message names another vehicle and is not a stop."""
        if message.get("robot", self.robot) != self.robot and message["type"] != "stop":
            raise UsageError.of("web.other-robot")
        kind, message = message["type"], {name: value for name, value in message.items() if name != "robot"}
        if kind == "mission" and self._local_files is not None:
            return await self._send_packed_mission(visitor, message, self._local_files)
        actions = dict.fromkeys(("mark", "end", "set", "shake", "again"), self._forward) | {
            "stop": self._stop, "beat": self._beat, "take": self._take, "give": self._give, "clear": self._clear,
            "mission": self._mission, "pause": self._pause, "go": self._pause, "pace": self._pace,
            "history": self._send_history, "identify": self._identify,
        }  # fmt: skip
        if kind not in actions:
            raise UsageError.of("web.unknown-word", request=one_line(kind)[:MAX_OPTION_LETTERS])
        return actions[kind](visitor, message)

    def on_disconnect(self, visitor: Visitor) -> None:
        """End the right to drive of a browser that has disconnected; without its heartbeats the vehicle stops."""
        self.lease.on_disconnect(visitor)

    def check_may_change(self, visitor: Visitor) -> None:
        """Raise SafetyStop if the role of the browser is not DRIVE, or if another browser has the right to drive."""
        self._require_role(visitor, Role.DRIVE)
        if self.lease.holder is not None:
            self.lease.check_holder(visitor)

    def announce_swap(self, role: str, kind: str, blocks: dict[str, str]) -> None:
        """Announce to all browsers that a block of this kind is used for a role from the next mission on."""
        self._blocks = dict(blocks)
        self._on_event({"message": note("web.swapped", role=role, kind=kind)})
        self._send_blocks()

    def _stop(self, visitor: Visitor, message: JsonObject) -> None:
        """Stop the vehicle at once. The browser needs the role STOP, but not the right to drive."""
        self._require_role(visitor, Role.STOP)
        self._link.send("stop", reason=stop(StopReason.STOPPED_ON_PAGE, name=visitor.name))

    def _beat(self, visitor: Visitor, message: JsonObject) -> None:
        u = message["u"]
        if not isinstance(u, list) or len(u) > MAX_COMMANDS or not all(is_finite_number(x) for x in u):
            raise UsageError.of("web.not-understood", error="u")
        age_s = self.feed.age_s(int(message["frame"]))
        if self.lease.renew(visitor, int(message["n"]), age_s, visitor.round_trip_s):
            self._link.send("hand", u=[float(x) for x in u])

    def _take(self, visitor: Visitor, message: JsonObject) -> None:
        self._require_role(visitor, Role.DRIVE)
        self.lease.acquire(visitor, visitor.name)
        self._send_lease()

    def _give(self, visitor: Visitor, message: JsonObject) -> None:
        """Pass the right to drive to a browser with this name and the role DRIVE, or end it if no name is given."""
        to = None
        if message.get("to"):
            drivers = [peer for peer in self._browsers() if peer.role == Role.DRIVE]
            if (to := next((peer for peer in drivers if peer.name == message["to"]), None)) is None:
                name = one_line(str(message["to"]))[:MAX_OPTION_LETTERS]
                raise UsageError.of("web.no-such-visitor", name=name)
        self.lease.pass_to(visitor, to, getattr(to, "name", ""))
        self._send_lease()

    def _mission(self, visitor: Visitor, message: JsonObject) -> None:
        kind, order = self._checked_mission_request(visitor, message)
        self._send_mission(visitor, kind=kind, **order)

    async def _send_packed_mission(self, visitor: Visitor, message: JsonObject, files: LocalFiles) -> None:
        """Pack a mission on this computer and send it to a robot, which cannot read local files."""
        kind, order = self._checked_mission_request(visitor, message)
        mission = await files.pack(kind, order)
        self.lease.check_holder(visitor)
        files.expect(self._send_mission(visitor, mission=mission), kind, order)

    def _send_mission(self, visitor: Visitor, **fields: object) -> str:
        """Send a mission to the service, and return its id."""
        self._last_sender, number = visitor, uuid4().hex
        self._link.send("mission", id=number, attended=True, door=VERSION, **fields)
        return number

    def _checked_mission_request(self, visitor: Visitor, message: JsonObject) -> tuple[str, JsonObject]:
        """Return the kind and the options of a mission. Raise SafetyStop if the browser is not the driver."""
        self.lease.check_holder(visitor)
        kind, order = requested_mission(message)
        return kind, order | ({"blocks": self._blocks} if kind == "repeat" and self._blocks else {})

    def _pause(self, visitor: Visitor, message: JsonObject) -> None:
        """Pause or continue the time of a simulation, or the guide of a robot, which then waits on its route."""
        request = {"type": "set", "path": PACE, "value": float(message["type"] == "go")}
        if "paused" in self._state:
            request = {"type": message["type"], "ticks": max(0, min(1000, int(message.get("ticks") or 0)))}
        self._forward(visitor, request)

    def _clear(self, visitor: Visitor, message: JsonObject) -> None:
        """Clear a stop, on request of the driver, or of a browser with the role DRIVE without a driver."""
        self.check_may_change(visitor)
        self._link.send("clear")

    def _forward(self, visitor: Visitor, message: JsonObject) -> None:
        """Forward a request of the driver, as a mark, a gain, or a fault of a simulated vehicle."""
        self.lease.check_holder(visitor)
        self._last_sender = visitor
        self._link.send(message["type"], **{k: v for k, v in message.items() if k != "type"})

    def _pace(self, visitor: Visitor, message: JsonObject) -> None:
        """Forward the pace from the driver, or from a browser with the role DRIVE without a driver."""
        self.check_may_change(visitor)
        self._last_sender = visitor
        self._link.send("pace", factor=float(message["factor"]))

    def _send_history(self, visitor: Visitor, message: JsonObject) -> None:
        visitor.send_history(self.feed.history(float(message.get("from") or 0.0)))

    def _identify(self, visitor: Visitor, message: JsonObject) -> None:
        self.identifying.set_subscription(visitor, bool(message["on"]))

    def _require_role(self, visitor: Visitor, role: Role) -> None:
        if visitor.role is None or visitor.role < role:
            raise SafetyStop(note("web.role", Severity.ERROR))

    # from the vehicle

    def _receive(self, message: JsonObject) -> None:
        action = {
            "frame": self._on_frame, "state": self._on_state, "event": self._on_event, "refused": self._on_refusal,
            "vehicle": self._on_vehicle, "fields": self._on_fields, "route": self._on_route,
            "routes": self._on_routes, "done": self._on_done, "over": self._on_drive_end, "ledger": self._on_ledger,
        }.get(message["type"])  # fmt: skip
        if action is not None:
            action(message)

    def _on_frame(self, message: JsonObject) -> None:
        frame = self.feed.add_rows(message)
        if frame is not None:
            self.identifying.add_rows(message["x"])
            self.foxglove.send_rows(message["x"])
            picture = binary_frame(frame)
            for visitor in self._browsers():
                visitor.send_latest(picture)

    def _on_state(self, message: JsonObject) -> None:
        shown_keys = ("state", "mission", "paused", "pace", "scene", "step")
        if any(message.get(key) != self._state.get(key) for key in shown_keys):
            self._has_changed = True
        if message["state"] != self._state["state"] and message["state"] == "STOPPED":
            self._state = message
            self._send_state()  # at once, because it is the most important message
        self._state = message

    def _on_event(self, message: JsonObject) -> None:
        diagnostic = message["message"]
        if diagnostic.code == "door.set":
            self._set_gain(diagnostic)
        t_s = self.feed.value("t")
        self._events.append((t_s if math.isfinite(t_s) else 0.0, diagnostic))
        self.foxglove.send_event(str(diagnostic.severity), text(diagnostic))
        for visitor in self._browsers():
            self._send_event(visitor, *self._events[-1])

    def _set_gain(self, message: Diagnostic) -> None:
        """Store a gain that was changed in the vehicle, and send it to all browsers."""
        with suppress(KeyError, TypeError, ValueError):
            new_gains = {message.figures["path"]: float(message.figures["value"])}
            self._vehicle |= {"gains": self._vehicle.get("gains", {}) | new_gains}
            self._send_blocks()

    def _on_refusal(self, message: JsonObject) -> None:
        """Send a refusal of the service to the browser of the last request, or to all if this browser has left."""
        cause, browsers = message.get("diagnostic"), self._browsers()
        for visitor in [self._last_sender] if self._last_sender in browsers else browsers:
            if visitor is not None:
                with use_language(visitor.language):
                    words = text(cause) if isinstance(cause, Diagnostic) else one_line(str(message["reason"]))
                code = getattr(cause, "code", "")
                visitor.send({"type": "refused", "reason": words, "code": code, "to": "mission"})

    def _on_vehicle(self, message: JsonObject) -> None:
        self._vehicle = message
        self.identifying.vehicle = message.get("file") or self.identifying.vehicle
        self._send_blocks()

    def _on_fields(self, message: JsonObject) -> None:
        names, units = message["names"], message.get("units", [])
        columns_changed = self.feed.begin_drive([str(name) for name in names])
        self.identifying.begin(self.feed.names, early_start="file" in self._vehicle)
        self._events.clear()
        if columns_changed:
            commands = [str(command["name"]) for command in self._vehicle.get("command", [])]
            self._fields = field_rows(names, units, commands)
            for visitor in self._browsers():
                self.send_hello(visitor)
        self.description_event.set()

    def _on_route(self, message: JsonObject) -> None:
        self._route = message if message["x"] else None
        self._send_to_all({"type": "route", "name": "", "closed": False, "x": [], "y": []} | message)

    def _on_routes(self, message: JsonObject) -> None:
        self._routes = [route for route in message["routes"] if isinstance(route, dict) and "name" in route]
        self._send_to_all({"type": "routes", "routes": self._routes})

    def _on_ledger(self, message: JsonObject) -> None:
        """Store the faults of a simulated drive with the checks that detected them, and send them to all browsers."""
        self._ledger = [row for row in message["rows"] if isinstance(row, dict)]
        for visitor in self._browsers():
            self._send_ledger(visitor)

    def _send_ledger(self, visitor: Visitor) -> None:
        with use_language(visitor.language):
            visitor.send({"type": "ledger", "rows": ledger_rows(self._ledger)})

    def _on_done(self, message: JsonObject) -> None:
        """Report the end of a mission and its reason, and request the routes again, or the run of a robot."""
        if message["reason"] is not None:
            self._on_event({"message": message["reason"]})
        if self._local_files is None:
            with suppress(BaqueanoError):
                self._link.send("routes")
        else:
            self._local_files.fetch(message, self._on_fetched)
        self._has_changed = True
        self.on_done()

    def _on_fetched(self, message: Diagnostic, routes: list[JsonObject] | None) -> None:
        """Report that the run of a robot was copied to this computer, or why this failed."""
        self._on_event({"message": message})
        if routes is not None:
            self._on_routes({"routes": routes})
            self.on_done()

    def _on_drive_end(self, message: JsonObject) -> None:
        """Report to all browsers that the last drive has ended, and set `over`."""
        self._state = {"type": "state", "state": "OVER", "reason": message["reason"]}
        self._send_state()
        self.over.set()

    # to all

    def _browsers(self) -> list[Visitor]:
        return [visitor for visitor in self._visitors() if visitor.role is not None]

    def _send_blocks(self) -> None:
        """Send all browsers the blocks by role, the gains, and the blocks swapped for the next mission."""
        block_names = {name: self._vehicle.get(name, {}) for name in ("blocks", "gains")}
        self._send_to_all({"type": "blocks", **block_names, "swapped": self._blocks})

    def _send_to_all(self, message: JsonObject) -> None:
        for visitor in self._browsers():
            visitor.send(message)

    async def _send_states_periodically(self) -> None:
        """Send the state and the driver's name when they change, and during a drive the state every STATE_PERIOD_S."""
        while True:
            await asyncio.sleep(STATE_PERIOD_S / 2)
            if self._last_lease != (self.lease.holder, len(self._browsers())):
                self._send_lease()
            if self._has_changed or self._state["state"] in ("MISSION", "MANUAL"):
                self._has_changed = False
                self._send_state()
                await asyncio.sleep(STATE_PERIOD_S / 2)

    def _send_state(self) -> None:
        words: dict[str, JsonObject] = {}
        for visitor in self._browsers():
            if visitor.language not in words:
                with use_language(visitor.language):
                    words[visitor.language] = self._description()
            visitor.send(words[visitor.language])

    def _description(self) -> JsonObject:
        now_s, cause = self.feed.value("t"), self._state.get("reason")
        warnings = [
            message for t_s, message in self._events
            if message.severity in (Severity.WARNING, Severity.ERROR) and not now_s - t_s > WARNING_DISPLAY_S
            and message != cause
        ]  # fmt: skip
        is_waiting = self._vehicle.get("gains", {}).get(PACE) == 0.0
        pause_state = {"paused": is_waiting} if self._state.get("mission") == "repeat" else {}  # of a robot
        return state_message(pause_state | self._state, self.feed, self._route, warnings[-3:])

    def _send_lease(self) -> None:
        self._last_lease = self.lease.holder, len(self._browsers())
        for visitor, message in lease_messages(self.lease, self._browsers()):
            visitor.send(message)

    def _send_event(self, visitor: Visitor, t_s: float, message: Diagnostic) -> None:
        with use_language(visitor.language):
            event = {"t": t_s, "severity": str(message.severity), "text": list_item(text(message))}
            visitor.send({"type": "event"} | event)
