"""The page of the emulated robot, from the key in a real browser to the pins of the Uno.

The service runs as systemd starts it, with the page process and Chromium. A shell replaces ssh between the page and the
service. After any lost connection between them the motors are off within half a second.
"""

import os
import signal
import sys
import time
from pathlib import Path

import pytest

from tests.emulated.onboard import running
from tests.emulated.test_processes import wait
from tests.web.chromium import CHROMIUM, Chromium
from tests.web.test_page_over_ssh import put_programs
from tests.web.test_serve import port_of, program

pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="Debian's package chromium is not installed"),
    pytest.mark.skipif(sys.platform != "linux", reason="a pty, signals, /proc"),
]
START_S, OFF_S, TRIES = 60.0, 0.5, 6
KEY_MS, PRESSES = 60.0, 7
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
            if wait(lambda: self.state() == "MANUAL", 10.0):
                self.tab.down("w", "KeyW")
                if wait(self.live.moving, 5.0):
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
        assert wait(lambda: not self.live.moving(), START_S)
        with self.live.lock:
            return self.live.uno.off_since() - now_s

    def is_driven(self, pins):
        """Return True if these pins turn a motor."""
        return any(pins.terminal(channel, self.live.uno.driver).duty for channel in range(2))

    def key_ms(self):
        """Return the time [ms] from a key to the pins of the motors, in the time of the Uno."""
        for _ in range(TRIES):
            if self.state() != "MANUAL":
                self.drives()
            self.tab.up("w", "KeyW")
            assert wait(lambda: not self.live.moving(), START_S)
            now_s = self.live.now_s()
            self.tab.down("w", "KeyW")
            if wait(self.live.moving, 3.0):  # else a stalled machine has stopped it before
                with self.live.lock:
                    return 1e3 * (self.live.uno.first_time(self.is_driven, after_s=now_s) - now_s)
        raise AssertionError(self.tab.js("baqueano.page.state.sentence"))


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


def test_rt13_rt15_any_lost_connection_from_browser_to_motors_stops_the_motors(firmware, tmp_path):
    took, keys_ms = {}, []
    with running(firmware, tmp_path, environment={"BAQUEANO_BACKEND": "python"}) as service:
        calls = put_programs(tmp_path / "bin", service.door)
        environment = {**os.environ, "PATH": f"{tmp_path / 'bin'}:{os.environ['PATH']}"}
        serve = (
            "baqueano", "serve", "--robot", "ana@r1", "--vehicle", str(service.file.path), "--no-browser",
            "--runs", str(tmp_path / "here"),
        )  # fmt: skip

        def line_to_robot(first_call):
            """Return the process that replaces ssh for the page that made this call."""
            return int(calls.read_text().splitlines()[first_call].split()[0])

        with program(*serve, cwd=tmp_path, env=environment) as page:
            port = port_of(page)
            with Chromium() as chromium:
                tab = chromium.tab()
                wheel = Wheel(tab, port, service.live)
                assert tab.js("baqueano.page.hello.vehicle.world") == "real"
                wheel.drives()
                keys_ms = [wheel.key_ms() for _ in range(PRESSES)]
                took["STOP"] = wheel.off_after(lambda: tab.press(" ", "Space"))
                tab.up("w", "KeyW")
                wheel.drives()
                took["tab closed"] = wheel.off_after(tab.close)
                tab = chromium.tab()  # the user returns
                wheel = Wheel(tab, port, service.live)
                assert wait(lambda: wheel.state() == "STOPPED", START_S)
                wheel.drives()
                browser = chromium._process.pid
                took["browser frozen"] = wheel.off_after(lambda: signalled(browser, signal.SIGSTOP))
                signalled(browser, signal.SIGCONT)
                tab.up("w", "KeyW")
                wheel.drives()
                took["browser killed"] = wheel.off_after(lambda: signalled(browser, signal.SIGKILL))
            with Chromium() as chromium:
                tab = chromium.tab()
                wheel = Wheel(tab, port, service.live)
                for name, process in (("page frozen", page.pid), ("network lost", line_to_robot(0))):
                    wheel.drives()
                    took[name] = wheel.off_after(lambda pid=process: os.kill(pid, signal.SIGSTOP))
                    os.kill(process, signal.SIGCONT)
                    tab.up("w", "KeyW")
                wheel.drives()
                took["page killed"] = wheel.off_after(page.kill)
                call_count = len(calls.read_text().splitlines())
                with program(*serve, cwd=tmp_path, env=environment) as second_page:
                    wheel = Wheel(tab, port_of(second_page), service.live)
                    wheel.drives()
                    took["ssh killed"] = wheel.off_after(
                        lambda: os.kill(line_to_robot(call_count), signal.SIGKILL)
                    )
                tab.close()
    print(
        {name: round(1e3 * seconds) for name, seconds in took.items()}, "ms; from key to pins", keys_ms, "ms"
    )
    assert all(seconds <= OFF_S for seconds in took.values()), took
    assert min(keys_ms) <= KEY_MS, keys_ms  # the machine may delay the others
