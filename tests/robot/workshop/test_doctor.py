"""What `baqueano robot doctor` says of a machine, from its files in a folder, and how it puts it."""

import os
import time

import pytest

from baqueano.robot.workshop import doctor, uno_checks
from baqueano.robot.workshop.checks import Check, Report


def only(checks):
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
def test_the_supply_of_a_pi_is_reported_from_its_bits(tmp_path, bits, verdict, figure):
    put_file(tmp_path, doctor.THROTTLED, bits + "\n")
    assert only(doctor.power(tmp_path))[1:3] == (verdict, figure)


@pytest.mark.parametrize("look", [doctor.power, doctor.temperature, doctor.governor])
def test_what_this_machine_does_not_tell_is_unknown_and_not_held_against_it(tmp_path, look):
    check = only(look(tmp_path))
    assert check.verdict == "unknown"
    assert "this machine" in check.figure
    assert Report([check]).verdict == "ok"


def test_heat_and_a_clock_that_steps_are_warned_of(tmp_path):
    put_file(tmp_path, "sys/class/thermal/thermal_zone0/temp", "81000\n")
    put_file(tmp_path, "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "ondemand\n")
    assert only(doctor.temperature(tmp_path))[1:3] == ("warn", "81 °C")
    assert only(doctor.governor(tmp_path))[1:3] == ("warn", "ondemand")


def test_a_user_outside_a_group_is_reported_how_to_join_it(tmp_path, monkeypatch):
    put_file(tmp_path, "etc/group", "root:x:0:\ndialout:x:20:\ni2c:x:998:\n")
    monkeypatch.setattr(os, "getgroups", lambda: [20])
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    serial, i2c, gpio = doctor.groups(tmp_path)
    assert serial.verdict == "ok"
    assert i2c.verdict == "bad"
    assert "sudo usermod -aG i2c $USER" in i2c.remedy
    assert gpio == Check("group gpio", "unknown", "there is no such group on this machine")


@pytest.mark.parametrize(("least_mb", "verdict"), [(1e-6, "ok"), (1e12, "bad")])
def test_room_for_runs_is_looked_at_where_they_will_be(tmp_path, least_mb, verdict):
    check = only(doctor.disk(tmp_path / "not" / "yet", least_mb))
    assert check.verdict == verdict
    assert str(tmp_path) in check.figure


def test_a_date_before_this_program_is_not_believed():
    assert only(doctor.clock(lambda: 0.0)).verdict == "warn"
    assert only(doctor.clock(time.time)).verdict == "ok"


def test_a_battery_is_judged_by_its_limit():
    assert [uno_checks.battery(v, 6.6).verdict for v in (6.0, 6.7, 7.4)] == ["bad", "warn", "ok"]
    assert uno_checks.battery(6.0, 0.0).verdict == "unknown"


def test_real_time_and_jitter_tell_a_figure_and_leave_the_priority_as_it_was():
    before = os.sched_getscheduler(0)
    assert "SCHED_FIFO" in only(doctor.realtime()).figure
    texts = []
    check = only(doctor.jitter(0.2, texts.append))
    assert "of 20 ticks" in check.figure
    assert "p99" in check.figure
    assert texts == ["measures the wake-up error of a 100 Hz loop for 0.2 s"]
    assert os.sched_getscheduler(0) == before


def test_a_refused_priority_is_a_warning_that_names_who_has_it(monkeypatch):
    def refuse(*arguments):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    check = only(doctor.realtime())
    assert check.verdict == "warn"
    assert "systemd" in check.remedy


def test_the_report_tells_what_to_do_below_what_is_not_well():
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
        "ok       a  1", "warn     b  2", "→ do this", "bad      c  3", "→ do that", "all in all: bad",
    ]  # fmt: skip
    assert [row["verdict"] for row in report.rows()] == ["ok", "warn", "bad"]


def test_hardware_that_is_not_there_is_bad_and_not_the_end(tmp_path, monkeypatch):
    from baqueano import vehicle_file
    from baqueano.robot.uno import serial_port

    monkeypatch.setattr(serial_port, "BY_ID", str(tmp_path / "*"))
    monkeypatch.setattr(serial_port, "OTHERS", ())
    hardware = vehicle_file.load("small").robot
    report = doctor.examine(hardware, tmp_path, tmp_path)
    checks = {check.name: check for check in report.checks}
    assert "is its USB cable plugged in" in checks["serial line"].remedy.lower().replace(
        "is its usb", "is its USB"
    )
    assert {"IMU", "group i2c", "supply", "disk", "clock", "real time"} <= set(checks)
