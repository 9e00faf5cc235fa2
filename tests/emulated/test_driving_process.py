"""`baqueano drive` on the vehicle, as over ssh: a terminal, the service, pyserial and the firmware, in real time."""

import time

import pytest

from baqueano.drive.life import GONE_S
from baqueano.drive.session import marks_of
from baqueano.robot.remote import reached
from baqueano.runs import read_run
from tests.cli.test_driving import W_DOWN, Terminal
from tests.emulated.test_processes import PATIENCE_S, live, ready, service, stops, until, vehicle  # noqa: F401


@pytest.fixture
def screen(service, vehicle, tmp_path):  # noqa: F811
    """The terminal of a drive that may begin."""
    _, door = service
    with reached(str(door)) as remote:
        ready(remote)
    screen = Terminal(
        tmp_path, "drive", "--robot", str(door), "--vehicle", str(vehicle.path), "--share", "0.9", "-o", "run.mcap",
        gone_s=GONE_S,
    )  # fmt: skip
    screen.until(rb"MANUAL")
    yield screen
    screen.close()


def test_a_key_drives_the_firmware_and_a_mark_is_in_the_run_that_comes_back(screen, live, tmp_path):  # noqa: F811
    screen.type(W_DOWN)
    assert until(live.moving, PATIENCE_S)
    screen.until(rb"vehicle \d+ ms")
    screen.type(b"\x1b[119;1:3u\x1b[109u")
    stops(live, 5.0)
    screen.until(rb"marks 1")
    time.sleep(0.3)
    screen.type(b"\x1b[113u")
    assert screen.ends() == 0
    assert len(marks_of(read_run(tmp_path / "run.mcap"))) == 1


def test_a_terminal_that_stops_answering_leaves_a_stopped_vehicle(screen, live):  # noqa: F811
    screen.type(W_DOWN)
    assert until(live.moving, PATIENCE_S)
    screen.there = False
    print(f"off {1e3 * stops(live, 10.0):.0f} ms after the terminal")
    assert screen.ends() == 5
    assert b"baqueano robot clear" in screen.heard


def test_a_terminal_that_hangs_up_leaves_a_stopped_vehicle(screen, live):  # noqa: F811
    screen.type(W_DOWN)
    assert until(live.moving, PATIENCE_S)
    screen.hang_up()
    print(f"off {1e3 * stops(live, 10.0):.0f} ms after the hang-up")
