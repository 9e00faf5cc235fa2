"""Two to five browsers at once, over sockets: commands come of one driver at a time, whoever says what and when."""

import random
from contextlib import AsyncExitStack

import pytest

from baqueano.web.lease import HOLDS_S
from tests.web.fake_vehicle import live_page, until
from tests.web.page_client import browser, run_page
from tests.web.test_lease import Clock

NAMES = ("ana", "luis", "eva", "juan", "mia")
WORDS = (*3 * ["take"], *8 * ["beat"], "give", "give to", "give to", "late", "stop", "drive", "drive", "gone")
STEPS = 80


class Model:
    """Who drives, by the rules of lease.py, and the commands that the vehicle should hear."""

    def __init__(self, clock):
        self.clock, self.holder, self.until_s, self.n = clock, None, 0.0, 0
        self.commands, self.missions = [], 0

    def now(self):
        """Return who drives now."""
        if self.holder is not None and self.clock.s > self.until_s:
            self.holder = None
        return self.holder

    def hold(self, who):
        self.holder, self.until_s, self.n = who, self.clock.s + HOLDS_S, 0


@pytest.mark.parametrize("seed", range(8))
def test_rt14_of_several_browsers_one_drives_at_a_time(tmp_path, seed):
    chance, clock = random.Random(f"drivers {seed}"), Clock()
    names = NAMES[: 2 + seed % 4]
    model, counts = Model(clock), dict.fromkeys(names, 0)

    async def act(there, live, link, who, word):
        one = there[who]
        if word == "take":
            await one.say("take")
            if model.now() in (None, who):
                model.hold(who)
        elif word == "beat":
            n = chance.choice(
                (counts[who] + 1, counts[who])
            )  # a second time with the same number it does not count
            counts[who] = n
            await one.say("beat", n=n, seen=live.feed.number, u=[names.index(who) + 1.0])
            if model.now() == who and n > model.n:
                model.n, model.until_s = n, clock.s + HOLDS_S
                model.commands.append([names.index(who) + 1.0])
        elif word in ("give", "give to"):
            to = chance.choice(names) if word == "give to" else None
            await one.say("give", **({"to": to} if to else {}))
            if model.now() == who:
                model.holder = None
                if to:
                    model.hold(to)
        elif word == "late":
            clock.s += chance.choice((0.1, 0.4))
        elif word == "stop":
            await one.say("stop")
        elif word == "drive":
            await one.say("mission", kind="drive")
            model.missions += model.now() == who
        await one.say("no such word")  # refused after all that was said before it
        await one.next("no", where=lambda no: no["to"] == "no such word")

    async def job():
        async with live_page(tmp_path) as (server, link, live), AsyncExitStack() as lines:
            live.lease._now = clock
            there = {name: await lines.enter_async_context(browser(server, name=name)) for name in names}
            link.frame(0.05)
            stops = 0
            for _ in range(STEPS):
                driver = model.now() if chance.random() < 0.5 else None
                who, word = driver or chance.choice(names), chance.choice(WORDS)
                if word == "gone":
                    there[who].line.transport.abort()
                    await until(lambda: len(server.visitors) < len(names))
                    if model.now() == who:
                        model.holder = None
                    there[who], counts[who] = await lines.enter_async_context(browser(server, name=who)), 0
                else:
                    await act(there, live, link, who, word)
                    stops += word == "stop"
                assert [message["u"] for message in link.requests("hand")] == model.commands, (word, who)
                assert getattr(live.lease.holder, "name", None) == model.now(), (word, who)
                assert len(link.requests("stop")) == stops  # anybody's
                assert len(link.requests("mission")) == model.missions
            assert len(model.commands) > 2

    run_page(job)
