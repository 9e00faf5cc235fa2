"""Pass messages between browsers and the service of a vehicle, in both directions.

The page does not create heartbeats: each valid heartbeat of the driver is sent to the service as one `hand`.
"""

import asyncio
import math
import secrets
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import TYPE_CHECKING
from uuid import uuid4

from baqueano.diagnostics import Diagnostic, Severity, StopReason, fault, note, stop
from baqueano.door import VERSION
from baqueano.errors import BaqueanoError, SafetyStop, UsageError
from baqueano.messages import text
from baqueano.messages.language import use_language
from baqueano.messages.printable import one_line
from baqueano.web.feed import Feed, field_rows
from baqueano.web.foxglove.bridge import Foxglove
from baqueano.web.guard import MAX_OPTION_LETTERS, Role, finite, mission_of
from baqueano.web.lab.identifying import Identifying
from baqueano.web.lab.local_files import LocalFiles
from baqueano.web.lease import Lease, lease_messages
from baqueano.web.sentence import ledger_rows, state_message
from baqueano.web.service import DoorLink
from baqueano.web.visitor import Visitor, binary_frame

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject

HZ = 20.0
STATE_S = 0.4  # between states
ODD_S = 15.0  # drive time for which an event stays in the sentence
MAX_EVENTS, MAX_COMMANDS = 40, 8  # sent to a new browser, fewer than its queue accepts; in a heartbeat


class Live:
    """A vehicle that many browsers watch and one browser drives."""

    def __init__(self, link: DoorLink, visitors: Callable[[], Iterable[Visitor]]) -> None:
        self._link, self._visitors = link, visitors
        self.identifying = Identifying(self._all)
        self.feed, self.lease, self.foxglove = Feed(), Lease(), Foxglove(self._vehicle_description)
        self.robot = secrets.token_hex(4)  # id that the messages of the driver must contain
        self.described = asyncio.Event()  # vehicle and columns have arrived
        self.on_done: Callable[[], None] = lambda: None
        self._local: LocalFiles | None = None  # of a robot
        self.say_hello: Callable[[Visitor], None] = lambda visitor: None
        self._state: JsonObject = {"is": "state", "state": "DISARMED"}
        self._vehicle: JsonObject = {}
        self._fields: list[JsonObject] = []
        self._route: JsonObject | None = None
        self._routes: list[JsonObject] = []
        self._events: deque[tuple[float, Diagnostic]] = deque(maxlen=MAX_EVENTS)
        self._last_sender: Visitor | None = None  # sender of the last message that the service can refuse
        self._last_lease: tuple[object, int] = (None, 0)  # holder and number of watchers last sent
        self._changed = True
        self.over = asyncio.Event()  # all drives have ended regularly, and so has the service
        self._ledger: list[JsonObject] = []  # the rows, with diagnostics
        self._blocks: dict[str, str] = {}  # role → kind, in place of the file's blocks

    def _vehicle_description(self) -> "JsonObject":
        blocks = self._vehicle.get("blocks", {})
        return {"vehicle": self._vehicle, "blocks": blocks, "fields": self._fields, "route": self._route}

    def begin(self) -> None:
        """Request frames from the service, and the routes if they are not on this computer."""
        self._link.send("watch", hz=HZ)
        if self._local is None:
            self._link.send("routes")

    def presume(self, files: LocalFiles, about: "JsonObject") -> None:
        """Use the local files of a robot, and their description `about` until the robot sends its own."""
        self._local = files
        self._vehicle, self._routes = self._vehicle or about["vehicle"], about["routes"]

    async def run(self) -> None:
        """Process the messages of the service until it ends, then report the end to every browser."""
        ticking = asyncio.create_task(self._tell_states())
        try:
            await self._link.receive(self._receive)
        finally:
            ticking.cancel()
            if not self.over.is_set():
                self._state = {"is": "state", "state": "STOPPED", "why": fault("web.service-gone")}
            self._say_state()

    # from the browser

    def hello(self, visitor: Visitor) -> "JsonObject":
        """Return the part of `hello` that describes the vehicle."""
        with use_language(visitor.language):
            state = self._description()
        about = {k: v for k, v in self._vehicle.items() if k not in ("is", "blocks", "file")}
        return {
            "robot": self.robot, "vehicle": about or None, "blocks": self._vehicle.get("blocks", {}),
            "swapped": self._blocks, "fields": self._fields,
            "driver": getattr(self.lease.holder, "name", None), "state": state, "route": self._route,
            "routes": [route["name"] for route in self._routes],
        }  # fmt: skip

    def send_backlog(self, visitor: Visitor) -> None:
        """Send a new browser the events, the record of faults, and the stored rows of the drive."""
        for t_s, message in self._events:
            self._say_event(visitor, t_s, message)
        if self._ledger:
            self._say_ledger(visitor)
        visitor.catch_up(self.feed.history())

    async def receive(self, visitor: Visitor, word: "JsonObject") -> None:
        """Execute a message of a browser. Raise UsageError if the message names another vehicle and is not a stop."""
        if word.get("robot", self.robot) != self.robot and word["is"] != "stop":
            raise UsageError(fault("web.other-robot"))
        word = {name: value for name, value in word.items() if name != "robot"}
        if word["is"] == "mission" and self._local is not None:
            return await self._whole_mission(visitor, word, self._local)
        do = {
            "stop": self._stop, "beat": self._beat, "take": self._take, "give": self._give,
            "mission": self._mission, "pause": self._pass_on, "go": self._pass_on, "mark": self._pass_on,
            "end": self._pass_on, "clear": self._clear, "set": self._set, "shake": self._set, "again": self._set,
            "pace": self._pace, "history": self._send_history, "identify": self._identify,
        }.get(word["is"])  # fmt: skip
        if do is None:
            raise UsageError(fault("web.unknown-word", word=one_line(word["is"])[:MAX_OPTION_LETTERS]))
        return do(visitor, word)

    def on_disconnect(self, visitor: Visitor) -> None:
        """End the right to drive of a browser that has disconnected; without its heartbeats the vehicle stops."""
        self.lease.on_disconnect(visitor)

    def may_change(self, visitor: Visitor) -> None:
        """Raise SafetyStop if the role of the browser is not DRIVE, or if another browser has the right to drive."""
        self._needs(visitor, Role.DRIVE)
        if self.lease.holder is not None:
            self.lease.check(visitor)

    def announce_swap(self, role: str, kind: str, blocks: dict[str, str]) -> None:
        """Announce to all browsers that a block of this kind is used for a role from the next mission on."""
        self._blocks = dict(blocks)
        self._on_event({"said": note("web.swapped", role=role, kind=kind)})
        self._tell_blocks()

    def _stop(self, visitor: Visitor, word: "JsonObject") -> None:
        """Stop the vehicle at once. The browser needs the role STOP, but not the right to drive."""
        self._needs(visitor, Role.STOP)
        self._link.send("stop", why=stop(StopReason.STOPPED_BY, words=visitor.name))

    def _beat(self, visitor: Visitor, word: "JsonObject") -> None:
        u = word["u"]
        if not isinstance(u, list) or len(u) > MAX_COMMANDS or not all(finite(x) for x in u):
            raise UsageError(fault("web.not-understood", error="u"))
        age_s = self.feed.age_s(int(word["seen"]))
        if self.lease.beat(visitor, int(word["n"]), age_s, visitor.way_s):
            self._link.send("hand", u=[float(x) for x in u])

    def _take(self, visitor: Visitor, word: "JsonObject") -> None:
        self._needs(visitor, Role.DRIVE)
        self.lease.take(visitor, visitor.name)
        self._say_lease()

    def _give(self, visitor: Visitor, word: "JsonObject") -> None:
        """Pass the right to drive to a browser with this name and the role DRIVE, or end it if no name is given."""
        to = None
        if word.get("to"):
            drivers = [guest for guest in self._all() if guest.role == Role.DRIVE]
            if (to := next((guest for guest in drivers if guest.name == word["to"]), None)) is None:
                name = one_line(str(word["to"]))[:MAX_OPTION_LETTERS]
                raise UsageError(fault("web.no-such-visitor", name=name))
        self.lease.give(visitor, to, getattr(to, "name", ""))
        self._say_lease()

    def _mission(self, visitor: Visitor, word: "JsonObject") -> None:
        kind, order = self._check_order(visitor, word)
        self._ask(visitor, kind=kind, **order)

    async def _whole_mission(self, visitor: Visitor, word: "JsonObject", files: LocalFiles) -> None:
        """Pack a mission on this computer and send it to a robot, which cannot read local files."""
        kind, order = self._check_order(visitor, word)
        mission = await files.pack(kind, order)
        self.lease.check(visitor)
        files.expect(self._ask(visitor, mission=mission), kind, order)

    def _ask(self, visitor: Visitor, **fields: object) -> str:
        """Send a mission to the service, and return its id."""
        self._last_sender, number = visitor, uuid4().hex
        self._link.send("mission", id=number, attended=True, by="page", door=VERSION, **fields)
        return number

    def _check_order(self, visitor: Visitor, word: "JsonObject") -> "tuple[str, JsonObject]":
        """Return the kind and the options of a mission. Raise SafetyStop if the browser is not the driver."""
        self.lease.check(visitor)
        kind, order = mission_of(word)
        return kind, order | ({"blocks": self._blocks} if kind == "repeat" and self._blocks else {})

    def _pass_on(self, visitor: Visitor, word: "JsonObject") -> None:
        self.lease.check(visitor)
        self._last_sender = visitor
        more = (
            {"ticks": max(0, min(1000, int(word["ticks"])))} if "ticks" in word and word["is"] == "go" else {}
        )
        self._link.send(word["is"], **more)

    def _clear(self, visitor: Visitor, word: "JsonObject") -> None:
        """Clear a stop, on request of the driver, or of a browser with the role DRIVE without a driver."""
        self.may_change(visitor)
        self._link.send("clear")

    def _set(self, visitor: Visitor, word: "JsonObject") -> None:
        """Forward a message of the driver: a gain, a fault of a simulated vehicle, or a request to repeat the drive."""
        self.lease.check(visitor)
        self._last_sender = visitor
        self._link.send(word["is"], **{k: v for k, v in word.items() if k not in ("is", "do")})

    def _pace(self, visitor: Visitor, word: "JsonObject") -> None:
        """Forward the pace from the driver, or from a browser with the role DRIVE without a driver."""
        self.may_change(visitor)
        self._last_sender = visitor
        self._link.send("pace", factor=float(word["factor"]))

    def _send_history(self, visitor: Visitor, word: "JsonObject") -> None:
        visitor.catch_up(self.feed.history(float(word.get("from") or 0.0)))

    def _identify(self, visitor: Visitor, word: "JsonObject") -> None:
        self.identifying.look(visitor, bool(word["on"]))

    def _needs(self, visitor: Visitor, role: Role) -> None:
        if visitor.role is None or visitor.role < role:
            raise SafetyStop(note("web.role", Severity.ERROR))

    # from the vehicle

    def _receive(self, word: "JsonObject") -> None:
        do = {
            "frame": self._on_frame, "state": self._on_state, "event": self._on_event, "no": self._on_no,
            "vehicle": self._on_vehicle, "fields": self._on_fields, "route": self._on_route,
            "routes": self._on_routes, "done": self._on_done, "over": self._on_over, "ledger": self._on_ledger,
        }.get(word["is"])  # fmt: skip
        if do is not None:
            do(word)

    def _on_frame(self, word: "JsonObject") -> None:
        frame = self.feed.take(word)
        if frame is not None:
            self.identifying.take(word["x"])
            self.foxglove.show(word["x"])
            picture = binary_frame(frame)
            for visitor in self._all():
                visitor.show(picture)

    def _on_state(self, word: "JsonObject") -> None:
        if any(
            word.get(k) != self._state.get(k) for k in ("state", "mission", "paused", "pace", "scene", "step")
        ):
            self._changed = True
        if word["state"] != self._state["state"] and word["state"] == "STOPPED":
            self._state = word
            self._say_state()  # at once, because it is the most important message
        self._state = word

    def _on_event(self, word: "JsonObject") -> None:
        message = word["said"]
        if message.code == "door.set":
            self._set_gain(message)
        t_s = self.feed.value("t")
        self._events.append((t_s if math.isfinite(t_s) else 0.0, message))
        self.foxglove.event(str(message.severity), text(message))
        for visitor in self._all():
            self._say_event(visitor, *self._events[-1])

    def _set_gain(self, message: Diagnostic) -> None:
        """Store a gain that was changed in the vehicle, and send it to all browsers."""
        with suppress(KeyError, TypeError, ValueError):
            now = {message.figures["path"]: float(message.figures["now"])}
            self._vehicle |= {"gains": self._vehicle.get("gains", {}) | now}
            self._tell_blocks()

    def _on_no(self, word: "JsonObject") -> None:
        """Send a refusal of the service to the browser of the last request, or to all if this browser has left."""
        about = word.get("about")
        for visitor in [self._last_sender] if self._last_sender in set(self._all()) else self._all():
            if visitor is not None:
                with use_language(visitor.language):
                    reason = text(about) if isinstance(about, Diagnostic) else one_line(str(word["why"]))
                visitor.send({"is": "no", "why": reason, "code": getattr(about, "code", ""), "to": "mission"})

    def _on_vehicle(self, word: "JsonObject") -> None:
        self._vehicle = word
        self.identifying.vehicle = word.get("file") or self.identifying.vehicle
        self._tell_blocks()

    def _on_fields(self, word: "JsonObject") -> None:
        names, units = word["names"], word.get("units", [])
        columns_changed = self.feed.columns([str(name) for name in names])
        self.identifying.begin(self.feed.names, ahead="file" in self._vehicle)
        self._events.clear()
        if columns_changed:
            commands = [str(command["name"]) for command in self._vehicle.get("command", [])]
            self._fields = field_rows(names, units, commands)
            for visitor in self._all():
                self.say_hello(visitor)
        self.described.set()

    def _on_route(self, word: "JsonObject") -> None:
        self._route = word if word["x"] else None
        self._tell({"is": "route", "name": "", "closed": False, "x": [], "y": []} | word)

    def _on_routes(self, word: "JsonObject") -> None:
        self._routes = [route for route in word["routes"] if isinstance(route, dict) and "name" in route]
        self._tell({"is": "routes", "routes": self._routes})

    def _on_ledger(self, word: "JsonObject") -> None:
        """Store the faults of a simulated drive with the checks that detected them, and send them to all browsers."""
        self._ledger = [row for row in word["rows"] if isinstance(row, dict)]
        for visitor in self._all():
            self._say_ledger(visitor)

    def _say_ledger(self, visitor: Visitor) -> None:
        with use_language(visitor.language):
            visitor.send({"is": "ledger", "rows": ledger_rows(self._ledger)})

    def _on_done(self, word: "JsonObject") -> None:
        """Report the end of a mission and its reason, and request the routes again, or the run of a robot."""
        if word["why"] is not None:
            self._on_event({"said": word["why"]})
        if self._local is None:
            with suppress(BaqueanoError):
                self._link.send("routes")
        else:
            self._local.fetch(word, self._on_fetched)
        self._changed = True
        self.on_done()

    def _on_fetched(self, message: Diagnostic, routes: "list[JsonObject] | None") -> None:
        """Report that the run of a robot was copied to this computer, or why this failed."""
        self._on_event({"said": message})
        if routes is not None:
            self._on_routes({"routes": routes})
            self.on_done()

    def _on_over(self, word: "JsonObject") -> None:
        """Report to all browsers that the last drive has ended, and set `over`."""
        self._state = {"is": "state", "state": "OVER", "why": word["why"]}
        self._say_state()
        self.over.set()

    # to all

    def _all(self) -> list[Visitor]:
        return [visitor for visitor in self._visitors() if visitor.role is not None]

    def _tell_blocks(self) -> None:
        """Send all browsers the blocks by role, the gains, and the blocks swapped for the next mission."""
        about = {name: self._vehicle.get(name, {}) for name in ("blocks", "gains")}
        self._tell({"is": "blocks", **about, "swapped": self._blocks})

    def _tell(self, word: "JsonObject") -> None:
        for visitor in self._all():
            visitor.send(word)

    async def _tell_states(self) -> None:
        """Send the state and the driver's name when they change, and during a drive the state every STATE_S."""
        while True:
            await asyncio.sleep(STATE_S / 2)
            if self._last_lease != (self.lease.holder, len(self._all())):
                self._say_lease()
            if self._changed or self._state["state"] in ("MISSION", "MANUAL"):
                self._changed = False
                self._say_state()
                await asyncio.sleep(STATE_S / 2)

    def _say_state(self) -> None:
        words: dict[str, JsonObject] = {}
        for visitor in self._all():
            if visitor.language not in words:
                with use_language(visitor.language):
                    words[visitor.language] = self._description()
            visitor.send(words[visitor.language])

    def _description(self) -> "JsonObject":
        now_s = self.feed.value("t")
        odd = [
            message for t_s, message in self._events
            if message.severity in (Severity.WARNING, Severity.ERROR) and not now_s - t_s > ODD_S
        ]  # fmt: skip
        return state_message(self._state, self.feed, self._route, odd[-3:])

    def _say_lease(self) -> None:
        self._last_lease = self.lease.holder, len(self._all())
        for visitor, message in lease_messages(self.lease, self._all()):
            visitor.send(message)

    def _say_event(self, visitor: Visitor, t_s: float, message: Diagnostic) -> None:
        with use_language(visitor.language):
            visitor.send({"is": "event", "t": t_s, "severity": str(message.severity), "text": text(message)})
