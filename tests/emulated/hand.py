"""A simulated hand lifts and turns an IMU chip on its bus."""

from pathlib import Path

import numpy as np

from baqueano.robot.imu import driver as imu
from baqueano.sensors.imu import STANDARD_GRAVITY
from tests.emulated.i2c_ioctl import connect
from tests.emulated.mpu import EmulatedBus, MpuEmulator

TURN_S = 2.0


class Hand:
    """The motion of the chip in a hand. `axes` (3, 3): the rows are the axes of the chip that point ahead, left and
    up. `slope` (2,) is the slope of the floor towards its x and y [rad]; `heading_rad` is the heading of the vehicle
    on it."""

    def __init__(
        self, robot, axes=None, slope=(0.0, 0.0), accel_bias=(0.0, 0.0, 0.0), gyro_bias=(0.0, 0.0, 0.0)
    ):
        self.robot, self.axes = robot, np.eye(3) if axes is None else np.asarray(axes, dtype=float)
        self.slope, self.accel_bias, self.gyro_bias = slope, np.array(accel_bias), np.array(gyro_bias)
        self.heading, self.lift, self.roll = 0.0, 0.0, 0.0  # targets [rad]
        self._before = (0.0, 0.0, 0.0)
        self._since_ns = robot.now_ns
        robot.chip.motion = self.motion

    def moves(self, *, heading=None, lift=None, roll=None):
        """Begin a motion to this heading, lift and roll at the present time."""
        self._before, self._since_ns = self._now(self.robot.now_ns)[0], self.robot.now_ns
        self.heading = self.heading if heading is None else heading
        self.lift = self.lift if lift is None else lift
        self.roll = self.roll if roll is None else roll

    def _now(self, t_ns):
        share = min(1.0, (t_ns - self._since_ns) * 1e-9 / TURN_S)
        target = np.array([self.heading, self.lift, self.roll])
        rate = (target - self._before) / TURN_S if share < 1.0 else np.zeros(3)
        return np.asarray(self._before) + share * (target - self._before), rate

    def motion(self, t_ns):
        """Return specific force and rate along the axes of the chip."""
        (heading, lift, roll), (turning, lifting, rolling) = self._now(t_ns)
        c, s = np.cos(heading), np.sin(heading)
        sx, sy = self.slope
        force = STANDARD_GRAVITY * np.array(
            [np.sin(lift) + c * sx + s * sy, np.sin(roll) + c * sy - s * sx, np.cos(lift) * np.cos(roll)]
        )
        rate = np.array([rolling, -lifting, turning])
        chip_force, chip_rate = self.axes.T @ force + self.accel_bias, self.axes.T @ rate + self.gyro_bias
        return tuple(chip_force), tuple(chip_rate)


class OnBus:
    """A chip on its bus, its driver, and a clock that advances during each wait. `chip` contains options of
    MpuEmulator."""

    def __init__(self, folder, patches, **chip):
        self.now_ns = 10**9
        self.chip = MpuEmulator(now_ns=lambda: self.now_ns, start_ns=self.now_ns, seed=5, **chip)
        path = str(folder / "i2c-1")
        Path(path).touch()
        connect(patches, {path: EmulatedBus({0x68: self.chip}, self._pass)})
        self.imu = imu.open_imu(path, notify=None, now_ns=lambda: self.now_ns, sleep=self.wait)

    def _pass(self, ns):
        self.now_ns += ns

    def wait(self, seconds):
        self.now_ns += round(seconds * 1e9)
        self.chip.run_until(self.now_ns)
