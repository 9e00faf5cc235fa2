"""A vehicle on the page: the forwarded commands, the viewers, and the texts."""

import asyncio
import math
import struct

import numpy as np
import pytest

from baqueano.diagnostics import Severity, StopReason, note, stop
from baqueano.web.feed import HEAD_LAYOUT, Feed
from baqueano.web.guard import Role
from tests.web.fake_vehicle import COLUMNS, VEHICLE, live_page, until
from tests.web.page_client import WAIT_S, browser


async def test_the_hello_message_describes_vehicle_routes_and_fields(tmp_path):
    async with live_page(tmp_path) as (server, link, _):
        assert link.messages[0] == {"type": "watch", "hz": 20.0}
        link.on_word({"type": "routes", "routes": [{"name": "oval"}]})
        async with browser(server, "es", name="Ana") as visitor:
            hello = visitor.hello
            assert (hello["mode"], hello["you"], hello["driver"]) == ("live", "Ana", None)
            assert not hello["shared"]
            assert hello["vehicle"]["name"] == "small"
            assert hello["routes"] == ["oval"]
            assert [field["name"] for field in hello["fields"]] == COLUMNS
            assert hello["fields"][0]["label"] == "tiempo"
            assert hello["state"]["state"] == "READY"


async def until_frames(visitor, count):
    """Receive until this many frames have arrived."""
    async with asyncio.timeout(WAIT_S):
        while len(visitor.frames) < count:
            data = await visitor.line.recv()
            if isinstance(data, bytes):
                visitor.frames.append(data)


def test_frames_are_float32_in_the_order_of_the_fields():
    feed = Feed()
    feed.begin_drive(COLUMNS)
    frame = feed.add_rows({"x": [[1.0, 2.0, None, 4.0, 5.0, 6.0, 7.0], [1.5, 0, 0, 0, 0, 0, 1e-3]]})
    number, rows, t0 = struct.unpack("<IId", frame[:16])
    assert (number, rows, t0) == (1, 2, 1.0)
    x = np.frombuffer(frame, "<f4", offset=16).reshape(2, 7)
    assert math.isnan(x[0, 2])
    assert x[1, 6] == np.float32(1e-3)
    assert feed.value("cross") == 1e-3
    assert math.isnan(feed.value("battery"))
    assert feed.add_rows({"x": [[1.0]]}) is None
    for x in (5, [5], [None], {"a": 1}, [["a"] * 7]):  # of a robot that lies
        assert feed.add_rows({"x": x}) is None
    assert feed.add_rows({}) is None


def test_the_mean_of_a_column_is_taken_over_the_last_seconds():
    feed = Feed()
    feed.begin_drive(COLUMNS)
    for k in range(30):
        feed.add_rows(
            {"x": [[float(k), 0, 0, 0, 1.0 if k < 20 else 3.0, 0, 0], [k + 0.5, 0, 0, 0, None, 0, 0]]}
        )
    assert feed.mean("nis", 9.5) == (3.0, 10)
    assert feed.mean("battery", 9.0)[1] == 0


async def test_the_page_forwards_each_heartbeat_of_the_driver_and_adds_none(tmp_path):
    page = live_page(tmp_path)
    async with (
        page as (server, link, live),
        browser(server, name="ana") as ana,
        browser(server, name="luis") as luis,
    ):
        await ana.send("beat", n=1, frame=0, u=[0.1])
        await ana.send("take")
        assert (await ana.next("lease", you=True))["driver"] == "ana"
        for n in range(1, 6):
            link.frame(0.05 * n)
            await ana.send("beat", n=n, frame=live.feed.number, u=[0.1 * n])
            await luis.send("beat", n=n, frame=live.feed.number, u=[-1.0])
            await until(lambda n=n: len(link.requests("hand")) == n)
        assert [word["u"] for word in link.requests("hand")] == [[0.1 * n] for n in range(1, 6)]
        await ana.send("beat", n=5, frame=live.feed.number, u=[1.0])
        await ana.send("beat", n=4, frame=live.feed.number, u=[1.0])
        await ana.next("lease", driver=None)  # the driver was silent
        assert len(link.requests("hand", "beat")) == 5


async def test_heartbeats_of_a_driver_with_a_frozen_picture_are_not_forwarded(tmp_path):
    async with live_page(tmp_path) as (server, link, live), browser(server) as ana:
        await ana.send("take")
        frame, n = live.feed.number, 0
        while live.lease.holder is not None or n == 0:
            n += 1
            link.frame(0.05 * n)
            await ana.send("beat", n=n, frame=frame, u=[1.0])
            await asyncio.sleep(0.05)
        assert len(link.requests("hand")) < 16  # 0.3 s plus the permitted delay of the connection
        assert n > 2


@pytest.mark.parametrize("u", [[1e400], ["a"], None, 3, [float("nan")], [0.0] * 9, [True], [None]])
async def test_a_heartbeat_with_an_invalid_command_is_refused(tmp_path, u):
    async with live_page(tmp_path) as (server, link, _), browser(server) as ana:
        await ana.send("take")
        await ana.send("beat", n=1, frame=0, u=u)
        assert (await ana.next("refused"))["to"] == "beat"
        assert not link.requests("hand")


async def test_anyone_stops_the_vehicle_without_the_lease(tmp_path):
    async with live_page(tmp_path, shared_address="127.0.0.2") as (server, link, _):
        tokens = server.guard.tokens
        async with (
            browser(server, token=tokens[Role.DRIVE]) as driver,
            browser(server, token=tokens[Role.STOP], name="eva") as stopper,
            browser(server, token=tokens[Role.VIEW]) as viewer,
        ):
            await driver.send("take")
            await viewer.send("stop")
            assert (await viewer.next("refused"))["code"] == "web.role"
            assert not link.requests("stop")
            await stopper.send("take")
            assert (await stopper.next("refused"))["code"] == "web.role"
            await stopper.send("stop")
            await until(lambda: link.requests("stop"))
            reason = link.requests("stop")[0]["reason"]
            assert (reason.code, reason.figures["name"]) == (StopReason.STOPPED_ON_PAGE, "eva")
            link.state("STOPPED", reason=reason)
            for visitor in (driver, stopper, viewer):
                assert "eva" in (await visitor.next("state", state="STOPPED"))["sentence"]


MOVING = (
    ("mission", {"kind": "drive"}), ("mark", {}), ("end", {}), ("pause", {}), ("go", {}), ("give", {}),
    ("set", {"path": "controller.k_x", "value": 1.0}), ("shake", {"kind": "push"}),
)  # fmt: skip


async def test_moving_the_vehicle_needs_the_lease(tmp_path):
    async with live_page(tmp_path) as (server, link, _), browser(server) as ana, browser(server) as luis:
        before = len(link.messages)
        for holder in (False, True):
            if holder:
                await ana.send("take")
                await ana.next("lease", you=True)
            for word, fields in MOVING:
                await luis.send(word, **fields)
                no = await luis.next("refused")
                assert (no["code"], no["to"]) == ("web.lease-needed", word)
        assert len(link.messages) == before


async def test_missions_are_requested_only_by_name(tmp_path):
    async with live_page(tmp_path) as (server, link, _), browser(server) as ana:
        await ana.send("take")
        await ana.send("mission", kind="repeat", route="oval", laps=3, mission="{}", by="me", seed=1)
        await until(lambda: link.requests("mission"))
        mission = link.requests("mission")[0]
        assert {"kind": "repeat", "route": "oval", "laps": 3, "attended": True}.items() <= mission.items()
        assert "mission" not in mission
        assert "seed" not in mission
        for fields in (
            {"kind": "fly"},
            {"kind": "repeat", "route": 3},
            {"kind": "repeat", "route": "x" * 99},
            {},
        ):
            await ana.send("take")
            await ana.send("mission", **fields)
            assert (await ana.next("refused"))["to"] == "mission"
        assert len(link.requests("mission")) == 1
        link.on_word(
            {
                "type": "refused",
                "reason": "no such route",
                "diagnostic": note("door.no-route", value="oval", valid=[]),
            }
        )
        assert "oval" in (await ana.next("refused"))["reason"]


async def test_the_vehicle_is_handed_over_by_name(tmp_path):
    page = live_page(tmp_path)
    async with (
        page as (server, link, live),
        browser(server, name="ana") as ana,
        browser(server, name="luis") as luis,
    ):
        await ana.send("take")
        await luis.send("take")
        no = await luis.next("refused")
        assert no["code"] == "web.lease-taken"
        assert "ana" in no["reason"]
        await ana.send("take")
        await ana.send("give", to="luis")
        assert (await luis.next("lease", you=True))["driver"] == "luis"
        await luis.send("beat", n=1, frame=live.feed.number, u=[0.3])
        await until(lambda: link.requests("hand"))
        await luis.line.close()
        await until(lambda: live.lease.holder is None)


async def test_a_disconnected_browser_releases_its_lease(tmp_path):
    async with live_page(tmp_path) as (server, link, live):
        async with browser(server) as ana:
            await ana.send("take")
            await until(lambda: live.lease.holder is not None)
            ana.line.transport.abort()
            await until(lambda: not server.visitors)
        assert live.lease.holder is None
        assert not link.requests("hand")


async def test_the_status_sentence_reports_task_quality_and_anomalies(tmp_path):
    page = live_page(tmp_path)
    async with page as (server, link, _), browser(server, "es") as uno, browser(server, "en") as english:
        link.on_word(
            {"type": "route", "name": "oval", "closed": True, "length_m": 2.0, "x": [0, 1], "y": [0, 1]}
        )
        for k in range(20):
            link.frame(0.5 * k, 10, nis=4.0, progress=2.5, cross=-0.012)
        link.on_word(
            {
                "type": "event",
                "level": "warning",
                "message": note("sensor.degraded", Severity.WARNING, cause="imu[2]"),
            }
        )
        link.state("MISSION", mission="repeat", laps=3, left_s=12.0, t_s=9.0, pace=1.0, paused=False)
        state = await english.next("state", state="MISSION")
        assert (state["lap"], state["laps"], state["mission"]) == (2, 3, {"kind": "repeat", "route": "oval"})
        assert state["title"] == "REPEATING"
        assert "Lap 2 of 3" in state["sentence"]
        assert "1.2 cm" in state["sentence"]
        assert "NIS 4.0" in state["sentence"]
        assert (state["severity"], len(state["warnings"])) == ("warning", 1)
        assert "1,2 cm" in (await uno.next("state", state="MISSION"))["sentence"]


async def test_the_reason_of_a_stop_is_reported_once(tmp_path):
    stop_reason = stop(StopReason.STOPPED_BY, words="it nears the stairs")
    async with live_page(tmp_path) as (server, link, _), browser(server) as guest:
        link.frame(1.0)
        link.on_word({"type": "done", "id": "x", "run": None, "reason": stop_reason})
        link.state("STOPPED", reason=stop_reason)
        state = await guest.next("state", state="STOPPED")
        assert (state["severity"], state["warnings"]) == ("error", [])
        assert "it nears the stairs" in state["sentence"]


async def test_a_change_of_vehicle_sends_a_new_hello_message(tmp_path):
    async with live_page(tmp_path) as (server, link, _), browser(server) as visitor:
        link.on_word(VEHICLE | {"name": "car"})
        link.on_word({"type": "fields", "names": ["t", "battery"], "units": ["s", "V"]})
        hello = await visitor.next("hello")
        assert hello["vehicle"]["name"] == "car"
        assert [field["label"] for field in hello["fields"]] == ["time", "battery"]


async def test_a_browser_that_does_not_read_does_not_delay_others(tmp_path):
    page = live_page(tmp_path)
    async with page as (server, link, live), browser(server) as stalled_visitor, browser(server) as visitor:
        stalled_visitor.line.transport.pause_reading()
        for k in range(1500):
            link.frame(0.05 * k, 5)
            await asyncio.sleep(0)
        last_number = live.feed.number
        while True:
            data = await asyncio.wait_for(visitor.line.recv(), WAIT_S)
            if isinstance(data, bytes) and HEAD_LAYOUT.unpack(data[:16])[0] == last_number:
                break
        buffers = [visitor._writer.transport.get_write_buffer_size() for visitor in server.visitors]
        assert max(buffers) < 1 << 20
        stalled_visitor.line.transport.abort()


async def test_the_end_of_the_service_is_reported_to_all_browsers(tmp_path):
    async with live_page(tmp_path) as (server, link, live), browser(server) as visitor:
        link.gone = True
        await visitor.send("stop")
        assert (await visitor.next("refused"))["code"] == "web.service-ended"
        live._state = {"type": "state", "state": "STOPPED", "reason": stop(StopReason.SERVICE_ENDED)}
        live._has_changed = True
        assert (await visitor.next("state", state="STOPPED"))["severity"] == "error"


async def test_a_robot_receives_complete_missions_packed_by_the_page(tmp_path):
    from baqueano.drive.mission import Mission
    from baqueano.guides.shapes import sinuous_circle
    from baqueano.runs.route_file import write_route
    from baqueano.web.lab.local_files import LocalFiles

    write_route(sinuous_circle(0.6, 0.08, 5, 0.2), tmp_path / "oval.csv")
    page = live_page(tmp_path)
    async with page as (server, link, live):
        files = LocalFiles("robot", "small", tmp_path, tmp_path / "runs")
        live.use_local_files(files, await files.describe())
        async with browser(server) as ana:
            assert ana.hello["routes"] == ["oval"]
            for kind, fields in (
                ("repeat", {"route": "oval", "laps": 2}),
                ("drive", {}),
                ("teach", {"name": "ring"}),
            ):
                await drive_page(ana, link, kind, **fields)
                mission = Mission.from_json(link.requests("mission")[-1]["mission"])
                assert (mission.kind, mission.laps) == (kind, fields.get("laps", 1))
                assert 'name = "small"' in mission.vehicle
            for kind, fields in (
                ("repeat", {"route": "../oval"}),
                ("teach", {}),
                ("teach", {"name": "../x"}),
            ):
                await ana.send("take")
                await ana.send("mission", kind=kind, **fields)
                assert (await ana.next("refused"))["to"] == "mission"
        await files.close()


async def drive_page(visitor, link, kind, **fields):
    """Request a mission, and send heartbeats until it is packed."""
    before, n = len(link.requests("mission")), 0
    await visitor.send("take")
    await visitor.send("mission", kind=kind, **fields)
    async with asyncio.timeout(WAIT_S):
        while len(link.requests("mission")) == before:
            n += 1
            await visitor.send("beat", n=n, frame=0, u=[0.0])
            await asyncio.sleep(0.05)
