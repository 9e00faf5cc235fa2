"""What the link and the world of the loop make of the real firmware, in lock-step with it."""

import pytest

from baqueano import vehicle_file
from tests.emulated.robot import EmulatedRobot


@pytest.fixture
def robot(firmware, monkeypatch):
    robot = EmulatedRobot(firmware, vehicle_file.load("small"), patches=monkeypatch)
    robot.wait(0.1)
    yield robot
    robot.close()


def hold(robot, left, right, seconds, step_s=0.01):
    """Commands for so long, as a loop computes them."""
    for _ in range(round(seconds / step_s)):
        robot.uno.drive(left, right)
        robot.wait(step_s)


@pytest.mark.parametrize("lost", [100, 127, 200, 255])
def test_commands_are_lost_on_the_line_and_the_next_one_moves_the_motors(robot, lost):
    """The firmware takes a number for old that is 128 to 255 ahead; telemetry tells where to go on."""
    robot.uno.arm()
    hold(robot, 0.4, 0.4, 0.2)
    robot.write = lambda data: None
    hold(robot, 0.4, 0.4, 0.01 * lost)
    assert not robot.board.moving
    del robot.write
    robot.uno.drive(0.4, 0.4)
    robot.wait(0.02)
    assert robot.board.moving
    hold(robot, 0.4, 0.4, 0.5)
    assert robot.board.moving
    assert robot.board.info().old_sequence == 0
