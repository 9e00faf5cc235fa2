"""The screen *Identify* in a real browser: error bars, the coloured path, a run with a scrub bar."""

import json
import time

import numpy as np
import pytest

from tests.web.chromium import CHROMIUM, SIZES
from tests.web.screens import BOXES, PAGE, open_page, painted, still_page, until
from tests.web.taught import fit_taught

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: sudo apt-get install chromium")


WIDTHS = "[...document.querySelectorAll('.estimates .bar')].map((one) => parseFloat(one.style.width))"


def kinds(tab) -> set[str]:
    return set(
        tab.js("[...document.querySelectorAll('.estimates li')].map((one) => one.dataset.kind.split(' ')[0])")
    )


def test_error_bars_are_hollow_until_a_fit_and_shrink_while_driving(tab, live):
    open_page(tab, live, screen="identify")
    tab.wait("document.querySelectorAll('.estimates li').length === 14")
    word = fit_taught("en", live=True)
    live.put(word | {"fit": None})
    until(lambda: kinds(tab) == {"hollow"})
    assert "8 s of driving" in tab.js("document.querySelector('.about').textContent")
    before = tab.js(WIDTHS)
    live.put(word | {"fit": None, "compiled": False})
    tab.wait("document.querySelector('.about').textContent.includes('a fit comes every 15 s')")
    assert kinds(tab) == {"hollow"}
    live.put(word | {"std": [std / 3 for std in word["std"]]})
    until(lambda: kinds(tab) == {"hollow", "filled"})  # one of them is unobservable
    assert all(
        now < first for now, first in zip(sorted(tab.js(WIDTHS)), sorted(before), strict=True) if first > 1.0
    )
    assert tab.js("document.querySelector('.estimates-card .chip').textContent") == "USABLE"
    unseen_chip = "document.querySelector('[data-kind~=hollow]')"
    assert "not identified" in tab.js(f"{unseen_chip}.textContent")
    assert "missing: sliding sideways" in tab.js(f"{unseen_chip}.textContent")
    advice = tab.js("document.querySelector('.next-card p').textContent")
    assert word["next"]["motion"] in advice
    assert word["next"]["label"] in advice
    live.put(word | {"fit": word["fit"] | {"verdict_id": "REFUSED", "verdict": "REFUSED"}})
    until(lambda: kinds(tab) == {"hollow"})  # a refused fit fills no bar


def test_the_page_reports_when_the_identify_screen_opens_or_closes(tab, live):
    open_page(tab, live)
    assert not live.words("identify")
    tab.press("2", "Digit2", "2")
    until(lambda: [word["on"] for word in live.words("identify")] == [True])
    tab.press("1", "Digit1", "1")
    until(lambda: [word["on"] for word in live.words("identify")] == [True, False])


def test_an_experiment_can_be_started_from_the_identify_screen(tab, live):
    live.state, live.kind = "READY", None
    open_page(tab, live, screen="identify")
    assert tab.js("document.querySelector('.next-card button').disabled")
    tab.press("l", "KeyL", "l")
    tab.wait("!document.querySelector('.next-card button').disabled")
    tab.click(".next-card button")
    assert until(lambda: live.words("mission"))[-1] == {
        "type": "mission",
        "kind": "experiment",
        "seconds": 60,
    }


def test_the_identify_screen_of_a_run_follows_the_scrub_bar(tab, replay):
    open_page(tab, replay, screen="identify")
    tab.wait("document.querySelectorAll('.estimates li').length === 14")
    bits = "Number(document.querySelector('.identify .numbers b').textContent)"
    marks = []
    for seconds in (4.0, 12.0, 40.0):
        tab.js(f"{PAGE}.screens.replay.seek({seconds})")
        time.sleep(0.15)
        marks.append((tab.js(bits), kinds(tab)))
    assert marks[0][0] < marks[1][0] < marks[2][0]
    assert marks[0][1] == {"hollow"}  # before the first fit
    assert "filled" in marks[1][1]
    tab.press("Home", "Home")
    until(lambda: tab.js(bits) == 0.0)
    assert len(set(tab.js(WIDTHS))) == 1
    tab.press("k", "KeyK", "k")
    until(lambda: tab.js(f"{PAGE}.screens.replay.now_s") > 0.3)


def test_with_reduced_motion_bars_are_not_animated(tab, live):
    tab.media(prefers_reduced_motion="reduce")
    open_page(tab, live, screen="identify")
    tab.wait("document.querySelectorAll('.estimates li').length === 14")
    assert tab.js("getComputedStyle(document.querySelector('.estimates .bar')).transitionDuration") == "0s"


def test_the_path_is_coloured_by_the_information_of_each_part(tab, live):
    """Each segment on the map has the colour of the rate at its time, on a logarithmic scale from 0.1 to 100 bits/s."""
    x = still_page(tab, live, "en", "identify")
    start_s = x["t"][0]
    rate = [0.1 * 10 ** (3.0 * k / 99.0) for k in range(100)]  # over 20 s, from the first colour to the last
    word = fit_taught("en", live=True) | {"rate": rate, "start": float(start_s), "dt": 0.2}
    tab.js(f"{PAGE}.screens.identify.identified({json.dumps(word)})")
    curve = painted(tab, f"{PAGE}.screen.curve")
    label = "(({ w, context }) => w - context.measureText('100').width)"
    assert max(point[1] for mark in curve for point in mark["path"]) < tab.js(f"{label}({PAGE}.screen.curve)")
    marks = painted(tab, f"{PAGE}.screen.map.canvas")
    left, top, scale = tab.js(f"(({{ X, Y, view }}) => [X(0), Y(0), view.scale])({PAGE}.screen.map)")
    place = np.column_stack([x["eta.x"], x["eta.y"]])
    shades, times_s = [], []
    for mark in marks:
        if mark["kind"] == "line" and mark["colour"].startswith("#") and mark["width"] >= 4:
            _, px, py = mark["path"][len(mark["path"]) // 2]
            distance = np.hypot(*(place - [(px - left) / scale, (top - py) / scale]).T)
            shades.append(mark["colour"])
            times_s.append(x["t"][np.argmin(distance)] - start_s)
    ends = tab.js(
        "['quiet', 'loud'].map((n) => getComputedStyle(document.documentElement).getPropertyValue(`--${n}`).trim())"
    )
    assert len(set(shades)) == 12
    by_time = [shades[k] for k in np.argsort(times_s)]
    assert [by_time[0], by_time[-1]] == ends
    for k, shade in enumerate(dict.fromkeys(by_time)):  # the rate of each colour, to half a step
        level = np.mean([t for s, t in zip(shades, times_s, strict=True) if s == shade]) / 19.8
        assert abs(level - k / 11.0) < 0.08


SCENE = {
    "screen": "tuned", "history": [1.2, 1.2, 1.05, 0.96, 0.94], "start_cost": 1.2, "cost": 0.94,
    "gains": [{"name": "k_x", "unit": "1/s", "file_value": None, "value": 2.54}],
}  # fmt: skip


def title(tab) -> str:
    return tab.js("document.getElementById('title').textContent")


def test_a_demo_changes_the_screen_until_the_user_chooses_a_screen(tab, live):
    open_page(tab, live)
    for scene, screen in (
        ({"screen": "identify"}, "identify"),
        (SCENE, "tuned"),
        ({"screen": "drive"}, "drive"),
    ):
        live.put(live._state("en") | {"scene": scene})
        tab.wait(f"{PAGE}.screen.constructor.key === '{screen}'")
        if screen == "tuned":
            assert title(tab) == "TUNED"
            assert "2.54" in tab.js("document.querySelector('.tuned').textContent")
    tab.click("#tab-runs")
    live.put(live._state("en") | {"scene": {"screen": "identify"}})
    time.sleep(0.3)
    assert tab.js(f"{PAGE}.screen.constructor.key") == "runs"


@pytest.mark.parametrize("size", SIZES)
def test_the_tuning_scene_has_no_layout_fault(tab, live, size):
    tab.size(*SIZES[size])
    open_page(tab, live, "es")
    live.put(live._state("es") | {"scene": SCENE})
    tab.wait(f"{PAGE}.screen.constructor.key === 'tuned'")
    time.sleep(0.3)
    assert not tab.js(BOXES) + tab.errors
