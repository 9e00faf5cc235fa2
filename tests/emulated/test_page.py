"""The page of the emulated robot, from the key in a real browser to the pins of the Uno.

The service runs as systemd starts it, with the page process and Chromium. After any lost connection between them the
motors are off within half a second.
"""

import os
import signal
import sys
import time
from pathlib import Path

import pytest

from tests.emulated.onboard import running
from tests.emulated.test_processes import until
from tests.web.chromium import CHROMIUM, Chromium
from tests.web.test_serve import port_of, program

pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="Debian's package chromium is not installed"),
    pytest.mark.skipif(sys.platform != "linux", reason="a pty, signals, /proc"),
]
START_S, OFF_S, TRIES = 60.0, 0.5, 6
BUTTON = "[...document.querySelectorAll('button')].find((one) => one.innerText.startsWith({name!r}))"


class Wheel:
    """A person at the page of the robot."""

    def __init__(self, tab, port, live):
        self.tab, self.live = tab, live
        tab.size(1280, 800)  # all buttons are visible
        tab.goto(f"http://127.0.0.1:{port}/")
        tab.wait("globalThis.baqueano?.page.link?.up", START_S)

    def state(self):
        return self.tab.js("baqueano.page.state.state")

    def hold(self, name):
        """Press a button for the duration that a real vehicle requires."""
        button = BUTTON.format(name=name)
        x, y = self.tab.js(
            f"(({{x, y, width, height}}) => [x + width / 2, y + height / 2])({button}.getBoundingClientRect())"
        )
        self.tab.mouse("mousePressed", x, y)
        time.sleep(0.9)
        self.tab.mouse("mouseReleased", x, y)

    def ready(self):
        """Take control of the vehicle, and clear any stop."""
        end = time.monotonic() + START_S
        while not (self.state() == "READY" and self.tab.js("baqueano.page.hand.mine")):
            assert time.monotonic() < end, self.tab.js("baqueano.page.state.sentence")
            if not self.tab.js("baqueano.page.hand.mine"):
                self.tab.js("document.getElementById('lease').click()")
            elif self.state() == "STOPPED":
                self.tab.js("document.getElementById('clear').click()")
            time.sleep(0.3)

    def drives(self):
        """Drive ahead manually, until the motors turn; a machine that stalls may stop it before."""
        for _ in range(TRIES):
            self.ready()
            self.hold("Manual")
            if until(lambda: self.state() == "MANUAL", 10.0):
                self.tab.down("w", "KeyW")
                if until(self.live.moving, 5.0):
                    time.sleep(0.3)
                    if self.live.moving():
                        return
            self.tab.up("w", "KeyW")
        raise AssertionError(
            self.tab.js("[baqueano.page.state.sentence, document.getElementById('toast').innerText]")
        )

    def off_after(self, lose):
        """Return how long the motors turn on [s] after `lose`, in the Uno's own time."""
        now_s = self.live.now_s()
        lose()
        assert until(lambda: not self.live.moving(), START_S)
        with self.live.lock:
            return self.live.uno.off_since() - now_s


def signalled(process, number):
    """Send a signal to a process and to all its child processes."""
    children = [
        int(pid)
        for task in Path(f"/proc/{process}/task").glob("*/children")
        for pid in task.read_text().split()
    ]
    os.kill(process, number)
    for child in children:
        signalled(child, number)


@pytest.mark.alone
def test_rt13_rt15_any_lost_connection_from_browser_to_motors_stops_the_motors(firmware, tmp_path):
    with (
        running(firmware, tmp_path, environment={"BAQUEANO_BACKEND": "python"}) as service,
        Chromium() as chromium,
    ):
        serve = (
            "baqueano", "serve", "--robot", str(service.door), "--vehicle", str(service.file.path), "--no-browser",
            "--runs", str(tmp_path / "here"),
        )  # fmt: skip
        took = {}
        with program(*serve, cwd=tmp_path) as page:
            port = port_of(page)
            tab = chromium.tab()
            wheel = Wheel(tab, port, service.live)
            assert tab.js("baqueano.page.hello.vehicle.world") == "real"
            wheel.drives()
            took["STOP"] = wheel.off_after(lambda: tab.press(" ", "Space"))
            tab.up("w", "KeyW")
            wheel.drives()
            took["tab closed"] = wheel.off_after(tab.close)
            tab = chromium.tab()  # the user returns
            wheel = Wheel(tab, port, service.live)
            assert until(lambda: wheel.state() == "STOPPED", START_S)
            wheel.drives()
            took["browser frozen"] = wheel.off_after(lambda: signalled(chromium._process.pid, signal.SIGSTOP))
            signalled(chromium._process.pid, signal.SIGCONT)
            tab.up("w", "KeyW")
            wheel.drives()
            took["page frozen"] = wheel.off_after(lambda: os.kill(page.pid, signal.SIGSTOP))
            os.kill(page.pid, signal.SIGCONT)
            tab.up("w", "KeyW")
            wheel.drives()
            took["page killed"] = wheel.off_after(page.kill)
            tab.close()
        assert all(seconds <= OFF_S for seconds in took.values()), took
        print({name: round(1e3 * seconds) for name, seconds in took.items()}, "ms")
