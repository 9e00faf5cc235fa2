"""The limits for a browser: sizes, rates, numbers, timeouts."""

import asyncio
import time
from contextlib import AsyncExitStack

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.frames import Frame, Opcode

from baqueano.web import server as serving
from baqueano.web.feed import HEAD_LAYOUT
from baqueano.web.guard import RateLimit
from baqueano.web.lab.worker_client import WorkerClient
from baqueano.web.visitor import FRAGMENT_BYTES
from tests.web.fake_vehicle import live_page, until
from tests.web.page_client import WAIT_S, browser, drive, folder_of, line_to, recorded_page, request
from tests.web.test_live import until_frames


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return folder_of(tmp_path_factory.mktemp("page") / "runs", circle=drive())


async def test_ne5_messages_are_limited_in_size_and_rate(folder):
    async with recorded_page(folder, "circle") as server:
        for frame, code in (
            (" " * 17000, 1009),
            (b"binary", 1003),
            ("[1]", 1008),
            ('{"type": 3}', 1008),
            ("{", 1008),
            ('{"type": "ask", "question": "ping", "id": %s}' % ("[" * 600 + "]" * 600), 1008),
        ):
            async with browser(server) as visitor:
                await visitor.line.send(frame)
                with pytest.raises(ConnectionClosed):
                    await visitor.next("never")
                assert visitor.line.close_code == code, frame
        async with browser(server) as visitor:
            for _ in range(300):
                try:
                    await visitor.send("ask", id=1, question="ping")
                except ConnectionClosed:
                    break
            with pytest.raises(ConnectionClosed):
                await visitor.next("never")
            assert visitor.line.close_code == 1008


@pytest.mark.parametrize("opcode", [Opcode.CONT, Opcode.PING])
async def test_ne5_frames_without_a_message_are_limited_in_rate(folder, opcode):
    beginning = Frame(Opcode.TEXT, b"", fin=False).serialize(mask=True) if opcode is Opcode.CONT else b""
    flood = beginning + Frame(opcode, b"", fin=opcode is Opcode.PING).serialize(mask=True) * 150
    async with recorded_page(folder, "circle") as server, browser(server) as visitor:
        visitor.line.transport.write(flood)
        with pytest.raises(ConnectionClosed):
            await visitor.next("never")
        assert visitor.line.close_code == 1008


@pytest.mark.parametrize("question", [{"question": "identify"}, {"question": "compare"}])
async def test_ne5_a_browser_with_many_waiting_questions_is_disconnected(folder, monkeypatch, question):
    async def never(lab, *request, **words):
        await asyncio.Event().wait()

    async with (
        recorded_page(folder, "circle") as server,
        browser(server) as visitor,
        browser(server) as other,
    ):
        run = visitor.hello["runs"][0]["id"]
        await visitor.next("runs")
        monkeypatch.setattr(WorkerClient, "request", never)
        for number in range(40):
            await visitor.send("ask", id=number, run=run, runs=[run], **question)
        with pytest.raises(ConnectionClosed):
            await visitor.next("never")
        assert visitor.line.close_code == 1008
        assert await other.request("ping")


async def test_ne5_the_question_of_a_browser_waits_for_one_question_of_another_browser(folder, monkeypatch):
    """A worker answers one question at a time. A browser that leaves takes its waiting questions with it."""
    begun_requests, may_end, exchange = [], asyncio.Event(), WorkerClient._exchange

    async def slow(lab, request):
        if request["type"] != "check":
            return await exchange(lab, request)
        begun_requests.append(request["room"])
        await may_end.wait()
        return {"findings": []}, b""

    monkeypatch.setattr(WorkerClient, "_exchange", slow)
    async with recorded_page(folder, "circle") as server, browser(server) as visitor:
        async with browser(server) as other:
            run = visitor.hello["runs"][0]["id"]
            for number in range(20):
                await other.send("ask", id=number, question="check", room="guide", run=run)
            await until(lambda: begun_requests == ["guide"])
            await visitor.send("ask", id=100, question="check", room="controller", run=run)
            assert await visitor.request("ping")
            may_end.set()
            await visitor.next("answer", id=100)
            assert begun_requests.index("controller") <= 2
            await other.next("answer", id=19)
            may_end.clear()
            for number in range(20):
                await other.send("ask", id=number, question="check", room="guide", run=run)
            await until(lambda: len(begun_requests) == 22)
        await until(lambda: len(server.visitors) == 1)
        may_end.set()
        assert (await visitor.request("check", room="controller", run=run))["findings"] == []
        assert len(begun_requests) == 23


def test_ne5_at_most_fifty_messages_per_second_are_accepted():
    now = 0.0
    rate = RateLimit(50.0, lambda: now)
    assert sum(rate.allows_message() for _ in range(200)) == 100
    now = 1.0
    assert sum(rate.allows_message() for _ in range(200)) == 50


async def test_ne5_at_most_thirty_two_browsers_are_accepted(folder):
    async with recorded_page(folder, "circle") as server, AsyncExitStack() as stack:
        lines = [await stack.enter_async_context(line_to(server)) for _ in range(serving.MAX_VISITORS)]
        with pytest.raises(InvalidStatus, match="503"):
            async with line_to(server):
                pass
        await lines[0].close()
        while len(server.visitors) == serving.MAX_VISITORS:
            await asyncio.sleep(0.01)
        async with browser(server) as visitor:
            assert visitor.hello["role"] == "drive"


async def test_ne5_one_machine_of_the_network_leaves_places_for_the_others(folder):
    async def answer(server, machine, head=b""):
        reader, writer = await asyncio.open_connection("127.0.0.2", server.port, local_addr=(machine, 0))
        writer.write(head)
        return reader, writer

    async with recorded_page(folder, "circle", shared_address="127.0.0.2") as server:
        silent = [await answer(server, "127.0.0.3") for _ in range(serving.MAX_ADDRESS_CONNECTIONS)]
        head = f"GET / HTTP/1.1\r\nHost: 127.0.0.2:{server.port}\r\n\r\n".encode()
        reader, one_more = await answer(server, "127.0.0.3")
        assert await asyncio.wait_for(reader.read(), WAIT_S) == b""
        reader, other = await answer(server, "127.0.0.4", head)
        assert (await asyncio.wait_for(reader.read(), WAIT_S)).startswith(b"HTTP/1.1 200 OK")
        for _, writer in silent:
            writer.close()
        await until(lambda: not server._connections["127.0.0.3"])
        reader, second_answer = await answer(server, "127.0.0.3", head)
        assert (await asyncio.wait_for(reader.read(), WAIT_S)).startswith(b"HTTP/1.1 200 OK")
        for writer in (one_more, other, second_answer):
            writer.close()


async def test_ne5_websocket_messages_are_not_compressed(folder):
    async with recorded_page(folder, "circle") as server, line_to(server, compression="deflate") as line:
        assert "Sec-WebSocket-Extensions" not in line.response.headers


async def test_ne5_a_silent_connection_is_closed(folder, monkeypatch):
    monkeypatch.setattr(serving, "HANDSHAKE_TIMEOUT_S", 0.3)
    async with recorded_page(folder, "circle") as server:
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        writer.write(b"GET / HTTP/1.1\r\nHost:")
        assert await asyncio.wait_for(reader.read(), WAIT_S) == b""
        writer.close()
        async with line_to(server) as line:
            with pytest.raises(ConnectionClosed):
                await asyncio.wait_for(line.recv(), WAIT_S)


async def test_ne5_a_long_request_header_is_refused(folder):
    async with recorded_page(folder, "circle") as server:
        assert (await request(server, "GET / HTTP/1.1\r\nX: " + "a" * 40000))[0] in (431, 0)
        headers = "\r\n".join(f"X{k}: 1" for k in range(100))
        assert (await request(server, f"GET / HTTP/1.1\r\n{headers}"))[0] == 400


async def test_a_browser_that_does_not_read_is_disconnected(folder):
    async with recorded_page(folder, "circle") as server, browser(server) as guest:
        (visitor,) = server.visitors
        guest.line.transport.pause_reading()
        picture, start_s = bytes(200_000), time.monotonic()
        for _ in range(400):
            visitor.send_latest(picture)
            await asyncio.sleep(0)
        assert time.monotonic() - start_s < WAIT_S
        assert visitor._writer.transport.get_write_buffer_size() <= len(picture) + 100
        for _ in range(70):
            visitor.send({"type": "event", "text": "x" * 1000})
        while server.visitors:
            await asyncio.sleep(0.01)
        guest.line.transport.abort()


async def test_ne5_browsers_that_do_not_read_share_one_history_buffer(tmp_path):
    async with live_page(tmp_path) as (server, link, live):
        for k in range(60):
            link.frame(float(k), 400)
        total_bytes = sum(map(len, await anext(live.feed.history())))
        assert total_bytes > 20 * FRAGMENT_BYTES
        async with AsyncExitStack() as lines:
            for _ in range(12):
                line = await lines.enter_async_context(line_to(server, max_queue=1))
                line.transport.pause_reading()
                await line.send('{"type": "hello", "lang": "en"}')
            await until(lambda: len(live._browsers()) == 12)
            await asyncio.sleep(0.3)
            buffers = [visitor._writer.transport.get_write_buffer_size() for visitor in server.visitors]
            assert max(buffers) <= FRAGMENT_BYTES + 100
            async with browser(server) as visitor:
                link.frame(60.0, 5)  # while the last minute is sent
                await until_frames(visitor, 2)
                assert {HEAD_LAYOUT.unpack(frame[:16])[1] for frame in visitor.frames} == {60 * 400, 5}
                assert max(map(len, visitor.frames)) == total_bytes
