"""Implement Foxglove's WebSocket protocol, version 1, under both its names, with read-only access.

    ws://HOST:PORT/foxglove[/TOKEN]

channels        one JSON channel for each family of columns, one message per tick; events; the route
parameters      name, world and blocks of the vehicle, its gains and limits: read only
connection      the block diagram: which block publishes a topic, which block reads it
graph

The field `op` names each message. A client that tries to publish, call or set receives an error status, and the vehicle
does not change.
"""

import json
import struct
import time
from collections.abc import Callable, Iterable
from typing import NamedTuple

from baqueano.contracts.values import JsonObject, Value
from baqueano.diagnostics import note
from baqueano.messages import text
from baqueano.messages.printable import one_line
from baqueano.web.visitor import Visitor, binary_frame, encode_json

SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")  # names of the subprotocol
MESSAGE_LAYOUT = struct.Struct("<BIQ")  # opcode 1, subscription, time [ns]
DATA, ERROR, SECOND = 1, 2, 10**9
MAX_SUBSCRIPTIONS = 256  # maximum number of subscriptions of a client
PREFIX_TOPICS = {  # first part of a column's name → topic
    "eta": "/estimate/pose", "P": "/estimate/covariance", "nu": "/estimate/velocity", "ref": "/guide/reference",
    "truth": "/world/truth", "u": "/command/applied", "requested": "/controller/command", "z": "/sensors",
    "model": "/estimate/measurement", "innov": "/estimate/innovation", "S": "/estimate/innovation_std",
}  # fmt: skip
DRIVE, EVENTS, ROUTE = "/drive", "/events", "/guide/route"
BLOCK_INPUTS = {  # block → the topics that it reads; each publishes the topics below its name
    "estimator": ("/sensors", "/command/applied"), "guide": ("/estimate/pose", ROUTE),
    "controller": ("/guide/reference", "/estimate/pose", "/estimate/velocity"),
    "supervisor": ("/controller/command", "/sensors"), "world": ("/command/applied",),
}  # fmt: skip
BLOCK_OUTPUTS = {
    "estimator": "/estimate/", "guide": "/guide/", "controller": "/controller/", "supervisor": "/command/",
    "world": ("/sensors", "/world/", DRIVE, EVENTS),
}  # fmt: skip
LEVELS = {"info": 2, "warning": 3, "error": 4, "fatal": 5}  # levels of foxglove.Log
REFUSAL_TEXTS = {
    "setParameters": "web.foxglove-set", "advertise": "web.foxglove-publish",
    "subscribeParameterUpdates": "web.foxglove-updates",
}  # fmt: skip


class Client(NamedTuple):
    """A connected program and its subscriptions: subscription number → topic."""

    line: Visitor
    subscriptions: dict[int, str]


class FoxgloveServer:
    """The clients that watch a vehicle; `about` returns its description: vehicle, blocks, fields, route."""

    def __init__(self, about: Callable[[], JsonObject], now_ns: Callable[[], int] = time.time_ns) -> None:
        self._about, self._now_ns = about, now_ns
        self._clients: dict[Visitor, Client] = {}
        self._topics: list[str] = []
        self._begun_ns, self._last_s = now_ns(), float("inf")

    def __len__(self) -> int:
        return len(self._clients)

    def add_client(self, line: Visitor) -> None:
        """Send a new client the server information and the list of channels."""
        self._clients[line] = Client(line, {})
        vehicle = self._about().get("vehicle") or {}
        line.send({
            "op": "serverInfo", "name": f"baqueano: {vehicle.get('name', '')}", "sessionId": str(self._begun_ns),
            "capabilities": ["parameters", "connectionGraph"], "supportedEncodings": ["json"],
            "metadata": {"world": str(vehicle.get("world", ""))},
        })  # fmt: skip
        line.send({"op": "advertise", "channels": self._channels()})

    def on_disconnect(self, line: Visitor) -> None:
        """Remove a client that has disconnected."""
        self._clients.pop(line, None)

    async def receive(self, line: Visitor, request: JsonObject) -> None:
        """Execute a message of a client, or answer it with an error status if it would change something."""
        client, op = self._clients[line], request["op"]
        try:
            match op:
                case "subscribe":
                    self._subscribe(client, request["subscriptions"])
                case "unsubscribe":
                    for subscription_id in request["subscriptionIds"]:
                        client.subscriptions.pop(int(subscription_id), None)
                case "getParameters":
                    line.send(self._parameters(request["parameterNames"], request.get("id")))
                case "subscribeConnectionGraph":
                    line.send(self._graph())
                case "unsubscribeConnectionGraph" | "unsubscribeParameterUpdates" | "unadvertise":
                    pass
                case _:
                    line.send(_status(REFUSAL_TEXTS.get(op, "web.unknown-word"), op))
                    if op == "setParameters":  # send the present values
                        line.send(self._parameters([], request.get("id")))
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            line.send(_status("web.not-understood", type(error).__name__))

    def send_rows(self, rows: list[list[float]]) -> None:
        """Send the rows of a frame to the clients that subscribed to their topics; encode each topic only once."""
        if not self._clients:
            return
        fields = self._about()["fields"]
        self._advertise_again()
        stamps_ns = [self._wall_time_ns(row) for row in rows]
        bodies: dict[str, list[tuple[int, bytes]]] = {}
        for client in self._clients.values():
            messages = []
            for subscription_id, topic in client.subscriptions.items():
                if topic not in bodies:
                    contents = [_body(topic, fields, row) for row in rows]
                    bodies[topic] = list(zip(stamps_ns, contents, strict=True))
                messages += [
                    binary_frame(MESSAGE_LAYOUT.pack(DATA, subscription_id, t_ns) + content)
                    for t_ns, content in bodies[topic]
                    if content
                ]
            if messages:
                client.line.send_latest(b"".join(messages))

    def send_event(self, severity: str, words: str) -> None:
        """Send an event to the clients that subscribed to events."""
        self._send(EVENTS, {
            "timestamp": _time(self._now_ns()), "level": LEVELS.get(severity, 2), "message": words,
            "name": "baqueano", "file": "", "line": 0,
        })  # fmt: skip

    def _subscribe(self, client: Client, requests: list[JsonObject]) -> None:
        new_topics = set[str]()
        for request in requests:
            subscription_id, channel = int(request["id"]), int(request["channelId"])
            if not 0 < channel <= len(self._topics) or not 0 <= subscription_id < 1 << 32:
                client.line.send(_status("web.foxglove-channel", str(channel)))
            elif len(client.subscriptions) >= MAX_SUBSCRIPTIONS:
                client.line.send(_status("web.foxglove-most", str(MAX_SUBSCRIPTIONS)))
            else:
                client.subscriptions[subscription_id] = self._topics[channel - 1]
                new_topics.add(self._topics[channel - 1])
        if ROUTE in new_topics:
            self._send(ROUTE, self._route(), [client])

    def _channels(self) -> list[JsonObject]:
        fields = self._about()["fields"]
        families = [
            PREFIX_TOPICS[family]
            for family in dict.fromkeys(_topic_prefix(f["name"]) for f in fields)
            if family in PREFIX_TOPICS
        ]
        self._topics = [*families, DRIVE, EVENTS, ROUTE]
        kinds = {EVENTS: "foxglove.Log", ROUTE: "foxglove.PosesInFrame"}
        return [
            {
                "id": k, "topic": topic, "encoding": "json", "schemaEncoding": "jsonschema",
                "schemaName": kinds.get(topic, "baqueano" + topic.replace("/", ".")),
                "schema": json.dumps({"type": "object", "properties": _properties(topic, fields)}),
            }
            for k, topic in enumerate(self._topics, 1)
        ]  # fmt: skip

    def _advertise_again(self) -> None:
        """Advertise the channels again if the topics have changed, as they do with other columns of another vehicle."""
        old_topics = self._topics
        channels = self._channels()
        if old_topics == self._topics:
            return
        for client in self._clients.values():
            client.subscriptions.clear()
            client.line.send({"op": "unadvertise", "channelIds": [*range(1, len(old_topics) + 1)]})
            client.line.send({"op": "advertise", "channels": channels})

    def _parameters(self, names: list[str], request_id: object) -> JsonObject:
        vehicle = self._about().get("vehicle") or {}
        shown_values: dict[str, Value] = {
            f"vehicle.{k}": vehicle[k] for k in ("name", "world", "rate_hz") if k in vehicle
        }
        shown_values |= {
            f"block.{role}": str(kind) for role, kind in (self._about().get("blocks") or {}).items()
        }
        shown_values |= dict(vehicle.get("gains") or {})
        for command in vehicle.get("command", []):
            shown_values[f"limit.{command['name']}"] = [command["low"], command["high"]]
        selection = [name for name in shown_values if not names or name in names]
        values = [{"name": name, "value": shown_values[name]} for name in selection]
        return {"op": "parameterValues", "parameters": values} | (
            {} if request_id is None else {"id": str(request_id)}
        )

    def _graph(self) -> JsonObject:
        def blocks(topic: str) -> list[str]:
            return [block for block, topics in BLOCK_OUTPUTS.items() if topic.startswith(topics)]

        return {
            "op": "connectionGraphUpdate", "advertisedServices": [], "removedTopics": [], "removedServices": [],
            "publishedTopics": [{"name": topic, "publisherIds": blocks(topic)} for topic in self._topics],
            "subscribedTopics": [
                {"name": topic, "subscriberIds": [block for block, read in BLOCK_INPUTS.items() if topic in read]}
                for topic in self._topics
            ],
        }  # fmt: skip

    def _route(self) -> JsonObject:
        route = self._about().get("route") or {"x": [], "y": []}
        pose = {"orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
        poses = [
            {"position": {"x": x, "y": y, "z": 0.0}} | pose
            for x, y in zip(route["x"], route["y"], strict=False)
        ]
        return {"timestamp": _time(self._now_ns()), "frame_id": "map", "poses": poses}

    def _send(self, topic: str, message: JsonObject, clients: Iterable[Client] | None = None) -> None:
        content = encode_json(message)
        for client in self._clients.values() if clients is None else clients:
            for subscription_id, channel_topic in client.subscriptions.items():
                if channel_topic == topic:
                    client.line.send_latest(
                        binary_frame(MESSAGE_LAYOUT.pack(DATA, subscription_id, self._now_ns()) + content)
                    )

    def _wall_time_ns(self, row: list[float]) -> int:
        """Return the wall-clock time [ns] of a row: the start of its drive plus its drive time."""
        t_s = float(row[0] or 0.0)
        if t_s < self._last_s:
            self._begun_ns = self._now_ns() - round(t_s * SECOND)
        self._last_s = t_s
        return self._begun_ns + round(t_s * SECOND)


def _topic_prefix(name: str) -> str:
    return name.partition(".")[0]


def _topic(name: str) -> str:
    return PREFIX_TOPICS.get(_topic_prefix(name), DRIVE)


def _key(name: str) -> str:
    return name.partition(".")[2] or name


def _properties(topic: str, fields: list[JsonObject]) -> JsonObject:
    if topic == EVENTS:
        return {"message": {"type": "string"}, "level": {"type": "integer"}, "name": {"type": "string"}}
    if topic == ROUTE:
        return {"frame_id": {"type": "string"}, "poses": {"type": "array", "items": {"type": "object"}}}
    return {
        _key(field["name"]): {"type": "number", "description": field["unit"]}
        for field in fields if _topic(field["name"]) == topic
    }  # fmt: skip


def _body(topic: str, fields: list[JsonObject], row: list[float]) -> bytes:
    """Return the values of one topic in this row as JSON, or b"" if all of them are None."""
    pairs = zip((field["name"] for field in fields), row, strict=False)
    values = {_key(name): x for name, x in pairs if _topic(name) == topic}
    return encode_json(values) if any(x is not None for x in values.values()) else b""


def _time(t_ns: int) -> JsonObject:
    return {"sec": t_ns // SECOND, "nsec": t_ns % SECOND}


def _status(code: str, detail: str = "") -> JsonObject:
    short_word = one_line(detail)[:40]
    return {"op": "status", "level": ERROR, "message": text(note(code, request=short_word, error=short_word))}
