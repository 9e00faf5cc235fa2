"""Gains that change while the vehicle drives: only its driver sets them, between two ticks, and the run logs an
event.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from baqueano.door.mission.gain_changes import SOURCE, AdjustableController, ChangeObserver
from baqueano.door.operator import Operator
from baqueano.drive import repeat
from baqueano.drive.budget import BudgetedBlock
from baqueano.drive.observers import Observer
from baqueano.errors import Invalid, SafetyStop
from baqueano.guides import shapes
from baqueano.vehicle_file import load
from tests.codes import refused


class Hand(Observer):
    """Set a gain at a given tick, as the driver does from outside."""

    def __init__(self, operator, tick, *changes):
        self.operator, self.at, self.changes, self.ticks = operator, tick, changes, 0

    def on_record(self, record):
        self.ticks += 1
        if self.ticks == self.at:
            for path, value in self.changes:
                self.operator.set_gain("me", path, value)


def drive_with(*changes, tick=100):
    file, operator, messages = load("small"), Operator(), []
    operator.queue_mission("me", "a mission")
    observers = (ChangeObserver(operator, messages.append), Hand(operator, tick, *changes))
    options = {"observers": observers, "duration_s": 12.0, "rest_s": 0.0}
    return file, repeat(file, shapes.circle(0.4, 0.3), **options), messages


def test_a_new_gain_applies_from_the_next_tick_and_is_logged():
    file, run, messages = drive_with(("controller.k_x", 0.0))
    _, repetition, _ = drive_with()
    before = load("small").controller().k_x
    first = int(np.flatnonzero(np.any(run.requested_commands != repetition.requested_commands, axis=1))[0])
    assert first in (101, 102)  # set after tick 100, seen by tick 101, in force for the next
    (event,) = [event for event in run.events if event.source == SOURCE]
    assert event.t_ns == run.t_ns[100]
    assert event.diagnostic.code == "door.set"
    assert event.diagnostic.figures == {
        "path": "controller.k_x", "former_value": str(float(before)), "value": "0.0"
    }  # fmt: skip
    assert messages[0]["message"] == event.diagnostic
    assert file.controller().k_x == before


@pytest.mark.parametrize(
    ("path", "value", "code"),
    [
        ("supervisor.max_speed_m_s", 100.0, "door.not-settable"),
        ("controller.nothing", 1.0, "door.not-settable"),
        ("controller", 1.0, "door.not-settable"),
        ("controller.k_x", "much", "door.not-a-number"),
        ("controller.k_x", float("nan"), "door.not-a-number"),
        ("controller.k_x", [1.0, 2.0], "door.not-a-number"),
        ("controller.k_x", None, "door.not-a-number"),
        ("controller.k_x", 10**400, "door.not-a-number"),
    ],
)
def test_a_forbidden_gain_change_is_reported_and_ignored(path, value, code):
    block = load("small").controller()
    adjustable = AdjustableController(block)
    with refused(code):
        adjustable.change(path, value)
    assert adjustable.block is block


@dataclass(frozen=True, slots=True, eq=False)
class Strict:
    """A user's controller that checks its own parameters."""

    steps: int = 3
    gain: float = 1.0

    def __post_init__(self):
        if self.gain > 2.0:
            raise KeyError("gain")
        while self.gain < 0.0:
            pass

    def init(self):
        return ()

    def step(self, state, reference, estimate):
        return state, np.zeros(3)


@pytest.mark.parametrize(
    ("value", "error"), [(3.0, "KeyError"), (-1.0, "TimeoutError")], ids=["raises", "hangs"]
)
def test_a_controller_that_fails_with_a_new_gain_keeps_its_old_gains(value, error):
    adjustable = AdjustableController(BudgetedBlock(Strict()))
    with refused("door.gain-refused", Invalid, name="controller.gain", former_value="1.0") as error_info:
        adjustable.change("controller.gain", value)
    assert error_info.value.diagnostic.figures["error"].startswith(error)
    assert adjustable.block.block.gain == 1.0


def test_an_integer_parameter_stays_an_integer():
    adjustable = AdjustableController(Strict())
    adjustable.change("controller.steps", 5.0)
    assert (adjustable.block.steps, type(adjustable.block.steps)) == (5, int)
    for value in (5.5, 1e30):
        with refused("door.not-an-integer", Invalid, name="controller.steps"):
            adjustable.change("controller.steps", value)


def test_a_failing_controller_does_not_end_the_drive(monkeypatch):
    def fail(*args, **options):
        raise ZeroDivisionError

    monkeypatch.setattr("baqueano.door.mission.gain_changes.replace", fail)
    _, run, messages = drive_with(("controller.k_x", 1.0))
    _, repetition, _ = drive_with()
    np.testing.assert_array_equal(run.requested_commands, repetition.requested_commands)
    assert [(message["level"], message["message"].code) for message in messages] == [
        ("warning", "door.gain-refused")
    ]


def test_a_refused_change_does_not_end_the_drive():
    _, run, messages = drive_with(("supervisor.imu_timeout_s", 99.0), ("controller.k_x", "x"))
    _, repetition, _ = drive_with()
    np.testing.assert_array_equal(run.requested_commands, repetition.requested_commands)
    assert [message["level"] for message in messages] == ["warning", "warning"]


def test_only_the_client_that_drives_can_set_gains():
    operator = Operator()
    for person in ("me", "another"):
        with pytest.raises(SafetyStop):
            operator.set_gain(person, "controller.k_x", 1.0)
    operator.queue_mission("me", "a mission")
    with pytest.raises(SafetyStop):
        operator.set_gain("another", "controller.k_x", 1.0)
    operator.set_gain("me", "controller.k_x", 1.0)
    assert operator.pop_changes() == [("controller.k_x", 1.0)]
    assert operator.pop_changes() == []


def test_a_pace_of_zero_pauses_the_guide_and_is_logged():
    _, run, messages = drive_with(("guide.pace", 0.0), tick=100)
    v = run.reference.nu[:, 0]
    assert v[100] == pytest.approx(0.3)
    assert np.all(v[101 + 70 :] == 0.0)  # it brakes in 0.6 s and waits until the drive is ended
    assert np.max(np.abs(np.diff(v))) < 0.3 / 0.6 * 0.011
    assert [message["message"].code for message in messages] == ["door.set"]


@pytest.mark.parametrize("value", [1.5, -0.1, float("nan"), "slow", None])
def test_a_wrong_pace_is_refused_and_the_drive_continues(value):
    _, run, messages = drive_with(("guide.pace", value))
    assert [message["message"].code for message in messages] == ["door.guide-pace"]
    assert run.reference.at_end[-1] == 1.0
