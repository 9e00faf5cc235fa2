"""A drive with `--page` begins where a drive without a page begins."""

import numpy as np

from baqueano.cli.page.drive_door import DriveDoor
from baqueano.diagnostics import note
from baqueano.drive.mission import Mission
from baqueano.guides.shapes import circle
from baqueano.vehicle_file import load

ROUTE = circle(0.5, 0.2)


def test_the_simulated_vehicle_of_a_page_stands_where_the_mission_begins(tmp_path):
    """`repeat --page --from` set the estimate to the given pose, but the vehicle to the start of the route."""
    door = DriveDoor(load("small"), "simulation", tmp_path)
    try:
        for start in ((), (0.1, -0.2, 0.3)):
            mission = Mission("repeat", route=ROUTE, start=start)
            world = door.local_options(mission, load("small"), {"backend": "numpy"})["world"]
            np.testing.assert_allclose(world.truth.eta, start or ROUTE.eta[0])
    finally:
        door.close(note("drive.rest", rest_s=2.0))
