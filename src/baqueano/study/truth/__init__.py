"""An independent truth: simulators with equations of their own, which import nothing of the physics that they judge.

Data for studies, benchmarks and tests of statistics come from here: a fit that is judged by the step that it fits
agrees with itself. Plain NumPy, many vehicles side by side, Runge and Kutta at 1 kHz, each step ending where a
command is felt.
"""

from baqueano.study.truth.bicycle import Cars, draw_cars
from baqueano.study.truth.floor import Floor, FloorLines, Gate, PassingFaults, Reader
from baqueano.study.truth.group import Group, TruthGroup
from baqueano.study.truth.imu import Imus
from baqueano.study.truth.transmission import Transmission
from baqueano.study.truth.two_wheels import Robots, draw_robots
from baqueano.study.truth.world import TruthWorld
