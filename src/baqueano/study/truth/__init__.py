"""An independent truth: simulators with their own equations, which import none of the physics that they evaluate.

Data for studies, benchmarks and tests of statistics come from here, because a fit agrees with data from its own model.
Plain NumPy, many vehicles side by side, Runge-Kutta at 1 kHz; a step also ends where a command takes effect.
"""

from baqueano.study.truth.bicycle import Cars, draw_cars
from baqueano.study.truth.floor import Floor, FloorLines, Gate, PassingFaults, Reader
from baqueano.study.truth.group import Group, TruthGroup
from baqueano.study.truth.imu import Imus
from baqueano.study.truth.transmission import Transmission
from baqueano.study.truth.two_wheels import Robots, draw_robots
from baqueano.study.truth.world import TruthWorld
