"""The page process and the page together, in a real browser: watch a run, drive a vehicle, stop it."""

import os
import time

import pytest

from tests.web.chromium import CHROMIUM, SIZES
from tests.web.page_client import drive, folder_of
from tests.web.test_serve import port_of, program

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="Debian's package chromium is not installed")
PRESS = "[...document.querySelectorAll('button')].find((one) => one.innerText.startsWith({name!r})).click()"
TEXT = "document.body.innerText.includes({text!r})"
START_S, TRIES = 60.0, 6
REQUESTS = (
    "(({ record }) => Array.from(record.column('requested.0').subarray(0, record.length)))(baqueano.page)"
)
REFUSALS = """(({ on }) => {
  const refused = on.refused;
  globalThis.refusals = [];
  on.refused = (word) => { globalThis.refusals.push(`${word.code}, mine: ${baqueano.page.hand.mine}`); refused(word); };
})(baqueano.page.link)"""
BEATS = """async () => {  // of a driver who has handed over
  const { link } = baqueano.page;
  for (let n = 0; n < 12; n++) {
    link.send({ type: "beat", n: 1e6 + n, frame: link.frame, u: [1, 0, 0] });
    await new Promise((done) => setTimeout(done, 40));
  }
  return 12;
}"""


def show_text(tab, text):
    tab.wait(TEXT.format(text=text), START_S)


def take(tab):
    """Take control, and again if a busy machine has lost it."""
    end = time.monotonic() + START_S
    while not tab.js("baqueano.page.hand?.mine"):
        assert time.monotonic() < end, tab.js("document.body.innerText")
        tab.js("document.getElementById('lease').click()")
        time.sleep(0.3)


def test_a_run_and_its_ghost_run_are_shown(browser, tmp_path):
    folder = folder_of(tmp_path / "runs", circle=drive(), short=drive("short", 200))
    with program(
        "baqueano", "view", "circle", "--ghost", "short", "--runs", str(folder), "--no-browser"
    ) as page:
        tab = browser.tab()
        tab.goto(f"http://127.0.0.1:{port_of(page)}/")
        show_text(tab, "short (ghost)")
        tab.click("#tab-runs")
        links = tab.js(
            "[...document.querySelectorAll('.runs tbody tr:first-child a')].map((one) => one.href)"
        )
        name = tab.js("document.querySelector('.runs tbody tr:first-child label span').textContent")
        size = tab.js(f"fetch({links[1]!r}).then((it) => it.arrayBuffer()).then((it) => it.byteLength)")
        assert size == (folder / f"{name}.mcap").stat().st_size
        tab.goto(links[0])
        tab.wait(f"document.body.innerText.includes({name!r})", START_S)
        assert tab.js("document.querySelectorAll('svg').length") > 0
        tab.close()


def test_a_user_takes_control_drives_hands_over_and_any_user_stops(browser, tmp_path):
    with program(
        "baqueano", "serve", "--vehicle", "small", "--no-browser", cwd=tmp_path,
        env={**os.environ, "BAQUEANO_BACKEND": "python"},
    ) as page:  # fmt: skip
        tab = browser.tab()
        tab.goto(f"http://127.0.0.1:{port_of(page)}/")
        show_text(tab, "no driver")
        end = time.monotonic() + START_S
        while not tab.js(TEXT.format(text="MANUAL")):  # a busy machine loses control: it is taken again
            assert time.monotonic() < end, tab.js("document.body.innerText")
            if tab.js("baqueano.page.state.state") == "STOPPED":
                tab.js("baqueano.page.link.send({type: 'clear'})")
            take(tab)
            tab.js(PRESS.format(name="Manual"))
            time.sleep(0.7)
        show_text(tab, "m/s forward")
        other = browser.window()
        other.goto(tab.js("location.href"))
        show_text(other, "m/s forward")
        other.js(REFUSALS)
        end = time.monotonic() + START_S
        while not other.js("globalThis.refusals.includes('web.lease-taken, mine: false')"):
            assert time.monotonic() < end, other.js("globalThis.refusals")
            drives, took = tab.js("baqueano.page.hand.mine"), other.js("baqueano.page.hand.mine")
            window = other if drives or took else tab  # a busy machine has lost control: it is taken again
            window.js("document.getElementById('lease').click()")
            time.sleep(0.2)
        assert other.js("document.getElementById('toast').textContent")
        tab.down("w", "KeyW", "w")  # and it is not released
        other.wait(f"{REQUESTS}.at(-1) > 0 || baqueano.page.state.state === 'STOPPED'", START_S)
        end = time.monotonic() + START_S
        while not other.js("baqueano.page.hand.mine"):
            assert time.monotonic() < end
            take(tab)
            tab.js(
                "(() => { const list = document.getElementById('give');"
                "if (list.options[1]) { list.value = list.options[1].value; list.onchange(); } })()"
            )
            time.sleep(0.2)
        since_s = other.js("baqueano.page.record.end") + 0.1
        assert tab.js(f"({BEATS})()") == 12
        after = other.js(f"{REQUESTS}.filter((_, k) => baqueano.page.record.t[k] > {since_s})")
        assert not any(after)
        other.js(PRESS.format(name="STOP"))
        show_text(tab, "STOPPED")
        assert not tab.errors + other.errors
        other.close()
        tab.close()


def repeating(tab, condition):
    """Repeat `ring` as its driver. A tab without processor time on a busy machine loses control and takes it again."""
    end = time.monotonic() + START_S
    while not tab.js(condition):
        assert time.monotonic() < end
        if tab.js("baqueano.page.state.state") == "STOPPED":
            tab.js("baqueano.page.link.send({type: 'clear'})")
        if not tab.js("baqueano.page.hand.mine"):
            tab.js("baqueano.page.hand.toggle()")
        elif tab.js("baqueano.page.state.state") == "READY":
            tab.js("baqueano.page.link.send({type: 'mission', kind: 'repeat', route: 'ring', laps: 60})")
        time.sleep(0.7)


MINE = '''from baqueano.controllers import PdFeedforward


class MyLaw(PdFeedforward):
    """Mine."""
'''


def test_a_user_block_of_the_folder_replaces_a_block_and_drives(browser, tmp_path):
    from baqueano.guides.shapes import circle
    from baqueano.runs import read_run
    from baqueano.runs.route_file import write_route

    (tmp_path / "mine.py").write_text(MINE)
    (tmp_path / "routes").mkdir()
    write_route(circle(0.3, 0.2), tmp_path / "routes" / "ring.csv")
    blocks = "baqueano.page.screens.blocks"
    with program("baqueano", "serve", "--vehicle", "small", "--no-browser", cwd=tmp_path) as page:
        tab = browser.tab()
        tab.goto(f"http://127.0.0.1:{port_of(page)}/")
        tab.wait("baqueano.page.hello?.fields.length > 9", START_S)
        tab.click("#tab-blocks")
        tab.js(f"{blocks}.pick('controller')")
        tab.wait(f"Boolean({blocks}.details.controller?.text)", START_S)
        tab.js(
            "(() => { const one = document.querySelector('.other select'); one.value = 'mine.py:MyLaw';"
            "one.dispatchEvent(new Event('change')); })()"
        )
        tab.wait("baqueano.page.hello.swapped?.controller === 'mine.py:MyLaw'", START_S)
        repeating(tab, "baqueano.page.state.t_s > 0.5")
        tab.wait("baqueano.page.hello.blocks.controller === 'MyLaw'", START_S)
        show_text(tab, "MyLaw")
        tab.js(PRESS.format(name="STOP"))
        show_text(tab, "STOPPED")
        tab.close()
    run = read_run(max((tmp_path / "runs").glob("*.mcap")))
    assert run.metadata["controller"].startswith("MyLaw(")
    assert [e.diagnostic.figures["kind"] for e in run.events if e.source == "swap"] == ["mine.py:MyLaw"]


def phone(browser, port):
    """Return a tab of a phone at the page."""
    tab = browser.tab()
    tab.size(*SIZES["phone"])
    tab.do("Emulation.setTouchEmulationEnabled", enabled=True)
    tab.goto(f"http://127.0.0.1:{port}/")
    tab.wait("Boolean(baqueano.page?.screens.drive)", START_S)
    return tab


def tap(tab, selector):
    tab.js(f"document.querySelector({selector!r}).scrollIntoView({{ block: 'nearest' }})")
    tab.touch("touchStart", tab.middle(selector))
    tab.touch("touchEnd")


def test_a_phone_teaches_a_route_by_touch_repeats_and_stops_it(browser, tmp_path):
    action = ".drive .actions button:nth-of-type({})".format
    teach, repeat, finish = action(1), action(2), action(6)
    with program(
        "baqueano", "serve", "--vehicle", "small", "--no-browser", cwd=tmp_path,
        env={**os.environ, "BAQUEANO_BACKEND": "python"},
    ) as page:  # fmt: skip
        port = port_of(page)
        tab = phone(browser, port)
        is_taught = False
        for _ in range(TRIES):  # a stalled machine loses control of the vehicle
            take(tab)
            tab.js("document.getElementById('clear').click()")
            tab.wait("baqueano.page.state.state === 'READY'", START_S)
            tap(tab, teach)
            tab.wait("['MANUAL', 'STOPPED'].includes(baqueano.page.state.state)", START_S)
            tab.js("document.querySelector('.pad').scrollIntoView({ block: 'nearest' })")
            x, y = tab.middle(".pad")
            tab.touch("touchStart", (x, y))
            tab.touch("touchMove", (x, y - 20))
            tab.touch("touchMove", (x, y - 60))
            tab.wait(
                "baqueano.page.record.value('eta.x') > 0.4 || baqueano.page.state.state === 'STOPPED'",
                START_S,
            )
            tab.touch("touchEnd")
            if is_taught := tab.js("baqueano.page.state.state === 'MANUAL'"):
                break
        assert is_taught
        tap(tab, finish)
        tab.wait("baqueano.page.state.state === 'READY' && baqueano.page.screens.drive.route.value", START_S)
        tab.wait("baqueano.page.route?.name === baqueano.page.screens.drive.route.value", START_S)
        tap(tab, repeat)
        show_text(tab, "REPEATING")
        show_text(tab, "from its route")
        tap(tab, "#stop")
        show_text(tab, "STOPPED")
        assert not tab.errors
        tab.close()
