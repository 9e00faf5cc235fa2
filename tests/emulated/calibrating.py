"""`python -m tests.emulated.calibrating PORT`: calibrate motors as a process, with an IMU that is always at rest.

The vehicle never turns, so its first ramp, which is slow here, continues until the process is ended.
"""

import sys
import time
from typing import Any

import numpy as np

from baqueano.cli import main
from baqueano.robot.imu import driver as imu
from baqueano.robot.workshop import calibrate_motors, floor_tests
from baqueano.sensors.imu import STANDARD_GRAVITY
from baqueano.worlds.robot import Sample

STEP_NS = 5_000_000


class Still:
    """An IMU at rest on a level floor, with 200 samples a second."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self._sent_ns = time.monotonic_ns()

    def read(self) -> list[Sample]:
        """Return the samples since the last call."""
        stamps = range(self._sent_ns + STEP_NS, time.monotonic_ns(), STEP_NS)
        self._sent_ns = stamps[-1] if stamps else self._sent_ns
        return [Sample(t_ns, np.array([0.0, 0.0, STANDARD_GRAVITY]), np.zeros(3), 20.0) for t_ns in stamps]

    def close(self) -> None:
        """Do nothing, because no device is open."""


imu.open_imu = Still
calibrate_motors.RAMP_PER_S = 0.02
floor_tests.MAX_SILENCE_S = 30.0  # a busy machine is not a fault of the line
main(
    ["robot", "calibrate", "motors", "--vehicle", "small", "--set", f"robot.port={sys.argv[1]}",
     "--set", "robot.dead_man_s=1"]
)  # fmt: skip
