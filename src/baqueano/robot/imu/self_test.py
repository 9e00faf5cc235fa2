"""Run the chip's self-test: the chip deflects each sensor, and the response must agree with the factory's response.

With STR = (reading with the test bit) − (reading without) and the factory's response FT from its code n in the chip,

    MPU-6050    gyro  FT = 25 · 1.046ⁿ⁻¹ °/s (y: negative), at ±250 °/s                                   (1)
                accel FT = 0.34 · (0.92/0.34)^((n−1)/30) g, at ±8 g                                       (2)
                passed: |STR/FT − 1| ≤ 14 %                                                               (3)
    MPU-6500    FT = 2620 · 1.01ⁿ⁻¹ LSB, at ±250 °/s and ±2 g                                             (4)
                passed: STR/FT > 0.5, and < 1.5 for the accelerometer                                     (5)

n = 0 means that the factory did not write a code: the axis is then not evaluated. The vehicle must be at
rest: the test fails if the standard deviation of the readings exceeds ten times the sensor's noise.
Sources: RM-MPU-6000A 4.2, registers 13 to 16, and the data sheet's ±14 %; the MPU-6500's application note.
"""

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from baqueano.errors import AnswerNo
from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.messages.text_table import text_table
from baqueano.robot.imu.chips import GYRO_LSB_PER_DPS
from baqueano.robot.imu.mpu6050 import SMPLRT_DIV, Mpu6050

AXES = (N_("accel x"), N_("accel y"), N_("accel z"), N_("gyro x"), N_("gyro y"), N_("gyro z"))
UNITS = ("g", "g", "g", "°/s", "°/s", "°/s")
FILTER_SETTING = 2
TEST_BITS = 0xE0
READING_COUNT = 100
STEP_S = 0.002
SETTLE_S = 0.1
MAX_REST_SPREAD = np.array([0.05, 0.05, 0.05, 1.0, 1.0, 1.0])  # g, °/s: ten times the noise at 94 Hz
TOLERANCE_6050 = 0.14
MIN_6500, MAX_6500 = 0.5, 1.5


class AxisResponse(NamedTuple):
    """The response of an axis, and the factory's response `trim`, in °/s or g.

    `has_passed` is None if the factory did not write a code.
    """

    name: str
    unit: str
    response: float
    trim: float
    has_passed: bool | None


class SelfTest(NamedTuple):
    """The responses of the six axes, in the order accel x y z, gyro x y z."""

    axes: tuple[AxisResponse, ...]

    @property
    def has_passed(self) -> bool:
        """Return True if no axis failed. An axis without a factory code cannot fail."""
        return all(axis.has_passed is not False for axis in self.axes)

    def table(self) -> str:
        """Return a table as text, with one line for each axis."""
        verdict_texts = {True: _("passed"), False: _("FAILED"), None: _("no factory code")}
        rows = (
            [
                _(a.name),
                f"{number(a.response):.3f} {a.unit}",
                f"{number(a.trim):.3f}",
                verdict_texts[a.has_passed],
            ]
            for a in self.axes
        )
        return "\n".join(text_table("<>><", ["", "", _("factory"), ""], *rows))


def self_test(imu: Mpu6050, sleep: Callable[[float], object] = time.sleep) -> SelfTest:
    """Test the chip, and return the responses. The test takes about 0.7 s; the reads after it start `imu` again.

    Raise AnswerNo if the vehicle moved or the bus failed.
    """
    own_accel_filter = imu.chip.has_own_accel_filter
    accel_bits = 0x00 if own_accel_filter else 0x10
    try:
        mean_at_rest = _mean(imu, 0x00, accel_bits, sleep)
        test_mean = _mean(imu, TEST_BITS, TEST_BITS | accel_bits, sleep)
        codes = _codes(imu)
    except OSError as error:
        raise AnswerNo.of("imu.self-test-broke-off", error=error) from None
    finally:
        imu.start_again()
    trims = factory_trims(codes, own_accel_filter)
    axes = (
        AxisResponse(
            AXES[n],
            UNITS[n],
            float(test_mean[n] - mean_at_rest[n]),
            trims[n],
            None if codes[n] == 0 else True,
        )
        for n in range(6)
    )
    return SelfTest(
        tuple(axis._replace(has_passed=_is_passed(n, axis, own_accel_filter)) for n, axis in enumerate(axes))
    )


def factory_trims(codes: tuple[int, ...], own_accel_filter: bool) -> tuple[float, ...]:
    """Return FT (6,) in g and °/s, 0 for code 0, in the order of the codes: accel x y z, gyro x y z.  (1) (2) (4)"""
    trims = []
    for n, code in enumerate(codes):
        if code == 0:
            trims.append(0.0)
        elif own_accel_filter:
            trims.append(2620.0 * 1.01 ** (code - 1) / (16384.0 if n < 3 else GYRO_LSB_PER_DPS[0]))
        elif n < 3:
            trims.append(0.34 * (0.92 / 0.34) ** ((code - 1) / 30.0))
        else:
            trims.append(25.0 * 1.046 ** (code - 1) * (-1.0 if n == 4 else 1.0))
    return tuple(trims)


def _is_passed(n: int, axis: AxisResponse, own_accel_filter: bool) -> bool | None:
    """Return True if axis `n` passes the test, None without a factory code.  (3) (5)"""
    if axis.has_passed is None:
        return None
    ratio = axis.response / axis.trim
    if own_accel_filter:
        return ratio > MIN_6500 and (n > 2 or ratio < MAX_6500)
    return abs(ratio - 1.0) <= TOLERANCE_6050


def _codes(imu: Mpu6050) -> tuple[int, ...]:
    """Return the six codes of the factory: accel x y z, gyro x y z."""
    if imu.chip.has_own_accel_filter:
        return (*imu.device.read(0x0D, 3), *imu.device.read(0x00, 3))
    x, y, z, low_bits = imu.device.read(0x0D, 4)
    accel = (x >> 5 << 2 | low_bits >> 4 & 3, y >> 5 << 2 | low_bits >> 2 & 3, z >> 5 << 2 | low_bits & 3)
    return (*accel, x & 31, y & 31, z & 31)


def _mean(imu: Mpu6050, gyro_bits: int, accel_bits: int, sleep: Callable[[float], object]) -> np.ndarray:
    """Return the mean readings (6,) in g and °/s with these test bits set. Raise AnswerNo if the vehicle moves."""
    accel_filter = (FILTER_SETTING,) if imu.chip.has_own_accel_filter else ()
    imu.device.write(SMPLRT_DIV, 0, FILTER_SETTING, gyro_bits, accel_bits, *accel_filter)
    sleep(SETTLE_S)
    rows = []
    for _reading in range(READING_COUNT):
        rows.append(np.frombuffer(imu.device.read(0x3B, 14), ">i2")[[0, 1, 2, 4, 5, 6]].astype(float))
        sleep(STEP_S)
    accel_lsb = 16384.0 if imu.chip.has_own_accel_filter else 4096.0
    values = np.array(rows) / np.array([accel_lsb] * 3 + [GYRO_LSB_PER_DPS[0]] * 3)
    scatter = values.std(axis=0)
    if np.any(scatter > MAX_REST_SPREAD):
        worst_axis = int(np.argmax(scatter / MAX_REST_SPREAD))
        raise AnswerNo.of(
            "imu.self-test-moved",
            axis=AXES[worst_axis],
            scatter=scatter[worst_axis],
            unit_name=UNITS[worst_axis],
            limit=MAX_REST_SPREAD[worst_axis],
        )
    return values.mean(axis=0)
