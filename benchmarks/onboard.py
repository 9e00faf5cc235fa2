"""Measure the onboard service as a process: memory, start, ticks, with an estimate for a Pi 3.

The process is started as by systemd, with the unit's OPENBLAS_NUM_THREADS. The firmware is emulated behind a pty, the
MPU-6050 behind umockdev, so calls of I2C cost more than with a kernel driver. The work of a tick is measured in
lock-step, minus the work of the emulators. No Pi was available. The estimate is processor time here × the ratio of one
published figure of a Pi 3 to the same figure here: Python without site (`-S`) prints hello. It takes 110.02 ms on
"Raspberry Pi 3 (arm64), Debian buster", Python 3.6.4 (github.com/bdrung/startup-time, README of 2018-02-10). With
Python 3.6 on both sides the ratio was within 10 % of the ratio with 3.11. Waiting times do not scale. While the IMU
starts, the program is loaded; loading takes longer on a Pi. A pty does not have a boot-loader. The boot-loader of a
real Uno needs BOOT_S (Optiboot, emulated) after its line is opened. This happens after the share EARLY of the start's
computing.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from baqueano import vehicle_file
from baqueano.door.remote import connect
from baqueano.drive.mission import Mission, pack
from baqueano.drive.recording import CLOCK_SOURCE
from baqueano.symbolic.c_code.compile import user_cache
from benchmarks.harness import LeftOut
from tests.emulated import rig
from tests.emulated.drives import drive, serve, spin
from tests.emulated.onboard import running
from tests.emulated.robot import EmulatedRobot

MOST_MB, MOST_START_S = 80.0, 4.0
PI3_HELLO_S = 0.11002
BOOT_S, EARLY = 1.4, 0.25
AS_INSTALLED = {
    "PYTHONDONTWRITEBYTECODE": ""
}  # pip writes bytecode; here the first start writes it, independent of the environment
HELLO = [sys.executable, "-S", "-c", "print('Hello World!')"]


@dataclass(frozen=True)
class Figures:
    """The measured figures; only the memory is judged, because the other figures are estimates."""

    resident_mb: dict[str, float]
    start_s: float
    start_cpu_s: float
    loading_s: float  # the part of start_cpu_s while the IMU starts
    tick_s: float
    clock_text: str
    ratio: float

    @property
    def pi_start_s(self) -> float:
        """Return the estimated duration [s] of a start on a Pi 3 with the boot-loader."""
        computing_s, loading_s = self.start_cpu_s * self.ratio, self.loading_s * self.ratio
        waiting_s = (
            self.start_s - self.start_cpu_s + self.loading_s
        )  # until the IMU is ready; loading may hide it
        return max(computing_s - loading_s, EARLY * computing_s + BOOT_S) + max(loading_s, waiting_s)

    @property
    def met(self) -> bool:
        """Return True if the memory stays below MOST_MB."""
        return max(self.resident_mb.values()) <= MOST_MB

    def table(self) -> str:
        """Return the figures as text."""
        verdict = "" if self.met else ": missed"
        lines = [f"onboard service, small vehicle, default EKF compiled (target {MOST_MB:g} MB{verdict})"]
        lines += [f"  resident, {when:<10} {mb:8.1f} MB" for when, mb in self.resident_mb.items()]
        over = "" if self.pi_start_s <= MOST_START_S else f", more than {MOST_START_S:g} s"
        lines += [
            f"  start to READY       {self.start_s:8.2f} s, {self.start_cpu_s:.2f} s of it computing",
            f"  computing in a tick  {1e3 * self.tick_s:8.2f} ms",
            f"  {self.clock_text}",
            f"  a Pi 3, estimated at ×{self.ratio:.1f}: start {self.pi_start_s:.1f} s with the Uno's boot-loader{over};"
            f" {1e3 * self.tick_s * self.ratio:.1f} ms of a tick's 10",
        ]
        return "\n".join(lines)

    def as_rows(self) -> list[dict[str, Any]]:
        """Return the figures as dicts, for JSON."""
        return [{**self.__dict__, "pi_start_s": self.pi_start_s}]


def benches(smallest: bool) -> list[Figures] | list[LeftOut]:
    """Return the figures of the fastest of five starts and a drive of 30 s; if `smallest`, of one start and 1 s."""
    if lacking := rig.missing():
        return [LeftOut("onboard service", f"sudo apt-get install {' '.join(lacking)}")]
    build = rig.build(user_cache() / "emulated")
    starts = [start_service(build) for _ in range(0 if smallest else 4)]
    with tempfile.TemporaryDirectory() as folder:
        resident, clock_text, own_ms = drive_service(build, Path(folder), 1.0 if smallest else 30.0)
    start_s, cpu_s = min([*starts, own_ms])
    ratio = PI3_HELLO_S / hello_s(2 if smallest else 40)
    loading, tick_s = loading_s(1 if smallest else 5), computing(build, 1.0 if smallest else 20.0)
    return [Figures(resident, start_s, cpu_s, loading, tick_s, clock_text, ratio)]


def loading_s(times: int) -> float:
    """Return the processor time [s] to load the modules that are loaded while the IMU starts: the least of `times`."""
    code = (
        "import importlib, time, baqueano.cli.robot.robot, baqueano.robot.service.onboard as o; "
        "import baqueano.vehicle_file as v; "
        "v.load('small'); t = time.process_time(); "
        "[importlib.import_module(name) for name in o.BACKGROUND_MODULES]; print(time.process_time() - t)"
    )
    environment = {**os.environ, **AS_INSTALLED}
    processes = [
        subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, env=environment)
        for _ in range(times)
    ]
    return min(float(process.stdout) for process in processes)


def start_service(build: Any) -> tuple[float, float]:
    """Return the time [s] until READY=1, and the processor time [s], of a start."""
    with (
        tempfile.TemporaryDirectory() as folder,
        running(build, Path(folder), environment=AS_INSTALLED) as service,
    ):
        return service.start_s, service.cpu_s


def drive_service(
    build: Any, folder: Path, seconds: float
) -> tuple[dict[str, float], str, tuple[float, float]]:
    """Return the memory [MB] around a drive and its maximum, a text about the ticks, and the times [s] of the start."""
    resident: dict[str, float] = {}
    with running(build, folder, environment=AS_INSTALLED) as service, connect(str(service.door)) as remote:
        while remote.state["state"] != "READY":
            remote.receive(("state",), 60.0)
        resident["READY"] = service.memory_mb()["VmRSS"]

        def look(t_s: float) -> None:
            resident["driving"] = service.memory_mb()["VmRSS"]

        u = np.tile([0.25, 0.0, 0.35], (round(seconds * service.file.rate_hz), 1))
        run = remote.perform(
            pack(Mission("experiment", u=u), service.file), folder / "run.mcap", progress=look
        )
        after = service.memory_mb()
    resident |= {"after": after["VmRSS"], "most ever": after["VmHWM"]}
    clock_text = next(event.text for event in run.events if event.source == CLOCK_SOURCE)
    return resident, clock_text, (service.start_s, service.cpu_s)


def computing(build: Any, seconds: float) -> float:
    """Return the median processor time [s] of a tick, in lock-step, minus the time of the emulators."""
    robot = EmulatedRobot(build, vehicle_file.load("small"))
    with tempfile.TemporaryDirectory() as folder:
        service = serve(robot, vehicle_file.load("small"), Path(folder))
        wait_s, marks = 0.0, []

        def wait(seconds: float) -> None:
            nonlocal wait_s
            start_s = time.thread_time()
            robot.wait(seconds)
            wait_s += time.thread_time() - start_s

        service.sleep, service.notify_watchdog = wait, lambda: marks.append(time.thread_time() - wait_s)
        drive(service, spin(seconds, 0.3))
    robot.close()
    return median(np.diff(marks).tolist())


def hello_s(times: int) -> float:
    """Return the median processor time [s] of the command HELLO over `times` runs."""
    cpu_times = []
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    for _ in range(times):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(HELLO, stdout=subprocess.DEVNULL, env=environment, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu_times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return median(cpu_times)
