"""The page process and the page together, in a real browser: watch a run, drive a vehicle, stop it."""

import os

import pytest

from tests.web.chromium import CHROMIUM, Chromium
from tests.web.page_client import drive, folder_of
from tests.web.test_serve import port_of, program

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="Debian's package chromium is not installed")
PRESS = "[...document.querySelectorAll('button')].find((one) => one.innerText.startsWith({name!r})).click()"
TEXT = "document.body.innerText.includes({text!r})"
START_S = 60.0


@pytest.fixture(scope="module")
def chromium():
    with Chromium() as browser:
        yield browser


def shown(tab, text):
    tab.wait(TEXT.format(text=text), START_S)


def test_a_run_and_its_ghost_are_shown(chromium, tmp_path):
    folder = folder_of(tmp_path / "runs", circle=drive(), short=drive("short", 200))
    with program(
        "baqueano", "view", "circle", "--ghost", "short", "--runs", str(folder), "--no-browser"
    ) as page:
        tab = chromium.tab()
        tab.goto(f"http://127.0.0.1:{port_of(page)}/")
        shown(tab, "short (ghost)")
        assert not tab.errors
        tab.close()


def test_a_vehicle_is_taken_driven_and_stopped(chromium, tmp_path):
    with program(
        "baqueano", "serve", "--vehicle", "small", "--no-browser", cwd=tmp_path,
        env={**os.environ, "BAQUEANO_BACKEND": "python"},
    ) as page:  # fmt: skip
        tab = chromium.tab()
        tab.goto(f"http://127.0.0.1:{port_of(page)}/")
        shown(tab, "nobody drives")
        tab.js(PRESS.format(name="Take the wheel"))
        shown(tab, "you drive")
        tab.js(PRESS.format(name="By hand"))
        shown(tab, "BY HAND")
        shown(tab, "m/s ahead")
        tab.js(PRESS.format(name="STOP"))
        shown(tab, "STOPPED")
        assert not tab.errors
        tab.close()


TUNE = "baqueano.page.screens.tune"


def test_gains_are_tuned_applied_and_taken_back_while_it_repeats(chromium, tmp_path):
    """On the simulated service itself: the run holds what was set."""
    from baqueano.guides.shapes import circle
    from baqueano.runs import read_run
    from baqueano.runs.route_file import write_route

    (tmp_path / "routes").mkdir()
    write_route(circle(0.3, 0.2), tmp_path / "routes" / "ring.csv")
    with program("baqueano", "serve", "--vehicle", "small", "--no-browser", cwd=tmp_path) as page:
        tab = chromium.tab()
        tab.goto(f"http://127.0.0.1:{port_of(page)}/")
        shown(tab, "nobody drives")
        tab.wait("baqueano.page.hello?.fields.length > 9", START_S)  # a second hello begins afresh
        tab.js(PRESS.format(name="Take the wheel"))
        shown(tab, "you drive")
        tab.js("baqueano.page.link.send({is: 'mission', kind: 'repeat', route: 'ring', laps: 60})")
        shown(tab, "REPEATING")
        tab.click("#tab-tune")
        tab.wait(f"{TUNE}.about?.route === 'ring' && Boolean({TUNE}.lap)", START_S)
        tab.wait(f"{TUNE}.land?.side === 10 || {TUNE}.land?.side === 20", START_S)
        before = tab.js(f"{TUNE}.lap.rms")
        tab.js(f"{TUNE}.jump([0, 1, 0.5, 0.25])")
        tab.wait(f"{TUNE}.lap.rms !== {before}", START_S)
        tab.js(f"{TUNE}.do.downhill.click()")
        tab.wait(f"{TUNE}.way && {TUNE}.values.join() === {TUNE}.way.way.at(-1).join()", START_S)
        tab.js(f"{TUNE}.do.apply.click()")
        tab.wait(f"{TUNE}.state.textContent === 'in force'", START_S)
        applied = tab.js(f"{TUNE}.values")
        tab.js(f"{TUNE}.do.undo.click()")
        tab.wait(f"{TUNE}.force[1] === 1 && {TUNE}.force[2] === 4", START_S)
        tab.js(PRESS.format(name="STOP"))
        shown(tab, "STOPPED")
        tab.close()
    run = read_run(next((tmp_path / "runs").glob("*.mcap")))
    set_to = [e.diagnostic.figures for e in run.events if e.source == "set"]
    assert {one["path"] for one in set_to} >= {"controller.k_x", "controller.k_chi"}
    k_x = [float(one["now"]) for one in set_to if one["path"] == "controller.k_x"]
    assert k_x == [pytest.approx(applied[1]), 1.0]
