"""Monitor an IMU by its samples and errors, and report each event once, when it begins.

The last bits of a sensor always change: at ±4 g and 44 Hz the accelerometer's noise is 27 LSB. Six equal consecutive
words can occur by chance at the narrowest filter (5 Hz: about one time in a thousand). Twenty cannot: the
probability is 10⁻⁶⁰.
"""

import errno
from typing import Any

from baqueano.diagnostics import Severity, note
from baqueano.messages.language import mark as N_, translate as _
from baqueano.robot.imu.i2c import is_stuck_low
from baqueano.robot.imu.settings import SECOND, Counts, ImuEvent, ImuSettings

Row = tuple[int, ...]  # raw words: accelerometer, temperature, gyro

SILENCE_NS = SECOND // 2
MAX_CALL_NS = SECOND // 10
MIN_ROWS = 20
REPORT_PERIOD_S = 0.1
FULL_SCALE = 32767
AXES = (
    N_("accelerometer x"),
    N_("accelerometer y"),
    N_("accelerometer z"),
    N_("gyro x"),
    N_("gyro y"),
    N_("gyro z"),
)
ERROR_NAMES = {
    errno.EREMOTEIO: N_("no answer"),
    errno.ENXIO: N_("no answer"),
    errno.EIO: N_("interrupted"),
    errno.ETIMEDOUT: N_("timed out"),
    errno.EAGAIN: N_("arbitration lost"),
}


class ImuWatch:
    """A monitor that evaluates the samples of each call; `last_ns` is the time of the last good sample."""

    def __init__(self, settings: ImuSettings, counts: Counts, now_ns: int) -> None:
        self.silent = False
        self.is_frozen = False
        self.last_ns = self._last_call_ns = now_ns
        self.rounds = 0  # restarts that this silence has requested, at 0.5 s, 1.5 s, …
        self._quiet_ns = 0
        self._counts = counts
        self._settings = settings
        self._rows = max(MIN_ROWS, round(REPORT_PERIOD_S * settings.rate_hz))
        self._last: Row = ()
        self._repeated_count = 0
        self._at_end = [0] * 6  # consecutive rows, per axis
        self._any_at_end = False
        self._error: Exception | None = None
        self.bus_stuck = False  # found by the last transfer
        self._events: list[ImuEvent] = []

    def record_event(self, now_ns: int, code: str, **figures: Any) -> None:
        """Record an event with this code and these values."""
        self._events.append(ImuEvent(now_ns, note(code, Severity.WARNING, **figures)))

    def pop_events(self) -> list[ImuEvent]:
        """Return the recorded events and clear them."""
        events, self._events = self._events, []
        return events

    def record_failure(self, now_ns: int, error: Exception) -> None:
        """Record a transfer that failed although it was repeated, and report a bus that is newly stuck."""
        self._error = error
        is_bus_stuck = isinstance(error, OSError) and is_stuck_low(error)
        if is_bus_stuck and not self.bus_stuck:
            self.record_event(now_ns, "imu.held")
        self.bus_stuck = is_bus_stuck

    def check_rows(self, now_ns: int, rows: list[Row]) -> tuple[list[bool], bool]:
        """Return a mask of the rows to use, one bool per row, and True if the chip must be started again."""
        is_kept, is_broken = [], False
        for row in rows:
            is_same, is_repeating = self._repeats(now_ns, row)
            is_broken = is_broken or is_repeating
            is_kept.append(not (is_same and self.is_frozen))
            if self._any_at_end or max(row) >= FULL_SCALE or min(row) <= -FULL_SCALE:
                self._count_saturation(now_ns, row)
        kept_count = sum(is_kept)
        self._counts.samples += kept_count
        self._counts.repeated_samples += len(rows) - kept_count
        return is_kept, self._update_silence(now_ns, kept_count > 0) or is_broken

    def _update_silence(self, now_ns: int, has_answered: bool) -> bool:
        """Measure the time without good samples; return True if the chip must be started again.

        Of the time since the last call, at most 0.1 s is added.
        """
        span_ns = min(now_ns - self._last_call_ns, MAX_CALL_NS)
        self._last_call_ns = now_ns
        if has_answered:
            if self.silent:
                gap_s = (now_ns - self.last_ns) / SECOND
                self.record_event(now_ns, "imu.answers-again", silent_s=gap_s)
            self.silent, self.last_ns, self.bus_stuck, self._error = False, now_ns, False, None
            self._quiet_ns = self.rounds = 0
            return False
        self._quiet_ns += span_ns
        if self._quiet_ns < SILENCE_NS + self.rounds * SECOND:
            return False
        self.rounds += 1
        if not self.silent:
            self.silent = True
            cause_text = f": {error_reason(self._error)}" if self._error else ""
            self.record_event(now_ns, "imu.data-missing", silent_s=SILENCE_NS / SECOND, cause=cause_text)
        return True

    def _repeats(self, now_ns: int, row: Row) -> tuple[bool, bool]:
        """Return two flags; the first is True for a row that equals the last row or is all zero.

        The second flag is True once: for the row with which so many such rows have arrived that the chip is faulty.
        """
        is_same = (row[:3] == self._last[:3] and row[4:] == self._last[4:]) or not (
            any(row[:3]) or any(row[4:])
        )
        self._last = row
        if not is_same:
            self.is_frozen, self._repeated_count = False, 0
            return False, False
        self._repeated_count += 1
        if self.is_frozen or self._repeated_count < self._rows:
            return True, False
        self.is_frozen = True
        self.record_event(now_ns, "imu.frozen", count=self._repeated_count)
        return True, True

    def _count_saturation(self, now_ns: int, row: Row) -> None:
        """Count the rows with an axis at the end of its range, and report such an axis after 0.1 s.

        The temperature is not tested.
        """
        six = (*row[:3], *row[4:])
        at_end = [abs(value) >= FULL_SCALE for value in six]
        self._any_at_end = any(at_end)
        self._counts.full_scale_samples += self._any_at_end
        for axis in range(6):
            self._at_end[axis] = self._at_end[axis] + 1 if at_end[axis] else 0
            if self._at_end[axis] == self._rows:
                self.record_event(now_ns, "imu.saturated", axis=AXES[axis], range=self._range_text(axis))

    def _range_text(self, axis: int) -> str:
        s = self._settings
        return f"±{s.accel_range_g} g" if axis < 3 else f"±{s.gyro_range_dps} °/s"


def error_reason(error: Exception | None) -> str:
    """Return the error as a short text in the current language."""
    if isinstance(error, OSError):
        return f"{_(ERROR_NAMES.get(error.errno or 0, N_('failed')))} ({error})"
    return str(error)
