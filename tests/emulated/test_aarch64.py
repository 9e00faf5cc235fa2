"""The onboard service on the instruction set of a Pi 3, under qemu: it starts, is READY, and drives with its EKF.

qemu is many times slower than the machine, so ticks are skipped, and no test here checks a duration.
"""

import re
import shutil
import subprocess

import numpy as np
import pytest

from baqueano.door.remote import connect
from baqueano.drive import drive_stop_reason
from baqueano.drive.mission import Mission, pack
from baqueano.drive.recording import CLOCK_SOURCE
from tests.emulated import aarch64
from tests.emulated.onboard import running
from tests.emulated.test_processes import PATIENCE_S, ready

ATTEMPTS = 4


@pytest.fixture(autouse=True)
def _aarch64(request):
    if lacking := aarch64.missing():
        pytest.skip(f"{request.node.name}: {lacking}")


def test_the_command_line_runs_on_aarch64(tmp_path):
    result = subprocess.run(
        [*aarch64.python(), "-m", "baqueano", "--version"], env=aarch64.environment(False, tmp_path),
        capture_output=True, text=True, timeout=10 * PATIENCE_S,
    )  # fmt: skip
    assert re.fullmatch(r"baqueano, version \S+\n", result.stdout), result.stderr


@pytest.mark.parametrize("backend", ["c", "python"])
def test_the_service_is_ready_and_drives_with_its_ekf_compiled(firmware, tmp_path, backend):
    """With a C compiler, as on Raspberry Pi OS Lite, and without one: then blocks are compiled to Python."""
    if backend == "c" and not shutil.which(aarch64.COMPILER):
        pytest.skip(
            f"no {aarch64.COMPILER}: sudo apt-get install gcc-aarch64-linux-gnu libc6-dev-arm64-cross"
        )
    variables = aarch64.environment(backend == "c", tmp_path / "cache")
    with running(firmware, tmp_path, aarch64.python(), variables) as service:
        guest_mb = service.guest_mb("qemu-aarch64")
        with connect(str(service.door)) as remote:
            ready(remote)
            mission = pack(Mission("experiment", u=np.tile([0.0, 0.0, 0.3], (200, 1))), service.file)
            for attempt in range(ATTEMPTS):  # a slow emulated Pi may receive the Uno too late
                run = remote.perform(mission, tmp_path / f"{attempt}.mcap")
                if not drive_stop_reason(run):
                    break
                remote.send(type="clear")
                ready(remote)
        print(
            f"READY after {service.start_s:.1f} s, {service.cpu_s:.1f} s of a processor; resident without qemu's "
            f"own at most {guest_mb:.0f} MB, after a drive {service.guest_mb('qemu-aarch64'):.0f} MB"
        )
    assert drive_stop_reason(run) is None
    assert run.metadata["machine"] == "Linux aarch64"
    assert run.metadata["backend"] == backend
    assert run.duration_s >= 2.0
    assert np.all(np.isfinite(run.estimate.eta))
    assert np.max(run.applied_commands[:, 2]) == pytest.approx(0.3, abs=0.002)
    assert len(run.sensors["imu"].t_ns) > 20
    assert any(event.source == CLOCK_SOURCE for event in run.events)
    assert "MPU-6050" in (tmp_path / "output.txt").read_text()
