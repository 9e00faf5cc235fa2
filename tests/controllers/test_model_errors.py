"""A vehicle that differs from the model of its controller, or that a limit holds back: no steady error, no wind-up."""

import numpy as np
import pytest

from baqueano.geometry import compose
from baqueano.guides.shapes import circle
from baqueano.symbolic import function
from baqueano.vehicle_file import load
from tests.controllers.test_model_following import LAWS, SMALL, drives, estimate, reference

WRONG_TURNING = [
    ("small", {"model.drivetrain.dead_zone_forward": [0.336, 0.27]}, 0.5, 0.2),
    ("small", {"model.drivetrain.gain": [0.988, 0.96]}, 0.5, 0.3),
    ("car", {"model.steering_offset_rad": 0.023}, 1.5, 0.5),
]


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("name", "changes", "radius_m", "speed"), WRONG_TURNING)
def test_no_law_remains_beside_its_circle_if_its_model_is_wrong(law, name, changes, radius_m, speed):
    """A wheel differs by 5 %, or the servo by 0.02 rad. Before, the laws drove 2 to 10 mm beside the circle."""
    file, route = load(name), circle(radius_m, speed)
    (_, eta, _), *_ = drives(file, route, law, 9.5, [((0.0, 0.0, 0.0), speed)], file.with_values(changes))
    centre = compose(route.eta[0], np.array([0.0, radius_m, 0.0]))[:2]
    cross_track_m = np.hypot(*(eta[-round(3.0 * file.rate_hz) :, :2] - centre).T) - radius_m
    assert np.abs(cross_track_m).mean() < 0.0015


def test_a_wheel_at_its_limit_does_not_wind_up_the_integral_of_the_turn():
    """The reference turns at 12 rad/s, and the wheels allow 9 rad/s. Before, ω_i grew to 1.6 rad/s."""
    controller, motion = SMALL.controller(), SMALL.vehicle.init()
    state = controller.init()
    steer = function(controller.step, state, reference(np.zeros(3)), estimate(np.zeros(3)))
    move = function(SMALL.vehicle.step, motion, np.zeros(3), 0.01, np.zeros(3))
    for k in range(200):
        target = reference([0.0, 0.0, 0.12 * k], [0.2, 0.0, 12.0], k)
        state, command = steer(state, target, estimate(motion.eta, motion.nu, k))
        motion, _ = move(motion, command.u, 0.01, np.zeros(3))
    assert np.abs(state.integral[1]) < 0.1
