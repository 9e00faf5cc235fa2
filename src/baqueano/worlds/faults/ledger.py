"""Record, for each fault of a drive, the checks that detected the fault and when, and the reason if none did.

  monitor      reports a sensor that disagrees (monitor/)
  model        the model no longer agrees with the readings, over 5 s (drive/health.py)
  supervisor   stops the vehicle
  gate         the weight of MIN_REFUSALS innovations within WINDOW_S was below one half
  nis          Σ yᵀS⁻¹y over WINDOW_S exceeds the value that k correct innovations exceed once in 10⁴ windows:
               k (1 − 2/9k + Z √(2/9k))³ (Wilson and Hilferty), and MIN_NIS_RATIO times its mean before the fault (1)

A notice belongs to the last fault that began, or to the fault of the sensor that the monitor names. A notice can also
arrive up to COVER_AFTER_S after the end of its fault.
"""

from collections import deque
from dataclasses import dataclass, field
from math import isfinite, sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.blocks import Estimator
from baqueano.diagnostics import Diagnostic, note
from baqueano.monitor.sensor_monitor import innovation_channels
from baqueano.sensors.sampling import measures_pose
from baqueano.signals import seconds
from baqueano.worlds.faults.fault import CHANNEL_KINDS, SENSOR_KINDS, SOURCE, Fault

if TYPE_CHECKING:
    from baqueano.runs.run import Run
    from baqueano.vehicle_file.file import VehicleFile

WITNESSES = ("monitor", "model", "supervisor", "gate", "nis")
SOURCE_WITNESSES = {"sensors": "monitor", "model": "model", "loop": "supervisor"}
COVER_AFTER_S, WINDOW_S, KEEP_BEFORE_S = 2.0, 1.0, 5.0
MIN_REFUSALS, Z, MIN_NIS_RATIO = 3, 3.72, 1.3
MIN_INNOVATIONS = 6  # innovations in a window
MIN_LASTED_S = 1.0  # duration of a fault after which a missing notice counts
WHEELS = ("wheels", "encoders", "odometer")


class LedgerNotice(NamedTuple):
    """A check that detected a fault, with its delay and its message."""

    witness: str  # name of the check, one of WITNESSES
    after_s: float
    message: Diagnostic


@dataclass
class LedgerRow:
    """A fault, the checks that detected it, and the error of the estimate."""

    number: int
    fault: Fault
    message: Diagnostic
    until_s: float
    notices: list[LedgerNotice] = field(default_factory=list)
    worst_nis: float = float("nan")  # largest mean over a window, while the fault lasted
    error_m: float = float("nan")  # of the estimate at the end of the watched time
    bound_m: float = float("nan")  # 1.96 standard deviations of the position at that time

    def includes(self, t_s: float) -> bool:
        """Return True if a notice at `t_s` can belong to this fault."""
        return self.fault.start_s <= t_s <= self.until_s + COVER_AFTER_S

    def silent_witnesses(self) -> tuple[str, ...]:
        """Return the names of the checks that did not detect the fault."""
        return tuple(
            witness for witness in WITNESSES if witness not in [notice.witness for notice in self.notices]
        )


class Ledger:
    """The faults of one drive and the checks that detected them, filled from its events and ticks in order.

    Parameters
    ----------
    vehicle_file : VehicleFile
        The vehicle that drives.
    estimator : Estimator, optional
        The estimator of the drive; by default the estimator of the file.

    Examples
    --------
    >>> from baqueano.drive import experiment
    >>> robot = bq.load("small")
    >>> u = np.tile([0.6, 0.0, 0.1], (500, 1))
    >>> run = experiment(robot, u, shake=["2-4 s: cut imu"])
    >>> [(row.fault.kind, [notice.witness for notice in row.notices]) for row in fault_ledger(run, robot).rows]
    [('cut', ['supervisor', 'monitor'])]
    """

    def __init__(self, vehicle_file: "VehicleFile", estimator: Estimator | None = None) -> None:
        sensors, self._estimator = vehicle_file.sensors, estimator or vehicle_file.estimator()
        self._sensors = sensors
        self._sources = {
            name: optional.attribute(getattr(sensors, name), "reads") for name in sensors._fields
        }
        self._measures_pose = any(measures_pose(sensor) for sensor in sensors)
        self._used_channels: set[str] | None = None  # channels with an innovation; None before the first
        self.rows: list[LedgerRow] = []
        self.now_s = 0.0
        self._window: deque[tuple[float, float, int]] = deque()
        self._sum, self._count = 0.0, 0
        self._window_means: deque[tuple[float, float]] = deque()  # means of the windows, each WINDOW_S
        self._refusals_s: deque[float] = deque()

    def on_event(self, t_ns: int, source: str, event: "Diagnostic | str") -> None:
        """Record an event of the run: the start or end of a fault, or the notice of a check."""
        if not isinstance(event, Diagnostic):
            return
        t_s = seconds(t_ns)
        if source == SOURCE:
            self._add_fault(event)
        elif (witness := SOURCE_WITNESSES.get(source)) is not None and event.code != "sensor.agrees-again":
            self._add_notice(witness, t_s, event)

    def record_tick(
        self, t_ns: int, y: np.ndarray | None, S: np.ndarray | None, weight: np.ndarray | None,
        eta: np.ndarray, cov: np.ndarray, truth: np.ndarray | None,
    ) -> None:  # fmt: skip
        """Update the test of the innovations `y` (m,), `S` (m, m) and `weight` (m,), and the bound of the position.

        Also update the error of the position, if the true pose `truth` (3,) is known.
        """
        self.now_s = t_s = seconds(t_ns)
        self._test_innovations(t_s, y, S)
        if weight is not None and self.rows:
            self._check_gate(t_s, weight)
        for row in self.rows:
            if row.includes(t_s):
                if truth is not None:
                    row.error_m = float(np.hypot(*(eta[:2] - truth[:2])))
                row.bound_m = 1.96 * sqrt(max(float(np.linalg.eigvalsh(cov[:2, :2])[-1]), 0.0))

    def unnoticed_diagnostic(self, row: LedgerRow) -> Diagnostic | None:
        """Return a message with the reason why no check detected a fault.

        Return None if a check detected the fault, or if the fault is younger than MIN_LASTED_S.
        """
        duration_s = min(self.now_s, row.until_s + COVER_AFTER_S) - row.fault.start_s
        if row.notices or duration_s < MIN_LASTED_S:
            return None
        figures = {"delay_s": duration_s, "nis": row.worst_nis, "reason": self.reason_unnoticed(row.fault)}
        if isfinite(row.error_m) and isfinite(row.bound_m):
            error_diagnostic = note(
                "ledger.estimate-error", error_cm=100.0 * row.error_m, bound_cm=100.0 * row.bound_m
            )
            return note("ledger.undetected-error", subject="nobody", consequence=error_diagnostic, **figures)
        return note("ledger.undetected", subject="nobody", **figures)

    def reason_unnoticed(self, fault: Fault) -> Diagnostic:
        """Return the reason why the checks cannot detect a fault of this kind with these sensors."""
        wheels = any(reads in WHEELS for reads in self._sources.values())
        code = fault.kind
        if (
            self._used_channels is not None
            and fault.kind in CHANNEL_KINDS
            and fault.target not in self._used_channels
        ):
            return note("ledger.why-unused", subject=fault.target)
        if fault.kind == "slip" and wheels:
            code = "slip-wheels"
        if fault.kind == "tilt" and self._measures_pose:
            code = "tilt-pose"
        if fault.kind == "drift":
            other_sensors = [name for name in self._sources if name != fault.target.partition("[")[0]]
            code = "drift-others" if other_sensors else "drift"
        return note(f"ledger.why-{code}", subject=fault.target or fault.kind)

    def _add_fault(self, diagnostic: Diagnostic) -> None:
        number = int(diagnostic.figures["number"])
        if diagnostic.code == "shake.end":
            row = next(row for row in self.rows if row.number == number)
            row.until_s = row.fault.start_s + float(diagnostic.figures["duration_s"])
            return
        fault_ = Fault.from_diagnostic(diagnostic)
        self._window_means = deque(
            pair for pair in self._window_means if pair[0] >= fault_.start_s - KEEP_BEFORE_S
        )
        self.rows.append(LedgerRow(number, fault_, diagnostic, fault_.end_s))
        self._window.clear()  # the entries of an earlier fault do not belong to this one
        self._refusals_s.clear()
        self._sum, self._count = 0.0, 0

    def _add_notice(self, witness: str, t_s: float, diagnostic: Diagnostic) -> None:
        watched_rows = [row for row in self.rows if row.includes(t_s)]
        if not watched_rows:
            return
        name = diagnostic.subject.partition("[")[0]
        sensor_rows = [row for row in watched_rows if row.fault.kind in (*CHANNEL_KINDS, *SENSOR_KINDS)
               and row.fault.target.partition("[")[0] == name]  # fmt: skip
        row = (sensor_rows if witness == "monitor" and sensor_rows else watched_rows)[-1]
        if witness not in [notice.witness for notice in row.notices]:
            row.notices.append(LedgerNotice(witness, t_s - row.fault.start_s, diagnostic))

    def _check_gate(self, t_s: float, weight: np.ndarray) -> None:
        refusals = int(np.sum(weight < 0.5))
        self._refusals_s.extend([t_s] * refusals)
        while self._refusals_s and t_s - self._refusals_s[0] > WINDOW_S:
            self._refusals_s.popleft()
        if refusals and len(self._refusals_s) >= MIN_REFUSALS:
            self._add_notice("gate", t_s, note("ledger.gate", count=len(self._refusals_s), limit_s=WINDOW_S))

    def _channels(self, m: int) -> set[str] | None:
        """Return the names of the channels of m innovations, as "imu[2]"; None if they are unknown."""
        channel_indices = innovation_channels(self._estimator, self._sensors, m)
        names = [f"{n}[{c}]" for n, s in self._sensors._asdict().items() for c in range(s.size)]
        return None if channel_indices is None else {names[c] for c in channel_indices}

    def _test_innovations(self, t_s: float, y: np.ndarray | None, S: np.ndarray | None) -> None:
        """Add the innovations of a tick to the window, and test the sum over the window.  (1)"""
        if y is not None and self._used_channels is None and self._count == 0:
            self._used_channels = self._channels(len(y))
        if y is not None and S is not None and (is_finite := np.isfinite(y)).any():
            innovation = y[is_finite]
            try:
                square = float(innovation @ np.linalg.solve(S[np.ix_(is_finite, is_finite)], innovation))
            except np.linalg.LinAlgError:
                return
            self._window.append((t_s, square, int(is_finite.sum())))
            self._sum, self._count = self._sum + square, self._count + int(is_finite.sum())
        while self._window and t_s - self._window[0][0] > WINDOW_S:
            _, square, m = self._window.popleft()
            self._sum, self._count = self._sum - square, self._count - m
        if self._count < MIN_INNOVATIONS:
            return
        mean, k = self._sum / self._count, self._count
        is_window_full = bool(self._window) and t_s - self._window[0][0] > 0.9 * WINDOW_S
        if is_window_full and (not self._window_means or t_s - self._window_means[-1][0] >= WINDOW_S):
            self._window_means.append((t_s, mean))
        for row in [row for row in self.rows if row.includes(t_s)][-1:]:
            row.worst_nis = mean if not isfinite(row.worst_nis) else max(mean, row.worst_nis)
            earlier_means = [nis for window_s, nis in self._window_means if window_s < row.fault.start_s]
            chance_ratio = (1.0 - 2.0 / (9.0 * k) + Z * sqrt(2.0 / (9.0 * k))) ** 3
            limit = max(chance_ratio, MIN_NIS_RATIO * float(np.mean(earlier_means)) if earlier_means else 0.0)
            if mean > limit:
                self._add_notice("nis", t_s, note("ledger.nis", nis=mean, maximum=limit, window_s=WINDOW_S))


def fault_ledger(run: "Run", vehicle_file: "VehicleFile") -> Ledger:
    """Return the record of the faults of a recorded run.

    A run does not contain the weights of its innovations. So only a `Ledger` that is filled during the drive contains
    notices of the gate.

    Parameters
    ----------
    run : Run
        A drive with faults.
    vehicle_file : VehicleFile
        The vehicle that drove.

    Returns
    -------
    Ledger
        A row for each fault.

    Examples
    --------
    >>> still = bq.simulate(bq.load("small"), np.zeros((20, 3)))
    >>> fault_ledger(still, bq.load("small")).rows
    []
    """
    ledger, log, truth = Ledger(vehicle_file), run.estimate, run.truth
    events = sorted(run.events, key=lambda event: event.t_ns)
    event_index = 0
    for k, t_ns in enumerate([] if log is None else log.t_ns):
        while event_index < len(events) and events[event_index].t_ns <= t_ns:
            ledger.on_event(
                events[event_index].t_ns, events[event_index].source, events[event_index].diagnostic or ""
            )
            event_index += 1
        assert log is not None
        y = None if log.innovation is None else log.innovation[k]
        S = None if log.innovation_cov is None else log.innovation_cov[k]
        true_pose = None if truth is None or k >= len(truth.eta) else truth.eta[k]
        ledger.record_tick(int(t_ns), y, S, None, log.eta[k], log.cov[k], true_pose)
    for event in events[event_index:]:
        ledger.on_event(event.t_ns, event.source, event.diagnostic or "")
    return ledger
