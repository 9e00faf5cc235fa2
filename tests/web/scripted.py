"""A page process that plays a script: it speaks the words of the page, drives a circle on paper, and keeps what a
browser said. The page is judged by it alone, in states that a real drive reaches late or never."""

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
    "imu[0]": ("acceleration ahead", "m/s²"),
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
KNOWN = [  # path, label in both languages, value, unit
    ("friction.quadratic[1]", ("drag sideways, ∝ v²", "rozamiento lateral, ∝ v²"), 2.1, "N s²/m²"),
    ("friction.quadratic[0]", ("drag ahead, ∝ v²", "rozamiento al avanzar, ∝ v²"), 0.84, "N s²/m²"),
    ("friction.linear[1]", ("drag sideways", "rozamiento lateral"), 40.2, "N s/m"),
    ("friction.coulomb[0]", ("dry friction ahead", "fricción seca al avanzar"), 0.248, "N"),
    ("friction.linear[0]", ("drag ahead", "rozamiento al avanzar"), 3.3, "N s/m"),
    ("friction.quadratic[2]", ("drag in turning, ∝ r²", "rozamiento al girar, ∝ r²"), 0.0003, "N m s²/rad²"),
    ("actuator_matrix[0,0]", ("push of the motors", "empuje de los motores"), 3.38, "N/u"),
    ("friction.coulomb[2]", ("dry friction in turning", "fricción seca al girar"), 0.01, "N m"),
    ("drivetrain.lag_s", ("lag of the motors", "retardo de los motores"), 0.06, "s"),
    ("friction.linear[2]", ("drag in turning", "rozamiento al girar"), 0.0115, "N m s/rad"),
    (
        "drivetrain.dead_zone_forward[1]",
        ("dead zone ahead, motor 2", "zona muerta adelante, motor 2"),
        0.27,
        "u",
    ),
    ("actuator_matrix[2,2]", ("turn of the motors", "giro de los motores"), 0.203, "N m/u"),
    (
        "drivetrain.dead_zone_backward[0]",
        ("dead zone back, motor 1", "zona muerta atrás, motor 1"),
        0.34,
        "u",
    ),
    (
        "drivetrain.dead_zone_backward[1]",
        ("dead zone back, motor 2", "zona muerta atrás, motor 2"),
        0.29,
        "u",
    ),
]
SENTENCES = {
    "en": {
        "MISSION": (
            "REPEATING",
            "lab, lap 2 of 3, 12 s to go. It is 2.5 cm from the route and its filter knows it.",
        ),
        "READY": ("READY", "The vehicle stands. Take the wheel to teach or to repeat a route."),
        "STOPPED": ("STOPPED", "A person stopped it. It drives again once the stop is cleared."),
    },
    "es": {
        "MISSION": (
            "REPITIENDO",
            "lab, vuelta 2 de 3, faltan 12 s. Está a 2,5 cm de la ruta y su filtro lo sabe.",
        ),
        "READY": ("LISTO", "El vehículo está quieto. Tome el volante para enseñar o repetir una ruta."),
        "STOPPED": ("DETENIDO", "Una persona lo detuvo. Vuelve a andar cuando se levante el alto."),
    },
}
RUNS = [
    {
        "id": f"r{k}",
        "name": name,
        "kind": kind,
        "when": "2026-03-02 10:15",
        "seconds": 41.6,
        "laps": laps,
        "report": True,
    }
    for k, (name, kind, laps) in enumerate(
        [
            ("0042-repeat", "repeat", 3),
            ("0039-repeat", "repeat", 3),
            ("0038-teach", "teach", None),
            ("0037-experiment", "experiment", None),
        ]
    )
]


def fields() -> list[dict[str, str]]:
    made = [{"name": name, "unit": "", "group": name, "label": name} for name in PLAIN]
    made += [
        {"name": f"{kind}.{k}", "unit": "duty", "group": one["name"], "label": one["name"]}
        for kind in ("u", "asked")
        for k, one in enumerate(COMMAND)
    ]
    return made + [
        {"name": f"{kind}.{name}", "unit": unit, "group": name, "label": label}
        for kind in ("z", "model", "innov", "S")
        for name, (label, unit) in CHANNELS.items()
    ]


def row(tick: int, off: float = 0.02) -> list[float]:
    """Return a tick of a vehicle that drives a circle, `off` metres outside its route; noise is a sine of the tick."""
    t, noise = tick / RATE, math.sin(12.9898 * tick) * math.cos(78.233 * tick)
    angle, r = SPEED * t, RADIUS + off * (1 + 0.5 * math.sin(0.7 * t))
    x, y, psi = r * math.sin(angle), RADIUS - r * math.cos(angle), math.remainder(angle, 2 * math.pi)
    sd = 0.01 + 0.0004 * t
    plain = [
        t,
        x,
        y,
        psi,
        sd**2,
        0.2 * sd**2,
        2 * sd**2,
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
        + [one * 1.05 for one in u]
        + [m + v for m, v in zip(model, innovation, strict=True)]
        + model
        + innovation
        + sds
    )


def packed(number: int, first: int, count: int, off: float = 0.02) -> bytes:
    rows = [row(tick, off) for tick in range(first, first + count)]
    flat = [value for one in rows for value in one]
    return struct.pack("<IId", number, count, first / RATE) + struct.pack(f"<{len(flat)}f", *flat)


def route() -> dict[str, Any]:
    angles = [2 * math.pi * k / 120 for k in range(120)]
    return {
        "name": "lab",
        "closed": True,
        "x": [math.sin(a) for a in angles],
        "y": [1 - math.cos(a) for a in angles],
    }


def taught(language: str, live: bool) -> dict[str, Any]:
    """Return what a drive of 26 s has taught: one parameter is poorly known, one not seen."""
    k = 0 if language == "en" else 1
    needs = ("missing: sliding sideways both a little and fast, as in turns of many speeds",
             "falta: deslizarse de costado un poco y rápido, como en giros a muchas velocidades")  # fmt: skip
    now = [min(0.9, 10 ** (-0.35 - 0.27 * j)) for j in range(len(KNOWN))]
    fit = {
        "t": 24.0, "took_s": 0.31, "value": [None, *(one[2] for one in KNOWN[1:])],
        "sd": [None, *(1.7 * sd for sd in now[1:])], "verdict": "USABLE", "verdict_is": "USABLE",
        "why": None,
    }  # fmt: skip
    rate = [round(60 * math.exp(-j / 14) + 3 * (1 + math.sin(0.3 * j)), 2) for j in range(130)]
    motion = ("drive straight in bursts, ahead and then back, 4 s",
              "maneje derecho a impulsos, hacia adelante y después hacia atrás, 4 s")  # fmt: skip
    word = {
        "of": "live", "t": 26.0, "start": 0.0 if not live else 34.0, "dt": 0.2, "rate": rate, "bits": 117.3, "now": now,
        "before": [min(1.0, 1.35 * sd) for sd in now], "compiled": True, "busy": False, "first": 8.0,
        "why": None, "fit": fit,
        "parameters": [
            {"path": path, "label": label[k], "unit": unit, "guess": value, "needs": None if j else needs[k]}
            for j, (path, label, value, unit) in enumerate(KNOWN)
        ],
        "next": {"motion": motion[k], "label": KNOWN[1][1][k], "from": 0.29, "to": 0.13},
    }  # fmt: skip
    if live:
        return {"is": "identify"} | word
    grown = [[min(1.0, sd * (41.6 / (0.4 * (j + 1))) ** 0.5) for sd in now] for j in range(104)]
    return word | {"expected": grown, "step_s": 0.4, "fits": [fit | {"t": 8.0}, fit]}


class Scripted:
    """`with Scripted("live") as server:`, then server.url, server.said, server.put(word)."""

    def __init__(
        self, mode: str, *, ghost: bool = False, world: str = "simulated", name: str = "small"
    ) -> None:
        self.mode, self.ghost, self.world, self.name = mode, ghost, world, name
        self.said: list[tuple[float, dict[str, Any]]] = []
        self.guests: list[tuple[ServerConnection, str]] = []
        self.holder: ServerConnection | None = None
        self.state, self.kind = "MISSION", "repeat"
        self.tick, self.running, self.frozen = 6000, True, False

    def __enter__(self) -> "Scripted":
        self._server = serve(self._guest, "127.0.0.1", 0, process_request=_file, subprotocols=["baqueano.1"])  # pyright: ignore
        self.port = self._server.socket.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}/"
        for work in (self._server.serve_forever, self._drive):
            threading.Thread(target=work, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self.running = False
        self._server.shutdown()

    def words(self, kind: str) -> list[dict[str, Any]]:
        return [word for _, word in list(self.said) if word["is"] == kind]

    def drop(self) -> None:
        """Cut every connection."""
        for guest, _ in list(self.guests):
            guest.close()

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
            "is": "state",
            "state": self.state,
            "mission": {"kind": self.kind} if self.kind else None,
            "lap": 2,
            "laps": 3,
            "left_s": 12.0,
            "title": title,
            "sentence": sentence,
            "odd": [],
            "paused": False,
            "pace": 1.0,
            "severity": "error" if self.state == "STOPPED" else "info",
        }

    def _hello(self, language: str) -> dict[str, Any]:
        live = self.mode == "live"
        return {
            "is": "hello",
            "protocol": 1,
            "role": "drive" if live else "view",
            "mode": self.mode,
            "vehicle": self._vehicle(),
            "blocks": BLOCKS,
            "fields": fields(),
            "driver": None,
            "you": "guest 1",
            "state": self._state(language),
            "route": route(),
            "room": None,
            "routes": ["lab", "oval"],
            "runs": RUNS,
            "open": None if live else {"run": "r0", "ghost": "r1" if self.ghost else None},
        }

    def _vehicle(self) -> dict[str, Any]:
        return {
            "name": self.name,
            "footprint": {"kind": "round", "length_m": 0.14, "width_m": 0.14},
            "command": COMMAND,
            "rate_hz": RATE,
            "world": self.world if self.mode == "live" else "recorded",
        }

    def _guest(self, guest: ServerConnection) -> None:
        language = json.loads(guest.recv())["lang"]
        guest.send(json.dumps(self._hello(language)))
        if self.mode == "live":
            guest.send(packed(0, self.tick - 2000, 2000))
        self.guests.append((guest, language))
        self._lease()
        try:
            for text in guest:
                self._word(guest, json.loads(text))
        finally:
            self.guests = [one for one in self.guests if one[0] is not guest]
            self.holder = None if self.holder is guest else self.holder

    def _word(self, guest: ServerConnection, word: dict[str, Any]) -> None:
        self.said.append((time.monotonic(), word))
        if word["is"] == "take":
            self.holder = guest
            self._lease()
        elif word["is"] == "give":
            self.holder = None
            self._lease()
        elif word["is"] == "stop":
            self.go("STOPPED")
        elif word["is"] == "clear":
            self.go("READY")
        elif word["is"] == "open":
            self._open(guest, word["run"], word.get("ghost"))
        elif word["is"] == "identify" and word["on"]:
            guest.send(json.dumps(taught(self._language(guest), live=True)))
        elif word["is"] == "ask":
            more = taught(self._language(guest), live=False) if word["what"] == "identify" else {}
            guest.send(json.dumps({"is": "answer", "to": "ask", "id": word["id"]} | more))

    def _language(self, guest: ServerConnection) -> str:
        return next((language for one, language in self.guests if one is guest), "en")

    def _lease(self) -> None:
        for guest, _ in list(self.guests):
            guest.send(
                json.dumps(
                    {
                        "is": "lease",
                        "who": "guest 1" if self.holder else None,
                        "until_ms": 300,
                        "you": self.holder is guest,
                        "watching": 2,
                    }
                )
            )

    def _open(self, guest: ServerConnection, run: str, ghost: str | None) -> None:
        for stream, key, off in ((1, run, 0.02), (2, ghost, 0.08)):
            about = next((one for one in RUNS if one["id"] == key), None)
            if about is None:
                continue
            events = [
                {"t": 12.0, "severity": "warning", "text": "gate refused 3 innovations"},
                {"t": 30.0, "severity": "info", "text": "mark 1"},
            ]
            head = {
                "is": "answer",
                "to": "open",
                "stream": stream,
                "run": about,
                "rows": 4160,
                "seconds": 41.6,
                "fields": fields(),
                "vehicle": self._vehicle() | {"world": "recorded"},
                "blocks": BLOCKS,
                "route": route(),
                "events": events,
            }
            guest.send(json.dumps(head | {"done": False}))
            for first in (0, 4096):
                guest.send(packed(stream << 24 | 1, first, min(4096, 4160 - first), off))
            guest.send(
                json.dumps({"is": "answer", "to": "open", "stream": stream, "done": True, "seconds": 41.6})
            )

    def _drive(self) -> None:
        number = 0
        while self.running:
            time.sleep(0.05)
            if self.mode != "live" or self.frozen:
                continue
            number += 1
            moves = self.state in ("MISSION", "MANUAL")
            frame = packed(number, self.tick, 5 if moves else 0)
            self.tick += 5 if moves else 0
            for guest, _ in list(self.guests):
                try:
                    guest.send(frame)
                except Exception:  # it has gone; its own thread takes it from the list
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
