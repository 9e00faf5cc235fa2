"""`baqueano robot run` as systemd starts it: a separate process, the firmware on a pty, an MPU-6050 on /dev/i2c-1."""

import errno
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from baqueano import vehicle_file
from tests.emulated.body import Body, RealTimeBody
from tests.emulated.realtime import OnPty, on_pty
from tests.emulated.rig import Built
from tests.emulated.test_imu_process import Machine

PATIENCE_S = 120.0  # timeout of the start
CLOCK_HZ = os.sysconf("SC_CLK_TCK")


class Running:
    """A service that has sent READY=1 to systemd, and its figures from the operating system."""

    def __init__(self, process: Any, door: Path, file: Any, live: OnPty, messages: list[str]) -> None:
        self.process = process
        self.door = door
        self.file = file
        self.live = live
        self.notifications = messages
        self.start_s = self.cpu_s = 0.0  # until READY=1
        self.body: Body | None = None

    def memory_mb(self) -> dict[str, float]:
        """Return VmRSS, VmHWM and VmLck of its status and Pss of its maps [MB of 10⁶ bytes]."""
        text = Path(f"/proc/{self.process.pid}/status").read_text()
        text += Path(f"/proc/{self.process.pid}/smaps_rollup").read_text()
        lines = (line.split() for line in text.splitlines())
        keys = ("VmRSS:", "VmHWM:", "VmLck:", "Pss:")
        return {words[0][:-1]: 1024e-6 * float(words[1]) for words in lines if words and words[0] in keys}

    def guest_mb(self, emulator: str) -> float:
        """Resident memory [MB] less the emulator's program and the code that it made: at most that of its guest."""
        resident, counts = 0.0, False
        for line in Path(f"/proc/{self.process.pid}/smaps").read_text().splitlines():
            words = line.split()
            # address, rights, offset, device, inode and, if it is one, the file
            if not words[0].endswith(":"):
                counts = emulator not in line and not (len(words) == 5 and "x" in words[1])
            elif words[0] == "Rss:" and counts:
                resident += 1024e-6 * float(words[1])
        return resident

    def used_s(self) -> float:
        """Return the processor time of all threads until now."""
        words = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(words[11]) + int(words[12])) / CLOCK_HZ


def vehicle_of(port: str, folder: Path) -> Any:
    """Return the file of the small vehicle with its default EKF and the Uno at `port`."""
    path = folder / "vehicle.toml"
    text = vehicle_file.load("small").text
    path.write_text(f'{text}\n[robot]\nport = "{port}"\nimu_bus = 1\n', encoding="utf-8")
    return vehicle_file.load(path)


@contextmanager
def running(
    build: Built,
    folder: Path,
    python: Sequence[str] = (sys.executable,),
    environment: dict[str, str] | None = None,
    imu: bool = True,
    unheard: int = 0,
    body: bool = False,
) -> Iterator[Running]:
    """The service after READY=1; its output goes to the file output.txt of `folder`. The IMU does not answer the first
    `unheard` transfers. With `body` the motors move a body whose motion the IMU measures; else it stays at rest."""
    machine = Machine("i2c_umockdev.py", {}) if imu else None
    try:
        if machine is not None and unheard:
            machine.order("fail", errno.EREMOTEIO, unheard)
        with on_pty(build) as live:
            file = vehicle_of(live.path, folder)
            body_motion = RealTimeBody(file, live, machine) if body else None
            devices = (
                {} if machine is None else {k: machine.environment[k] for k in ("UMOCKDEV_DIR", "LD_PRELOAD")}
            )
            try:
                with _spawned(python, file, folder, live, {**devices, **(environment or {})}) as service:
                    service.body = body_motion.body if body_motion else None
                    yield service
            finally:
                if body_motion:
                    body_motion.close()
    finally:
        if machine is not None:
            machine.close()


@contextmanager
def _spawned(
    python: Sequence[str], file: Any, folder: Path, live: OnPty, environment: dict[str, str]
) -> Iterator[Running]:
    door, notify = folder / "door", folder / "notify"
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    listener.bind(str(notify))
    listener.settimeout(0.2)
    with (folder / "output.txt").open("wb") as out, listener:
        start_s = time.monotonic()
        process = subprocess.Popen(
            [*python, "-m", "baqueano", "robot", "run", "--vehicle", str(file.path), "--door", str(door),
             "--runs", str(folder / "there")],
            stdout=out, stderr=subprocess.STDOUT,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", **environment, "NOTIFY_SOCKET": str(notify)},
        )  # fmt: skip
        service = Running(process, door, file, live, [])
        try:
            while "READY=1" not in service.notifications:
                assert process.poll() is None, (folder / "output.txt").read_text()
                assert time.monotonic() < start_s + PATIENCE_S, (folder / "output.txt").read_text()
                with suppress(TimeoutError):
                    service.notifications.append(listener.recv(4096).decode())
            service.start_s, service.cpu_s = time.monotonic() - start_s, service.used_s()
            stop = threading.Event()
            hearing = threading.Thread(
                target=_hear, args=(listener, service.notifications, stop), daemon=True
            )
            hearing.start()
            try:
                yield service
            finally:
                stop.set()
                hearing.join()
        finally:
            process.kill()
            process.wait()


def _hear(listener: socket.socket, messages: list[str], stop: threading.Event) -> None:
    while not stop.is_set():
        with suppress(TimeoutError):
            messages.append(listener.recv(4096).decode())
