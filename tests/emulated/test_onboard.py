"""Memory and threads of the onboard service as a process: it uses no more than a Raspberry Pi has."""

import json
import os
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from baqueano.door.remote import connect
from baqueano.drive.mission import Mission, pack
from baqueano.drive.recording import CLOCK_SOURCE
from baqueano.guides.shapes import circle
from baqueano.robot.service.realtime import PRIORITY
from benchmarks.onboard import BOOT_S, MOST_MB, Figures
from tests.emulated.onboard import running
from tests.emulated.test_imu_process import _installed, lacking  # noqa: F401
from tests.emulated.test_processes import drive_whole, perform_mission

WATCHER = Path(__file__).with_name("watched.py")
NOT_AT_THE_START = (  # modules of a laptop, or of the start of a drive
    "baqueano.simulate", "baqueano.runs.importing", "baqueano.runs.export",
    "baqueano.runs.route_file", "baqueano.vehicle_file.text.edit", "baqueano.identify", "baqueano.compare",
    "baqueano.report", "baqueano.study", "baqueano.tune", "scipy", "matplotlib", "mcap", "csv", "hashlib",
)  # fmt: skip


@pytest.mark.parametrize("backend", ["c", "python"])
def test_the_service_imports_no_laptop_module_at_start_or_in_drives(firmware, tmp_path, backend):
    log = tmp_path / "watched.jsonl"
    environment = {"MODULE_LOG": str(log), "BAQUEANO_BACKEND": backend}
    with running(firmware, tmp_path, (sys.executable, str(WATCHER)), environment) as service:
        ring = circle(0.05, 0.2)
        missions = [
            Mission("experiment", u=np.tile([0.0, 0.0, 0.3], (100, 1))),
            Mission("repeat", route=ring),
            Mission("teach", route=ring),
            Mission("first drive"),
        ]
        with connect(str(service.door)) as remote:

            def enough(t_s: float) -> None:
                if t_s > 2.5:  # a first drive takes a minute
                    remote.send(type="stop", reason="enough was seen")

            for mission in missions:
                packed_mission = pack(mission, service.file)
                perform_mission(remote, packed_mission, tmp_path / f"{mission.kind}.mcap", progress=enough)
    at_ready, *drives = map(json.loads, log.read_text(encoding="utf-8").splitlines())
    assert "baqueano.drive.session" in at_ready["ready"]
    assert not set(NOT_AT_THE_START) & set(at_ready["ready"])
    assert len(drives) == len(missions)
    assert [drive["late"] for drive in drives] == [[]] * len(drives)


def test_the_door_and_the_serial_thread_run_below_the_loop_and_before_ordinary_programs(firmware, tmp_path):
    chrt = ("chrt", "-f", "40")  # as the unit starts it: every thread begins with the priority of the loop
    if shutil.which("chrt") is None or subprocess.run([*chrt, "true"], capture_output=True).returncode:
        pytest.skip("this user may have no real-time priority")
    with running(firmware, tmp_path, (*chrt, sys.executable), {"BAQUEANO_BACKEND": "numpy"}) as service:
        idle = priorities(service)
        with connect(str(service.door)) as remote:
            driving = []
            mission = pack(Mission("experiment", u=np.tile([0.0, 0.0, 0.3], (300, 1))), service.file)
            path = tmp_path / "run.mcap"
            perform_mission(remote, mission, path, progress=lambda t_s: driving.append(priorities(service)))
    longest = max(driving, key=len)
    assert idle == [PRIORITY - 1, PRIORITY - 1, PRIORITY]
    assert longest == [0, *idle]  # the run's writer


def priorities(service):
    """Return the real-time priorities of its threads, 0 without one; a thread may end meanwhile."""
    priorities = []
    for task in Path(f"/proc/{service.process.pid}/task").iterdir():
        with suppress(ProcessLookupError):
            priorities.append(os.sched_getparam(int(task.name)).sched_priority)
    return sorted(priorities)


def test_resident_memory_stays_below_80_mb_while_idle_driving_and_after(firmware, tmp_path, monkeypatch):
    monkeypatch.delenv("BAQUEANO_BACKEND", raising=False)
    with running(firmware, tmp_path) as service:
        output = (tmp_path / "output.txt").read_text()
        idle = service.memory_mb()
        with connect(str(service.door)) as remote:
            mission = pack(Mission("experiment", u=np.tile([0.0, 0.0, 0.3], (300, 1))), service.file)
            run = drive_whole(remote, mission, service.live, tmp_path / "here")
        after = service.memory_mb()
        assert "WATCHDOG=1" in service.notifications
    assert ("memory locked" in output) == (idle["VmLck"] > 0.0)
    assert idle["VmRSS"] < MOST_MB
    assert after["VmHWM"] < MOST_MB
    assert run.metadata["backend"] == "c"
    assert len(run.sensors["imu"].t_ns) > 20
    assert any(event.source == CLOCK_SOURCE for event in run.events)


def test_an_imu_that_does_not_answer_at_start_is_detected_later(firmware, tmp_path):
    with running(firmware, tmp_path, unheard=4) as service, connect(str(service.door)) as remote:
        mission = pack(Mission("experiment", u=np.tile([0.0, 0.0, 0.3], (300, 1))), service.file)
        run = drive_whole(remote, mission, service.live, tmp_path / "here")
    output = (tmp_path / "output.txt").read_text()
    assert output.count("the IMU is missing: No IMU answers at 0x68") == 1
    assert output.count("the IMU answers now") == 1
    assert len(run.sensors["imu"].t_ns) > 20


def test_the_benchmark_judges_memory_and_estimates_the_start_time():
    figures = Figures(
        {"READY": 46.0, "most ever": 57.0}, 0.9, 0.4, 0.04, 0.4e-3, "100 ticks: none late", 10.0
    )
    assert figures.met
    assert figures.pi_start_s == pytest.approx(4.0 + 0.5 + 0.04 - 0.4)  # all but the part that loading hides
    assert (
        "a Pi 3, estimated at ×10.0: start 4.1 s with the Uno's boot-loader, more than 4 s" in figures.table()
    )
    assert "4.0 ms of a tick's 10" in figures.table()
    heavy = Figures({"READY": 81.0}, 0.7, 0.1, 0.0, 0.4e-3, "", 10.0)
    assert not heavy.met
    assert "missed" in heavy.table()
    assert heavy.pi_start_s == pytest.approx(0.6 + 0.25 + BOOT_S), "the boot-loader is what it waits for"
    assert "more than 4 s" not in heavy.table()
