"""The work of an evening on the page of the emulated robot: teach, repeat, tune, swap a block, stop, replay.

The service runs as systemd starts it. Its Uno runs the real firmware, whose motors move a simulated body; its IMU
measures the motion of the body.
"""

import sys
import time

import numpy as np
import pytest

from baqueano.guides.shapes import circle
from baqueano.runs import read_run
from baqueano.runs.route_file import write_route
from tests.emulated.onboard import running
from tests.emulated.test_page import OFF_S, START_S, TRIES, Wheel
from tests.emulated.test_processes import wait
from tests.web.chromium import CHROMIUM, Chromium
from tests.web.test_serve import port_of, program

pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="Debian's package chromium is not installed"),
    pytest.mark.skipif(sys.platform != "linux", reason="a pty, signals, /proc"),
]
TAUGHT_M, LAPS = 0.4, 60
SCREENS = "baqueano.page.screens"
TUNE = f"{SCREENS}.tune"
DRIVING = "baqueano.page.state.mission?.kind === 'repeat' && baqueano.page.state.t_s > 0.5"
PICK = (
    "((one) => {{ one.value = {kind!r}; one.dispatchEvent(new Event('change')); }})"
    "(document.querySelector({select!r}))"
)


def teach(wheel, body):
    """Teach a route ahead in a manual drive; a stalled machine may stop the vehicle, then it is taught again."""
    for _ in range(TRIES):
        wheel.ready()
        wheel.hold("Teach")
        if wait(lambda: wheel.state() == "MANUAL", 10.0):
            wheel.tab.down("w", "KeyW")
            goal = body.motion.eta[0] + TAUGHT_M
            wait(lambda end=goal: body.motion.eta[0] > end or wheel.state() != "MANUAL", START_S)
            wheel.tab.up("w", "KeyW")
            if wheel.state() == "MANUAL":
                wheel.hold("End")
                if wait(lambda: wheel.state() == "READY", START_S):
                    return
    raise AssertionError(wheel.tab.js("baqueano.page.state.sentence"))


def repeat(wheel, route, condition, tab="drive"):
    """Repeat the route, on this tab, until it drives and `condition`; if a busy machine stops it, it begins again."""
    end = time.monotonic() + 3.0 * START_S
    while not (wheel.live.moving() and wheel.tab.js(condition)):
        assert time.monotonic() < end, wheel.tab.js("baqueano.page.state.sentence")
        if wheel.state() != "MISSION":
            wheel.ready()
            wheel.tab.click("#tab-drive")
            wheel.tab.js(f"Object.assign({SCREENS}.drive, {{ laps: {LAPS} }}).route.value = {route!r}")
            wheel.hold("Repeat")
            wait(lambda: wheel.state() == "MISSION", 10.0)
            wheel.tab.click(f"#tab-{tab}")
        time.sleep(0.3)


def pause_and_continue(wheel, route, body):
    """Pause the repetition by its key until the vehicle rests, and continue; a stalled machine may stop it before."""
    for _ in range(TRIES):
        repeat(wheel, route, DRIVING)
        wheel.tab.press("p", "KeyP", "p")
        if wait(lambda: wheel.tab.js("baqueano.page.state.paused") and abs(body.motion.nu[0]) < 0.02, 10.0):
            place = np.array(body.motion.eta[:2])
            wheel.tab.press("p", "KeyP", "p")
            if wait(lambda place_now=place: np.hypot(*(body.motion.eta[:2] - place_now)) > 0.1, 10.0):
                return
    raise AssertionError(wheel.tab.js("baqueano.page.state.sentence"))


def stop(wheel):
    """Stop by the space bar; the motors are off within OFF_S."""
    assert wheel.off_after(lambda: wheel.tab.press(" ", "Space")) <= OFF_S


def test_a_route_is_taught_repeated_tuned_swapped_and_replayed_on_the_emulated_robot(firmware, tmp_path):
    (tmp_path / "routes").mkdir()
    write_route(circle(0.3, 0.2), tmp_path / "routes" / "ring.csv")
    with running(firmware, tmp_path, body=True) as service, Chromium() as chromium:
        serve = (
            "baqueano", "serve", "--robot", str(service.door), "--vehicle", str(service.file.path), "--no-browser",
            "--runs", str(tmp_path / "here"),
        )  # fmt: skip
        with program(*serve, cwd=tmp_path) as page:
            port = port_of(page)
            tab = chromium.tab()
            wheel = Wheel(tab, port, service.live)
            teach(wheel, service.body)
            # the run is copied, and its route is stored
            tab.wait(f"{SCREENS}.drive.names.length > 1", START_S)
            assert len(list((tmp_path / "here").glob("*-teach.mcap"))) >= 1
            (name,) = set(tab.js(f"{SCREENS}.drive.names")) - {"ring"}
            repeat(wheel, name, DRIVING)
            stop(wheel)
            pause_and_continue(wheel, "ring", service.body)
            stop(wheel)

            tab.click("#tab-tune")
            tab.wait(f"{TUNE}.about?.route === 'ring' && Boolean({TUNE}.lap)", START_S)
            tab.js(f"{TUNE}.jump({TUNE}.values.map((gain) => 1.1 * gain))")
            repeat(wheel, "ring", f"!{TUNE}.do.apply.disabled", "tune")
            tab.js(f"{TUNE}.do.apply.click()")
            tab.wait(f"{TUNE}.state.textContent === 'in use'", START_S)
            stop(wheel)

            tab.click("#tab-blocks")
            tab.js(f"{SCREENS}.blocks.pick('controller')")
            tab.wait(f"Boolean({SCREENS}.blocks.details.controller?.text)", START_S)
            tab.js(PICK.format(select=".other select", kind="kanayama"))
            tab.wait("baqueano.page.hello.swapped?.controller === 'kanayama'", START_S)
            repeat(wheel, "ring", f"{DRIVING} && baqueano.page.hello.blocks.controller === 'Kanayama'")

            assert wheel.off_after(tab.close) <= OFF_S  # the tab is lost while it drives
            tab = chromium.tab()
            wheel = Wheel(tab, port, service.live)
            assert wait(lambda: wheel.state() == "STOPPED", START_S)
            wheel.ready()
            tab.wait(
                "baqueano.page.runs.filter((one) => one.kind === 'repeat' && one.seconds).length >= 3",
                START_S,
            )
            tab.js("baqueano.page.openRun(baqueano.page.runs.find((one) => one.kind === 'teach').id)")
            tab.wait("baqueano.page.opened", START_S)
            tab.press("End")
            at_end = tab.js(f"{SCREENS}.replay.now_s")
            tab.press("Home")
            assert tab.js(f"{SCREENS}.replay.now_s") < at_end
            assert not tab.errors
            tab.close()
    runs = [read_run(path) for path in sorted((tmp_path / "there").glob("*-repeat.mcap"))]
    events = [event for run in runs for event in run.events]
    changes = {event.diagnostic.figures["path"] for event in events if event.source == "set"}
    assert "controller.k_chi" in changes
    assert [e.diagnostic.figures["kind"] for e in events if e.source == "swap"][-1] == "kanayama"
