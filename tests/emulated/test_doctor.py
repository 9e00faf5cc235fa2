"""`baqueano robot doctor` checks the real firmware over the real serial driver, and an IMU through its driver."""

import re
from copy import copy

import pytest

from baqueano import vehicle_file
from baqueano.robot.uno.frames import AskInfo, Info, ResetCause, Settings, WheelCurve
from baqueano.robot.uno.statistics import Statistics
from baqueano.robot.workshop import doctor, uno_checks
from tests.emulated.bad_line import BadLine
from tests.emulated.hand import OnBus
from tests.emulated.realtime import on_pty


@pytest.fixture
def robot(new_robot):
    return new_robot(wait_s=2.0)


@pytest.fixture
def on_bus(tmp_path, monkeypatch):
    return OnBus(tmp_path, monkeypatch)


def by_name(checks):
    return {check.name: check for check in checks}


def counts_of(check):
    """Return the numbers of frames to the Uno: sent, damaged, not executed, bytes lost, damaged earlier."""
    return [int(n) for n in re.findall(r"(?<![\d.])\d+(?![\d.])", check.figure)]


def test_the_doctor_reports_the_figures_of_an_uno(firmware):
    with on_pty(firmware) as live:
        for _ in range(5):  # a stalled machine also loses frames
            checks = by_name(uno_checks.check_uno(live.path, 6.6, seconds=0.5))
            if checks["frames"].verdict == checks["frames to the Uno"].verdict == "ok":
                break
    assert checks["serial line"].figure == live.path
    assert checks["firmware"].verdict == "ok"
    assert "ms, at most" in checks["link round trip"].figure
    assert " received, 0 lost, 0 damaged" in checks["frames"].figure
    count_sent, *rest = counts_of(checks["frames to the Uno"])
    assert count_sent >= 50, "half a second of commands"
    assert rest == [0, 0, 0, 0]
    assert checks["Uno's start"].verdict == "ok"
    assert checks["battery"].figure.startswith(("7.3", "7.4"))
    assert checks["motors"].figure == "not calibrated"
    assert checks["Uno's memory"].verdict == "ok"
    assert int(checks["Uno's memory"].figure.split()[0]) > 1000


def test_an_uno_with_little_free_memory_is_reported(robot):
    check = uno_checks.check_memory(robot.board.info()._replace(least_free_ram=40))
    assert (check.verdict, check.figure) == ("warn", "40 of 2048 bytes were never used")
    assert "robot flash" in check.remedy


def test_a_second_check_without_an_uno_reset_counts_no_bad_frames(firmware):
    """The last sequence number of the Uno differs from the 0 with which the host begins."""
    with on_pty(firmware) as live:
        for _ in range(5):
            list(uno_checks.check_uno(live.path, 0.0, seconds=0.6))
            checks = by_name(uno_checks.check_uno(live.path, 0.0, seconds=0.6))
            if checks["frames"].verdict == "ok":
                break
    assert counts_of(checks["frames to the Uno"])[1:] == [0, 0, 0, 0]


def test_a_sound_robot_passes_all_checks(robot):
    robot.uno.store_settings(Settings(curves=(WheelCurve(300, 700, 0),) * 4), robot.wait)
    checks = by_name(uno_checks.check_answers(robot.uno, 6.6, Statistics(), robot.wait))
    assert {check.verdict for check in checks.values()} == {"ok"}, checks


def test_a_weak_battery_and_an_old_firmware_are_reported(robot):
    robot.board.set_battery(6.0)
    robot.wait(1.0)
    robot.uno.info = robot.uno.info._replace(version_major=0)
    checks = by_name(uno_checks.check_answers(robot.uno, 6.6, Statistics(), robot.wait))
    assert checks["battery"][1:] == ("bad", checks["battery"].figure, "Charge it")
    assert checks["firmware"].verdict == "warn"
    assert "flash" in checks["firmware"].remedy


def test_a_line_that_loses_frames_is_reported(robot):
    read_line = robot.read
    counts = []

    def lossy():
        data = read_line()
        counts.append(data)
        return b"" if data and len(counts) % 10 == 0 else data

    robot.read = lossy
    robot.wait(2.0)
    checks = by_name(uno_checks.check_answers(robot.uno, 0.0, Statistics(), robot.wait))
    assert checks["frames"].verdict in ("warn", "bad")
    assert "100 nF" in checks["frames"].remedy


def looked_at(robot, seconds=2.0):
    """Return the checks of the doctor on the Uno after this many seconds of commands."""
    before = copy(robot.uno.statistics)
    uno_checks.send_commands(robot.uno, seconds, robot.wait)
    return by_name(uno_checks.check_answers(robot.uno, 0.0, before, robot.wait))


def test_frames_damaged_on_the_way_to_the_uno_are_reported(robot):
    line, bad_before = BadLine(robot, seed=1), robot.board.info().bad_crc
    line.noise = 0.001
    check = looked_at(robot, 8.0)["frames to the Uno"]
    count_sent, count_damaged, *rest = counts_of(check)
    assert count_sent >= 800
    assert count_damaged / count_sent == pytest.approx(0.016, abs=0.008)  # 1 - 0.999¹⁶
    assert 0 <= robot.board.info().bad_crc - bad_before - count_damaged <= 1, (
        "telemetry may not contain the last command yet"
    )
    assert rest == [0, 0, 0]
    assert f"({100 * count_damaged / count_sent:.1f} %)" in check.figure
    assert check.verdict == "warn"
    assert "100 nF" in check.remedy
    robot.uno.request(AskInfo(), Info, robot.wait)
    assert counts_of(looked_at(robot, 0.1)["frames to the Uno"])[-1] >= count_damaged, (
        "these counts now belong to an earlier check"
    )


def test_the_count_of_damaged_frames_may_exceed_255(robot):
    write_line = robot.write
    robot.write = lambda data: write_line(data[:5] + bytes([data[5] ^ 1]) + data[6:])
    uno_checks.send_commands(robot.uno, 4.0, robot.wait)
    robot.write = write_line
    robot.wait(0.1)
    assert robot.uno.statistics.rejected_frames == robot.board.info().bad_crc > 400


def test_intact_commands_that_are_not_executed_give_a_warning(robot):
    write, robot.write = robot.write, lambda data: (write(data), write(data))
    check = looked_at(robot, 0.5)["frames to the Uno"]
    assert counts_of(check)[1:] == [0, 49, 0, 0], "each came twice; the last is in no telemetry yet"
    assert check.verdict == "warn"
    assert "another program" in check.remedy


@pytest.mark.parametrize(
    ("accident", "verdict", "figure", "remedy"),
    [
        (lambda board: board.power_cycle(), "ok", "number 1, by power", ""),
        (lambda board: board.reset(ResetCause.BROWN_OUT), "warn", "number 1, by brown-out warm", "1000 µF"),
        (lambda board: board.hang(), "warn", "number 1, by watchdog hung warm", "robot flash"),
        (lambda board: board.reset(ResetCause(0)), "ok", "number 1, by warm", ""),
    ],
    ids=["power", "brown-out", "hang", "boot-loader"],
)  # fmt: skip
def test_the_cause_of_the_last_uno_start_is_reported_with_a_remedy(robot, accident, verdict, figure, remedy):
    accident(robot.board)
    robot.wait(1.0)
    check = looked_at(robot, 0.1)["Uno's start"]
    assert (check.verdict, check.figure) == (verdict, figure)
    assert remedy in check.remedy


def test_a_missing_identity_of_the_uno_fails_the_check(robot):
    robot.uno.info = None
    (check,) = uno_checks.check_answers(robot.uno, 0.0, Statistics(), robot.wait)
    assert check.verdict == "bad"


def test_the_reported_imu_figures_match_the_chip(on_bus):
    checks = by_name(doctor.imu_checks(on_bus.imu, on_bus.wait))
    assert "MPU-6050" in checks["IMU"].figure
    assert checks["IMU bus"][1:3] == ("ok", "14 bytes in 0.38 ms: 408 kHz or more")
    assert checks["IMU rate"].verdict == "ok"
    assert checks["IMU noise"].verdict == "ok"
    assert checks["IMU self-test"][1:3] == (
        "ok", "6 of 6 axes respond as in the factory, which did not store a code for 0"
    )  # fmt: skip
    assert "IMU scale" not in checks
    on_bus.chip.self_test_error = -0.3
    check = doctor.self_test_check(on_bus.imu, on_bus.wait)
    assert check.verdict == "warn"
    assert "0 of 6 axes" in check.figure
    assert "gyro z" in check.figure


def test_the_imu_rate_is_reported_within_its_stated_error(tmp_path, monkeypatch):
    on_bus = OnBus(tmp_path, monkeypatch, clock_ppm=8_000)
    check = by_name(doctor.imu_checks(on_bus.imu, on_bus.wait, 4.0))["IMU rate"]
    assert check.verdict == "ok"
    rate, error, _, offset, stamp_ms, count_failed, count_lost = map(
        float, re.findall(r"[-+]?\d+(?:\.\d+)?", check.figure)
    )
    assert abs(rate - 200 * 1.008) <= error + 0.01
    assert error < 0.5
    assert offset == 0.8
    assert 0.0 < stamp_ms < 1.0
    assert (count_failed, count_lost) == (0, 0)


def test_lost_imu_samples_are_detected_by_the_sample_clock(on_bus):
    due = [on_bus.now_ns + 2_000_000_000]

    def wait(seconds):
        on_bus.wait(seconds)
        if due and on_bus.now_ns > due[0] and len(on_bus.chip.fifo) == 4 * 14:
            due.clear()
            for _ in range(3 * 14):
                on_bus.chip.fifo.popleft()

    check = by_name(doctor.imu_checks(on_bus.imu, wait, 4.0))["IMU rate"]
    assert not due
    assert check.verdict == "warn"
    assert int(re.findall(r"\d+", check.figure)[-1]) >= 1


def test_a_moving_or_silent_imu_and_a_wrong_scale_are_reported(on_bus):
    on_bus.chip.motion = lambda t_ns: ((0.0, 0.0, 6.0 + t_ns % 7), (0.0, 0.0, 0.0))
    checks = by_name(doctor.imu_checks(on_bus.imu, on_bus.wait, 0.5))
    assert checks["IMU noise"].verdict == "warn"
    assert "moved during the self-test" in checks["IMU self-test"].figure
    on_bus.chip.motion = lambda t_ns: ((0.0, 0.0, 7.0), (0.0, 0.0, 0.0))
    on_bus.wait(0.2)
    assert by_name(doctor.imu_checks(on_bus.imu, on_bus.wait, 0.5))["IMU scale"].remedy == "Replace the IMU"
    on_bus.imu.read = lambda: []
    assert by_name(doctor.imu_checks(on_bus.imu, on_bus.wait, 0.1))["IMU rate"].figure == "no sample in 0.1 s"


def test_a_missing_imu_fails_the_check_only_on_a_raspberry_pi(tmp_path):
    hardware = vehicle_file.load("small").robot
    (laptop,) = doctor.check_imu(hardware, tmp_path)
    assert laptop[:3] == ("IMU", "unknown", "/dev/i2c-1 is missing on this machine: it is not a Raspberry Pi")
    (tmp_path / doctor.MODEL_FILE).parent.mkdir(parents=True)
    (tmp_path / doctor.MODEL_FILE).write_text("Raspberry Pi 3 Model B Plus")
    (pi,) = doctor.check_imu(hardware, tmp_path)
    assert pi.verdict == "bad"
    assert pi.remedy
