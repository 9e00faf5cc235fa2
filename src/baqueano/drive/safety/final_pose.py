"""Report a drive that does not end at the end of its route, for example after a push on its last metre.

  away if |p_r − p| > MAX_DISTANCE_M or |ψ_r − ψ| > MAX_TURN_RAD           at the tick in which the guide is done   (1)

p, ψ: estimated pose; index r: reference. The controllers end an undisturbed drive within these limits.
"""

from collections.abc import Iterable
from math import degrees, hypot

from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.drive.observers import EventLine, Observer
from baqueano.geometry import wrap
from baqueano.guides.sequence import START_TOLERANCES
from baqueano.loop import Record

MAX_DISTANCE_M, MAX_TURN_RAD = START_TOLERANCES["tolerance_m"], START_TOLERANCES["tolerance_rad"]


class FinalPose(Observer):
    """Observer that compares the last pose of a drive with the end of its route."""

    def __init__(self) -> None:
        self._last: Record | None = None

    def on_record(self, record: Record) -> None:
        """Store the record of the present tick."""
        self._last = record

    def end(self, reason: Diagnostic | None) -> Iterable[EventLine]:
        """Return a warning if the guide is done and the vehicle is outside the limits.  (1)"""
        if reason is not None or self._last is None or not self._last.reference.at_end > 0.0:
            return ()
        x, y, psi = self._last.reference.eta - self._last.estimate.eta
        distance_m, turn_rad = hypot(x, y), abs(wrap(psi))
        if not (distance_m > MAX_DISTANCE_M or turn_rad > MAX_TURN_RAD):
            return ()
        figures = {"distance_cm": 100.0 * distance_m, "turn_deg": degrees(turn_rad)}
        limits = {"max_cm": 100.0 * MAX_DISTANCE_M, "max_deg": degrees(MAX_TURN_RAD)}
        return [("drive", "warning", note("drive.end-beside", Severity.WARNING, **figures, **limits))]
