"""Check the conditions before and during a drive: tilt, battery, temperature, free disk space."""

import math
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from baqueano.diagnostics import Diagnostic, StopReason, stop

if TYPE_CHECKING:
    from baqueano.vehicle_file.head import Hardware
    from baqueano.worlds import Robot

TEMPERATURE_FILE = Path("/sys/class/thermal/thermal_zone0/temp")  # of the processor, in thousandths of a °C
READ_PERIOD_S = 1.0  # between two readings of the temperature file
MIN_LOW_S = 2.0  # least duration of a low voltage that is reported: starting motors lower it for a moment


class ComputerHealth:
    """A monitor of tilt, battery, temperature and disk space; `limits` is the table [robot] of the vehicle file."""

    def __init__(
        self,
        limits: "Hardware",
        folder: Path,
        now_ns: Callable[[], int],
        temperature: Path = TEMPERATURE_FILE,
    ) -> None:
        self.limits, self._folder, self._now_ns, self._file = limits, folder, now_ns, temperature
        self.temperature_c = float("nan")
        self._last_check_ns, self._low_since_ns = -(1 << 62), -1

    def start_obstacle(self, world: "Robot") -> Diagnostic | None:
        """Return the reason why a drive is not allowed to begin, such as a full disk; None if it is allowed.

        The space in a folder that was removed is not known: the next drive makes the folder again, or reports it.
        """
        free_mb = math.nan
        with suppress(OSError):
            free_mb = shutil.disk_usage(self._folder).free / 1e6
        if free_mb < self.limits.least_disk_mb:
            return stop(StopReason.DISK_FULL, free_mb=free_mb, min_disk_mb=self.limits.least_disk_mb)
        return self.stop_reason(world)

    def stop_reason(self, world: "Robot") -> Diagnostic | None:
        """Return the reason why a drive must end, or None to continue."""
        now_ns = self._now_ns()
        if now_ns - self._last_check_ns >= READ_PERIOD_S * 1e9:
            self._last_check_ns, self.temperature_c = now_ns, self._temperature_c()
        if world.tilt_rad > self.limits.max_tilt_rad:
            tilt_deg = float(np.degrees(world.tilt_rad))
            return stop(StopReason.TILT, tilt_deg=tilt_deg, max_tilt_rad=self.limits.max_tilt_rad)
        if self.temperature_c > self.limits.max_temperature_c:
            max_c = self.limits.max_temperature_c
            return stop(StopReason.TEMPERATURE, temperature_c=self.temperature_c, max_temperature_c=max_c)
        if self._is_low(world.battery_v, now_ns):
            min_v = self.limits.least_battery_v
            return stop(StopReason.BATTERY, battery_v=world.battery_v, min_battery_v=min_v, low_s=MIN_LOW_S)
        return None

    def _is_low(self, volts: float, now_ns: int) -> bool:
        if not 0.0 < volts < self.limits.least_battery_v:
            self._low_since_ns = -1
        elif self._low_since_ns < 0:
            self._low_since_ns = now_ns
        return self._low_since_ns >= 0 and now_ns - self._low_since_ns >= MIN_LOW_S * 1e9

    def _temperature_c(self) -> float:
        try:
            return int(self._file.read_text(encoding="utf-8")) / 1000.0
        except (OSError, ValueError):
            return float("nan")
