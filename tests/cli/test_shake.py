"""Faults on the command line: every student gets the same fault, and the detections are listed."""

import pytest

from baqueano.runs import read_run
from tests.faults_of_run import find_faults


def test_a_fault_given_on_the_command_line_is_logged_and_detected(baqueano):
    line = ("experiment", "--vehicle", "small", "--seconds", "4", "-o", "run.mcap",
            "--shake", "2 s: push 0.3 N s left", "--shake", "3 s: sag 84 %", "--shake", "9 s: cut imu")  # fmt: skip
    result = baqueano(*line)
    assert result.code == 0
    assert "NIS detected it" in result.err
    assert "9 s: cut imu: the drive ended at 4.0 s, so this fault did not occur." in result.err
    run = read_run("run.mcap")
    faults = find_faults((e.t_ns, e.source, e.diagnostic) for e in run.events)
    assert [(fault.kind, fault.start_s) for fault in faults] == [("push", 2.0), ("sag", 3.0)]


@pytest.mark.parametrize(
    ("options", "code"),
    [
        (("--shake", "dance"), "shake.syntax"),
        (("--robot", "pi@robot.local", "--shake", "2 s: cut imu"), "shake.robot"),
        (("--robot", "emulated", "--shake", "2 s: cut imu"), "shake.robot"),
    ],
)
def test_an_impossible_fault_is_refused_before_the_drive(baqueano, options, code):
    result = baqueano("experiment", "--vehicle", "small", *options)
    assert result.code == 2
    assert result.reason.code == code
