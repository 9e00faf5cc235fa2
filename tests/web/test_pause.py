"""Pause the repetition of a robot: the robot waits on its route."""

import pytest

from baqueano.diagnostics import note
from tests.web.chromium import CHROMIUM
from tests.web.fake_vehicle import live_page, until
from tests.web.page_client import browser
from tests.web.screens import PAGE, open_page, until as wait_until
from tests.web.scripted import ScriptedServer


async def test_a_robot_waits_on_its_route_during_a_pause_and_then_goes_on(tmp_path):
    """The page sets the pace of the guide, and reports the pace that the robot has set."""
    async with live_page(tmp_path) as (server, link, _), browser(server) as ana:

        async def state(**expected):
            link.state("MISSION", **expected)
            return await ana.next("state", state="MISSION")

        await ana.send("take")
        assert (await state(mission="teach"))["paused"] is None  # without a guide
        assert (await state(mission="repeat"))["paused"] is False
        for word, pace in (("pause", 0.0), ("go", 1.0)):
            await ana.send("take")
            await ana.send(word)
            await until(lambda: link.requests("set"))
            assert link.messages.pop() == {"type": "set", "path": "guide.pace", "value": pace}
            message = note("door.set", path="guide.pace", former_value="1.0", value=str(pace))
            link.on_word({"type": "event", "message": message})
            await ana.next("state", paused=pace == 0.0)


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: sudo apt-get install chromium")
def test_a_repetition_of_a_robot_is_paused_and_continued_by_a_button_and_a_key(tab):
    with ScriptedServer("live", world="real") as live:
        live.pace = None
        open_page(tab, live)
        tab.press("l", "KeyL", "l")
        pause = f"{PAGE}.screen.pause"
        tab.wait(f"{PAGE}.hand.mine && !{pause}.disabled")
        tab.js(f"{pause}.click()")
        wait_until(lambda: live.words("pause"))
        tab.wait(f"{pause}.innerText.startsWith('Continue') && {pause}.ariaPressed === 'true'")
        tab.press("p", "KeyP", "p")
        wait_until(lambda: live.words("go"))
        tab.wait(f"{pause}.innerText.startsWith('Pause')")
        live.paused = None  # a person teaches it
        live.go("MANUAL", "teach")
        tab.wait(f"{pause}.disabled")
