"""`baqueano study controllers`: compare all controllers with the same simulated robots, routes, noise and tuning.

Robots of the second simulator (truth/) with the tolerances of real parts are identified from commands and IMU only, as
in `study driving`. The gains of each controller are tuned once, on the identified model of another robot, from the same
number of starts. The second row is the paper's PD, tuned over draws of that fit and of its delay: the ratios refer to
it. This law does not correct a cross-track error, so it is tuned with starts on the route, the others with starts
beside it. A controller that cannot be compiled, such as mpc, has its default gains. Each controller drives each route
of each robot from rest, with the same noise. There are three evaluations:

    pose         pose and velocity are known; the distance of the robot from its path
    estimate     commands and IMU only; the distance by the robot's estimate
    truth        the same drives; the true distance
"""

from collections.abc import Callable, Sequence
from functools import partial

from baqueano.contracts.blocks import OwnBlock
from baqueano.study.controllers import drawing as drawing  # it adds `.plot()` and the card
from baqueano.study.controllers.drives import compared_controllers, drive_robot
from baqueano.study.controllers.result import EVALUATIONS, Controllers
from baqueano.sweep.result import SweepResult
from baqueano.sweep.workers import run_in_processes

KINDS = ("pd", "pd_feedforward", "kanayama", "lqr", "pure_pursuit", "stanley", "mpc")  # the paper's first
START_COUNT = 3


def controllers(
    seeds: int = 100, first: int = 0, processes: int = 1, backend: str = "auto", user_blocks: Sequence[OwnBlock] = (),
    kinds: Sequence[str] = KINDS, starts: int = START_COUNT, advance: Callable[[int], None] = lambda k: None,
) -> Controllers:  # fmt: skip
    """Return the drives of robots `first` … `first + seeds − 1`. `user_blocks` are further controllers
    ("file.py:Class" or a class). The gains of each controller are tuned by `starts` descents. `advance` is called
    with the number of robots that have just finished.
    """
    controllers = compared_controllers((*kinds, *user_blocks), starts, backend)
    reference = next(
        (controller.label for controller in controllers if controller.over_draws), controllers[0].label
    )
    work = partial(drive_robot, controllers=controllers, backend=backend)
    robot_drives = run_in_processes(work, range(first, first + seeds), processes, advance)
    robots = sorted(robot_drives, key=lambda robot: robot.seed)
    drives = [robot for robot in robots if robot.drives]
    results = {
        figure: SweepResult(tuple(d for robot in drives for d in robot.drives[figure]), 0, reference)
        for figure in EVALUATIONS
    }
    return Controllers(
        results, controllers, len(robots), tuple(robot.seed for robot in robots if not robot.drives)
    )
