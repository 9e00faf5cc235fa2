"""The costs of viewers as counts: bytes of a picture, encodings of a tick. Times are in benchmarks/."""

import asyncio
from contextlib import AsyncExitStack

from baqueano.web import live as live_module
from baqueano.web.feed import HEAD_LAYOUT
from baqueano.web.visitor import Visitor
from benchmarks.page import VIEWERS
from tests.web.fake_vehicle import COLUMNS, live_page
from tests.web.page_client import browser
from tests.web.test_live import until_frames

TICKS, ROWS = 20, 5  # pictures, and ticks in a picture


async def test_five_viewers_share_one_encoding_of_each_picture(tmp_path, monkeypatch):
    encoded_frames, shown_messages, frame_of, show = [], [], live_module.binary_frame, Visitor.send_latest

    def encode(data):
        encoded_frames.append(frame_of(data))
        return encoded_frames[-1]

    def show_picture(visitor, picture):
        shown_messages.append(picture)
        show(visitor, picture)

    monkeypatch.setattr(live_module, "binary_frame", encode)
    monkeypatch.setattr(Visitor, "send_latest", show_picture)
    async with live_page(tmp_path) as (server, link, _), AsyncExitStack() as room:
        viewers = [await room.enter_async_context(browser(server)) for _ in range(VIEWERS)]
        for k in range(TICKS):
            link.frame(0.05 * k, ROWS)
            await asyncio.gather(*[until_frames(viewer, k + 1) for viewer in viewers])
        assert len(encoded_frames) == TICKS
        assert len(shown_messages) == TICKS * VIEWERS
        assert {id(picture) for picture in shown_messages} == {
            id(picture) for picture in encoded_frames
        }  # no copies
        size = HEAD_LAYOUT.size + ROWS * len(COLUMNS) * 4  # float32 and nothing else
        assert {len(frame) for viewer in viewers for frame in viewer.frames} == {size}
