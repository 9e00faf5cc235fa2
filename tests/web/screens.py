"""The screens of the page in typical states: live, recorded, and with a ghost run."""

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from tests.web.chromium import SIZES, Chromium, Tab
from tests.web.scripted import ScriptedServer

LIVE = ("drive", "identify", "replay", "tune", "runs", "blocks", "faults")
RECORDED = ("identify", "replay", "tune", "runs", "blocks")
GHOST = ("replay",)
SEEN = {"live": LIVE, "recorded": RECORDED, "ghost": GHOST}
THEMES, LANGUAGES = ("light", "dark"), ("en", "es")
BOXES = (Path(__file__).parent / "boxes.js").read_text(encoding="utf-8")
SHOTS = os.environ.get("BAQUEANO_SHOTS")  # a folder for pictures of the tested screens
PAGE = "baqueano.page"
READY = f"Boolean(globalThis.baqueano?.page?.screen) && {PAGE}.link.up"
REST_S = 0.25  # a canvas resizes at once, and the map moves gradually
DRAWN = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))"


def open_page(tab: Tab, server: ScriptedServer, language: str = "en", screen: str = "") -> Tab:
    tab.goto(f"{server.url}?lang={language}")
    tab.wait(READY)
    if server.mode == "replay":
        tab.wait(f"Boolean({PAGE}.opened && {PAGE}.opened.record.length === 4160)")
    else:
        tab.wait(f"{PAGE}.record.length > 1990")
    if screen:
        tab.click(f"#tab-{screen}")
    return tab


def until(true: Callable[[], Any], seconds: float = 10.0) -> Any:
    end = time.monotonic() + seconds
    while not (result := true()):
        assert time.monotonic() < end, "still not true"
        time.sleep(0.02)
    return result


def each_screen(browser: Chromium, kind: str, language: str) -> Iterator[tuple[str, Tab]]:
    """Yield the tab at each screen of this kind of page, with all requests answered."""
    with ScriptedServer("live" if kind == "live" else "replay", ghost=kind == "ghost") as server:
        tab = browser.tab()
        tab.size(*SIZES["laptop"])
        open_page(tab, server, language)
        if kind == "ghost":
            tab.wait(f"Boolean({PAGE}.ghost)")
        if kind != "live":
            tab.js(f"{PAGE}.screens.replay.seek(22.4)")
        for screen in SEEN[kind]:
            tab.click(f"#tab-{screen}")
            if screen == "tune":
                tab.wait(f"{PAGE}.screens.tune.land?.side === 20 && Boolean({PAGE}.screens.tune.lap)")
                tab.js(f"{PAGE}.screens.tune.jump([0.5, 1, 1, 0.8])")
                tab.wait(f"{PAGE}.screens.tune.lap.rms > 0.05 && {PAGE}.screens.tune.land?.side === 20")
            yield screen, tab
        assert not tab.errors
        tab.close()


def looked_at(tab: Tab, size: str, theme: str) -> None:
    """Give the tab a size and a theme, and wait until animations have ended."""
    tab.size(*SIZES[size])
    tab.media(prefers_color_scheme=theme)
    tab.js("dispatchEvent(new Event('resize'))")
    time.sleep(REST_S)
    tab.js(DRAWN)


def shot(tab: Tab, *name: str) -> None:
    """Save a picture if pictures are requested."""
    if SHOTS:
        Path(SHOTS).mkdir(parents=True, exist_ok=True)
        tab.shot(Path(SHOTS, f"{'-'.join(name)}.png"))
