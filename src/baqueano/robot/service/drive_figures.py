"""Report the losses of a drive as the last lines of its run: missed ticks, and losses of the Uno and the IMU."""

from dataclasses import asdict, astuple, dataclass
from typing import Any

from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.robot.imu.settings import Counts
from baqueano.robot.uno.statistics import Statistics

LINE_COUNTS = (
    "sent_commands", "unsent_commands", "received_frames", "lost_frames", "late_frames", "damaged_frames", "resets",
)  # fmt: skip
WARNING_COUNTS = tuple(name for name in LINE_COUNTS if name not in ("sent_commands", "received_frames"))
EventLine = tuple[str, Diagnostic]  # level, message


@dataclass
class TickDelays:
    """The delays of the ticks [ms], and the number of missed ticks."""

    worst_ms: float = 0.0
    late_ticks: int = 0  # ticks delayed by more than half a period
    skipped_ticks: int = 0
    ticks: int = 0
    now_ms: float = 0.0  # delay of the last tick

    def record_tick(self, delay_ms: float, max_delay_ms: float, skipped_ticks: int) -> None:
        """Record the delay of a tick, which is late above `max_delay_ms`, and the ticks skipped so far."""
        self.ticks, self.skipped_ticks = self.ticks + 1, skipped_ticks
        self.now_ms, self.worst_ms = delay_ms, max(self.worst_ms, delay_ms)
        self.late_ticks += delay_ms > max_delay_ms

    def event_line(self) -> EventLine:
        """Return the delays as a line of the run, which is a warning if ticks were missed."""
        return _event_line(
            "drive.ticks",
            bool(self.skipped_ticks),
            **{n: x for n, x in asdict(self).items() if n != "now_ms"},
        )


def line_losses(previous: Statistics, current: Statistics, stop_cause: Diagnostic | None = None) -> EventLine:
    """Return the losses on the serial line since `previous`; a warning for any loss, or for `stop_cause` of the Uno."""
    counts = current.since(previous, *LINE_COUNTS)
    n: dict[str, int] = dict(zip(LINE_COUNTS, counts, strict=True))
    if stop_cause is not None:
        return _event_line("drive.line-stopped", is_warning=True, **n, cause=stop_cause)
    return _event_line("drive.line", any(n[name] for name in WARNING_COUNTS), **n)


def uno_losses(previous: Statistics, current: Statistics) -> EventLine:
    """Return the Uno's counts since `previous`; a warning if it lost bytes, or frames were damaged or ignored."""
    frames, damaged_frames, ignored_frames, lost_bytes = current.since(
        previous, "written_frames", "rejected_frames", "ignored_frames", "overrun_bytes"
    )
    return _event_line(
        "drive.uno", bool(damaged_frames or ignored_frames or lost_bytes), received_frames=frames,
        damaged_frames=damaged_frames,
        damage_percent=100.0 * damaged_frames / max(1, frames), ignored_frames=ignored_frames, lost_bytes=lost_bytes,
    )  # fmt: skip


def imu_losses(previous: Counts, current: Counts) -> EventLine:
    """Return the IMU's counts of samples and faults since `previous`; a warning if there was a fault."""
    n = Counts(
        *(
            new_count - old_count
            for old_count, new_count in zip(astuple(previous), astuple(current), strict=True)
        )
    )
    has_losses = (
        n.full_scale_samples or n.repeated_samples or n.retries or n.failures or n.overflows or n.restarts
    )
    return _event_line("drive.imu", bool(has_losses), **asdict(n))


def _event_line(code: str, is_warning: bool, **figures: Any) -> EventLine:
    level = Severity.WARNING if is_warning else Severity.INFO
    return str(level), note(code, level, **figures)
