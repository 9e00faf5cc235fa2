"""The whole vehicle with one simulated clock: the real firmware on an emulated Uno, the real drivers, a simulated body.

In each millisecond the Uno runs, its motor pins drive the motors of the body, the body moves, and the IMU chip measures
this. The link and the driver of the IMU are those of the vehicle; only the serial line and the bus are emulated. The
clock of the computer has no effect, so two runs are equal bit by bit.
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from baqueano.robot.imu import driver as imu_driver
from baqueano.robot.imu.settings import ImuSettings
from baqueano.robot.service.configuration import configure_body
from baqueano.robot.uno.link import Uno
from baqueano.signals import Motion
from baqueano.worlds import Robot
from tests.emulated.body import Body
from tests.emulated.i2c_ioctl import connect
from tests.emulated.mpu import EmulatedBus, MpuEmulator
from tests.emulated.rig import Built
from tests.emulated.uno import EmulatedUno

MS = 1_000_000


class Patches:
    """A replacement for the monkeypatch of pytest outside of tests."""

    def setattr(self, place: Any, name: str, value: Any) -> None:
        setattr(place, name, value)


class EmulatedRobot:
    """One vehicle. `truth` is the vehicle file of its body; `chip` holds options of its MPU; `host_ppm` is how far the
    clock of the host is ahead of true time, by which the Uno lives."""

    def __init__(
        self, build: Built, truth: Any, seed: int = 0, patches: Any = None, *, chip: Any = None,
        host_ppm: float = 0.0, **uno: Any,
    ) -> None:  # fmt: skip
        self._true_s_per_ns = 1e-9 / (1.0 + 1e-6 * host_ppm)
        self.board = EmulatedUno(build, battery_v=truth.vehicle.drivetrain.battery_v, **uno)
        self.now_ns = MS * round(1e3 * self.board.t_s + 1)
        self.uno, self.body = Uno(self, self._time), Body(truth, seed)
        self._truths: list[tuple[int, Motion]] = []
        options = {"now_ns": self._time, "start_ns": self.now_ns, "seed": seed + 1} | (chip or {})
        self.chip = MpuEmulator(self._specific_force, **options)
        self.bus = EmulatedBus({0x68: self.chip}, lambda ns: None)
        self._folder = tempfile.TemporaryDirectory(prefix="emulated-")
        path = str(Path(self._folder.name) / "i2c-1")
        Path(path).touch()
        connect(patches or Patches(), {path: self.bus})
        settings = ImuSettings(accel_range_g=4)
        self.imu = imu_driver.open_imu(
            path, settings=settings, notify=None, now_ns=self._time, sleep=self.wait
        )

    def close(self) -> None:
        """Free the core."""
        self.board.close()
        self._folder.cleanup()

    def put_back(self) -> None:
        """Put the body at rest at the origin."""
        self.body.put_back()

    @property
    def motion(self) -> Motion:
        """Return the true motion of the body at present."""
        return self.body.motion

    # the wire

    def write(self, data: bytes) -> None:
        self.board.write(data)

    def read(self) -> bytes:
        return self.board.read()

    # time

    def wait(self, seconds: float) -> None:
        """Advance the time by this duration."""
        self.run_until(self.now_ns + round(seconds * 1e9))

    def run_until(self, t_ns: int) -> None:
        """Advance to this time, in whole milliseconds."""
        while self.now_ns < t_ns:
            self.now_ns += MS
            self.board.run_until(self.now_ns * self._true_s_per_ns)
            self.body.step(self._at_wheels())
            self.chip.run_until(self.now_ns)
            self.uno.pump()  # as the listening thread does

    def _at_wheels(self) -> np.ndarray:
        """Return the duties (2,) of the left and the right wheel."""
        return np.array(self.board.duties())

    def new_truths(self) -> list[tuple[int, Motion]]:
        """Return the pose of the body at each time that `keep_truth` stored since the last call."""
        truths, self._truths = self._truths, []
        return truths

    def keep_truth(self, t_ns: int) -> None:
        """Store the present truth under the time `t_ns` of a run."""
        self._truths.append((t_ns, self.motion))

    def _time(self) -> int:
        return self.now_ns

    def _specific_force(self, t_ns: int) -> Any:
        return self.body.force


class EmulatedWorld(Robot):
    """The emulated vehicle as a world of the loop, and its clock."""

    def __init__(self, robot: EmulatedRobot, file: Any) -> None:
        robot.wait(0.1)
        body = configure_body(file, robot.uno, robot.wait)
        super().__init__(file.sensors, robot.uno, robot.imu, body, lambda: robot.now_ns)
        self.robot = robot

    @property
    def truth(self) -> Motion:
        """Return the present motion of the body."""
        return self.robot.motion

    def ticks(self, rate_hz: float) -> Iterator[int]:
        """Return the clock of a drive after the vehicle was put back; the motors are armed at its start."""
        self.robot.put_back()
        start = self.robot.now_ns
        self.begin(start)
        self.robot.uno.arm()
        k = 1
        while True:
            due = round(k * 1e9 / rate_hz)
            self.robot.run_until(start + due)
            self.robot.keep_truth(due)
            yield due
            k += 1

    def new_truths(self) -> list[tuple[int, Motion]]:
        """Return the true poses since the last call."""
        return self.robot.new_truths()


def make_world(
    build: Built, file: Any, truth: Any = None, seed: int = 0
) -> tuple[EmulatedWorld, Iterator[int]]:
    """Return world and clock for `drive`, with the vehicle `truth`."""
    world = EmulatedWorld(EmulatedRobot(build, file if truth is None else truth, seed), file)
    return world, world.ticks(file.rate_hz)
