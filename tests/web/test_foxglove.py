"""The Foxglove protocol with its public client: the client watches the vehicle and changes nothing."""

import asyncio
import json
import math
import os
import shutil
import struct
import subprocess
from itertools import count, pairwise
from pathlib import Path

import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from baqueano.diagnostics import Severity, note
from baqueano.web.foxglove.bridge import MESSAGE_LAYOUT, SUBPROTOCOLS, FoxgloveServer
from baqueano.web.guard import Role
from tests.web.fake_vehicle import live_page, until
from tests.web.page_client import WAIT_S

HERE = Path(__file__).with_name("foxglove")
NODE = shutil.which("node")
needs_client = pytest.mark.skipif(  # if CI is set, a missing client is a mistake, and the test fails
    (NODE is None or not (HERE / "node_modules").is_dir()) and not os.environ.get("CI"),
    reason="the public client is not installed: make browser-tools",
)
ROUTE = {"type": "route", "name": "oval", "closed": True, "length_m": 2.0, "x": [0.0, 1.0], "y": [0.0, 0.5]}
BLOCKS = {"estimator": "Ekf", "guide": "AlongRoute", "controller": "PdFeedforward"}


def address_of(server, token=""):
    return f"ws://127.0.0.1:{server.port}/foxglove" + (f"/{token}" if token else "")


async def next_word(line, *ops):
    while True:
        data = await asyncio.wait_for(line.recv(), WAIT_S)
        if isinstance(data, str) and json.loads(data)["op"] in ops:
            return json.loads(data)


@needs_client
@pytest.mark.parametrize("name", ["foxglove.sdk.v1", "foxglove.websocket.v1"])
async def test_the_public_client_receives_all_data_and_changes_nothing(tmp_path, name):
    async with live_page(tmp_path) as (server, link, live):
        link.on_word({
            "type": "vehicle", "name": "small", "world": "simulated", "rate_hz": 100.0, "blocks": BLOCKS,
            "command": [{"name": "u_x", "low": -1, "high": 1}], "gains": {"controller.k_x": 3.0},
        })  # fmt: skip
        link.on_word(ROUTE)
        program = await asyncio.create_subprocess_exec(
            str(NODE), "look.mjs", address_of(server), "3", name, cwd=HERE, stdout=subprocess.PIPE
        )
        looking = asyncio.create_task(program.communicate())
        await until(lambda: len(live.foxglove) == 1)
        k = 0
        while not looking.done():
            k += 1
            link.frame(0.1 * k, 2, **{"eta.x": 0.25, "u.0": 0.5, "z.imu[2]": math.nan if k % 2 else 1.5})
            if k == 10:
                link.on_word({"type": "event", "message": note("web.begins", Severity.WARNING)})
            await asyncio.sleep(0.1)
        message = json.loads((await looking)[0])
    assert message["name"] == name
    assert message["info"]["capabilities"] == ["parameters", "connectionGraph"]
    topics = {channel["topic"]: channel for channel in message["channels"]}
    assert {"/estimate/pose", "/command/applied", "/sensors", "/drive", "/events", "/guide/route"} <= {
        *topics
    }
    assert topics["/events"]["schemaName"] == "foxglove.Log"
    poses = message["messages"]["/estimate/pose"]
    assert poses[0]["value"] == {"x": 0.25}
    steps = [b["t"] - a["t"] for a, b in pairwise(poses)]
    assert all(step > 0.0 for step in steps)
    assert min(steps) == pytest.approx(0.01, abs=1e-3)  # the two ticks of a frame
    assert {
        sample["value"]["u_x" if "u_x" in sample["value"] else "0"]
        for sample in message["messages"]["/command/applied"]
    } == {0.5}
    assert message["messages"]["/guide/route"][0]["value"]["poses"][1]["position"] == {
        "x": 1.0,
        "y": 0.5,
        "z": 0.0,
    }
    assert message["messages"]["/events"][0]["value"]["level"] == 3
    values = {parameter["name"]: parameter["value"] for parameter in message["parameters"]["all"]}
    assert values["controller.k_x"] == 3.0
    assert values["block.estimator"] == "Ekf"
    assert values["limit.u_x"] == [-1, 1]
    assert message["parameters"]["mine"] == message["parameters"]["all"]  # the set value is unchanged
    assert len(message["statuses"]) >= 3  # set, publish, updates
    publishers = {topic["name"]: topic["publisherIds"] for topic in message["graph"]["publishedTopics"]}
    subscribers = {topic["name"]: topic["subscriberIds"] for topic in message["graph"]["subscribedTopics"]}
    assert publishers["/estimate/pose"] == ["estimator"]
    assert set(subscribers["/estimate/pose"]) == {"guide", "controller"}
    assert "world" in subscribers["/command/applied"]
    assert message["closed"] == 1003  # the client published
    assert {word["type"] for word in link.messages} == {"watch", "routes"}  # the vehicle received nothing


@pytest.mark.parametrize("name", SUBPROTOCOLS)
async def test_both_names_of_the_foxglove_protocol_are_accepted(tmp_path, name):
    async with (
        live_page(tmp_path) as (server, link, _),
        connect(address_of(server), subprotocols=[name]) as line,
    ):
        assert line.subprotocol == name
        info = await next_word(line, "serverInfo")
        assert "small" in info["name"]
        channels = (await next_word(line, "advertise"))["channels"]
        channel_id = next(channel["id"] for channel in channels if channel["topic"] == "/drive")
        await line.send(
            json.dumps({"op": "subscribe", "subscriptions": [{"id": 7, "channelId": channel_id}]})
        )
        await line.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 8, "channelId": 99}]}))
        assert "99" in (await next_word(line, "status"))["message"]
        link.frame(1.0, nis=1.25)
        data = await asyncio.wait_for(line.recv(), WAIT_S)
        opcode, number, _ = MESSAGE_LAYOUT.unpack(data[: MESSAGE_LAYOUT.size])
        assert (opcode, number) == (1, 7)
        assert json.loads(data[MESSAGE_LAYOUT.size :])["nis"] == 1.25
        for request in (
            {"op": "subscribe"},
            {"op": "unsubscribe", "subscriptionIds": ["x"]},
            {"op": "fetchAsset"},
        ):
            await line.send(json.dumps(request))
            await next_word(line, "status")


class Line:
    """A client that stores what it receives."""

    def __init__(self):
        self.pictures = b""

    def send(self, message):
        pass

    def send_latest(self, picture):
        self.pictures += picture


def test_a_row_has_the_same_time_in_each_topic():
    fields = [{"name": name, "unit": ""} for name in ("t", "eta.x", "u.0")]
    clock = count(0, 10**6)
    line = Line()
    bridge = FoxgloveServer(lambda: {"fields": fields}, now_ns=lambda: next(clock))
    bridge.add_client(line)
    subscriptions = [{"id": k, "channelId": k} for k in (1, 2)]
    asyncio.run(bridge.receive(line, {"op": "subscribe", "subscriptions": subscriptions}))
    for first in (0, 2):
        bridge.send_rows([[0.01 * k, 0.5, 0.25] for k in (first, first + 1)])
    times, data = {1: [], 2: []}, line.pictures
    while data:
        _, number, t_ns = MESSAGE_LAYOUT.unpack_from(data, 2)
        times[number].append(t_ns)
        data = data[2 + data[1] :]
    assert times[1] == times[2]
    assert [b - a for a, b in pairwise(times[1])] == [10**7] * 3


def test_ne5_a_route_is_encoded_once_for_many_subscriptions_and_sent_to_their_client_alone():
    routes, single, other = [], Line(), Line()

    def about():
        return {"fields": [], "route": routes.append(1) or {"x": [0.0], "y": [0.0]}}

    bridge = FoxgloveServer(about)
    bridge.add_client(single)
    bridge.add_client(other)
    for line in (single, other):
        routes.clear()
        single.pictures = b""
        requests = [{"id": k, "channelId": 3} for k in range(20)]
        asyncio.run(bridge.receive(line, {"op": "subscribe", "subscriptions": requests}))
        assert line.pictures.count(b"map") == 20
        assert len(routes) == 1
    assert not single.pictures


async def test_ne2_ne3_a_foxglove_program_needs_a_token_like_a_browser(tmp_path):
    async def status_of(url, **options):
        with pytest.raises(InvalidStatus) as error:
            await connect(url, subprotocols=[SUBPROTOCOLS[0]], **options).__aenter__()
        return error.value.response.status_code

    async with live_page(tmp_path) as (server, _, _):
        evil = {"origin": "https://evil.example"}
        assert await status_of(address_of(server), **evil) == 403
        assert await status_of(address_of(server, "x" * 22)) == 403
        token = server.guard.tokens[Role.VIEW]
        # Foxglove's own page
        async with connect(address_of(server, token), subprotocols=[SUBPROTOCOLS[0]], **evil) as line:
            await next_word(line, "serverInfo")
        with pytest.raises(InvalidStatus):
            await connect(address_of(server)).__aenter__()  # of an unknown protocol
    async with live_page(tmp_path, shared_address="127.0.0.2") as (server, _, _):
        assert await status_of(address_of(server)) == 403


async def test_a_program_that_publishes_is_disconnected(tmp_path):
    async with (
        live_page(tmp_path) as (server, link, _),
        connect(address_of(server), subprotocols=[SUBPROTOCOLS[1]]) as line,
    ):
        await line.send(struct.pack("<BI", 1, 1) + b"{}")
        with pytest.raises(ConnectionClosed):
            await asyncio.wait_for(all_of(line), WAIT_S)
        assert {word["type"] for word in link.messages} == {"watch", "routes"}


async def all_of(line):
    """Read until the connection ends."""
    while True:
        await line.recv()
