"""A browser that connects during a drive receives the rows so far, and then each later row."""

import asyncio
import gc
import os
import sys

import numpy as np
import pytest

from baqueano.web.feed import HEAD_LAYOUT, RING_S, Feed
from tests.web.fake_vehicle import COLUMNS, live_page, until
from tests.web.page_client import Browser, browser, line_to
from tests.web.test_live import until_frames


async def test_a_browser_that_connects_during_a_drive_receives_the_last_minute(tmp_path):
    async with live_page(tmp_path) as (server, link, live):
        for k in range(80):
            link.frame(float(k), 100, **{"eta.x": k})
        async with browser(server) as visitor:
            await until_frames(visitor, 1)
            rows = visitor.rows(0, len(COLUMNS))
            assert rows[0, 0] >= 79 - RING_S
            assert len(rows) == 61 * 100
            await visitor.send("history", **{"from": 75.0})
            await until_frames(visitor, 2)
            assert visitor.rows(0, len(COLUMNS))[len(rows), 0] == 75.0
        link.frame(0.01)  # another drive begins
        head, *rows = await anext(live.feed.history())
        assert HEAD_LAYOUT.unpack(head)[1] == len(rows) == 1


async def test_a_browser_that_connects_during_a_drive_misses_no_row(tmp_path):
    """The last minute is longer than the buffers of the sockets, and the drive continues while it is sent."""
    async with live_page(tmp_path) as (server, link, _), line_to(server, max_queue=1) as line:
        for k in range(60):
            link.frame(float(k), 400, **{"eta.x": k})
        line.transport.pause_reading()
        visitor = Browser(line)
        await visitor.send("hello", lang="en")
        (guest,) = server.visitors
        await until(guest._writer.transport.get_write_buffer_size)
        for k in range(60, 80):
            link.frame(60.0 + 0.05 * (k - 60), 5, **{"eta.x": k})
        line.transport.resume_reading()
        while 79 not in (x := visitor.rows(0, len(COLUMNS))[:, 1]):
            await until_frames(visitor, len(visitor.frames) + 1)
        assert x.tolist() == [k for k in range(80) for _ in range(400 if k < 60 else 5)]


async def test_the_history_ends_for_a_browser_that_is_slower_than_the_drive():
    feed = Feed()
    feed.begin_drive(COLUMNS)
    feed.add_rows({"x": [[0.0] * len(COLUMNS)]})
    sent_count = 0
    async for _ in feed.history():
        sent_count += 1
        feed.add_rows({"x": [[0.05 * sent_count, *[0.0] * (len(COLUMNS) - 1)]]})
    assert sent_count == 1


@pytest.mark.skipif(sys.platform != "linux", reason="counts open files in /proc")
async def test_two_hundred_pages_that_open_and_close_leave_nothing_behind(tmp_path):
    """Neither a file, nor a task, nor an object per page remains, however the page ends."""

    async def visit(server, link, k):
        async with browser(server, name=f"ana {k}") as visitor:
            await visitor.send("take")
            await visitor.send("identify", on=True)
            await visitor.request("ping")
            link.frame(0.01 * k)
            if k % 2:
                visitor.line.transport.abort()
        await until(lambda: not server.visitors)

    async def left(server):
        await until(lambda: not server._connections and len(asyncio.all_tasks()) < 10)  # no task remains
        gc.collect()
        return np.array([len(os.listdir("/proc/self/fd")), len(gc.get_objects())])

    async with live_page(tmp_path) as (server, link, _):
        for k in range(70):  # more than each bounded buffer holds
            await visit(server, link, k)
        before = await left(server)
        for k in range(70, 270):
            await visit(server, link, k)
        assert np.all(await left(server) - before < [5, 200])
