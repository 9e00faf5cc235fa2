"""A user block that ends the program ends only its mission: it is named, the motors are off, and the service
continues.
"""

import pytest

from baqueano import vehicle_file
from baqueano.door.states import DoorState
from baqueano.drive.mission import Mission, pack
from baqueano.guides import shapes
from baqueano.messages import text
from baqueano.robot.service import service as module
from tests.emulated.drives import drive, spin

BLOCK = """import os, sys
import numpy as np
from baqueano.signals import Command
class Odd(BaseException): pass
{top}

class Mine:
    def __init__(self):
        {made}

    def init(self):
        {begun}
        return 0

    def step(self, state, reference, estimate):
        if state > 20:
            {line}
        return state + 1, Command(estimate.t_ns, np.array([0.0, 0.0, 0.4]))
"""
PLACES = {"top": 5, "made": 9, "begun": 12, "line": 17}  # lines of BLOCK


def repetition(folder, place, text, file):
    """Return a repetition with the controller BLOCK that contains `text`."""
    lines = dict.fromkeys(PLACES, "pass") | {place: text}
    (folder / "mine.py").write_text(BLOCK.format(**lines), encoding="utf-8")
    blocks = {"controller": f"{folder / 'mine.py'}:Mine"}
    return pack(Mission("repeat", route=shapes.circle(0.4, 0.25), blocks=blocks), file)


@pytest.mark.parametrize(
    ("place", "end", "message"),
    [
        *((place, "raise KeyboardInterrupt", "KeyboardInterrupt") for place in PLACES),
        ("top", "sys.exit()", "SystemExit"), ("made", "raise Odd", "Odd"), ("begun", "sys.exit()", "SystemExit"),
        ("line", "sys.exit('bye')", "SystemExit"), ("line", "raise Odd", "Odd"),
        ("line", "raise GeneratorExit", "GeneratorExit"), ("line", "1 / 0", "ZeroDivisionError"),
    ],
)  # fmt: skip
def test_a_block_that_ends_the_program_ends_only_its_mission(service, robot, tmp_path, place, end, message):
    last, run = drive(service, repetition(tmp_path, place, end, vehicle_file.load("small")))
    words = text(last["reason"])
    assert message in words
    assert "bye" in words or "bye" not in end
    assert f"mine.py line {PLACES[place]}" in words or f"mine.py:{PLACES[place]})" in words
    assert place == "top" or "Mine" in words
    robot.wait(0.2)
    assert not robot.board.moving
    assert (run is not None) == (place == "line")
    assert not service.journal.path.exists()
    service.operator.is_clear_requested = True
    for _ in range(3):
        service.idle()
        robot.wait(0.05)
    assert service.machine.state is DoorState.READY
    assert drive(service, spin(0.2))[0]["reason"] is None


def test_an_unguarded_block_failure_names_its_file_and_line(service, tmp_path):
    (tmp_path / "mine.py").write_text(
        "import sys\nclass Mine:\n    @property\n    def laps(self):\n        sys.exit(2)\n\n    def init(self):\n"
        "        return 0\n\n    def step(self, state, estimate):\n        return state\n"
    )
    mission = Mission(
        "repeat", route=shapes.circle(0.4, 0.25), blocks={"guide": f"{tmp_path / 'mine.py'}:Mine"}
    )
    end, _ = drive(service, pack(mission, vehicle_file.load("small")))
    assert (end["reason"].code, end["code"]) == ("block.raised-outside", 1)
    assert end["reason"].figures == {"place": "mine.py line 5", "error": "SystemExit: 2"}


@pytest.mark.parametrize("place", ["top", "line"])
def test_a_hanging_block_ends_only_its_mission(service, robot, tmp_path, monkeypatch, place):
    monkeypatch.setattr(module, "PREPARE_S", 3.0)
    endless = "while True: pass"
    end, _ = drive(service, repetition(tmp_path, place, endless, vehicle_file.load("small")))
    words = text(end["reason"])
    assert "TimeoutError: " in words
    assert f"mine.py line {PLACES[place]}" in words or f"mine.py:{PLACES[place]})" in words
    robot.wait(0.4)
    assert not robot.board.moving
