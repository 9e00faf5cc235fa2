"""Cars of the second simulator, on tyres that slip, join and begin their route: physics of its own judges the laws."""

import numpy as np
import pytest

from baqueano.geometry import compose
from baqueano.guides import Repeat, RepeatByProgress
from baqueano.guides.shapes import circle
from baqueano.routes import fastest
from baqueano.signals import NANOSECONDS, Command, Estimate
from baqueano.study.counterpart.cars import car_file
from baqueano.study.counterpart.world import LoopWorld
from baqueano.study.truth import draw_cars
from baqueano.symbolic import compile_block

RADIUS_M, ROUTE = 3.0, circle(3.0, 0.5)
CAR = draw_cars(1, 70)
FILE = car_file(CAR)
LAWS = ("pd_feedforward", "kanayama", "lqr", "pure_pursuit", "stanley")


def true_motion(guide, law, start, duration_s):
    """Return the true distance (N,) [m] outside the circle and the speed (N,) [m/s], from rest at `start` (3,)."""
    world, controller = LoopWorld(CAR, 1, FILE.rate_hz), compile_block(FILE.controller(law))
    guide = compile_block(guide)
    guide_state, state, out = guide.init(), controller.init(), []
    x, y, psi = ROUTE.eta[0]
    centre = np.array([x - RADIUS_M * np.sin(psi), y + RADIUS_M * np.cos(psi)])
    for tick in range(1, round(duration_s * FILE.rate_hz)):
        t_ns = round(tick * NANOSECONDS / FILE.rate_hz)
        world.read(t_ns)
        eta, nu = compose(start, world.motion.eta), world.motion.nu
        estimate = Estimate(t_ns, eta, nu, np.zeros((6, 6)))
        guide_state, reference = guide.step(guide_state, estimate)
        state, command = controller.step(state, reference, estimate)
        world.write(Command(t_ns, np.clip(command.u, -FILE.command.limit, FILE.command.limit)))
        out.append((np.hypot(*(eta[:2] - centre)) - RADIUS_M, nu[0]))
    return np.array(out).T


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("offset", [(0.0, 0.2, np.radians(30.0)), (0.0, -0.2, -np.radians(30.0))])
def test_a_car_on_tyres_joins_its_route_within_a_metre(law, offset):
    """The car begins at rest, 20 cm beside a circle of 3 m and 30° off, away from it."""
    cross_track_m, speed = true_motion(Repeat.along(ROUTE), law, compose(ROUTE.eta[0], np.array(offset)), 6.0)
    way_m = np.cumsum(np.abs(speed)) / FILE.rate_hz
    assert way_m[-1] > 2.0
    assert way_m[np.flatnonzero(np.abs(cross_track_m) > 0.03)[-1]] < 1.0


@pytest.fixture(scope="module")
def route():
    return fastest(ROUTE, FILE)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("kind", [Repeat, RepeatByProgress])
def test_a_car_on_tyres_begins_its_fastest_lap_on_the_route(kind, law, route):
    """Before, the reference began at 2.5 m/s, and the car left the circle by 0.54 to 0.84 m."""
    cross_track_m, speed = true_motion(kind.along(route, 2), law, route.eta[0], 12.0)
    assert speed.max() > 0.9 * route.nu[0, 0] > 2.0
    assert np.abs(cross_track_m).max() < 0.06
