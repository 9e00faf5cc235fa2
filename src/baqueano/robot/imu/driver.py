"""Open the IMU, report the chip that was found, and check that its values at rest are plausible.

An unlisted chip is used as an MPU-6500, with a warning, if its values at rest are plausible. They are plausible if |a|
is within 0.15 g of 1 g, and no rate exceeds 25 °/s (zero-rate level of the MPU-6050: ±20 °/s). A listed chip might be
in motion: implausible values are only warnings.

One burst of 14 bytes takes 156 bit times on the bus. It has 4 bytes of address and register and 14 of data, 9 bits
each, and also start and stop. The duration of a burst therefore shows the real clock of the bus. On a Raspberry Pi that
clock follows the clock of the core.

`driver.open_imu(...)` returns an IMU, and `imu.read()` reads it.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from baqueano.errors import RobotUnreachable
from baqueano.messages.language import number, translate as _
from baqueano.robot.imu.i2c import I2cDevice
from baqueano.robot.imu.mpu6050 import Mpu6050, detect_chip, find_chip
from baqueano.robot.imu.settings import SECOND, ImuSettings, OpenedImu
from baqueano.signals import STANDARD_GRAVITY

if TYPE_CHECKING:
    from baqueano.vehicle_file.head import Hardware

ADDRESSES = (0x68, 0x69)
BURST_REGISTERS, BURST_COUNT = (0x3B, 14), 20
STEP_S = 0.002
START_TIMEOUT_NS = 2 * SECOND
REST_SAMPLES = 20
GRAVITY_TOLERANCE = 0.15
MAX_REST_DPS = 25.0


def open_imu(
    bus: int | str = 1,
    *,
    address: int | None = None,
    settings: ImuSettings | None = None,
    notify: Callable[[str], object] | None = print,
    now_ns: Callable[[], int] = time.monotonic_ns,
    sleep: Callable[[float], object] = time.sleep,
) -> Mpu6050:
    """Return the running IMU on /dev/i2c-`bus` (or a path), and pass each finding to `notify` as a line of text.

    Its `read()` returns the samples since the last call, in m/s² and rad/s: at rest the accelerometer shows +g on z.
    `now_ns` is the clock of their timestamps. `address` is 0x68 or 0x69; None tries both. Raise RobotUnreachable if no
    device answers, or if the device that answers cannot be an IMU. Raise UsageError on a system other than Linux.

    >>> imu = open_imu(notify=None)  # /dev/i2c-1
    >>> print(imu.identity.chip, f"at 0x{imu.identity.address:02x} measures {imu.identity.accel_ms2:.1f} m/s²")
    MPU-6050, 6000 or 9150 at 0x68 measures 9.8 m/s²
    """
    path = bus if isinstance(bus, str) else f"/dev/i2c-{bus}"
    device, who_am_i, warnings = find_chip(path, ADDRESSES if address is None else (address,))
    try:
        chip = detect_chip(device, who_am_i)
        imu = Mpu6050(device, chip, settings or ImuSettings(), now_ns)
        identity = _identify_chip(imu, who_am_i, now_ns, sleep)
        identity = replace(identity, warnings=(*warnings, *identity.warnings))
    except BaseException:
        device.close()
        raise
    imu.identity = identity
    for line in description_lines(imu, identity) if notify else ():
        notify(line)  # type: ignore[misc]
    return imu


def start_imu(
    hardware: "Hardware", notify: Callable[[str], object] | None, in_chip_axes: bool = False
) -> Mpu6050:
    """Return the running IMU, with the settings in [robot] of the vehicle file.

    With `in_chip_axes` the samples stay in the chip's axes, as needed if the mounting is not yet known.
    """
    settings = ImuSettings(
        filter=round(hardware.imu_filter), accel_range_g=round(hardware.imu_accel_range_g),
        gyro_range_dps=round(hardware.imu_gyro_range_dps),
        axes=("x", "y", "z") if in_chip_axes else tuple(hardware.imu_axes),
    )  # fmt: skip
    return open_imu(
        round(hardware.imu_bus), address=round(hardware.imu_address), settings=settings, notify=notify
    )


def time_burst(device: I2cDevice, now_ns: Callable[[], int]) -> float:
    """Return the shortest duration [s] of a burst of 14 bytes in BURST_COUNT attempts; NaN if all failed."""
    min_duration_s = float("nan")
    for _time in range(BURST_COUNT):
        start_ns = now_ns()
        try:
            device.read(*BURST_REGISTERS)
        except OSError:
            continue
        min_duration_s = np.fmin(min_duration_s, (now_ns() - start_ns) / SECOND)
    return float(min_duration_s)


def description_lines(imu: Mpu6050, identity: OpenedImu) -> list[str]:
    """Return chip, settings, filter, first values and warnings as lines of text."""
    s, band = imu.settings, imu.chip.filter_bands[imu.settings.filter]
    axes = ", ".join(s.axes)
    warm = "" if np.isnan(identity.temperature_c) else f", {number(identity.temperature_c):.1f} °C"
    lines = [
        _(
            "IMU: {chip} (WHO_AM_I 0x{who_am_i:02X}) at 0x{address:02X} on {path}{warm}",
            chip=identity.chip,
            who_am_i=identity.who_am_i,
            address=identity.address,
            path=identity.path,
            warm=warm,
        ),
        "  "
        + _(
            "{rate_hz} Hz; ±{accel_range_g} g, ±{gyro_range_dps} °/s; forward, left, up: {axes}",
            rate_hz=s.rate_hz,
            accel_range_g=s.accel_range_g,
            gyro_range_dps=s.gyro_range_dps,
            axes=axes,
        ),
        "  "
        + _(
            "filter {filter}: accelerometer {accel_hz:g} Hz, delay {accel_delay_s:.1f} ms; gyro "
            "{gyro_hz:g} Hz, delay {gyro_delay_s:.1f} ms",
            filter=s.filter,
            accel_hz=band.accel_hz,
            accel_delay_s=band.accel_delay_s * 1000.0,
            gyro_hz=band.gyro_hz,
            gyro_delay_s=band.gyro_delay_s * 1000.0,
        ),
        "  "
        + _(
            "now {accel_ms2:.2f} m/s², {gyro_dps:.1f} °/s; 14 bytes take {burst_s:.2f} ms (bus at "
            "{bus_hz:.0f} kHz or more)",
            accel_ms2=identity.accel_ms2,
            gyro_dps=identity.gyro_dps,
            burst_s=identity.burst_s * 1000.0,
            bus_hz=identity.bus_hz / 1000.0,
        ),
    ]
    return lines + ["  " + _("warning: {text}", text=text) for text in identity.warnings]


def _identify_chip(
    imu: Mpu6050, who_am_i: int, now_ns: Callable[[], int], sleep: Callable[[float], object]
) -> OpenedImu:
    """Start the chip, and return its identity, the means of its first samples, the burst time, and warnings.

    Raise RobotUnreachable if too few samples arrive, or for an unlisted chip with impossible values.
    """
    samples, start_ns = [], now_ns()
    while len(samples) < REST_SAMPLES:
        samples += imu.read()
        if now_ns() - start_ns > START_TIMEOUT_NS:
            raise RobotUnreachable.of(
                "imu.too-few-samples",
                address=imu.device.address,
                path=imu.device.path,
                count=len(samples),
                limit_s=START_TIMEOUT_NS // SECOND,
                events=" ".join(e.text for e in imu.events()) or "–",
            )
        sleep(STEP_S)
    accel = float(np.linalg.norm(np.mean([s.accel for s in samples], axis=0)))
    gyro = float(np.degrees(np.max(np.abs(np.mean([s.gyro for s in samples], axis=0)))))
    return OpenedImu(
        imu.chip.name,
        who_am_i,
        imu.device.address,
        imu.device.path,
        samples[-1].temperature_c,
        accel,
        gyro,
        time_burst(imu.device, now_ns),
        tuple(_rest_warnings(imu, who_am_i, accel, gyro)),
    )


def _rest_warnings(imu: Mpu6050, who_am_i: int, accel: float, gyro: float) -> list[str]:
    """Return a warning for each implausible value, and for an unlisted chip.

    Raise RobotUnreachable for an unlisted chip with implausible values.
    """
    doubts = []
    if abs(accel / STANDARD_GRAVITY - 1.0) > GRAVITY_TOLERANCE:
        doubts.append(
            _(
                "measures {accel:.2f} m/s² at rest; expected {standard_gravity:.2f} ± 15 %",
                accel=accel,
                standard_gravity=STANDARD_GRAVITY,
            )
        )
    if gyro > MAX_REST_DPS:
        doubts.append(
            _(
                "turns at {gyro:.1f} °/s at rest; expected less than {still_dps:g}",
                gyro=gyro,
                still_dps=MAX_REST_DPS,
            )
        )
    if imu.chip.is_listed:
        return doubts
    if doubts:
        raise RobotUnreachable.of(
            "imu.unknown-chip",
            who_am_i=who_am_i,
            address=imu.device.address,
            fault=f" {_('and')} ".join(doubts),
        )
    doubts.append(
        _(
            "WHO_AM_I 0x{who_am_i:02X} is not known: the chip is used as an MPU-6500, with an unknown "
            "temperature. Its values at rest are plausible.",
            who_am_i=who_am_i,
        )
    )
    return doubts
