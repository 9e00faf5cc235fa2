"""Monitor the agreement of the model with the vehicle, and of the sensors with the model.

The filter predicts every measurement and the variance of its error:

  NIS = mean over the last WINDOW_S of min(yᵀ S⁻¹ y / m, OUTLIER_SIGMA²)                                 (1)

y are the innovations with their covariance S, m the number of values that arrived in a tick. A filter that fits its
vehicle has NIS = 1. Above MAX_NIS the innovations are √2 times as large as predicted: the vehicle no longer fits the
identified model. For example, it is worn, loaded, on another floor, or its IMU is loose. This is reported once per run;
only the supervisor stops the motors. The monitor (monitor/) reports which channel disagrees, and for how long.
The report at the end states if the run left the envelope of the fit, and the number of rejected readings per channel.
"""

from collections import deque
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
from baqueano.signals import Estimate, Tick, seconds
from baqueano.vehicle_file.envelope import Envelope, EnvelopeMonitor

WINDOW_S = 5.0
MAX_NIS = 2.0
OUTLIER_SIGMA = 5.0  # standard deviations: limits the effect of a single outlier
SOURCE = "model"
SENSORS_SOURCE = "sensors"
EventLine = tuple[str, str, Diagnostic]  # source, level, message of an event


def degraded_note(degraded_sensors: tuple[Finding, ...]) -> Diagnostic | None:
    """Return the degraded sensors of a tick as one message, None if no sensor is degraded."""
    return merge_diagnostics(finding.diagnostic for finding in degraded_sensors)


class Health:
    """A monitor of model and sensors during one run; `envelope` is the range that the fit covered."""

    def __init__(self, envelope: Envelope | None = None, sensors: SensorMonitor | None = None) -> None:
        self._watch = EnvelopeMonitor(envelope)
        self._sensors = sensors
        self._window: deque[tuple[int, float]] = deque()
        self._sum = 0.0
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
            self._reset_window()
        message = self.misfit_message(tick.t_ns, estimate)
        model = [] if message is None else [(SOURCE, "warning", message)]
        return [
            *model,
            *((SENSORS_SOURCE, str(notice.message.severity), notice.message) for notice in notices),
        ]

    def _reset_window(self) -> None:
        self._window.clear()
        self._sum = 0.0

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
        self._window.append((t_ns, min(square, OUTLIER_SIGMA**2)))
        self._sum += self._window[-1][1]
        if seconds(t_ns, self._window[0][0]) < WINDOW_S:
            return None
        while seconds(t_ns, self._window[0][0]) >= WINDOW_S:
            self._sum -= self._window.popleft()[1]
        nis = self._sum / max(1, len(self._window))
        if nis <= MAX_NIS:
            return None
        self.is_reported = True
        fix = "baqueano identify last"
        return note("model.fits-no-longer", Severity.WARNING, fix, window_s=WINDOW_S, ratio=np.sqrt(nis))


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
