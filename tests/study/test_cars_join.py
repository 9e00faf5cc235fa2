"""Cars of the second simulator, on tyres that slip, join their route: the laws are judged by physics of its own."""

import numpy as np
import pytest

from baqueano.geometry import compose
from baqueano.guides import Repeat
from baqueano.guides.shapes import circle
from baqueano.signals import NANOSECONDS, Command, Estimate
from baqueano.study.counterpart.cars import car_file
from baqueano.study.counterpart.world import LoopWorld
from baqueano.study.truth import draw_cars
from baqueano.symbolic import compile_block

RADIUS_M, ROUTE = 3.0, circle(3.0, 0.5)


@pytest.mark.parametrize("law", ["pd_feedforward", "kanayama", "lqr", "pure_pursuit", "stanley"])
@pytest.mark.parametrize("offset", [(0.0, 0.2, np.radians(30.0)), (0.0, -0.2, -np.radians(30.0))])
def test_a_car_on_tyres_joins_its_route_within_a_metre(law, offset):
    """The car begins at rest, 20 cm beside a circle of 3 m and 30° off, away from it."""
    car = draw_cars(1, 70)
    file, start = car_file(car), compose(ROUTE.eta[0], np.array(offset))
    world, guide, controller = (
        LoopWorld(car, 1, file.rate_hz),
        Repeat.along(ROUTE),
        compile_block(file.controller(law)),
    )
    guide_state, state, way_m, last_m = guide.init(), controller.init(), 0.0, 0.0
    x, y, psi = ROUTE.eta[0]
    centre = np.array([x - RADIUS_M * np.sin(psi), y + RADIUS_M * np.cos(psi)])
    for tick in range(1, round(6.0 * file.rate_hz)):
        t_ns = round(tick * NANOSECONDS / file.rate_hz)
        world.read(t_ns)
        eta, nu = compose(start, world.motion.eta), world.motion.nu
        estimate = Estimate(t_ns, eta, nu, np.zeros((6, 6)))
        guide_state, reference = guide.step(guide_state, estimate)
        state, command = controller.step(state, reference, estimate)
        world.write(Command(t_ns, np.clip(command.u, -file.command.limit, file.command.limit)))
        way_m += abs(nu[0]) / file.rate_hz
        last_m = way_m if abs(np.hypot(*(eta[:2] - centre)) - RADIUS_M) > 0.03 else last_m
    assert way_m > 2.0
    assert last_m < 1.0
