"""The screens of the page in typical states: live, recorded, and with a ghost run."""

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tests.web.chromium import SIZES, Chromium, Tab
from tests.web.scripted import RATE, ScriptedServer, fields, row

LIVE = ("drive", "identify", "replay", "tune", "runs", "blocks", "faults")
SCREENS = ("identify", "replay", "tune", "runs", "blocks")
GHOST = ("replay",)
SCREEN_KINDS = {"live": LIVE, "recorded": SCREENS, "ghost": GHOST}
THEMES, LANGUAGES = ("light", "dark"), ("en", "es")
BOXES = (Path(__file__).parent / "boxes.js").read_text(encoding="utf-8")
PAINTING = (Path(__file__).parent / "painted.js").read_text(encoding="utf-8")
SHOTS = os.environ.get("BAQUEANO_SHOTS")  # a folder for pictures of the tested screens
PAGE = "baqueano.page"
READY = f"Boolean(globalThis.baqueano?.page?.screen) && {PAGE}.link.up"
REST_S = 0.25  # a canvas resizes at once, and the map moves gradually
DRAWN = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))"
AXE = Path(__file__).parent / "axe" / "node_modules" / "axe-core" / "axe.min.js"
RULES = """axe.run(document, { resultTypes: ["violations"] }).then(({ violations, passes }) => ({
  passes: passes.length,
  violations: violations.map(({ id, help, nodes }) =>
    `${id}: ${help}: ${nodes.map((one) => one.html.slice(0, 160)).join(" | ")}`),
}))"""


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


def take_lease(tab: Tab) -> None:
    """Take control with the key of the page, and wait until the page has it."""
    tab.press("l", "KeyL", "l")
    tab.wait(f"{PAGE}.hand.mine")


def until(condition: Callable[[], Any], seconds: float = 10.0) -> Any:
    end = time.monotonic() + seconds
    while not (result := condition()):
        assert time.monotonic() < end, "still not true"
        time.sleep(0.02)
    return result


def still_page(tab: Tab, server: ScriptedServer, *where: str) -> dict[str, np.ndarray]:
    """Open a live page, stop its vehicle, and return the columns of all ticks that the page shows."""
    tab.media(prefers_reduced_motion="reduce")  # the map does not move gradually
    open_page(tab, server, *where)
    server.frozen = True
    tab.js(f"{PAGE}.link.socket.onmessage = null")  # of ticks that are on their way
    time.sleep(REST_S)
    tab.js(DRAWN)
    tab.js("globalThis.requestAnimationFrame = () => 0")  # from now on only `painted` draws
    times_s = tab.js(f"Array.from({PAGE}.record.t.subarray(0, {PAGE}.record.length))")
    assert len(times_s) > 1990
    rows = np.array([row(round(t_s * RATE)) for t_s in times_s])
    return {field["name"]: rows[:, k] for k, field in enumerate(fields())}


def painted(tab: Tab, canvas: str) -> list[dict[str, Any]]:
    """Return the lines and areas that the next picture of the screen draws on a canvas."""
    return tab.js(f"({PAINTING})({canvas}, () => {PAGE}.screen.draw(performance.now()))")


def only(marks: list[dict[str, Any]], **look: object) -> dict[str, Any]:
    """Return the only line or area with this look."""
    (single,) = (mark for mark in marks if look.items() <= mark.items())
    return single


def check_trace(
    mark: dict[str, Any], scale: list[float], x: dict[str, np.ndarray], name: str, span_s: float
) -> None:
    """Check that a line of a strip with this scale [least, greatest, height] shows a column over the last seconds."""
    low, high, height = scale
    values = [low + (height - 3 - point[2]) / (height - 6) * (high - low) for point in mark["path"]]
    since_s = x["t"] - x["t"][-1] + span_s
    long, short = x[name][since_s > -0.025], x[name][(since_s > 0.025) & (since_s < span_s - 0.025)]
    slack = 1e-4 * (high - low)
    assert long.min() - slack <= min(values) <= short.min() + slack, name
    assert short.max() - slack <= max(values) <= long.max() + slack, name


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
        for screen in SCREEN_KINDS[kind]:
            tab.click(f"#tab-{screen}")
            if screen == "tune":
                tab.wait(f"{PAGE}.screens.tune.land?.side === 20 && Boolean({PAGE}.screens.tune.lap)")
                tab.js(f"{PAGE}.screens.tune.jump([0.5, 1, 1, 0.8])")
                tab.wait(f"{PAGE}.screens.tune.lap.rms > 0.05 && {PAGE}.screens.tune.land?.side === 20")
            yield screen, tab
        assert not tab.errors
        tab.close()


def looked_at(tab: Tab, size: str, theme: str) -> None:
    """Give the tab a size and a theme without animations, and wait until it is drawn."""
    tab.size(*SIZES[size])
    tab.media(prefers_color_scheme=theme, prefers_reduced_motion="reduce")
    tab.js("dispatchEvent(new Event('resize'))")
    tab.js(DRAWN)


def shot(tab: Tab, *name: str) -> None:
    """Save a picture if pictures are requested."""
    if SHOTS:
        time.sleep(REST_S)
        Path(SHOTS).mkdir(parents=True, exist_ok=True)
        tab.shot(Path(SHOTS, f"{'-'.join(name)}.png"))


def axe(tab: Tab) -> dict[str, Any]:
    """Return {passes, violations} of the rules of axe-core on what a tab shows."""
    if not tab.js("'axe' in window"):
        tab.js(f"{AXE.read_text(encoding='utf-8')}\ntrue")
    return tab.js(RULES)
