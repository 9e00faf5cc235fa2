"""The settings of a small IMU: its ranges, the bandwidths and delays of its low-pass filter, and the filter of h.

    low_pass_hz = 1 / (2π d),  d the delay of the gyro                                                    (1)

The filter of h is of the first order (sampling.py) and has the delay of the chip's filter at low frequencies. A filter
with the chip's bandwidth would have 1.0 ms less delay at setting 3, and 13 ms more at setting 6.

Sources: register maps RM-MPU-6000A 4.2, RM-MPU-6500A 2.1. The accelerometer delay of the 6500 is from the latest map.
An earlier map has 11.80 ms instead of 4.88 ms (at 44.8 Hz), which is too long for a filter of that bandwidth.
"""

from typing import NamedTuple

import numpy as np

ACCEL_RANGES_G = (2, 4, 8, 16)
GYRO_RANGES_DPS = (250, 500, 1000, 2000)


class FilterBand(NamedTuple):
    """A setting of the low-pass filter: bandwidths [Hz] and delays [s]."""

    accel_hz: float
    accel_delay_s: float
    gyro_hz: float
    gyro_delay_s: float


MPU6050_BANDS = {
    1: FilterBand(184.0, 2.0e-3, 188.0, 1.9e-3),
    2: FilterBand(94.0, 3.0e-3, 98.0, 2.8e-3),
    3: FilterBand(44.0, 4.9e-3, 42.0, 4.8e-3),
    4: FilterBand(21.0, 8.5e-3, 20.0, 8.3e-3),
    5: FilterBand(10.0, 13.8e-3, 10.0, 13.4e-3),
    6: FilterBand(5.0, 19.0e-3, 5.0, 18.6e-3),
}
MPU6500_BANDS = {
    1: FilterBand(218.1, 1.88e-3, 184.0, 2.9e-3),
    2: FilterBand(99.0, 2.88e-3, 92.0, 3.9e-3),
    3: FilterBand(44.8, 4.88e-3, 41.0, 5.9e-3),
    4: FilterBand(21.2, 8.87e-3, 20.0, 9.9e-3),
    5: FilterBand(10.2, 16.83e-3, 10.0, 17.85e-3),
    6: FilterBand(5.05, 32.48e-3, 5.0, 33.48e-3),
}


def low_pass_hz(setting: float) -> float:
    """Return the bandwidth [Hz] of the first-order low-pass with the delay of the chip at a setting of 1 to 6.  (1)

    >>> print(f"{low_pass_hz(3):.1f} Hz")
    33.2 Hz
    """
    return float(0.5 / (np.pi * MPU6050_BANDS[round(setting)].gyro_delay_s))
