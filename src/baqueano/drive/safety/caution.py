"""Slow down a vehicle while its estimate is unreliable, and stop it if this lasts.

  unreliable = a sensor is DEGRADED, or σ > SLOW_SHARE · max_position_std_m of the supervisor                (1)
  pace       = SLOW while it is unreliable, 0 after WAIT_S of a severe case, 1 again afterwards              (2)
  stop       after REST_S at pace 0 in a severe case                                                        (3)

The monitor (monitor/) sets a sensor DEGRADED. If the monitor cannot decide if the sensor or the model is wrong, the
case is not severe: the vehicle only slows down. A model that is certainly wrong does not make the estimate unreliable.
"""

from baqueano.diagnostics import Diagnostic, Severity, StopReason, merge_diagnostics, note, stop
from baqueano.drive.observers import EventLine, Observer
from baqueano.drive.safety.paced_guide import PacedGuide
from baqueano.guides import DriveTo
from baqueano.loop import Blocks, Record
from baqueano.monitor.findings import MODEL, SENSOR
from baqueano.signals import seconds
from baqueano.supervisor import position_std

SLOW, WAIT_S, REST_S = 0.5, 3.0, 1.0
SLOW_SHARE = 0.7
SOURCE = WHO = "caution"


class Caution(Observer):
    """Observer of one drive; the supervisor stops the vehicle at the position uncertainty `max_std_m` [m].

    If `is_watching` is False, the observer only wraps the guide, so that the driver can set its pace
    (door/mission/gain_changes.py).
    """

    def __init__(
        self, max_std_m: float = float("inf"), is_watching: bool = True, lead_in: DriveTo | None = None
    ) -> None:
        self._max_std_m, self._is_watching, self._lead_in = max_std_m, is_watching, lead_in
        self._guide: PacedGuide | None = None
        self._reason: Diagnostic | None = None
        self._is_grave = False
        self._since_ns = 0
        self._lines: list[EventLine] = []

    def begin(self, blocks: Blocks) -> Blocks:
        """Return the blocks with the guide wrapped, so that its pace can be set."""
        self._guide = PacedGuide(blocks.guide, self._lead_in)
        return blocks._replace(guide=self._guide)

    def on_record(self, record: Record) -> None:
        """Set the pace of the guide from the next tick on.  (2)"""
        assert self._guide is not None
        t_ns = record.tick.t_ns
        reason, is_grave = self._unreliability(record)
        if is_grave != self._is_grave:
            self._since_ns = t_ns
        if (reason is None) != (self._reason is None):
            code = "caution.over" if reason is None else "caution.slow"
            level = Severity.INFO if reason is None else Severity.WARNING
            self._lines.append((SOURCE, str(level), note(code, level, cause=reason or self._reason)))
        self._reason, self._is_grave = reason, is_grave
        is_standing = is_grave and seconds(t_ns, self._since_ns) >= WAIT_S
        self._guide.set_pace(WHO, 1.0 if reason is None else 0.0 if is_standing else SLOW)

    def stop_reason(self, t_ns: int) -> Diagnostic | None:
        """Return the reason to stop the vehicle, or None to continue.  (3)"""
        if not self._is_grave or seconds(t_ns, self._since_ns) < WAIT_S + REST_S:
            return None
        return stop(StopReason.ESTIMATE_DOUBTFUL, cause=self._reason)

    def events(self) -> list[EventLine]:
        """Return the new messages about the beginning and the end of slow driving, with the reason."""
        lines, self._lines = self._lines, []
        return lines

    def _unreliability(self, record: Record) -> tuple[Diagnostic | None, bool]:
        """Return why the estimate is unreliable, or None, and True in a severe case.  (1)"""
        if not self._is_watching:
            return None, False
        slow_std_m, cov = SLOW_SHARE * self._max_std_m, record.estimate.cov
        if not cov.item(0) + cov.item(7) <= slow_std_m * slow_std_m:  # σ² ≤ p_xx + p_yy
            std_m = float(position_std(cov))
            if std_m > slow_std_m:
                return note("caution.uncertain", Severity.WARNING, std_m=std_m, max_m=self._max_std_m), True
        if not record.sensor_findings:
            return None, False
        findings = [finding for finding in record.sensor_findings if finding.faulty_part != MODEL]
        return merge_diagnostics(finding.diagnostic for finding in findings), any(
            finding.faulty_part == SENSOR for finding in findings
        )
