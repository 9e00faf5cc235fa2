"""Monitor the sensors during a drive: derive events, degraded sensors and counts of rejections from the ticks."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from baqueano.contracts.blocks import Estimator, SensorBlocks
from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.errors import error_text, is_interruption
from baqueano.estimators.augmented_ekf import AugmentedEkf
from baqueano.estimators.readings.sensor_numbers import channel_indices, split_use
from baqueano.monitor.agreement import AgreementMonitor
from baqueano.monitor.channel_properties import sensor_name
from baqueano.monitor.findings import LOST, MODEL, Finding, make_finding
from baqueano.monitor.memory import DEGRADED_S, EVENT_S, Memory
from baqueano.monitor.rejections import Rejections
from baqueano.signals import Estimate, Tick, seconds
from baqueano.symbolic import compile_block

# m/s² and rad/s²: with a disturbance of 0, the monitor could not attribute a residual to the model
MIN_DISTURBANCE_STD = 1e-3


class Notice(NamedTuple):
    """A message for the run, and the finding that it reports, if any."""

    message: Diagnostic
    finding: Finding | None = None  # the finding that began or became degraded


class SensorMonitor:
    """Monitor of the sensors during one drive.

    `model` is an AugmentedEkf without sensors in use. `estimator` is the estimator of the drive; `tick` and `estimate`
    are examples of its input and its output. `alternatives` are the models of fit_errors.py.
    """

    def __init__(
        self, model: AugmentedEkf, estimator: Estimator, tick: Tick, estimate: Estimate,
        alternatives: tuple[Tree, ...] = (),
    ) -> None:  # fmt: skip
        m = 0 if estimate.innovation is None else len(estimate.innovation)
        self._channel_indices = innovation_channels(estimator, model.sensors, m)
        self._model = replace(model, disturbance_std=np.maximum(model.disturbance_std, MIN_DISTURBANCE_STD))
        agreement = AgreementMonitor(self._model, self._channel_indices, alternatives)
        self.channels = agreement.channels
        self._block = compile_block(agreement)
        self._block.step(agreement.init(), tick, estimate.innovation, expected_innovation_cov(estimate))
        self._innovations = m
        self.begin()

    def begin(self, *start: np.ndarray) -> None:
        """Begin again, at the pose, or pose and velocity, at which the estimator begins."""
        self._state: Tree = self._block.init(*start)
        self._since_ns: dict[int, int] = {}  # start of the disagreement of each channel
        self._findings: dict[int, Finding] = {}
        self._arrivals, self._refusals = ([0] * self._innovations for _ in range(2))
        self._has_weights = self._has_failed = False

    @property
    def degraded_sensors(self) -> tuple[Finding, ...]:
        """Return the findings of the sensors that are degraded at present."""
        if self._findings:
            return tuple(
                sensor_finding for sensor_finding in self._findings.values() if sensor_finding.is_degraded
            )
        return ()

    @property
    def is_suspect(self) -> bool:
        """Return True if readings of a sensor disagree and the monitor has not decided against the model."""
        if not self._findings:  # in almost every tick
            return False
        return any(f.faulty_part != MODEL and f.symptom != LOST for f in self._findings.values())

    @property
    def rejections(self) -> tuple[Rejections, ...]:
        """Return the counts of rejected readings until now; empty for an estimator that does not report weights."""
        if not self._has_weights:
            return ()
        indices = range(len(self._arrivals)) if self._channel_indices is None else self._channel_indices
        names = [
            f"innovation[{c}]" if self._channel_indices is None else self.channels.names[c] for c in indices
        ]
        return tuple(
            Rejections(name, rejected_count, n)
            for name, rejected_count, n in zip(names, self._refusals, self._arrivals, strict=True)
        )

    def update(self, tick: Tick, estimate: Estimate) -> list[Notice]:
        """Return a notice for each finding that begins, becomes degraded or ends at this tick.

        After an error of the monitor, return one notice with this error, and then none until `begin`.
        """
        if estimate.weight is not None:
            self._has_weights = True
            for k, weight in enumerate(estimate.weight.tolist()):
                self._arrivals[k] += weight == weight
                self._refusals[k] += weight < 0.5
        if self._has_failed:
            return []
        y, S = estimate.innovation, expected_innovation_cov(estimate)
        try:
            for silent in self._model.rows_before(self._state.model, tick):
                unknown = None if y is None else np.full(len(y), np.nan)
                self._state, _ = self._block.step(self._state, silent, unknown, S)
            self._state, disagreement_s = self._block.step(self._state, tick, y, S)
        except BaseException as error:  # a drive continues without its monitor
            if is_interruption(error):
                raise
            self._has_failed, self._findings = True, {}
            return [Notice(note("monitor.raised", Severity.WARNING, error=error_text(error)))]
        durations_s = disagreement_s.tolist()
        if not self._since_ns and max(durations_s, default=0.0) < EVENT_S:
            return []
        return self._changes(tick.t_ns, durations_s)

    def _is_absent(self, c: int, memory: Memory) -> bool:
        """Return True for a channel that has given no number yet, while others of its sensor have: a gyro alone."""
        sensor = sensor_name(self.channels.names[c])
        indices = [k for k, name in enumerate(self.channels.names) if sensor_name(name) == sensor]
        is_silent = memory.last_change[c] == 0.0 and memory.last_reading[c] == 0.0
        return bool(is_silent and np.any(memory.last_change[indices] != 0.0))

    def _changes(self, t_ns: int, disagreement_s: list[float]) -> list[Notice]:
        notices, memory = [], Memory(*self._state.memory)
        for c, d in enumerate(disagreement_s):
            if c not in self._since_ns:
                if not d >= EVENT_S or self._is_absent(c, memory):  # also a NaN of the vehicle model
                    continue
                self._since_ns[c] = t_ns - round(1e9 * d)
                self._findings[c] = make_finding(self.channels, c, memory, t_ns, d)
                notices.append(Notice(self._findings[c].diagnostic, self._findings[c]))
            elif d >= DEGRADED_S and not self._findings[c].is_degraded:
                self._findings[c] = make_finding(self.channels, c, memory, t_ns, d)
                notices.append(Notice(self._findings[c].diagnostic, self._findings[c]))
            elif d <= 0.0:
                lasted_s = seconds(t_ns, self._since_ns.pop(c))
                name = self._findings.pop(c).name
                notices.append(Notice(note("sensor.agrees-again", subject=name, duration_s=lasted_s)))
        return notices


def innovation_channels(estimator: Estimator, sensors: SensorBlocks, m: int) -> tuple[int, ...] | None:
    """Return, for each of m innovations, the index of its channel from the estimator's `use`; None if unknown."""
    names = [(name, i) for name in sensors._fields for i in range(getattr(sensors, name).size)]
    uses = getattr(getattr(estimator, "block", estimator), "use", sensors._fields)
    try:
        indices = tuple(
            names.index((split_use(use)[0], i)) for use in uses for i in channel_indices(sensors, use)
        )
    except (AttributeError, TypeError, ValueError):
        return None
    return indices if len(indices) == m and m else None


def expected_innovation_cov(estimate: Estimate) -> np.ndarray | None:
    """Return S (m, m) with the noise of the vehicle file, also of an estimator that adapts its noise to the run."""
    cov = estimate.file_innovation_cov
    return estimate.innovation_cov if cov is None else cov
