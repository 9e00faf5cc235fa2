"""Simulate vehicles independently of the models: with other equations, and without an import of the evaluated physics.

Studies, benchmarks and tests of statistics use this data, because a fit agrees too well with data from its own model.
The simulators use plain NumPy, many vehicles at the same time, and Runge-Kutta at 1 kHz. A step also ends when a
command takes effect.
"""

from baqueano.study.truth.bicycle import Cars, draw_cars
from baqueano.study.truth.floor import FloorLines, Gate, PassingFaults, Reader, TagReaders
from baqueano.study.truth.group import Group, TruthGroup, merge
from baqueano.study.truth.imu import Imus
from baqueano.study.truth.transmission import Transmission
from baqueano.study.truth.two_wheels import Robots, draw_robots
from baqueano.study.truth.world import TruthWorld
