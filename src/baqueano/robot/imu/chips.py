"""List the chips that are sold as an MPU-6050, by their answer in WHO_AM_I (0x75), with their properties.

    a [m/s²] = raw · range_g · g / 2¹⁵                                                                    (1)
    ω [rad/s] = raw · (π/180) / s,  s = 131, 65.5, 32.8, 16.4 for ±250, 500, 1000, 2000 °/s     (2)
    T [°C] = raw / lsb_per_c + offset_c                                                                   (3)

There are two families. The 6050's filter (CONFIG, 0x1A) applies to both sensors. The 6500 has a separate filter for the
accelerometer (ACCEL_CONFIG 2, 0x1D), which a driver of the 6050 leaves at its widest setting. The 6500 also has another
temperature scale and other self-test registers. After a reset the FIFO has 1024 bytes in the 6050, 512 in other chips.

Sources: register maps RM-MPU-6000A 4.2, RM-MPU-6500A 2.1, RM-MPU-9250A 1.6; Linux, inv_mpu6050. The widths and delays
of the filters are in sensors/imu_filter.py. The register maps do not list chips that answer 0x72 or 0x75. These chips
are used as a 6500, without a temperature, like all chips with an unknown id.
"""

import math
from typing import NamedTuple

from baqueano.sensors.imu_filter import GYRO_RANGES_DPS, MPU6050_BANDS, MPU6500_BANDS, FilterBand
from baqueano.signals import STANDARD_GRAVITY

GYRO_LSB_PER_DPS = (131.0, 65.5, 32.8, 16.4)


class Chip(NamedTuple):
    """The properties of a chip. `lsb_per_c` is None if the scale is unknown."""

    name: str
    has_own_accel_filter: bool
    fifo_bytes: int
    lsb_per_c: float | None
    offset_c: float
    is_listed: bool = True

    @property
    def filter_bands(self) -> dict[int, FilterBand]:
        """Return filter setting → bandwidth and delay, for the settings that leave the gyro at 1 kHz."""
        return MPU6500_BANDS if self.has_own_accel_filter else MPU6050_BANDS

    def celsius(self, raw_value: int) -> float:
        """Return the temperature [°C]; NaN if the scale is unknown.  (3)"""
        return math.nan if self.lsb_per_c is None else raw_value / self.lsb_per_c + self.offset_c


def _family_6500(name: str) -> Chip:
    return Chip(
        name, has_own_accel_filter=True, fifo_bytes=512, lsb_per_c=1e6 / 2995.178, offset_c=7011 * 2995.178e-6
    )


def _family_20600(name: str) -> Chip:
    return Chip(
        name, has_own_accel_filter=True, fifo_bytes=512, lsb_per_c=1e6 / 3059.976, offset_c=8170 * 3059.976e-6
    )


CHIPS = {
    0x68: Chip(
        "MPU-6050, 6000 or 9150", has_own_accel_filter=False, fifo_bytes=1024, lsb_per_c=340.0, offset_c=36.53
    ),
    0x70: _family_6500("MPU-6500"),
    0x71: _family_6500("MPU-9250"),
    0x73: _family_6500("MPU-9255"),
    0x74: _family_6500("MPU-6515"),
    0x78: _family_6500("MPU-6880"),
    0x98: _family_20600("ICM-20689"),
    0xAE: _family_20600("ICM-20608-D"),
    0xAF: _family_20600("ICM-20608-G"),
    0x72: Chip("clone 0x72", has_own_accel_filter=True, fifo_bytes=512, lsb_per_c=None, offset_c=0.0),
    0x75: Chip("clone 0x75", has_own_accel_filter=True, fifo_bytes=512, lsb_per_c=None, offset_c=0.0),
}


def lookup_chip(who_am_i: int) -> Chip:
    """Return the chip with this answer in WHO_AM_I; for an unlisted answer a 6500 with `is_listed` False."""
    unknown_chip = Chip(
        f"unknown chip 0x{who_am_i:02X}",
        has_own_accel_filter=True,
        fifo_bytes=512,
        lsb_per_c=None,
        offset_c=0.0,
        is_listed=False,
    )
    return CHIPS.get(who_am_i, unknown_chip)


def accel_scale(range_g: int) -> float:
    """Return the scale of the accelerometer [m/s² per LSB].  (1)"""
    return range_g * STANDARD_GRAVITY / 32768.0


def gyro_scale(range_dps: int) -> float:
    """Return the scale of the gyro [rad/s per LSB].  (2)"""
    return math.radians(1.0 / GYRO_LSB_PER_DPS[GYRO_RANGES_DPS.index(range_dps)])
