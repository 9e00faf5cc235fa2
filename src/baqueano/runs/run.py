"""Represent a run in memory: commands, measurements, estimates, and the truth of a simulation.

Times are integer nanoseconds. A measurement has two times: its instant (`t_ns`) and its arrival at the loop
(`arrival_ns`). A tick at t_k contains the measurements that arrived in (t_{k-1}, t_k]; `applied_commands[k]` was
applied during the same interval. Two runs are equal (==) if all recorded data are equal, bit for bit, even if name,
path or notes differ.
"""

import tomllib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from baqueano.contracts.calls import checked_call
from baqueano.contracts.result import Result, pandas
from baqueano.contracts.values import TableRow, Value
from baqueano.diagnostics import Diagnostic
from baqueano.errors import UsageError
from baqueano.runs.logs import (
    Channel,
    EstimateLog,
    Event,
    ReferenceLog,
    TruthLog,
    checked_array,
    checked_channel,
    checked_log,
    checked_times,
    log_rows,
)  # fmt: skip
from baqueano.signals import NANOSECONDS, TICK_TOLERANCE_NS, Slot, Tick, seconds, sensor_slots

MEANS_KEY = "means"  # in the metadata: the names of the channels whose readings are means over an interval
REST_KEY = "rest_s"  # of the metadata
MAX_AGE_S = 0.25  # an older measurement has the timestamp of another clock


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Run(Result):
    """A recorded run. Arrays are converted to int64 or float64, and their shapes are checked.

    Parameters
    ----------
    name : str
        Name of the run.
    path : Path or None
        File of the run; None for a run that is only in memory.
    t_ns : ndarray (N,)
        Times of the ticks, int64; they increase.
    applied_commands : ndarray (N, n) [unit of u]
        Commands applied during the interval that ends at t_ns.
    requested_commands : ndarray (N, n), optional [unit of u]
        Commands of the controller at t_ns; NaN without a command.
    sensors : dict of Channel
        Measurements by sensor, in the order of the vehicle file.
    estimate : EstimateLog, optional
        Estimates.
    reference : ReferenceLog, optional
        Reference poses and velocities.
    truth : TruthLog, optional
        The true motion.
    events : tuple of Event
        Messages in the log of the run.
    vehicle_text : str
        Text of the vehicle file that was used.
    metadata : dict of str
        Seed, versions, back end, kind.
    sent_commands : ndarray (N, n), optional [unit of u]
        Commands that the supervisor sent at t_ns; NaN without a command.
    notes : tuple of Diagnostic
        Remarks of the reader about the file.

    Examples
    --------
    >>> run = bq.simulate(bq.load("small"), np.tile([0.5, 0.0, 0.0], (101, 1)))
    >>> print(f"{run.duration_s:.2f} s", list(run.sensors))
    1.00 s ['imu']
    """

    name: str
    path: Path | None
    t_ns: np.ndarray
    applied_commands: np.ndarray
    requested_commands: np.ndarray | None = None
    sensors: dict[str, Channel] = field(default_factory=dict)
    estimate: EstimateLog | None = None
    reference: ReferenceLog | None = None
    truth: TruthLog | None = None
    events: tuple[Event, ...] = ()
    vehicle_text: str = ""
    metadata: dict[str, str] = field(default_factory=dict)
    sent_commands: np.ndarray | None = None
    notes: tuple[Diagnostic, ...] = ()

    def __post_init__(self) -> None:
        set_field = object.__setattr__
        set_field(self, "t_ns", checked_times(self.t_ns, "t_ns", must_increase=True))
        n = np.shape(self.applied_commands)[1] if np.ndim(self.applied_commands) == 2 else -1
        for name in ("applied_commands", "requested_commands", "sent_commands"):
            if getattr(self, name) is not None or name == "applied_commands":
                set_field(self, name, checked_array(getattr(self, name), name, (len(self.t_ns), n)))
        sensors = {name: checked_channel(name, channel) for name, channel in self.sensors.items()}
        set_field(self, "sensors", sensors)
        for name in ("estimate", "reference", "truth"):
            set_field(self, name, checked_log(name, getattr(self, name)))
        events = (Event(int(e[0]), str(e[1]), str(e[2]), str(e[3]), e.diagnostic) for e in self.events)
        set_field(self, "events", tuple(events))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Run):
            return NotImplemented
        ignored_fields = {"name", "path", "notes"}
        return all(
            _are_identical(getattr(self, f.name), getattr(other, f.name))
            for f in fields(self)
            if f.name not in ignored_fields
        ) and list(self.sensors) == list(other.sensors)

    def __repr__(self) -> str:
        from baqueano.runs.show import short_text

        return short_text(self)

    @checked_call('run.save("runs/0001-mine.mcap")')
    def save(self, path: Path | str) -> Path:
        """Write the run to a new file and return its path; in a folder, the file receives the next number.

        Raise FileError if the file exists or cannot be written, and UsageError if its name does not end in .mcap.
        """
        from baqueano.runs.container.writer import write_run
        from baqueano.runs.folder import path_of_run

        return write_run(self, path_of_run(path, self.name))

    def rows(self) -> list[TableRow]:
        """Return one flat dict per topic; an unknown value is None."""
        from baqueano.runs.show import show

        return show(self).rows()

    def table(self) -> str:
        """Return the contents of the run: topics, rates, gaps, events."""
        from baqueano.runs.show import show

        return show(self).table()

    def to_pandas(self) -> Any:
        """Return a pandas DataFrame with a row per tick, indexed by time [s]. It has the columns of the CSV file of
        `baqueano runs export`; NaN if no value arrived since the previous tick.
        """
        from baqueano.runs.export import columns_of

        return pandas().DataFrame(dict(columns_of(self))).set_index("t_s")

    @property
    def commands(self) -> dict[str, np.ndarray]:
        """Return the recorded commands (N, n) [unit of u] by stage: applied, requested, sent."""
        stages = (
            ("applied", self.applied_commands),
            ("requested", self.requested_commands),
            ("sent", self.sent_commands),
        )
        return {stage: u for stage, u in stages if u is not None}

    @property
    def command_names(self) -> tuple[str, ...]:
        """Return the names of the commands, from the vehicle file or the map of the run; otherwise u[0], u[1], …"""
        n = self.applied_commands.shape[1]
        names = [name.strip() for name in self.metadata.get("commands", "").split(",")]
        with suppress(tomllib.TOMLDecodeError, RecursionError, KeyError, TypeError):
            names = [str(name) for name in tomllib.loads(self.vehicle_text)["command"]["names"]]
        return tuple(names if len(names) == n and all(names) else (f"u[{k}]" for k in range(n)))

    @property
    def duration_s(self) -> float:
        """Return the time from the first tick to the last [s]."""
        return float(seconds(self.t_ns[-1], self.t_ns[0])) if len(self.t_ns) else 0.0

    @property
    def start_ns(self) -> int:
        """Return the time of the first tick [ns]; 0 for a run without ticks."""
        return int(self.t_ns[0]) if len(self.t_ns) else 0

    @property
    def t_s(self) -> np.ndarray:
        """Return the time (N,) of each tick [s], from 0 at the first tick."""
        return seconds(self.t_ns, self.start_ns)

    @property
    def rest_s(self) -> float:
        """Return the time for which the vehicle was at rest before its drive [s]; 0 without a rest."""
        return float(self.metadata.get(REST_KEY, 0.0))

    @property
    def begin_index(self) -> int:
        """Return the index of the first tick after the rest."""
        return int(np.searchsorted(self.t_ns, self._instant_ns(self.rest_s) - TICK_TOLERANCE_NS))

    @property
    def without_rest(self) -> "Run":
        """Return the run from the beginning of its drive on."""
        return self.cut(self.rest_s) if self.rest_s else self

    @property
    def guide_reference(self) -> ReferenceLog | None:
        """Return the reference of the guide after the rest, or None if it equals the estimate, as in a drive without a
        guide.
        """
        ref, log = self.reference, self.estimate
        if ref is not None and log is not None and np.array_equal(ref.eta, log.eta, equal_nan=True):
            return None
        if ref is None or not self.rest_s:
            return ref
        return log_rows(ref, ref.t_ns >= self._instant_ns(self.rest_s) - TICK_TOLERANCE_NS)

    def ticks(self) -> Iterator[Tick]:
        """Yield the ticks as in the loop, with the newest measurement of each sensor since the previous tick,
        if any."""
        slots = sensor_slots(tuple(self.sensors))
        columns = [_slots(channel, self.t_ns) for channel in self.sensors.values()]
        for t_ns, u, *row in zip(self.t_ns.tolist(), self.applied_commands, *columns, strict=True):
            yield Tick(t_ns, u, slots(*row))

    @checked_call("run.cut(2.0, 8.0)")
    def cut(self, from_s: float = 0.0, to_s: float = float("inf")) -> "Run":
        """Return the part from `from_s` (included) to `to_s` (not included) seconds after the first tick."""
        if not from_s <= to_s:
            raise UsageError.of("runs.cut-order", start_s=from_s, end_s=to_s)
        low, high = (self._instant_ns(s) for s in (from_s, to_s))
        first, last = np.searchsorted(self.t_ns, [low, high])
        # measurements that arrived up to the previous tick belong to that tick
        previous_ns = self.t_ns[first - 1] if first > 0 else np.iinfo(np.int64).min

        def part(log: Any) -> Any:
            return None if log is None else log_rows(log, (log.t_ns >= low) & (log.t_ns < high))

        rest = {REST_KEY: repr(max(self.rest_s - from_s, 0.0))} if REST_KEY in self.metadata else {}
        sensors = {
            name: log_rows(channel, (channel.arrival_ns > previous_ns) & (channel.arrival_ns < high))
            for name, channel in self.sensors.items()
        }
        return replace(
            self,
            path=None,
            t_ns=self.t_ns[first:last],
            applied_commands=self.applied_commands[first:last],
            requested_commands=None
            if self.requested_commands is None
            else self.requested_commands[first:last],
            sent_commands=None if self.sent_commands is None else self.sent_commands[first:last],
            sensors=sensors,
            estimate=part(self.estimate),
            reference=part(self.reference),
            truth=part(self.truth),
            events=tuple(e for e in self.events if low <= e.t_ns < high),
            metadata=self.metadata | rest | {"cut": f"{from_s:g} s to {to_s:g} s of {self.name}"},
        )

    def _instant_ns(self, t_s: float) -> int:
        if not abs(t_s) < 1e9:
            return int(np.iinfo(np.int64).max if t_s > 0 else np.iinfo(np.int64).min)
        return self.start_ns + round(t_s * NANOSECONDS)


def _slots(channel: Channel, t_ns: np.ndarray) -> Iterator[Slot]:
    empty_slot = Slot(0.0, np.zeros(channel.z.shape[1]))
    newest_rows = np.searchsorted(channel.arrival_ns, t_ns, side="right") - 1
    last = -1
    for i, now_ns in zip(newest_rows.tolist(), t_ns.tolist(), strict=True):
        yield Slot(1.0, channel.z[i], age_s(int(channel.t_ns[i]), now_ns)) if i > last else empty_slot
        last = i


def age_s(measured_ns: Value, t_ns: Value) -> Value:
    """Return the age [s] of a measurement at `t_ns`; 0 if its timestamp is later, or older than MAX_AGE_S."""
    age = seconds(t_ns, measured_ns)
    return np.where((age >= 0.0) & (age <= MAX_AGE_S), age, 0.0)[()]


def _are_identical(a: object, b: object) -> bool:
    """Return True if both are equal bit for bit, even inside arrays, tuples and dicts. NaN equals the same NaN."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.shape == b.shape and a.dtype == b.dtype and a.tobytes() == b.tobytes()
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_are_identical(a[key], b[key]) for key in a)
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_are_identical, a, b))
    return type(a) is type(b) and a == b
