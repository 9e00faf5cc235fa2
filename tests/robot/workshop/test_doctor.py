"""The checks of `baqueano robot doctor` on the files of a machine in a folder, and their text."""

import os
import time

import pytest

from baqueano.diagnostics import fault
from baqueano.messages import text
from baqueano.robot.workshop import doctor, uno_checks
from baqueano.robot.workshop.checks import Check, Report


def single(checks):
    (check,) = checks
    return check


def put_file(root, path, text):
    (root / path).parent.mkdir(parents=True, exist_ok=True)
    (root / path).write_text(text)


@pytest.mark.parametrize(
    ("bits", "verdict", "figure"),
    [
        ("0x0", "ok", "never under 4.63 V"),
        ("50000", "warn", "was under 4.63 V, was throttled"),
        ("0x50005", "bad", "under 4.63 V now, throttled now, was under 4.63 V, was throttled"),
    ],
)
def test_the_supply_state_of_a_pi_is_decoded(tmp_path, bits, verdict, figure):
    put_file(tmp_path, doctor.THROTTLED_FILE, bits + "\n")
    assert single(doctor.check_power(tmp_path))[1:3] == (verdict, figure)


@pytest.mark.parametrize("look", [doctor.check_power, doctor.check_temperature, doctor.check_governor])
def test_unavailable_readings_are_unknown_and_do_not_change_the_verdict(tmp_path, look):
    check = single(look(tmp_path))
    assert check.verdict == "unknown"
    assert "this machine" in check.figure
    assert Report([check]).verdict == "ok"


def test_high_temperature_and_a_variable_cpu_clock_give_warnings(tmp_path):
    put_file(tmp_path, "sys/class/thermal/thermal_zone0/temp", "81000\n")
    put_file(tmp_path, "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "ondemand\n")
    assert single(doctor.check_temperature(tmp_path))[1:3] == ("warn", "81 °C")
    assert single(doctor.check_governor(tmp_path))[1:3] == ("warn", "ondemand")


def test_a_user_outside_a_group_gets_the_command_to_join(tmp_path, monkeypatch):
    put_file(tmp_path, "etc/group", "root:x:0:\n\ndialout:x:20:\ni2c:x:998:\n+:::\n")
    monkeypatch.setattr(os, "getgroups", lambda: [20])
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    serial, i2c, gpio = doctor.check_groups(tmp_path)
    assert serial.verdict == "ok"
    assert i2c.verdict == "bad"
    assert "sudo usermod -aG i2c $USER" in i2c.remedy
    assert gpio == Check("group gpio", "unknown", "this group does not exist on this machine")


@pytest.mark.parametrize(("least_mb", "verdict"), [(1e-6, "ok"), (1e12, "bad")])
def test_free_disk_space_is_checked_in_the_folder_of_runs(tmp_path, least_mb, verdict):
    check = single(doctor.check_disk(tmp_path / "not" / "yet", least_mb))
    assert check.verdict == verdict
    assert str(tmp_path) in check.figure


def test_a_date_earlier_than_the_program_is_refused():
    assert single(doctor.check_clock(lambda: 0.0)).verdict == "warn"
    assert single(doctor.check_clock(time.time)).verdict == "ok"


def test_the_battery_check_compares_the_voltage_with_its_limit():
    assert [uno_checks.check_battery(v, 6.6).verdict for v in (6.0, 6.7, 7.4)] == ["bad", "warn", "ok"]
    assert uno_checks.check_battery(6.0, 0.0).verdict == "unknown"


def test_real_time_and_jitter_checks_restore_the_priority():
    before = os.sched_getscheduler(0)
    assert "SCHED_FIFO" in single(doctor.check_realtime()).figure
    texts = []
    check = single(doctor.check_jitter(0.2, texts.append))
    assert "of 20 ticks" in check.figure
    assert "p99" in check.figure
    assert texts == ["measures the wake-up error of a 100 Hz loop for 0.2 s"]
    assert os.sched_getscheduler(0) == before


def test_a_refused_priority_is_a_warning_that_names_systemd(monkeypatch):
    def refuse(*arguments):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    check = single(doctor.check_realtime())
    assert check.verdict == "warn"
    assert "systemd" in check.remedy


def test_the_report_prints_a_remedy_below_each_failed_check():
    report = Report(
        [
            Check("a", "ok", "1", "unused"),
            Check("b", "warn", "2", "do this"),
            Check("c", "bad", "3", "do that"),
        ]
    )
    assert report.verdict == "bad"
    lines = report.table().splitlines()
    assert [line.strip() for line in lines] == [
        "ok    a  1", "warn  b  2", "→ do this", "bad   c  3", "→ do that", "overall result: bad",
    ]  # fmt: skip
    assert [row["verdict"] for row in report.rows()] == ["ok", "warn", "bad"]


def test_missing_hardware_fails_a_check_without_an_exception(tmp_path, monkeypatch):
    from baqueano import vehicle_file
    from baqueano.robot.uno import serial_port

    monkeypatch.setattr(serial_port, "BY_ID", str(tmp_path / "*"))
    monkeypatch.setattr(serial_port, "OTHER_PORTS", ())
    hardware = vehicle_file.load("small").robot
    report = doctor.examine(hardware, tmp_path, tmp_path)
    checks = {check.name: check for check in report.checks}
    assert checks["serial line"].remedy == text(fault("uno.no-line"))
    assert {"IMU", "group i2c", "supply", "disk", "clock", "real time"} <= set(checks)
