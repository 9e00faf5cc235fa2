"""Define the settings, the counts and the events of an IMU."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.diagnostics import Diagnostic
from baqueano.geometry import axes_rotation
from baqueano.messages import text
from baqueano.sensors.imu_filter import ACCEL_RANGES_G, GYRO_RANGES_DPS

MILLISECOND, SECOND = 1_000_000, 1_000_000_000
BURST_BITS = 156  # bit times of 14 bytes on the bus


class ImuEvent(NamedTuple):
    """An event of the IMU for the log, with its time."""

    t_ns: int
    message: Diagnostic

    @property
    def text(self) -> str:
        """Return the message as a sentence in the current language."""
        return text(self.message)


@dataclass
class Counts:
    """Counts of samples and faults since the start."""

    samples: int = 0
    retries: int = 0  # transfers that were tried again
    failures: int = 0  # calls without a result because the bus failed
    restarts: int = 0
    overflows: int = 0
    full_scale_samples: int = 0  # samples with an axis at the end of its range
    repeated_samples: int = 0  # samples that only repeated the last one


@dataclass(frozen=True)
class OpenedImu:
    """The chip, its first values at rest, and its warnings when the IMU was opened."""

    chip: str
    who_am_i: int
    address: int
    path: str
    temperature_c: float
    accel_ms2: float  # magnitude, mean of 20 samples
    gyro_dps: float  # greatest rate of an axis, mean of 20 samples
    burst_s: float
    warnings: tuple[str, ...]

    @property
    def bus_hz(self) -> float:
        """Return a lower bound of the bus clock [Hz], from the duration of a burst with the host's overhead."""
        return BURST_BITS / self.burst_s if self.burst_s > 0.0 else float("nan")


@dataclass(frozen=True, slots=True)
class ImuSettings:
    """The settings of the chip. The vehicle file is checked for impossible values when it is read.

    `rate_hz` is 1000 divided by an integer, from 4 to 1000 samples per second. `filter` is 1 (widest) to 6. The ranges
    are ±2, 4, 8, 16 g and ±250, 500, 1000, 2000 °/s. The default is ±4 g because motors shake: clipped vibration looks
    like a bias after the filter. The resolution is still a thirtieth of the noise. The gyro's default is ±1000 °/s
    because a car of this size spins at 660 °/s. The `axes` are the chip's axes that point forward, left and up, such as
    ("-y", "x", "z"). The driver rotates its samples to these axes, and worlds/robot.py uses the result as body axes.
    """

    rate_hz: int = 200
    filter: int = 3
    accel_range_g: int = 4
    gyro_range_dps: int = 1000
    axes: tuple[str, ...] = ("x", "y", "z")

    @property
    def divider(self) -> int:
        """Return the value of the register SMPLRT_DIV for `rate_hz`."""
        return 1000 // self.rate_hz - 1

    @property
    def accel_bits(self) -> int:
        """Return the value of the register ACCEL_CONFIG for the accelerometer's range."""
        return ACCEL_RANGES_G.index(self.accel_range_g) << 3

    @property
    def gyro_bits(self) -> int:
        """Return the value of the register GYRO_CONFIG for the gyro's range."""
        return GYRO_RANGES_DPS.index(self.gyro_range_dps) << 3

    def body_from_chip(self) -> np.ndarray:
        """Return the rotation (3, 3) from the chip's axes to the body's."""
        rotation = axes_rotation(self.axes)
        assert rotation is not None, self.axes
        return rotation
