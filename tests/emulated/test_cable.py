"""The cable of the Uno is disconnected in a drive and connected again: real pyserial, its thread, the firmware on a
pty.
"""

import os
import pty
import time
import tty

import pytest

from baqueano import vehicle_file
from baqueano.diagnostics import StopReason
from baqueano.door.operator import Operator
from baqueano.door.states import DoorState
from baqueano.robot.service.imu_upkeep import ImuUpkeep
from baqueano.robot.service.service import Service
from baqueano.robot.uno.serial_port import open_uno
from baqueano.runs import read_run
from tests.emulated.drives import spin
from tests.emulated.realtime import on_pty

WHEELS = (
    '[sensors.wheels]\nkind = "wheels"\nrate_hz = 50.0\nnoise_std = 0.01\n\n[estimator]\nuse = ["wheels"]'
)
PATIENCE_S = 60.0


@pytest.fixture
def plugged_uno(firmware, tmp_path):
    """Return the Uno and the name of its serial line."""
    with on_pty(firmware) as live:
        name = tmp_path / "uno"
        name.symlink_to(live.path)
        yield live, name


def pull(live, name):
    """Remove the line and its name."""
    name.unlink()
    master, slave = pty.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    with live.lock:
        old_ends, live.master, live._slave = (live.master, live._slave), master, slave
    for fd in old_ends:
        os.close(fd)


def put_back(live, name):
    """Add another device under the old name, as the operating system does; opening it resets an Uno."""
    with live.lock:
        live.uno.reset()
    name.symlink_to(os.ttyname(live._slave))


def look_until(service, condition):
    """Let the service examine its hardware while idle, until `well()` is true."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, service.machine.reason
        service.idle()
        time.sleep(0.05)


def test_rt10_a_disconnected_line_reopens_and_drives_after_a_clear(plugged_uno, tmp_path, monkeypatch):
    monkeypatch.setenv("BAQUEANO_BACKEND", "numpy")
    live, name = plugged_uno
    head, rest = vehicle_file.load("small").text.split("[sensors.imu]")
    file = vehicle_file.parse(
        (head + WHEELS + rest.split("[estimator]")[1]).replace("rate_hz = 100.0\n", "rate_hz = 50.0\n", 1),
        "wheels",
    )
    messages, ticks, pulls = [], [], []
    with open_uno(str(name)) as uno:
        service = Service(uno, ImuUpkeep(), file.robot, tmp_path / "runs", Operator(), messages.append)
        (tmp_path / "runs").mkdir()
        look_until(service, lambda: service.machine.state is DoorState.READY)

        def healthy():
            if service.machine.state is DoorState.MISSION and not pulls:
                ticks.append(live.moving())
                if not ticks[-1] and len(ticks) < 25:
                    return
                pulls.append(pull(live, name))

        service.notify_watchdog = healthy
        service.execute_request(spin(20.0, file=file), attended=False)
        assert pulls
        last = [m for m in messages if m["type"] == "done"][-1]
        # another reason may follow a stall of this machine
        assert last["reason"].code in (StopReason.UNO_SILENT, StopReason.UNO_DEAD_MAN)
        assert service.machine.state is DoorState.STOPPED
        end = time.monotonic() + PATIENCE_S
        while live.moving():
            assert time.monotonic() < end
            time.sleep(0.01)
        assert read_run(tmp_path / "runs" / last["run"]).notes == ()
        put_back(live, name)
        service.operator.is_clear_requested = True
        look_until(service, lambda: service.machine.state is DoorState.READY)
        assert uno.statistics.resets == 1
        uno.arm()
        end = time.monotonic() + PATIENCE_S
        while not live.moving():
            assert time.monotonic() < end
            uno.drive(0.5, 0.5)
            time.sleep(0.02)
