"""The gains of each law suit the speed at which a vehicle catches up with its reference."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.controllers.following.tracking import Tracking
from baqueano.vehicle_file import load

LAWS = ["pd_feedforward", "kanayama", "lqr", "pure_pursuit", "stanley"]


@pytest.mark.parametrize("law", LAWS)
def test_a_law_chooses_its_gains_for_the_speed_at_which_the_vehicle_catches_up(law):
    """A car at 1 m/s, 10 cm beside its path and 0.3 m behind, requests 1.3 m/s. Two laws turned as at 1 m/s."""
    controller = load("car").controller(law)
    (v, turn), (fast_v, fast_turn) = (car_request(controller, behind_m) for behind_m in (0.0, 0.3))
    assert fast_v > 1.25 > 1.05 > v
    assert 0.7 * turn < fast_turn < 0.85 * turn


@pytest.mark.parametrize("law", [law for law in LAWS if law != "lqr"])
def test_a_law_does_not_choose_its_gains_for_a_speed_that_no_vehicle_is_allowed(law):
    """With k_x = 10 1/s a law requests 4 m/s, but the base limits this to 1.3 m/s. Before, the gains were for 4 m/s."""
    controller = load("car").controller(law)
    _, turn = car_request(controller, 0.3)
    _, turn_of_high_gain = car_request(replace(controller, k_x=10.0), 0.3)
    assert turn_of_high_gain == pytest.approx(turn)


def car_request(controller, behind_m):
    """Return the velocity (v, ω) that a law requests 10 cm beside a straight path at 1 m/s, after 4 s."""
    e, memory = np.array([behind_m, 0.1, 0.0]), controller.memory()
    now = Tracking(e, 0.0, np.array([1.0, 0.0, 0.0]), 0.0, 1.0, 0.02)
    for _ in range(200):
        memory, request = controller.velocity_law(memory, now)
    return request
