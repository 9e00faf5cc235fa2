"""A page process that follows a script: it sends the messages of the page, drives a computed circle, and stores the
messages of a browser.

It tests the page in states that a real drive reaches only after a long time or never.
"""

import json
import math
import struct
import threading
import time
from http import HTTPStatus
from pathlib import Path
from typing import Any

from websockets.datastructures import Headers
from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection, serve

from baqueano.door.frames.rows import ESTIMATE_COLUMNS, OTHER_COLUMNS
from baqueano.web.page import label_fields
from tests.web.scripted_answers import GAINS, RUNS, answer_to, route
from tests.web.scripted_ledger import Faults, ledger
from tests.web.taught import fit_taught

STATIC = Path(__file__).parents[2] / "src" / "baqueano" / "web" / "static"
KINDS = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript",
    ".css": "text/css",
    ".json": "application/json",
    ".svg": "image/svg+xml",
}
CSP = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-ancestors 'none'; base-uri 'none'"
)
RATE, RADIUS, SPEED, LAP_S = 100, 1.0, 0.4, 2.0 * math.pi / 0.4
CHANNELS = {
    "imu[0]": ("forward acceleration", "m/s²"),
    "imu[1]": ("acceleration to the left", "m/s²"),
    "imu[2]": ("yaw rate of the gyroscope", "rad/s"),
}
PLAIN = [
    "t",
    "eta.x",
    "eta.y",
    "eta.psi",
    "P.xx",
    "P.xy",
    "P.yy",
    "P.psi",
    "nu.u",
    "nu.v",
    "nu.r",
    "ref.x",
    "ref.y",
    "ref.psi",
    "ref.u",
    "truth.x",
    "truth.y",
    "truth.psi",
    "nis",
    "progress",
    "cross",
    "battery",
    "late_ms",
]
COMMAND = [
    {"name": "u_x", "low": -1, "high": 1, "unit": "duty"},
    {"name": "u_y", "low": 0, "high": 0, "unit": "duty"},
    {"name": "u_psi", "low": -1, "high": 1, "unit": "duty"},
]
BLOCKS = {
    "estimator": "AugmentedEKF",
    "guide": "RepeatByProgress",
    "controller": "PDFeedforward",
    "model": "Planar",
}
SENTENCES = {
    "en": {
        "MISSION": (
            "REPEATING",
            "lab, lap 2 of 3, 12 s to go. It is 2.5 cm from the route, within the 95 % interval.",
        ),
        "READY": ("READY", "The vehicle stands. Take control to teach or to repeat a route."),
        "STOPPED": ("STOPPED", "A person stopped it. It drives again once the stop is cleared."),
    },
    "es": {
        "MISSION": (
            "REPITIENDO",
            "lab, vuelta 2 de 3, faltan 12 s. Está a 2,5 cm de la ruta, dentro del intervalo del 95 %.",
        ),
        "READY": ("LISTO", "El vehículo está quieto. Tome el volante para enseñar o repetir una ruta."),
        "STOPPED": ("DETENIDO", "Una persona lo detuvo. Vuelve a andar cuando se levante el alto."),
    },
}


def fields() -> list[dict[str, str]]:
    units = dict(ESTIMATE_COLUMNS) | {name: unit.replace("1", "") for name, unit, _ in OTHER_COLUMNS}
    columns = label_fields(
        [{"name": name, "unit": units.get(name, "s"), "group": name} for name in PLAIN], "en"
    )
    columns += [
        {"name": f"{kind}.{k}", "unit": "duty", "group": entry["name"], "label": entry["name"]}
        for kind in ("u", "requested")
        for k, entry in enumerate(COMMAND)
    ]
    return columns + [
        {"name": f"{kind}.{name}", "unit": unit, "group": name, "label": label}
        for kind in ("z", "model", "innov", "S")
        for name, (label, unit) in CHANNELS.items()
    ]


def row(tick: int, offset_m: float = 0.02) -> list[float]:
    """Return a tick of a vehicle on a circle, `offset_m` outside its route; noise is a sine of the tick."""
    t, noise = tick / RATE, math.sin(12.9898 * tick) * math.cos(78.233 * tick)
    angle, r = SPEED * t, RADIUS + offset_m * (1 + 0.5 * math.sin(0.7 * t))
    x, y, psi = r * math.sin(angle), RADIUS - r * math.cos(angle), math.remainder(angle, 2 * math.pi)
    std = 0.01 + 0.0004 * t
    plain = [
        t,
        x,
        y,
        psi,
        std**2,
        0.2 * std**2,
        2 * std**2,
        0.01,
        SPEED * r,
        0.0,
        SPEED,
        RADIUS * math.sin(angle),
        RADIUS - RADIUS * math.cos(angle),
        psi,
        SPEED,
        x + 0.01,
        y - 0.01,
        psi,
        1.0 + noise,
        SPEED * RADIUS * t,
        RADIUS - r,
        7.4 - t / 600,
        0.5 + 0.1 * noise,
    ]
    u = [0.5 + 0.1 * math.sin(t), 0.0, 0.3 + 0.05 * math.cos(3 * t)]
    model = [0.2 * math.sin(t), 0.16 * math.cos(2 * t), SPEED + 0.1 * math.sin(3 * t)]
    sds = [0.1, 0.1, 0.01]
    innovation = [s * 1.4 * noise for s in sds]
    return (
        plain
        + u
        + [value * 1.05 for value in u]
        + [m + v for m, v in zip(model, innovation, strict=True)]
        + model
        + innovation
        + sds
    )


def packed_rows(number: int, first: int, count: int, offset_m: float = 0.02) -> bytes:
    rows = [row(tick, offset_m) for tick in range(first, first + count)]
    flat = [value for row in rows for value in row]
    return struct.pack("<IId", number, count, first / RATE) + struct.pack(f"<{len(flat)}f", *flat)


class ScriptedServer:
    """`with ScriptedServer("live") as server:`, then server.url, server.messages, server.put(word)."""

    def __init__(
        self, mode: str, *, ghost: bool = False, world: str = "simulated", name: str = "small"
    ) -> None:
        self.mode, self.ghost, self.world, self.name = mode, ghost, world, name
        self.messages: list[tuple[float, dict[str, Any]]] = []
        self.guests: list[tuple[ServerConnection, str]] = []
        self.holder: ServerConnection | None = None
        self.state, self.kind = "MISSION", "repeat"
        self.gains = {f"controller.{gain['name']}": gain["file"] for gain in GAINS}
        self.tick, self.running, self.frozen = 6000, True, False
        self.paused, self.pace, self.shared = False, 1.0, False
        self.faults = Faults()
        self._showing = threading.Lock()  # no frame between the history of a guest and its first picture

    def __enter__(self) -> "ScriptedServer":
        self._server = serve(self._guest, "127.0.0.1", 0, process_request=_file, subprotocols=["baqueano.3"])  # pyright: ignore
        self.port = self._server.socket.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}/"
        for work in (self._server.serve_forever, self._drive):
            threading.Thread(target=work, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self.running = False
        self._server.shutdown()

    def words(self, kind: str) -> list[dict[str, Any]]:
        return [word for _, word in list(self.messages) if word["type"] == kind]

    def drop(self) -> None:
        """Close every connection."""
        for guest, _ in list(self.guests):
            guest.close(1012)  # like a service that restarts

    def put(self, word: dict[str, Any]) -> None:
        for guest, _ in list(self.guests):
            guest.send(json.dumps(word))

    def go(self, state: str, kind: str | None = None) -> None:
        self.state, self.kind = state, kind
        for guest, language in list(self.guests):
            guest.send(json.dumps(self._state(language)))

    def _state(self, language: str) -> dict[str, Any]:
        title, sentence = SENTENCES[language].get(self.state, (self.state, ""))
        return {
            "type": "state",
            "state": self.state,
            "mission": {"kind": self.kind} if self.kind else None,
            "lap": 2,
            "laps": 3,
            "left_s": 12.0,
            "title": title,
            "sentence": sentence,
            "warnings": [],
            "paused": self.paused,
            "pace": self.pace,
            "severity": "error" if self.state == "STOPPED" else "info",
        }

    def _hello(self, language: str) -> dict[str, Any]:
        live = self.mode == "live"
        return {
            "type": "hello",
            "protocol": 3,
            "role": "drive" if live else "view",
            "mode": self.mode,
            "vehicle": self._vehicle(),
            "blocks": BLOCKS,
            "fields": fields(),
            "driver": None,
            "you": "guest 1",
            "state": self._state(language),
            "route": route(),
            "routes": ["lab", "oval"],
            "runs": RUNS,
            "shared": self.shared,
            "open": None if live else {"run": "r0", "ghost": "r1" if self.ghost else None},
        }

    def _vehicle(self) -> dict[str, Any]:
        return {
            "name": self.name,
            "footprint": {"kind": "round", "length_m": 0.14, "width_m": 0.14},
            "command": COMMAND,
            "rate_hz": RATE,
            "sensors": [{"name": "imu", "kind": "imu", "channels": 3, "rate_hz": RATE}],
            "gains": self.gains,
            "world": self.world if self.mode == "live" else "recorded",
        }

    def _guest(self, guest: ServerConnection) -> None:
        language = json.loads(guest.recv())["lang"]
        guest.send(json.dumps(self._hello(language)))
        if self.mode == "live" and self.world == "simulated":
            guest.send(json.dumps(ledger(language)))
        with self._showing:
            if self.mode == "live":
                guest.send(packed_rows(0, self.tick - 2000, 2000))
            self.guests.append((guest, language))
        self._lease()
        try:
            for text in guest:
                self._word(guest, json.loads(text))
        finally:
            self.guests = [entry for entry in self.guests if entry[0] is not guest]
            self.holder = None if self.holder is guest else self.holder

    def _word(self, guest: ServerConnection, word: dict[str, Any]) -> None:
        self.messages.append((time.monotonic(), word))
        if word["type"] == "take":
            self.holder = guest
            self._lease()
        elif word["type"] == "give":
            self.holder = None
            self._lease()
        elif word["type"] == "stop":
            self.go("STOPPED")
        elif word["type"] == "clear":
            self.go("READY")
        elif word["type"] == "open":
            self._open(guest, word["run"], word.get("ghost"), word.get("filter"))
        elif word["type"] == "identify" and word["on"]:
            guest.send(json.dumps(fit_taught(self._language(guest), live=True)))
        elif word["type"] == "ask":
            fitting = word["question"] == "identify"
            reply = fit_taught(self._language(guest), live=False) if fitting else answer_to(word)
            guest.send(json.dumps({"type": "answer", "to": "ask", "id": word["id"]} | reply))
        elif word["type"] in ("pause", "go"):
            self.paused = word["type"] == "pause" or "ticks" in word
            self.go(self.state, self.kind)
        elif word["type"] == "pace":
            self.pace = word["factor"]
            self.go(self.state, self.kind)
        elif word["type"] == "shake":
            self.put(self.faults.take(word, self.tick / RATE, self._language(guest)))
        elif word["type"] == "set":
            self.gains[word["path"]] = word["value"]
            for visitor, _ in list(self.guests):
                visitor.send(
                    json.dumps({"type": "blocks", "blocks": BLOCKS, "gains": self.gains, "swapped": {}})
                )

    def _language(self, guest: ServerConnection) -> str:
        return next((language for visitor, language in self.guests if visitor is guest), "en")

    def _lease(self) -> None:
        for guest, _ in list(self.guests):
            guest.send(
                json.dumps(
                    {
                        "type": "lease",
                        "driver": "guest 1" if self.holder else None,
                        "until_ms": 300,
                        "you": self.holder is guest,
                        "watching": 2,
                    }
                )
            )

    def _open(self, guest: ServerConnection, run: str, ghost: str | None, through: str | None) -> None:
        for stream, key, offset_m in ((1, run, 0.02), (2, run if through else ghost, 0.08)):
            about = next((run for run in RUNS if run["id"] == key), None)
            if about is None:
                continue
            events = [
                {"t": 12.0, "severity": "warning", "text": "gate refused 3 innovations"},
                {"t": 30.0, "severity": "info", "source": "mark", "text": "mark 1"},
            ]
            head = {
                "type": "answer",
                "to": "open",
                "stream": stream,
                "run": about,
                "filter": through if stream == 2 else None,
                "rows": 4160,
                "seconds": 41.6,
                "fields": fields(),
                "vehicle": self._vehicle() | {"world": "recorded"},
                "blocks": BLOCKS,
                "route": route(),
                "events": events,
                "sentence": f"The recording (repeat) lasts 41.6 s and has {len(events)} events.",
            }
            guest.send(json.dumps(head | {"done": False}))
            for first in (0, 4096):
                guest.send(packed_rows(stream << 24 | 1, first, min(4096, 4160 - first), offset_m))
            guest.send(
                json.dumps({"type": "answer", "to": "open", "stream": stream, "done": True, "seconds": 41.6})
            )

    def _drive(self) -> None:
        number = 0
        while self.running:
            time.sleep(0.05)
            if self.mode != "live" or self.frozen:
                continue
            number += 1
            with self._showing:
                self._show(number)

    def _show(self, number: int) -> None:
        moves = self.state in ("MISSION", "MANUAL")
        frame = packed_rows(number, self.tick, 5 if moves else 0)
        self.tick += 5 if moves else 0
        for guest, _ in list(self.guests):
            try:
                guest.send(frame)
            except Exception:  # it has disconnected; its own thread removes it from the list
                continue


def _file(connection: ServerConnection, request: Request) -> Response | None:
    path = request.path.split("?")[0]
    if path == "/ws":
        return None
    file = STATIC / ("index.html" if path == "/" else path.removeprefix("/static/"))
    if not file.is_file():
        return connection.respond(HTTPStatus.NOT_FOUND, "")
    body = file.read_bytes()
    headers = {
        "Content-Type": KINDS[file.suffix],
        "Content-Length": str(len(body)),
        "Content-Security-Policy": CSP,
        "Cache-Control": "no-store",
        "Connection": "close",
    }
    return Response(200, "OK", Headers(headers), body)
