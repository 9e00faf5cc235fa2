"""Straight driving with heading control: the real firmware and drivers, a simulated body whose wheels differ by 15
%.
"""

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.drive.mission import Mission, perform
from tests.drive.straight import as_fitted, body, hand_for, measured
from tests.emulated.robot import make_world

WAY_M = 5.0


@pytest.mark.parametrize("yaw_gain", [1.0, 2.0, 0.5])
def test_heading_control_drives_five_metres_straight(firmware, yaw_gain):
    holding = drive(firmware, yaw_gain, hold=True)
    print(f"yaw gain {yaw_gain}: held {holding.text()}")
    assert abs(holding.psi_deg) < 3.0
    assert holding.most_deg < 7.0
    assert abs(holding.beside_m) < 0.2
    assert np.ptp(holding.run.applied_commands[len(holding.run.t_s) // 2 :, 2]) < 0.05, "no swinging"


def test_without_heading_control_the_vehicle_turns(firmware):
    free = drive(firmware, 1.0, hold=False)
    print(f"free {free.text()}")
    assert abs(free.psi_deg) > 30.0


def drive(firmware, yaw_gain, hold):
    file = as_fitted(vehicle_file.load("small"))
    world, tick_times_ns = make_world(firmware, file, body(file, yaw_gain))
    hand = hand_for(14.0, [0.9, 0.0, 0.0], file.rate_hz)
    try:
        return measured(
            perform(Mission("teach", hold=hold), file, hand, world=world, tick_times_ns=tick_times_ns), WAY_M
        )
    finally:
        world.robot.close()
