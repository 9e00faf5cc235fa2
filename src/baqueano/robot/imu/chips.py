"""The chips that are sold as an MPU-6050, by what they answer in WHO_AM_I (0x75), and where they differ.

    a [m/s²] = raw · range_g · g / 2¹⁵                                                                    (1)
    ω [rad/s] = raw · (π/180) / s,  s = 131, 65.5, 32.8, 16.4 for ±250, 500, 1000, 2000 °/s     (2)
    T [°C] = raw / lsb_per_c + offset_c                                                                   (3)

Two families. The 6050's filter (CONFIG, 0x1A) serves both sensors; the 6500's has one of its own for the
accelerometer (ACCEL_CONFIG 2, 0x1D), which a driver of the 6050 leaves wide open, at another temperature scale and
with other self-test registers. The 6050's FIFO holds 1024 bytes, that of the others 512 as they come out of reset.

Sources: register maps RM-MPU-6000A 4.2, RM-MPU-6500A 2.1, RM-MPU-9250A 1.6; Linux, inv_mpu6050. The delay of the
6500's accelerometer is that of the latest map: an earlier one has 11.80 ms where this has 4.88 ms (at 44.8 Hz), more
than a filter of that width can have. What answers 0x72 and 0x75 is not in any map: taken for a 6500, as an
unknown id is, without a temperature.
"""

import math
from typing import NamedTuple

from baqueano.signals import STANDARD_GRAVITY

ACCEL_RANGES_G = (2, 4, 8, 16)
GYRO_RANGES_DPS = (250, 500, 1000, 2000)
GYRO_LSB_PER_DPS = (131.0, 65.5, 32.8, 16.4)


class FilterBand(NamedTuple):
    """A setting of the low-pass filter: widths [Hz] and delays [s]."""

    accel_hz: float
    accel_delay_s: float
    gyro_hz: float
    gyro_delay_s: float


class Chip(NamedTuple):
    """The properties of a chip. `lsb_per_c` is None where the scale is unknown."""

    name: str
    own_accel_filter: bool
    fifo_bytes: int
    lsb_per_c: float | None
    offset_c: float
    known: bool = True

    @property
    def bands(self) -> dict[int, FilterBand]:
        """Setting of the filter → what it does; only those that leave the gyro at 1 kHz."""
        return BANDS_6500 if self.own_accel_filter else BANDS_6050

    def celsius(self, raw: int) -> float:
        """Temperature [°C]; NaN where the scale is not known.  (3)"""
        return math.nan if self.lsb_per_c is None else raw / self.lsb_per_c + self.offset_c


BANDS_6050 = {
    1: FilterBand(184.0, 2.0e-3, 188.0, 1.9e-3),
    2: FilterBand(94.0, 3.0e-3, 98.0, 2.8e-3),
    3: FilterBand(44.0, 4.9e-3, 42.0, 4.8e-3),
    4: FilterBand(21.0, 8.5e-3, 20.0, 8.3e-3),
    5: FilterBand(10.0, 13.8e-3, 10.0, 13.4e-3),
    6: FilterBand(5.0, 19.0e-3, 5.0, 18.6e-3),
}
BANDS_6500 = {
    1: FilterBand(218.1, 1.88e-3, 184.0, 2.9e-3),
    2: FilterBand(99.0, 2.88e-3, 92.0, 3.9e-3),
    3: FilterBand(44.8, 4.88e-3, 41.0, 5.9e-3),
    4: FilterBand(21.2, 8.87e-3, 20.0, 9.9e-3),
    5: FilterBand(10.2, 16.83e-3, 10.0, 17.85e-3),
    6: FilterBand(5.05, 32.48e-3, 5.0, 33.48e-3),
}


def _family_6500(name: str) -> Chip:
    return Chip(name, True, 512, 1e6 / 2995.178, 7011 * 2995.178e-6)


def _family_20600(name: str) -> Chip:
    return Chip(name, True, 512, 1e6 / 3059.976, 8170 * 3059.976e-6)


CHIPS = {
    0x68: Chip("MPU-6050, 6000 or 9150", False, 1024, 340.0, 36.53),
    0x70: _family_6500("MPU-6500"),
    0x71: _family_6500("MPU-9250"),
    0x73: _family_6500("MPU-9255"),
    0x74: _family_6500("MPU-6515"),
    0x78: _family_6500("MPU-6880"),
    0x98: _family_20600("ICM-20689"),
    0xAE: _family_20600("ICM-20608-D"),
    0xAF: _family_20600("ICM-20608-G"),
    0x72: Chip("clone 0x72", True, 512, None, 0.0),
    0x75: Chip("clone 0x75", True, 512, None, 0.0),
}


def chip_of(who_am_i: int) -> Chip:
    """The chip that answers so; one that nobody listed is driven as a 6500, and `known` says no."""
    unknown = Chip(f"unknown chip 0x{who_am_i:02X}", True, 512, None, 0.0, known=False)
    return CHIPS.get(who_am_i, unknown)


def accel_scale(range_g: int) -> float:
    """m/s² per LSB.  (1)"""
    return range_g * STANDARD_GRAVITY / 32768.0


def gyro_scale(range_dps: int) -> float:
    """rad/s per LSB.  (2)"""
    return math.radians(1.0 / GYRO_LSB_PER_DPS[GYRO_RANGES_DPS.index(range_dps)])
