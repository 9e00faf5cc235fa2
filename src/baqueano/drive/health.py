"""Monitor the agreement of the model with the vehicle, and of the sensors with the model.

The filter predicts every measurement and the variance of its error:

  NIS = mean over the last WINDOW_S of min(yᵀ S⁻¹ y / m, OUTLIER_SIGMA²)                                 (1)

y are the innovations with their covariance S, m the number of values that arrived in a tick. A filter that fits its
vehicle has NIS = 1. Above MAX_NIS the innovations are √2 times as large as predicted: the vehicle no longer fits the
identified model. For example, it is worn, loaded, on another floor, or its IMU is loose. A push is not a misfit of
the model. After a push, innovations are large for half a second. So NIS must be above MAX_NIS without any PUSH_PARTS
successive parts of the window; a part lasts PART_S. This is reported once per run; only the supervisor stops the
motors. The monitor (monitor/) reports which channel disagrees, and for how long. The report at the end states if the
run left the envelope of the fit, and the number of rejected readings per channel.
"""

from collections import deque
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np

from baqueano.diagnostics import Diagnostic, Severity, merge_diagnostics, note
from baqueano.monitor import (
    REJECTIONS_SOURCE,
    Finding,
    Notice,
    SensorMonitor,
    expected_innovation_cov,
    rejection_event,
)
from baqueano.signals import NANOSECONDS, Estimate, Tick
from baqueano.vehicle_file.envelope import Envelope, EnvelopeMonitor

PART_S, PARTS = 0.5, 10  # of the window
PUSH_PARTS = 2  # innovations that are large for half a second are in at most two parts
WINDOW_S = PART_S * PARTS
PART_NS = round(PART_S * NANOSECONDS)
MAX_NIS = 2.0
OUTLIER_SIGMA = 5.0  # standard deviations: limits the effect of a single outlier
SOURCE = "model"
SENSORS_SOURCE = "sensors"
EventLine = tuple[str, str, Diagnostic]  # source, level, message of an event


def degraded_note(degraded_sensors: tuple[Finding, ...]) -> Diagnostic | None:
    """Return the degraded sensors of a tick as one message, None if no sensor is degraded."""
    return merge_diagnostics(finding.diagnostic for finding in degraded_sensors)


@dataclass(slots=True)
class _Part:
    """A part of the window."""

    index: int  # of the part since the time 0
    total: float = 0.0  # of the terms of (1)
    count: int = 0  # of these terms


class Health:
    """A monitor of model and sensors during one run; `envelope` is the range that the fit covered."""

    def __init__(self, envelope: Envelope | None = None, sensors: SensorMonitor | None = None) -> None:
        self._watch = EnvelopeMonitor(envelope)
        self._sensors = sensors
        self._window: deque[_Part] = deque()
        self.is_reported = False

    @property
    def degraded_sensors(self) -> tuple[Finding, ...]:
        """Return the findings about the sensors that are degraded now."""
        return () if self._sensors is None else self._sensors.degraded_sensors

    def events(self, tick: Tick, estimate: Estimate) -> list[EventLine]:
        """Return the events of a tick about the model and the sensors."""
        self.record_ranges(tick)
        notices: list[Notice] = [] if self._sensors is None else self._sensors.update(tick, estimate)
        # readings of a broken sensor do not show if the model fits
        if self._sensors is not None and self._sensors.is_suspect:
            self._window.clear()
        message = self.misfit_message(tick.t_ns, estimate)
        model = [] if message is None else [(SOURCE, "warning", message)]
        return [
            *model,
            *((SENSORS_SOURCE, str(notice.message.severity), notice.message) for notice in notices),
        ]

    def final_events(self) -> list[EventLine]:
        """Return the events at the end of the run: signals outside the envelope, and rejected readings."""
        counts = () if self._sensors is None else self._sensors.rejections
        envelope_lines = [(SOURCE, "warning", message) for message in self.envelope_notes()]
        return [*envelope_lines, *([(REJECTIONS_SOURCE, "info", rejection_event(counts))] if counts else [])]

    def envelope_notes(self) -> tuple[Diagnostic, ...]:
        """Return a message for each command and measurement that left the envelope."""
        return self._watch.range_warnings(note("envelope.this-run"))

    def record_ranges(self, tick: Tick) -> None:
        """Record the commands and measurements of a tick for `envelope_notes`."""
        self._watch.update(tick)

    def misfit_message(self, t_ns: int, estimate: Any) -> Diagnostic | None:
        """Return a message when the model no longer fits, once per run; None otherwise.  (1)"""
        y, S = estimate.innovation, expected_innovation_cov(estimate)
        if self.is_reported or y is None or S is None:
            return None
        try:
            square = normalised_innovation_squared(y.tolist(), S.tolist())
        except ZeroDivisionError:
            return None
        if square is None:
            return None
        index = t_ns // PART_NS
        nis = 0.0
        if not self._window or index > self._window[-1].index:
            nis = self._lasting_nis(index)
            self._window.append(_Part(index))
        part = self._window[-1]
        part.total += min(square, OUTLIER_SIGMA**2)
        part.count += 1
        if nis == 0.0:
            return None
        self.is_reported = True
        fix = "baqueano identify last"
        return note("model.fits-no-longer", Severity.WARNING, fix, window_s=WINDOW_S, ratio=np.sqrt(nis))

    def _lasting_nis(self, index: int) -> float:
        """Return the NIS of the complete window before the part `index`; 0 unless the model no longer fits.  (1)"""
        while self._window and self._window[0].index < index - PARTS:
            self._window.popleft()
        if not self._window or self._window[0].index > index - PARTS:
            return 0.0
        totals, counts = np.array([(part.total, part.count) for part in self._window]).T
        others = [
            np.sum(np.delete((totals, counts), slice(k, k + PUSH_PARTS), 1), 1) for k in range(len(totals))
        ]
        is_lasting = all(total > MAX_NIS * count for total, count in others)
        return float(np.sum(totals) / np.sum(counts)) if is_lasting else 0.0


def normalised_innovation_squared(y: list[float], S: list[list[float]]) -> float | None:
    """Return yᵀ S⁻¹ y / m of the m finite innovations in `y`, None if m is 0.

    `y` (list of n) and `S` (n rows of n) are overwritten. For three values NumPy would take five times as long.
    """
    finite_indices, total = [k for k, value in enumerate(y) if isfinite(value)], 0.0
    for row, k in enumerate(finite_indices, 1):
        total += y[k] * y[k] / S[k][k]
        for i in finite_indices[row:]:
            factor = S[i][k] / S[k][k]
            y[i] -= factor * y[k]
            for j in finite_indices[row:]:
                S[i][j] -= factor * S[k][j]
    return total / len(finite_indices) if finite_indices else None
