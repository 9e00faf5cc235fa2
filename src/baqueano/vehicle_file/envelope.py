"""Store the range of motion in the runs of the last fit, [envelope], and report runs outside this range.

    [envelope]
    run = "0001-experiment"
    names = ["u_x", "u_psi", "imu[2]"]   # the commands, and the channels that show a speed or a turn rate
    low = [-1.0, -0.5, -6.1]
    high = [1.0, 0.5, 5.8]

    beyond: a value outside [low, high] by more than RANGE_MARGIN (high − low)                                       (1)

A model is fitted to data. Outside the range of the data, motors can saturate, tyres slip and batteries sag, which the
model does not include. A fit writes the table. Every drive, replay and simulation with the file uses `EnvelopeMonitor`,
and so does the check of a fit with held-out runs.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from baqueano.contracts.blocks import SensorBlocks
from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.errors import UsageError
from baqueano.signals import Tick
from baqueano.vehicle_file.tables import ReadReport, number_array, report_unknown_key

RANGE_MARGIN = 0.1
MIN_REPORTED_SHARE = 0.01  # share of the values beyond (1) above which a name is reported
_CHANNEL = re.compile(r"(\w[\w.-]*)\[(\d+)\]")
BATCH_TICKS = 100  # ticks of a drive that are processed together


class Envelope(NamedTuple):
    """The range of each command, and of each measured speed and turn rate."""

    names: tuple[str, ...]  # (k,) the commands in the order of the file, then channels such as "imu[2]"
    low: np.ndarray  # (k,)
    high: np.ndarray  # (k,)
    run: str = ""

    @property
    def command_count(self) -> int:
        """Return the number of names that are commands."""
        return sum("[" not in name for name in self.names)

    @property
    def moved_commands(self) -> list[int]:
        """Return the indices of the commands that were not always 0."""
        return [k for k in range(self.command_count) if self.high[k] > self.low[k] or self.high[k] != 0.0]

    @property
    def ranges(self) -> list[Diagnostic]:
        """Return the ranges of the commands that were used: "throttle from -0.41 to 0.57", "servo from …"."""
        return [
            note("envelope.range", subject=self.names[k], low=self.low[k], high=self.high[k])
            for k in self.moved_commands
        ]

    def range_warnings(self, run: Any) -> tuple[Diagnostic, ...]:
        """Return a warning for each command and channel of a Run with more than the share MIN_REPORTED_SHARE of values
        outside.
        """
        watch = EnvelopeMonitor(self)
        watch.count(run.applied_commands, {name: channel.z for name, channel in run.sensors.items()})
        return watch.range_warnings(run.name)


class EnvelopeMonitor:
    """A counter of the values outside an envelope. Without an envelope, the count is 0."""

    def __init__(self, envelope: Envelope | None) -> None:
        self.envelope = envelope or Envelope((), np.zeros(0), np.zeros(0))
        k = len(self.envelope.names)
        self._sample_count, self._outside_count = np.zeros(k, int), np.zeros(k, int)
        self._lowest, self._highest = np.full(k, np.inf), np.full(k, -np.inf)
        self._ticks: list[Any] = []

    def count(self, u: np.ndarray, sensors: Mapping[str, np.ndarray]) -> None:
        """Count the values outside the envelope in commands (N, n) and measurements (M, m) of each sensor.  (1)
        Raise UsageError if n differs from the number of commands in the envelope.
        """
        envelope, n = self.envelope, self.envelope.command_count
        if n and u.shape[1] != n:
            raise UsageError.of("vehicle.commands-differ", "--vehicle FILE", value=u.shape[1], expected=n)
        for k, name in enumerate(envelope.names):
            sensor, _, entry = name.rstrip("]").partition("[")
            x = u[:, k] if k < n else sensors[sensor][:, int(entry)] if sensor in sensors else np.zeros(0)
            x = x[np.isfinite(x)]
            margin = RANGE_MARGIN * (envelope.high[k] - envelope.low[k])
            self._sample_count[k] += len(x)
            self._outside_count[k] += np.sum((x < envelope.low[k] - margin) | (x > envelope.high[k] + margin))
            self._lowest[k] = np.min(x, initial=self._lowest[k])
            self._highest[k] = np.max(x, initial=self._highest[k])

    def update(self, tick: Tick) -> None:
        """Count the values of one Tick of a drive that are outside the envelope."""
        if self.envelope.names:
            self._ticks.append(tick)
        if len(self._ticks) >= BATCH_TICKS:
            self._count_batch()

    def range_warnings(self, run: str | Diagnostic) -> tuple[Diagnostic, ...]:
        """Return a warning about `run` for each name with more than the share MIN_REPORTED_SHARE of its values
        outside.
        """
        self._count_batch()
        envelope, warnings = self.envelope, []
        outside_share = self._outside_count / np.maximum(self._sample_count, 1)
        for k in np.flatnonzero(outside_share > MIN_REPORTED_SHARE):
            figures = {
                "minimum": self._lowest[k],
                "maximum": self._highest[k],
                "percent": 100.0 * outside_share[k],
            }
            bounds = {"low": envelope.low[k], "high": envelope.high[k]}
            name = envelope.names[k]
            warnings.append(
                note("envelope.left", Severity.WARNING, subject=name, run=run, **figures, **bounds)
            )
        return tuple(warnings)

    def _count_batch(self) -> None:
        ticks, self._ticks = self._ticks, []
        if not ticks:
            return
        names = {name.partition("[")[0] for name in self.envelope.names if "[" in name}
        sensors = {}
        for name in names.intersection(ticks[0].sensors._fields):
            slots = [getattr(tick.sensors, name) for tick in ticks]
            z = [slot.z for slot in slots if slot.is_new > 0.5]
            sensors[name] = np.array(z).reshape(len(z), -1) if z else np.zeros((0, len(slots[0].z)))
        self.count(np.array([tick.u for tick in ticks]), sensors)


def read_envelope(
    report: ReadReport, data: JsonObject, commands: Sequence[str], sensors: SensorBlocks
) -> Envelope | None:
    """Return the table [envelope], checked against `commands` and `sensors` of the file; None without this table."""
    table, path = data.get("envelope"), ("envelope",)
    if table is None:
        return None
    if not isinstance(table, dict):
        report.add_problem(path, "vehicle.envelope-not-table")
        return None
    for name in table:
        if name not in Envelope._fields:
            report_unknown_key(report, (*path, name), table[name], dict.fromkeys(Envelope._fields, ""))
    names, run = table.get("names", []), table.get("run", "")
    low, high = (number_array(table.get(side, [])) for side in ("low", "high"))
    if not isinstance(run, str) or not _are_names(names, commands, sensors):
        report.add_table_problem(path, "vehicle.envelope-names", commands=commands)
        return None
    if (
        low is None
        or high is None
        or not low.shape == high.shape == (len(names),)
        or not (np.all(np.isfinite(high - low)) and np.all(low <= high))
    ):
        report.add_table_problem(path, "vehicle.envelope-ranges")
        return None
    return Envelope(tuple(names), low, high, run)


def _are_names(names: object, commands: Sequence[str], sensors: SensorBlocks) -> bool:
    """Return True if `names` are the commands, followed by channels of the file's sensors."""
    if not isinstance(names, list) or names[: len(commands)] != list(commands):
        return False
    sizes = {name: sensor.size for name, sensor in sensors._asdict().items()}
    for name in names[len(commands) :]:
        match = _CHANNEL.fullmatch(name) if isinstance(name, str) else None
        if match is None or int(match[2]) >= sizes.get(match[1], np.inf):
            return False
    return True
