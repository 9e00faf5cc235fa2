"""`baqueano drive` on the vehicle, as over ssh: a terminal, the service, pyserial and the firmware, in real time."""

import re
import time

import pytest

from baqueano.door.remote import connect
from baqueano.drive.manual.terminal_heartbeat import MAX_SILENCE_S
from baqueano.drive.session import mark_times_ns
from baqueano.runs import read_run
from tests.cli.test_driving import W_DOWN, Terminal
from tests.emulated.test_processes import (  # noqa: F401
    PATIENCE_S,
    end_of_drive,
    ready,
    service,
    stalled,
    stops,
    vehicle,
    wait,
)


@pytest.fixture
def screens(service, vehicle, live, tmp_path):  # noqa: F811
    """Return `screens()`, the terminal of a drive, 0.mcap, 1.mcap …, whose key W moves the motors."""
    _, door = service
    terminals = []

    def opens():
        end = time.monotonic() + 3.0 * PATIENCE_S
        while True:
            with connect(str(door)) as remote:
                ready(remote)
            screen = Terminal(
                tmp_path, "drive", "--robot", str(door), "--vehicle", str(vehicle.path), "--command-share", "0.9", "-o",
                f"{len(terminals)}.mcap", gone_s=MAX_SILENCE_S,
            )  # fmt: skip
            terminals.append(screen)
            if screen.shows(rb"MANUAL", PATIENCE_S):
                screen.type(W_DOWN)
                if wait(live.moving, PATIENCE_S / 4.0):
                    return screen
            assert time.monotonic() < end, screen.output[-2000:]
            screen.close()

    yield opens
    for screen in terminals:
        screen.close()


def test_a_key_drives_the_firmware_and_the_run_contains_a_mark(screens, service, live, tmp_path):  # noqa: F811
    code, end = -1, time.monotonic() + 3.0 * PATIENCE_S
    while code:
        loss_s, screen = live.loss_s, screens()
        screen.shows(rb"vehicle \d+ ms", PATIENCE_S)
        screen.type(b"\x1b[119;1:3u\x1b[109u")
        stops(live, 5.0)
        if screen.shows(rb"marks 1", PATIENCE_S):
            time.sleep(0.3)
            screen.type(b"\x1b[113u")
        code = screen.ends()
        reason, run = end_of_drive(service[1], tmp_path / "there")
        assert code == 0 or (stalled(run, live.loss_s - loss_s) and time.monotonic() < end), reason
    assert re.search(rb"vehicle \d+ ms", screen.output)
    assert len(mark_times_ns(run)) == 1
    run_path = max(tmp_path.glob("[0-9]*.mcap"), key=lambda path: int(path.stem))
    assert len(mark_times_ns(read_run(run_path))) == 1


def test_an_unresponsive_terminal_leaves_a_stopped_vehicle(screens, live):
    screen = screens()
    screen.present = False
    print(f"off {1e3 * stops(live, 10.0):.0f} ms after the terminal")
    assert screen.ends() == 5
    screen.until(rb"baqueano robot clear", PATIENCE_S)


def test_a_closed_terminal_leaves_a_stopped_vehicle(screens, live):
    screen = screens()
    screen.hang_up()
    print(f"off {1e3 * stops(live, 10.0):.0f} ms after the hang-up")
