"""Faults on the command line: the same fault for every student, and who noticed it."""

import pytest

from baqueano.runs import read_run
from baqueano.worlds.faults.fault import faults_in


def test_a_fault_is_typed_with_a_verb_logged_and_judged(baqueano):
    line = ("experiment", "--vehicle", "small", "--seconds", "4", "-o", "run.mcap",
            "--shake", "2 s: push 0.3 N s left", "--shake", "3 s: sag 84 %")  # fmt: skip
    done = baqueano(*line)
    assert done.code == 0
    assert "NIS noticed it" in done.err
    run = read_run("run.mcap")
    faults = faults_in((e.t_ns, e.source, e.diagnostic) for e in run.events)
    assert [(fault.kind, fault.at_s) for fault in faults] == [("push", 2.0), ("sag", 3.0)]


@pytest.mark.parametrize(
    ("more", "code"),
    [
        (("--shake", "dance"), "shake.words"),
        (("--robot", "pi@robot.local", "--shake", "2 s: cut imu"), "shake.robot"),
        (("--robot", "emulated", "--shake", "2 s: cut imu"), "shake.robot"),
    ],
)
def test_what_cannot_happen_is_refused_before_anything_moves(baqueano, more, code):
    done = baqueano("experiment", "--vehicle", "small", *more)
    assert done.code == 2
    assert done.reason.code == code
