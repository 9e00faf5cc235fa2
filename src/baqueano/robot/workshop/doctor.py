"""Examine the state of a vehicle. Each check has a result, a verdict and a remedy (checks.py).

Files are read below `root`, so that the files of another machine can be examined as well.
"""

import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from baqueano.errors import BaqueanoError
from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.robot.imu.bus_recovery import check_bus_recovery
from baqueano.robot.workshop.checks import Check, Report
from baqueano.robot.workshop.uno_checks import check_uno

if TYPE_CHECKING:
    from baqueano.vehicle_file.head import Hardware
    from baqueano.worlds.robot import Sample

DEVICE_GROUPS = {"dialout": N_("the serial line"), "i2c": N_("the IMU"), "gpio": N_("the pins")}
THROTTLED_FILE = "sys/devices/platform/soc/soc:firmware/get_throttled"
THROTTLE_BITS = {
    0: N_("under 4.63 V now"),
    1: N_("clock capped now"),
    2: N_("throttled now"),
    3: N_("hot now"),
    16: N_("was under 4.63 V"),
    17: N_("clock was capped"),
    18: N_("was throttled"),
    19: N_("was hot"),
}
MODEL_FILE = "proc/device-tree/model"
MAX_TEMPERATURE_C = 75.0  # the Pi slows down at 80
MIN_YEAR = 2025  # without a clock battery and a network, the date of a Pi is in the past
JITTER_HZ = 100.0
POSIX, LINUX = sys.platform != "win32", sys.platform == "linux"
Notify = Callable[[str], object]


def examine(
    hardware: "Hardware", root: Path, runs: Path, jitter_s: float = 0.0, notify: Notify = lambda text: None
) -> Report:
    """Run all checks, hardware first, and return the report. A missing or faulty device is reported, not raised."""
    report = Report()
    for part_checks in (
        lambda: check_uno(hardware.port, hardware.least_battery_v),
        lambda: check_imu(hardware, root),
        lambda: [
            Check(
                N_("IMU bus recovery"),
                *check_bus_recovery(f"/dev/i2c-{hardware.imu_bus:.0f}", root / MODEL_FILE),
            )
        ],
        lambda: check_groups(root),
        lambda: check_power(root),
        lambda: check_temperature(root),
        lambda: check_governor(root),
        lambda: check_disk(runs, hardware.least_disk_mb),
        lambda: check_clock(),
        lambda: check_realtime(),
        lambda: check_jitter(jitter_s, notify) if jitter_s > 0.0 else iter(()),
    ):
        report.checks += part_checks()
    return report


def check_imu(hardware: "Hardware", root: Path) -> Iterator[Check]:
    """Open the IMU of [robot], and yield the checks made during two seconds."""
    from baqueano.robot.imu import driver as imu_driver

    bus = f"dev/i2c-{hardware.imu_bus:.0f}"
    if not (root / bus).exists() and not (root / MODEL_FILE).exists():
        yield Check(
            "IMU", "unknown", _("/{bus} is missing on this machine: it is not a Raspberry Pi", bus=bus)
        )
        return
    try:
        chip = imu_driver.start_imu(hardware, None)
    except BaqueanoError as error:
        yield Check("IMU", "bad", _("none answers"), str(error))
        return
    try:
        yield from imu_checks(chip, time.sleep)
    finally:
        chip.close()


def imu_checks(chip: Any, wait: Callable[[float], object], seconds: float = 2.0) -> Iterator[Check]:
    """Yield the checks of chip, bus, rate, noise and self-test of a running IMU."""
    identity, samples = chip.identity, []
    for _poll in range(round(seconds / 0.02)):
        wait(0.02)
        samples += chip.read()
    figures = {name: getattr(identity, name) for name in ("chip", "who_am_i", "address", "path")}
    finding = _("{chip}, WHO_AM_I 0x{who_am_i:02X} at 0x{address:02X} on {path}", **figures)
    yield Check("IMU", "warn" if identity.warnings else "ok", finding, "; ".join(identity.warnings))
    yield _bus_check(chip)
    if not samples:
        finding, remedy = _("no sample in {seconds:g} s", seconds=seconds), _("Check its four wires")
        yield Check(N_("IMU rate"), "bad", finding, remedy)
        return
    yield _rate_check(chip)
    yield from check_noise(samples)
    yield self_test_check(chip, wait)


def _bus_check(chip: Any) -> Check:
    """Return the check of the bus: its speed, and the share of the time in which it is busy."""
    identity = chip.identity
    share = chip.settings.rate_hz * identity.burst_s
    figures = {"burst_s": 1000.0 * identity.burst_s, "bus_hz": identity.bus_hz / 1000.0}
    return Check(
        N_("IMU bus"),
        "ok" if identity.bus_hz > 200e3 else "warn" if share < 0.7 else "bad",
        _("14 bytes in {burst_s:.2f} ms: {bus_hz:.0f} kHz or more", **figures),
        _(
            "dtparam=i2c_arm_baudrate=400000 and core_freq=250 in /boot/firmware/config.txt: "
            "baqueano robot setup does it"
        ),
    )


def _rate_check(chip: Any) -> Check:
    """Return the check of the rate of the samples, and of the calls and samples that were lost."""
    relative_error = chip.rate_hz / chip.settings.rate_hz - 1.0
    failures, clock = chip.counts.overflows + chip.counts.failures, chip.clock
    return Check(
        N_("IMU rate"),
        "ok" if abs(relative_error) < 0.05 and not failures and not clock.contradiction_count else "warn",
        _(
            "{rate_hz:.2f} ± {rate_error_hz:.2f} Hz of {rate_hz2} ({off:+.1%}), timestamps within "
            "{phase_error_ns:.1f} ms; {failed} calls failed or overflowed, samples were lost {slips} times",
            rate_hz=chip.rate_hz,
            rate_error_hz=clock.rate_error_hz,
            rate_hz2=chip.settings.rate_hz,
            off=relative_error,
            phase_error_ns=1e-06 * clock.phase_error_ns,
            failed=failures,
            slips=clock.contradiction_count,
        ),
        _("Shorten its wires, and twist SDA with ground; the clock of a chip may have an error of 4 %"),
    )


def self_test_check(chip: Any, wait: Callable[[float], object]) -> Check:
    """Return the check of the chip's self-test, in which the chip deflects each axis."""
    from baqueano.robot.imu.self_test import self_test

    try:
        axes = self_test(chip, wait).axes
    except BaqueanoError as error:
        return Check(N_("IMU self-test"), "unknown", str(error))
    failed_axes = [
        _(
            "{name} {response:.2f} of {trim:.2f} {unit}",
            name=_(a.name),
            response=a.response,
            trim=a.trim,
            unit=a.unit,
        )
        for a in axes
        if a.has_passed is False
    ]
    silent_count = sum(a.has_passed is None for a in axes)
    ratios = _(
        "{good} of 6 axes respond as in the factory, which did not store a code for {silent}",
        good=6 - silent_count - len(failed_axes),
        silent=silent_count,
    )
    return Check(
        N_("IMU self-test"),
        "warn" if failed_axes else "ok",
        "; ".join([ratios, *failed_axes]),
        _("It is a clone, or a damaged chip"),
    )


def check_noise(samples: "list[Sample]") -> Iterator[Check]:
    """Yield the check of the IMU's scatter at rest, and a check of its scale if gravity is wrong by over 10 %."""
    import numpy as np

    from baqueano.robot.workshop.floor_tests import STILL_M_S2, STILL_RAD_S
    from baqueano.signals import STANDARD_GRAVITY

    accel, gyro = np.array([s.accel for s in samples]), np.array([s.gyro for s in samples])
    noise_a, noise_g = float(accel.std(axis=0).max()), float(gyro.std(axis=0).max())
    gravity = float(np.linalg.norm(accel.mean(axis=0)))
    yield Check(
        N_("IMU noise"),
        "ok" if noise_a < STILL_M_S2 and noise_g < STILL_RAD_S else "warn",
        _(
            "{noise_a:.3f} m/s², {noise_g:.3f} °/s; measures {size:.2f} m/s²",
            noise_a=noise_a,
            noise_g=np.degrees(noise_g),
            size=gravity,
        ),
        _(
            "Put the vehicle on a floor where nobody walks. If it is at rest, the chip or its supply is "
            "faulty"
        ),
    )
    if abs(gravity / STANDARD_GRAVITY - 1.0) > 0.1:
        yield Check(
            N_("IMU scale"),
            "bad",
            _("{size:.2f} m/s² at rest; expected 9.81 ± 10 %", size=gravity),
            _("Replace the IMU"),
        )


def check_groups(root: Path) -> Iterator[Check]:
    """Yield a check of this user's membership for each group that is allowed to open devices of the vehicle."""
    names: dict[int, str] = {}
    with suppress(OSError):
        for line in (root / "etc/group").read_text(encoding="utf-8", errors="replace").splitlines():
            name, _mark, gid, *_rest = [*line.split(":"), "", ""]
            names |= {int(gid): name} if gid.isdecimal() else {}  # a line of NIS is "+:::"
    own_groups = {names.get(gid) for gid in os.getgroups()} if POSIX else set()
    for group, device in DEVICE_GROUPS.items():
        if group not in names.values():
            yield Check(f"group {group}", "unknown", _("this group does not exist on this machine"))
        elif group in own_groups or (POSIX and os.geteuid() == 0):
            yield Check(f"group {group}", "ok", _("this user is allowed to open {what}", what=_(device)))
        else:
            yield Check(
                f"group {group}",
                "bad",
                _("this user is not in the group: {what} cannot be opened", what=_(device)),
                _("Type: sudo usermod -aG {group} $USER, and log in again", group=group),
            )


def check_power(root: Path) -> Iterator[Check]:
    """Check the Raspberry Pi's report about its supply voltage since it started."""
    try:
        bits = int((root / THROTTLED_FILE).read_text(encoding="utf-8"), 16)
    except (OSError, ValueError):
        yield Check(N_("supply"), "unknown", _("this machine does not report it (a Raspberry Pi does)"))
        return
    causes = [_(text) for bit, text in THROTTLE_BITS.items() if bits >> bit & 1]
    yield Check(
        N_("supply"),
        "bad" if bits & 0xF else "warn" if causes else "ok",
        ", ".join(causes) or _("never under 4.63 V"),
        _("Use a supply of 5.1 V and 2.5 A with short thick wires, separate from the motors' battery"),
    )


def check_temperature(root: Path) -> Iterator[Check]:
    """Check the temperature of the computer."""
    try:
        celsius = int((root / "sys/class/thermal/thermal_zone0/temp").read_text(encoding="utf-8")) / 1000.0
    except (OSError, ValueError):
        yield Check(N_("temperature"), "unknown", _("this machine does not report it"))
        return
    yield Check(
        N_("temperature"),
        "ok" if celsius < MAX_TEMPERATURE_C else "warn",
        f"{number(celsius):.0f} °C",
        _("Add a heat sink, or a fan"),
    )


def check_governor(root: Path) -> Iterator[Check]:
    """Check the governor of the processor's clock: a clock that changes delays ticks."""
    try:
        mode = (
            (root / "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
            .read_text(encoding="utf-8")
            .strip()
        )
    except OSError:
        yield Check(N_("governor"), "unknown", _("this machine does not report it"))
        return
    yield Check(
        N_("governor"),
        "ok" if mode == "performance" else "warn",
        mode,
        _(
            "The service sets performance; by hand: echo performance | sudo tee "
            "/sys/devices/system/cpu/cpu*/cpufreq/scaling_governor"
        ),
    )


def check_disk(runs: Path, min_mb: float) -> Iterator[Check]:
    """Check the free disk space for runs: a run at 100 Hz needs about 4 MB per minute."""
    folder = next(p for p in (runs.absolute(), *runs.absolute().parents) if p.exists())
    free_mb = shutil.disk_usage(folder).free / 1e6
    yield Check(
        N_("disk"),
        "bad" if free_mb < min_mb else "warn" if free_mb < 5 * min_mb else "ok",
        _(
            "{free_mb:.0f} MB free at {place}; a drive needs at least {least_mb:g} MB",
            free_mb=free_mb,
            place=folder,
            least_mb=min_mb,
        ),
        _("Delete old runs"),
    )


def check_clock(now_s: Callable[[], float] = time.time) -> Iterator[Check]:
    """Check that the clock is set: the year must be MIN_YEAR or later."""
    year = time.gmtime(now_s()).tm_year
    text = time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(now_s()))
    yield Check(
        N_("clock"),
        "ok" if year >= MIN_YEAR else "warn",
        text,
        _(
            "The clock is not set, and runs are named by it. baqueano robot setup sets it to the "
            "laptop's time"
        ),
    )


def check_realtime() -> Iterator[Check]:
    """Check if this user is allowed to use the real-time priority that a control loop needs."""
    from baqueano.robot.service.realtime import PRIORITY

    if not LINUX:
        yield Check(N_("real time"), "unknown", _("this system does not support SCHED_FIFO"))
        return
    previous = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        os.sched_setscheduler(0, *previous)
        yield Check(N_("real time"), "ok", _("SCHED_FIFO {priority} is granted", priority=PRIORITY))
    except OSError as error:
        yield Check(
            N_("real time"),
            "warn",
            _(
                "SCHED_FIFO {priority} is not granted to this user ({strerror})",
                priority=PRIORITY,
                strerror=error.strerror,
            ),
            _("The service receives it from systemd (baqueano robot setup); this user does not need it"),
        )


def check_jitter(seconds: float, notify: Notify = lambda text: None) -> Iterator[Check]:
    """Check the wake-up delays of a loop of 100 Hz, with real-time priority if this user is allowed to use it."""
    import numpy as np

    from baqueano.robot.service.realtime import PRIORITY

    is_granted, previous = False, None
    if LINUX:
        previous = os.sched_getscheduler(0), os.sched_getparam(0)
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
            is_granted = True
    notify(_("measures the wake-up error of a 100 Hz loop for {seconds:g} s", seconds=seconds))
    try:
        late_us = tick_delays(seconds)
    finally:
        if is_granted and previous is not None:
            os.sched_setscheduler(0, *previous)
    p50, p99, max_us = (float(x) for x in np.percentile(late_us, [50, 99, 100]))
    yield Check(
        N_("jitter"),
        "ok" if p99 < 1000.0 else "warn" if p99 < 5000.0 else "bad",
        ("SCHED_FIFO" if is_granted else _("no real-time priority"))
        + _(
            ": p50 {p50:.0f} µs, p99 {p99:.0f} µs, at most {worst:.0f} µs of {ticks} ticks",
            p50=p50,
            p99=p99,
            worst=max_us,
            ticks=len(late_us),
        ),
        _(
            "With the service's priority the delay is smaller: sudo baqueano robot doctor --jitter. If "
            "not, another program keeps the processor busy"
        ),
    )


def tick_delays(seconds: float) -> list[float]:
    """Return the delay [µs] of each wake-up of a loop with 100 absolute deadlines per second."""
    period = round(1e9 / JITTER_HZ)
    start_ns, delays = time.monotonic_ns(), []
    for tick in range(1, round(seconds * JITTER_HZ) + 1):
        due = start_ns + tick * period
        time.sleep(max(0.0, (due - time.monotonic_ns()) * 1e-9))
        delays.append((time.monotonic_ns() - due) / 1e3)
    return delays
