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
