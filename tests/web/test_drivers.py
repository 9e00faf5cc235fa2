"""Two to five browsers at once, over sockets: commands come from one driver at a time, for any order of messages."""

import random
from contextlib import AsyncExitStack

import pytest

from baqueano.web.lease import LEASE_S
from tests.web.fake_vehicle import live_page, until
from tests.web.page_client import browser
from tests.web.test_lease import Clock

NAMES = ("ana", "luis", "eva", "juan", "mia")
WORDS = (*3 * ["take"], *8 * ["beat"], "give", "give to", "give to", "late", "stop", "drive", "drive", "gone")
STEPS = 80


class Model:
    """The driver by the rules of lease.py, and the commands that the vehicle should receive."""

    def __init__(self, clock):
        self.clock, self.holder, self.until_s, self.n = clock, None, 0.0, 0
        self.commands, self.missions = [], 0

    def now(self):
        """Return the present driver."""
        if self.holder is not None and self.clock.s > self.until_s:
            self.holder = None
        return self.holder

    def hold(self, driver):
        self.holder, self.until_s, self.n = driver, self.clock.s + LEASE_S, 0


@pytest.mark.parametrize("seed", range(8))
async def test_rt14_only_one_of_several_browsers_drives_at_a_time(tmp_path, seed):
    chance, clock = random.Random(f"drivers {seed}"), Clock()
    names = NAMES[: 2 + seed % 4]
    model, counts = Model(clock), dict.fromkeys(names, 0)

    async def act(visitors, live, link, name, word):
        visitor = visitors[name]
        if word == "take":
            await visitor.send("take")
            if model.now() in (None, name):
                model.hold(name)
        elif word == "beat":
            # a second heartbeat with the same number does not count
            n = chance.choice((counts[name] + 1, counts[name]))
            counts[name] = n
            await visitor.send("beat", n=n, frame=live.feed.number, u=[names.index(name) + 1.0])
            if model.now() == name and n > model.n:
                model.n, model.until_s = n, clock.s + LEASE_S
                model.commands.append([names.index(name) + 1.0])
        elif word in ("give", "give to"):
            to = chance.choice(names) if word == "give to" else None
            await visitor.send("give", **({"to": to} if to else {}))
            if model.now() == name:
                model.holder = None
                if to:
                    model.hold(to)
        elif word == "late":
            clock.s += chance.choice((0.1, 0.4))
        elif word == "stop":
            await visitor.send("stop")
        elif word == "drive":
            await visitor.send("mission", kind="drive")
            model.missions += model.now() == name
        await visitor.send("no such word")  # refused after all earlier messages
        await visitor.next("refused", to="no such word")

    async with live_page(tmp_path) as (server, link, live), AsyncExitStack() as lines:
        live.lease._now = clock
        visitors = {name: await lines.enter_async_context(browser(server, name=name)) for name in names}
        link.frame(0.05)
        stops = 0
        for _ in range(STEPS):
            driver = model.now() if chance.random() < 0.5 else None
            name, word = driver or chance.choice(names), chance.choice(WORDS)
            if word == "gone":
                visitors[name].line.transport.abort()
                await until(lambda: len(server.visitors) < len(names))
                if model.now() == name:
                    model.holder = None
                visitors[name] = await lines.enter_async_context(browser(server, name=name))
                counts[name] = 0
            else:
                await act(visitors, live, link, name, word)
                stops += word == "stop"
            assert [message["u"] for message in link.requests("hand")] == model.commands, (word, name)
            assert getattr(live.lease.holder, "name", None) == model.now(), (word, name)
            assert len(link.requests("stop")) == stops  # of any client
            assert len(link.requests("mission")) == model.missions
        assert len(model.commands) > 2
