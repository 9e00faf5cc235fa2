"""Record a drive. A `RunWriter` writes it to a file, `MemoryRecorder` stores it in memory."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from baqueano.diagnostics import Diagnostic
from baqueano.loop import Record
from baqueano.messages import english_text
from baqueano.runs.run import Channel, EstimateLog, Event, ReferenceLog, Run, TruthLog
from baqueano.signals import Motion, measured_ns


class RunRecorder(Protocol):
    """Protocol of a recorder of a drive, tick by tick."""

    @property
    def failure(self) -> OSError | None:
        """Return the error that stopped the writing; None without an error."""
        ...

    def record(self, record: Record) -> None:
        """Record a tick: commands, measurements, estimate and reference."""
        ...

    def truth(self, t_ns: int, motion: Motion) -> None:
        """Record the true pose, velocity and acceleration."""
        ...

    def channel(self, name: str, t_ns: int, z: np.ndarray) -> None:
        """Record a measurement (m,) of a sensor outside the vehicle file."""
        ...

    def event(self, t_ns: int, level: str, source: str, message: Diagnostic | str) -> None:
        """Record an event: a message for the user."""
        ...


@dataclass
class MemoryRecorder:
    """A recorder with the methods of RunWriter that stores everything in memory."""

    vehicle_text: str
    metadata: dict[str, str]
    records: list[Record] = field(default_factory=list)
    truths: list[tuple[int, Motion]] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    channels: dict[str, list[tuple[int, np.ndarray]]] = field(default_factory=dict)
    failure: OSError | None = None  # always None: memory does not fail

    def record(self, record: Record) -> None:
        """Record a tick: commands, measurements, estimate and reference."""
        self.records.append(record._replace(states=None))

    def truth(self, t_ns: int, motion: Motion) -> None:
        """Record the true pose, velocity and acceleration."""
        self.truths.append((t_ns, motion))

    def channel(self, name: str, t_ns: int, z: np.ndarray) -> None:
        """Record a measurement (m,) of a sensor outside the vehicle file."""
        self.channels.setdefault(name, []).append((t_ns, z))

    def event(self, t_ns: int, level: str, source: str, message: Diagnostic | str) -> None:
        """Record an event: a message for the user."""
        data = message if isinstance(message, Diagnostic) else None
        self.events.append(Event(t_ns, level, source, english_text(message), data))

    def run(self, name: str) -> Run:
        """Return the recorded data as a run."""
        r = self.records
        t_ns = np.array([x.tick.t_ns for x in r], dtype=np.int64)
        return Run(
            name,
            None,
            t_ns,
            np.array([x.tick.u for x in r]),
            np.array([x.requested_command.u for x in r]),
            {name: self._sensor(name) for name in (r[0].tick.sensors._fields if r else ())}
            | {name: self._channel(name) for name in self.channels},
            _estimates(t_ns, r),
            ReferenceLog(t_ns, *(np.array([x.reference[i] for x in r]) for i in (1, 2, 3))),
            self._truth(),
            tuple(self.events),
            self.vehicle_text,
            self.metadata,
            np.array([x.sent_command.u for x in r]),
        )

    def _channel(self, name: str) -> Channel:
        t_ns = np.array([t for t, _ in self.channels[name]], dtype=np.int64)
        return Channel(t_ns, t_ns, np.array([z for _, z in self.channels[name]]))

    def _sensor(self, name: str) -> Channel:
        slots = [(x.tick.t_ns, getattr(x.tick.sensors, name)) for x in self.records]
        readings = [(measured_ns(t_ns, slot), t_ns, slot.z) for t_ns, slot in slots if slot.is_new > 0.5]
        t_ns, arrival_ns = (np.array([row[k] for row in readings], dtype=np.int64) for k in (0, 1))
        z = np.array([row[2] for row in readings]).reshape(len(readings), len(slots[0][1].z))
        return Channel(t_ns, arrival_ns, z)

    def _truth(self) -> TruthLog | None:
        if not self.truths:
            return None
        t_ns = np.array([t for t, _ in self.truths], dtype=np.int64)
        return TruthLog(t_ns, *(np.array([motion[i] for _, motion in self.truths]) for i in (0, 1, 2)))


def _estimates(t_ns: np.ndarray, records: list[Record]) -> EstimateLog:
    columns = [[x.estimate[i] for x in records] for i in range(1, 6)]
    present_columns = columns if all(c is not None for column in columns[3:] for c in column) else columns[:3]
    return EstimateLog(t_ns, *(np.array(column) for column in present_columns))
