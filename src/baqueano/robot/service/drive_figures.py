"""What a drive did to its ticks, to the line of the Uno and to the IMU: last lines of its run, each with its level."""

from dataclasses import astuple, dataclass

from baqueano.robot.imu.settings import Counts
from baqueano.robot.uno.statistics import Statistics

Line = tuple[str, str]  # level, text


@dataclass
class Lateness:
    """How late ticks began [ms], and how many were left out."""

    worst_ms: float = 0.0
    over_half: int = 0  # later than half a period
    missed: int = 0
    ticks: int = 0

    def told(self) -> Line:
        """A warning where ticks were left out."""
        return "warning" if self.missed else "info", (
            f"{self.ticks} ticks: the latest began {self.worst_ms:.1f} ms late, {self.over_half} by more than half a "
            f"period, {self.missed} were left out"
        )


def line_told(before: Statistics, now: Statistics, trouble: str = "") -> Line:
    """What the line lost since `before`; a warning where it was anything. `trouble`: what is wrong with the Uno now."""
    sent, unsent, heard, lost, late, damaged, resets = now.since(
        before, "sent", "unsent", "heard", "lost", "late", "damaged", "resets"
    )
    text = (
        f"the line of the Uno: {sent} commands sent, {unsent} not; {heard} frames heard, {lost} lost, {late} twice or "
        f"too late, {damaged} pieces damaged; {resets} times reset"
    )
    harmed = unsent or lost or late or damaged or resets
    return "warning" if harmed or trouble else "info", f"{text}: {trouble}" if trouble else text


def uno_told(before: Statistics, now: Statistics) -> Line:
    """What the Uno itself counted of all that was sent to it since `before`; a warning where it missed anything."""
    written, spoilt, ignored, overrun = now.since(before, "written", "spoilt", "ignored", "overrun")
    return "warning" if spoilt or ignored or overrun else "info", (
        f"the Uno counted of {written} frames sent to it {spoilt} damaged ({100.0 * spoilt / max(1, written):.1f} %), "
        f"{ignored} not obeyed, and {overrun} bytes lost in its receiver"
    )


def imu_told(before: Counts, now: Counts) -> Line:
    """What the IMU gave since `before`, and what was wrong with it, however briefly; a warning where anything was."""
    n = Counts(*(after - start for start, after in zip(astuple(before), astuple(now), strict=True)))
    harmed = n.saturated or n.withheld or n.retries or n.failures or n.overflows or n.restarts
    return "warning" if harmed else "info", (
        f"the IMU gave {n.samples} samples, {n.saturated} with an axis at the end of its range, and {n.withheld} that "
        f"only repeated the last one, which were left out; {n.retries} transfers were tried again, {n.failures} calls "
        f"gave nothing, its FIFO was emptied {n.overflows} times, it was started anew {n.restarts} times"
    )
