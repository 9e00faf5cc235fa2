"""Whole processes that open /dev/i2c-1 and call ioctl as on a Raspberry Pi, with an emulated chip behind umockdev.

Nothing in the client is replaced: smbus2, the driver and i2c-tools are the originals; libumockdev-preload answers
instead of the kernel. The tests run in real time, so none of them checks a duration.
"""

import json
import os
import queue
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from tests.emulated.umockdev import PATIENCE_S, SYSTEM_PYTHON, Machine

PACKAGES = "umockdev gir1.2-umockdev-1.0 libumockdev-dev python3-gi i2c-tools"
ASK = "import gi; gi.require_version('UMockdev', '1.0'); from gi.repository import UMockdev"
CLIENT = """
import json, select, sys
from baqueano.robot.imu import driver as imu

def print_event(**what):
    print(json.dumps(what), flush=True)

device = imu.open_imu(1, notify=None)
print_event(event="open", chip=device.identity.chip)
samples, printed = [], 0
while not select.select([sys.stdin], [], [], 0.01)[0]:
    samples += device.read()
    for event in device.events():
        print_event(event=event.message.code, text=event.text)
    if len(samples) >= printed + 100:
        printed = len(samples)
        print_event(event="samples", count=printed)
device.close()
print_event(event="end", t=[s.t_ns for s in samples], accel=[list(s.accel) for s in samples], rate=device.rate_hz,
     rate_error=device.clock.rate_error_hz, restarts=device.counts.restarts)
"""


def missing() -> str:
    """Return the missing packages, or an empty text."""
    if sys.platform != "linux" or not Path(SYSTEM_PYTHON).exists():
        return "no Linux with a system Python"
    result = subprocess.run([SYSTEM_PYTHON, "-c", ASK], capture_output=True, text=True)
    if result.returncode != 0:
        return f"{SYSTEM_PYTHON} lacks umockdev ({result.stderr.strip().splitlines()[-1]})"
    return "" if Path("/usr/sbin/i2cget").exists() else "no i2c-tools"


@pytest.fixture(scope="module")
def lacking() -> str:
    return missing()


@pytest.fixture(autouse=True)
def _installed(request, lacking):
    if lacking and os.environ.get("CI"):
        pytest.fail(
            f"The emulated /dev/i2c-1 must run in CI: {lacking}. Type: sudo apt-get install {PACKAGES}"
        )
    if lacking:
        pytest.skip(f"{request.node.name}: {lacking}; sudo apt-get install {PACKAGES}")


class Client:
    """The process that reads the IMU."""

    def __init__(self, environment: dict[str, str]) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", CLIENT], env=environment, stdin=-1, stdout=-1, stderr=-1, text=True
        )
        self.events: list[str] = []
        self._lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        for line in self._process.stdout:
            self._lines.put(line)
        self._lines.put("")

    def wait_for(self, kind: str, count: int = 0) -> dict:
        """Return the next event of this kind, with at least this number of samples."""
        while line := self._lines.get(timeout=PATIENCE_S):
            message = json.loads(line)
            self.events.append(message["event"])
            if message["event"] == kind and message.get("count", 0) >= count:
                return message
        raise AssertionError(
            f"ended before '{kind}', after {self.events}: {self._process.stderr.read()[-3000:]}"
        )

    def stop(self) -> dict:
        """Stop the process and return everything that it read."""
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        result = self.wait_for("end")
        assert self._process.wait(timeout=PATIENCE_S) == 0
        return result

    def close(self) -> None:
        """End the process and close its pipes."""
        self._process.stdin.close()
        try:
            self._process.wait(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        while self._lines.get(timeout=PATIENCE_S):
            pass
        self._process.stdout.close()
        self._process.stderr.close()


@pytest.fixture
def machine(until_end):
    """Return `machine(…)`, which makes a machine with an I2C bus and a chip with these options."""
    return lambda **chip: until_end(Machine("i2c_umockdev.py", chip))


@pytest.fixture
def read_imu(until_end):
    """Return `read_imu(machine)`, which starts a process that reads the IMU until it receives the stop order."""
    return lambda machine: until_end(Client({**os.environ, **machine.environment}))


def test_a_process_reads_every_sample_of_a_slow_clone(machine, read_imu):
    m = machine(who_am_i=0x98, clock_ppm=-40000)
    client = read_imu(m)
    assert client.wait_for("open")["chip"] == "ICM-20689"
    client.wait_for("samples", 500)
    result = client.stop()
    sample_times = np.array(m.order("taken"))
    times = np.array(result["t"])
    assert result["rate"] == pytest.approx(192.0, abs=result["rate_error"] + 0.01)
    assert np.all(np.diff(times) > 0)
    if result["restarts"] == 0 and "imu.overflow" not in client.events:
        span = sample_times[(sample_times > times[0] - 6e6) & (sample_times < times[-1] + 6e6)]
        assert abs(len(span) - len(times)) <= 3
    error = np.min(np.abs(sample_times[None, :] - times[200:, None]), axis=1)
    assert np.median(error) < 0.8e6, (
        "ns, where chance would give 1.3: both sides have the clock of this machine"
    )
    assert np.mean(result["accel"], axis=0) == pytest.approx([0.0, 0.0, 9.80665], abs=0.05)


def test_a_process_recovers_from_a_blocked_bus_within_its_timeout(machine, read_imu):
    m = machine()
    client = read_imu(m)
    client.wait_for("samples", 100)
    assert m.order("timeout") == 40_000_000
    m.order("hold", True)
    assert client.wait_for("imu.held")["text"]
    client.wait_for("imu.data-missing")
    m.order("hold", False)
    client.wait_for("imu.answers-again")
    client.wait_for("samples", 200)
    client.stop()


def test_i2c_tools_can_access_the_emulated_chip(machine):
    m = machine(who_am_i=0x70)
    assert m.run("i2cget", "-y", "1", "0x68", "0x75").stdout.strip() == "0x70"
    assert m.run("i2cset", "-y", "1", "0x68", "0x6b", "0x01").returncode == 0
    assert m.run("i2ctransfer", "-y", "1", "w1@0x68", "0x6b", "r1").stdout.strip() == "0x01"
    assert m.run("i2cget", "-y", "1", "0x55", "0x75").returncode != 0


def test_a_wrong_address_is_error_121_in_smbus2(machine):
    code = "import smbus2; smbus2.SMBus(1).read_byte_data(0x55, 0x75)"
    errors = machine().python("-c", code).stderr
    assert "[Errno 121] Remote I/O error" in errors


def test_a_sleeping_machine_without_a_chip_is_reported_in_one_paragraph(machine):
    code = "from baqueano.robot.imu import driver as imu; imu.open_imu(1, address=0x69)"
    errors = machine().python("-c", code).stderr
    assert "RobotUnreachable: No IMU answers at 0x69 on /dev/i2c-1" in errors
