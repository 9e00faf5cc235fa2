"""Commands that need the hardware exclusively: the service releases it meanwhile, and at a HOST they run by ssh."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.cli import main
from baqueano.door import remote_session
from baqueano.errors import BaqueanoError, FileError, RobotUnreachable, SafetyStop, UsageError
from baqueano.robot.uno.frames import Settings, WheelCurve
from baqueano.robot.workshop import exclusive_hardware
from baqueano.robot.workshop.calibrate_imu import ImuCalibration
from baqueano.robot.workshop.calibrate_motors import MotorCalibration, Sweep
from tests.codes import refused

IMU_FIT = ImuCalibration(("-y", "x", "z"), np.array([0.1, -0.2]), 0.03, 0.01, 0.3, 3.1, 0.02)


@pytest.fixture
def programs(tmp_path, monkeypatch):
    """Return `programs(ssh="…")`, which puts shell scripts in front of the path; their calls are in the file
    `calls`."""

    def put_scripts(**scripts):
        for name, text in scripts.items():
            path = tmp_path / name
            path.write_text(f'#!/bin/sh\necho "{name} $*" >>{tmp_path}/calls\n{text}\n')
            path.chmod(0o755)
        monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
        return tmp_path / "calls"

    return put_scripts


def test_a_running_service_is_stopped_and_started_again(programs):
    calls, texts = programs(systemctl="exit 0", sudo='shift; exec "$@"'), []
    with exclusive_hardware.stopped_service(texts.append):
        assert "systemctl stop baqueano.service" in calls.read_text()
        assert "start" not in calls.read_text()
    assert "systemctl start baqueano.service" in calls.read_text()
    assert texts == ["baqueano.service is stopped during these tests", "baqueano.service started again"]


def test_a_service_that_does_not_restart_is_reported_with_a_command(programs):
    programs(systemctl='case "$1" in start) echo Unit is masked. >&2; exit 1;; esac', sudo='shift; exec "$@"')
    texts = []
    with exclusive_hardware.stopped_service(texts.append):
        pass
    assert texts == [
        "baqueano.service is stopped during these tests",
        "baqueano.service was not started again (Unit is masked.). Type: sudo systemctl start baqueano.service",
    ]


def test_a_stopped_service_is_not_started(programs):
    calls = programs(systemctl="exit 3")
    with exclusive_hardware.stopped_service(print):
        pass
    assert "stop" not in calls.read_text()


def test_a_user_without_rights_to_stop_the_service_is_refused(programs):
    programs(systemctl="exit 0", sudo="echo a password is required >&2; exit 1")
    with refused("hardware.used-by-service", UsageError, error="a password is required"):
        exclusive_hardware.stopped_service(print).__enter__()


@pytest.mark.parametrize(
    ("code", "kind", "reason"),
    [
        (255, RobotUnreachable, "ssh.not-reached"),
        (127, RobotUnreachable, "ssh.no-baqueano"),
        (5, SafetyStop, "ssh.ended"),
        (2, UsageError, "ssh.ended"),
        (1, BaqueanoError, "ssh.ended"),
        (3, FileError, "ssh.ended"),
        (4, RobotUnreachable, "ssh.ended"),
        (137, RobotUnreachable, "ssh.ended"),
    ],
)
def test_an_error_at_a_host_raises_the_same_error_type_locally(programs, code, kind, reason):
    programs(ssh=f"exit {code}")
    with refused(reason, kind, host="r1"):
        exclusive_hardware.fetch_rows("r1", "robot", "doctor")


def test_an_interruption_at_a_host_interrupts_the_local_command(programs):
    programs(ssh="exit 130")
    with pytest.raises(KeyboardInterrupt):
        exclusive_hardware.fetch_rows("r1", "robot", "doctor")


@pytest.mark.parametrize(
    ("host", "match"),
    [("emulated", ("ssh.no-hardware", {"host": "emulated"})), ("/dev/ttyUSB0", ("ssh.not-a-host", {}))],
)
def test_an_invalid_host_is_refused_before_ssh_starts(host, match):
    with refused(match[0], UsageError, **match[1]) as error:
        exclusive_hardware.fetch_rows(host, "robot", "doctor")
    assert error.value.diagnostic.fix == (
        "baqueano experiment --robot emulated" if host == "emulated" else ""
    )


def test_a_port_is_passed_to_ssh_as_an_option(programs):
    calls = programs(ssh='echo \'{"rows": [], "verdict": ""}\'')
    assert exclusive_hardware.fetch_rows("me@r1:2222", "robot", "doctor") == []
    assert "-p 2222 -- me@r1 baqueano robot doctor --json" in calls.read_text()


def test_heartbeats_are_sent_to_the_host_and_its_result_is_returned(programs, monkeypatch):
    monkeypatch.setattr(remote_session, "HEARTBEAT_PERIOD_S", 0.01)
    programs(ssh='read sign; read sign; echo \'{"rows": [{"a": 1}], "verdict": ""}\'')
    assert exclusive_hardware.fetch_rows("r1", "robot", "doctor") == [{"a": 1}]


DOCTOR = (
    "import sys; from baqueano.door import remote_session; remote_session.ENDING_S = float(sys.argv.pop(1))\n"
    + ("from baqueano.cli import main; main(['robot', 'doctor', 'r1'])")
)


@pytest.mark.parametrize(
    ("ending_s", "ssh", "message"),
    [(60, "cat >/dev/null; echo last words >&2", "last words"), (0.1, "exec sleep 1000", "")],
)
def test_ctrl_c_ends_the_remote_program_and_waits_for_its_output(programs, ending_s, ssh, message):
    calls = programs(ssh=f"read sign; echo $$ >>$0.pid; {ssh}")
    pid = Path(calls.parent / "ssh.pid")
    with subprocess.Popen(
        [sys.executable, "-c", DOCTOR, str(ending_s)],
        stderr=subprocess.PIPE,
        start_new_session=True,
        text=True,
    ) as process:
        end = time.monotonic() + 60.0
        while not (pid.exists() and pid.read_text()):
            assert time.monotonic() < end
            time.sleep(0.02)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal sends it, to ssh too
        _, output = process.communicate(timeout=60.0)
    assert process.returncode == 130
    assert message in output
    with pytest.raises(ProcessLookupError):
        os.kill(int(pid.read_text()), 0)


def at_host(programs, rows):
    answer = json.dumps({"rows": rows, "verdict": ""}, default=lambda x: x.tolist())
    return programs(ssh=f"echo '{answer}'")


def exit_code(arguments):
    with pytest.raises(SystemExit) as exit_info:
        main(arguments)
    return exit_info.value.code


def test_an_imu_calibration_at_a_host_updates_the_local_file(programs, tmp_path, monkeypatch, capsys):
    calls = at_host(programs, IMU_FIT.rows())
    monkeypatch.chdir(tmp_path)
    vehicle_file.load("small").save("vehicle.toml")
    assert exit_code(["robot", "calibrate", "imu", "r1", "--update"]) == 0
    assert "calibrate imu --update --vehicle /var/lib/baqueano/vehicle.toml --json" in calls.read_text()
    file = vehicle_file.load("vehicle.toml")
    assert file.robot.imu_axes == ("-y", "x", "z")
    assert 'run = "calibrate imu"' in file.text
    assert "-y, x, z" in capsys.readouterr().out


def test_a_motor_test_at_a_host_is_reported_locally(programs, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    motors = MotorCalibration(
        Settings(1, curves=(WheelCurve(300, 700, 0),) * 4),
        (Sweep(0.4, 0.3, 9.0, 0.0),) * 4,
        (0.1, 0.0),
        (0.01, 0.0),
        (1.0, 0.0),
        (0.2, 0.0),
    )
    at_host(programs, motors.rows())
    assert exit_code(["robot", "calibrate", "motors", "r1"]) == 0
    assert capsys.readouterr().out.strip() == motors.table()


@pytest.mark.parametrize(("verdict", "code"), [("warn", 0), ("bad", 1)])
def test_the_doctor_at_a_host_exits_with_its_verdict(programs, verdict, code, capsys):
    calls = at_host(programs, [{"name": "clock", "verdict": verdict, "figure": "1970", "remedy": "wait"}])
    assert exit_code(["robot", "doctor", "r1", "--jitter"]) == code
    assert "--runs /var/lib/baqueano/runs --jitter=10 --vehicle" in calls.read_text()
    assert "→ wait" in capsys.readouterr().out


def test_flashing_at_a_host_prints_the_firmware_of_the_host(programs, capsys):
    at_host(programs, [{"port": "/dev/ttyACM0", "bytes": 5916, "version": "1.0.0", "boots": 7}])
    assert exit_code(["robot", "flash", "r1"]) == 0
    assert "5916 bytes written and read back; firmware 1.0.0" in capsys.readouterr().out


@pytest.mark.parametrize(
    "verb", [["doctor"], ["flash"], ["settings"], ["calibrate", "imu"], ["calibrate", "motors"]]
)
@pytest.mark.parametrize("rows", [[{"of another version": 1}], [{}]])
def test_an_answer_of_another_version_is_reported_with_a_remedy(programs, verb, rows, capsys):
    at_host(programs, rows)
    assert exit_code(["robot", *verb, "me@r1", "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["code"] == "ssh.other-version"


def test_a_local_hex_file_is_refused_for_a_host(capsys):
    assert exit_code(["robot", "flash", "r1", "--hex", "mine.hex"]) == 2
    assert "--hex names a file of this computer" in capsys.readouterr().err
