"""Convert the ticks of a drive to rows of values for the clients that watch the drive.

The thread of the loop puts each record into a ring, which takes a microsecond. The thread of the door makes each row
once for all clients, and only while a client watches. There are columns for all channels of the vehicle's sensors, so
that they do not depend on the blocks of the drive. Missing values are null.

  model    ẑ = z − y,  y the innovation                                                                  (1)
  nis      yᵀ S⁻¹ y / m over the m innovations that arrived                                              (2)
  progress distance s along the route, over all laps; cross: distance from it, positive to its left      (3)
"""

import threading
from collections import deque
from dataclasses import dataclass, field
from itertools import count
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.blocks import Estimator
from baqueano.contracts.values import JsonObject
from baqueano.door.frames.descriptions import route_description, vehicle_description
from baqueano.door.frames.route_progress import RouteProgress
from baqueano.drive.health import normalised_innovation_squared
from baqueano.guides.route import Route
from baqueano.loop import Record
from baqueano.monitor.sensor_monitor import innovation_channels
from baqueano.signals import NANOSECONDS, Motion, seconds
from baqueano.vehicle_file.file import VehicleFile
from baqueano.vehicle_file.units import channel_unit

if TYPE_CHECKING:
    from baqueano.drive.mission import Mission

MAX_STORED_TICKS = 1024  # ticks that are kept for slow clients
# rows that are made before the door reads again: a fast simulation makes thousands of ticks per second
TICKS_PER_TURN = 16
MAX_FRAME_RATE_HZ = 50.0  # largest frame rate
NAN = float("nan")
DRIVE_NUMBERS = count()

ESTIMATE_COLUMNS = (
    ("eta.x", "m"), ("eta.y", "m"), ("eta.psi", "rad"),
    ("P.xx", "m²"), ("P.xy", "m²"), ("P.yy", "m²"), ("P.psi", "rad²"),
    ("nu.u", "m/s"), ("nu.v", "m/s"), ("nu.r", "rad/s"),
    ("ref.x", "m"), ("ref.y", "m"), ("ref.psi", "rad"), ("ref.u", "m/s"),
    ("truth.x", "m"), ("truth.y", "m"), ("truth.psi", "rad"),
)  # fmt: skip
PREFIX_KINDS = {"eta": "estimate", "P": "covariance", "nu": "velocity", "ref": "reference", "truth": "truth"}
OTHER_COLUMNS = (
    ("nis", "1", "agreement"), ("progress", "m", "route"), ("cross", "m", "route"), ("battery", "V", "health"),
    ("late_ms", "ms", "health"),
)  # fmt: skip


class Column(NamedTuple):
    """A column of the rows: its name, its unit, and the kind of its quantity."""

    name: str
    unit: str
    kind: str


class RecordedTick(NamedTuple):
    """A tick, and values that its record does not contain: the true motion, the battery voltage, and the delay."""

    record: Record
    truth: Motion | None
    battery_v: float
    late_ms: float


def row_columns(vehicle_file: VehicleFile) -> list[Column]:
    """Return the columns of the rows of this vehicle, in order."""
    columns = [Column("t", "s", "time")]
    columns += [Column(name, unit, PREFIX_KINDS[name.partition(".")[0]]) for name, unit in ESTIMATE_COLUMNS]
    for name, kind in (("u", "command"), ("requested", "requested")):
        columns += [
            Column(f"{name}.{k}", vehicle_file.command.unit, kind)
            for k in range(len(vehicle_file.command.names))
        ]
    channels = [
        (name, k)
        for name in vehicle_file.sensors._fields
        for k in range(getattr(vehicle_file.sensors, name).size)
    ]
    for name, kind in (("z", "measurement"), ("model", "model"), ("innov", "innovation"), ("S", "deviation")):
        columns += [
            Column(f"{name}.{sensor}[{k}]", channel_unit(vehicle_file, sensor, k), kind)
            for sensor, k in channels
        ]
    return [*columns, *(Column(*column) for column in OTHER_COLUMNS)]


@dataclass
class DriveRows:
    """The rows of one drive, made from its ticks for the clients that watch it."""

    vehicle_file: VehicleFile
    estimator: Estimator | None = None  # the estimator of the drive
    route: Route | None = None
    ticks: deque[RecordedTick] = field(default_factory=lambda: deque(maxlen=MAX_STORED_TICKS))  # not yet rows
    tick_count: int = 0  # number of ticks stored by the loop

    def __post_init__(self) -> None:
        self.number = next(DRIVE_NUMBERS)
        self.columns = row_columns(self.vehicle_file)
        self.rows: deque[tuple[int, list[str]]] = deque(maxlen=MAX_STORED_TICKS)  # t_ns, the values as text
        self.row_count = 0  # rows since the beginning of the drive, including rows that were skipped
        sensors = self.vehicle_file.sensors
        self._sizes = [getattr(sensors, name).size for name in sensors._fields]
        self._progress = None if self.route is None else RouteProgress(self.route)
        # channel of each innovation; () before the first tick
        self._innovation_indices: tuple[int, ...] | None = ()

    def convert(self, max_count: int = MAX_STORED_TICKS) -> bool:
        """Convert at most `max_count` waiting ticks to rows, and return True while further ticks wait.

        Ticks that the ring has dropped are not converted.
        """
        tick_count, waiting_count = self.tick_count, len(self.ticks)
        first_row = max(self.row_count, tick_count - waiting_count)
        if first_row > self.row_count:
            self.rows.clear()
        new_ticks = [self.ticks.popleft() for _ in range(min(waiting_count, max_count))]
        for sample in new_ticks:
            self.rows.append((sample.record.tick.t_ns, _number_texts(self._row(sample))))
        self.row_count = first_row + len(new_ticks)
        return bool(self.ticks)

    def drop_ticks(self) -> None:
        """Drop all ticks so far, which no client has watched, and begin with the next tick."""
        self.ticks.clear()
        self.rows.clear()
        self.row_count = self.tick_count

    def frame(self, shown_count: int, columns: tuple[int, ...] | None) -> bytes | None:
        """Return the rows after the first `shown_count` rows as an encoded message, or None without such rows.

        `columns` are the indices of the columns to send, None for all.
        """
        frame_size = min(self.row_count - shown_count, len(self.rows))
        if frame_size <= 0:
            return None
        rows = [self.rows[k] for k in range(-frame_size, 0)]
        if columns is None:
            texts = [",".join(cells) for _, cells in rows]
        else:
            texts = [",".join([cells[c] for c in columns]) for _, cells in rows]
        head = f'{{"type":"frame","t_ns":{rows[0][0]},"n":{self.row_count - frame_size},"x":[['
        return (head + "],[".join(texts) + "]]}\n").encode()

    def _row(self, sample: RecordedTick) -> list[float]:
        record = sample.record
        tick, estimate, reference = record.tick, record.estimate, record.reference
        eta, nu, cov = estimate.eta.tolist(), estimate.nu.tolist(), estimate.cov
        truth = [NAN] * 3 if sample.truth is None else sample.truth.eta.tolist()
        z = [
            x
            for slot in tick.sensors
            for x in (slot.z.tolist() if slot.is_new > 0.0 else [NAN] * len(slot.z))
        ]
        innovation, deviation, nis = self._innovations(record, len(z))
        return [
            seconds(tick.t_ns), *eta, float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1]), float(cov[2, 2]), *nu,
            *reference.eta.tolist(), float(reference.nu[0]), *truth,
            *tick.u.tolist(), *record.requested_command.u.tolist(),
            *z, *(a - b for a, b in zip(z, innovation, strict=True)), *innovation, *deviation, nis,
            *((NAN, NAN) if self._progress is None else self._progress.update(eta)), sample.battery_v, sample.late_ms,
        ]  # fmt: skip

    def _innovations(self, record: Record, channel_count: int) -> tuple[list[float], list[float], float]:
        """Return the innovation of each channel, its standard deviation, and the NIS; NaN for missing values.  (2)"""
        y, S = record.estimate.innovation, record.estimate.innovation_cov
        innovation, deviation = [NAN] * channel_count, [NAN] * channel_count
        if y is None or S is None:
            return innovation, deviation, NAN
        if self._innovation_indices == () and self.estimator is not None:
            self._innovation_indices = innovation_channels(self.estimator, self.vehicle_file.sensors, len(y))
        values, spread = y.tolist(), np.sqrt(np.maximum(np.diagonal(S), 0.0)).tolist()
        for k, c in enumerate(self._innovation_indices or ()):
            innovation[c], deviation[c] = values[k], spread[k]
        try:
            nis = normalised_innovation_squared(values, S.tolist())
        except ZeroDivisionError:
            nis = None
        return innovation, deviation, NAN if nis is None else nis


def _number_texts(row: list[float]) -> list[str]:
    """Return the values as JSON with seven digits each, enough for hundredths of a second during a day."""
    return [f"{x:.7g}" if x - x == 0.0 else "null" for x in row]


class Frames:
    """The present or last drive. The loop calls `begin` and `on_record`, the door calls `drive`."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._drive: DriveRows | None = None
        self._descriptions: list[JsonObject] = []

    def begin(
        self, vehicle_file: VehicleFile, world: str, seed: int | None = None, estimator: Estimator | None = None,
        mission: "Mission | None" = None, name: str = "",
    ) -> None:  # fmt: skip
        """Begin a drive, or announce the vehicle before its first drive; `name` is the name of the route."""
        route, laps = (None, 1) if mission is None else (mission.route, mission.laps)
        drive = DriveRows(vehicle_file, estimator, route)
        fields: JsonObject = {
            "type": "fields", "names": [c.name for c in drive.columns], "units": [c.unit for c in drive.columns],
            "kinds": [c.kind for c in drive.columns], "step_ns": round(NANOSECONDS / vehicle_file.rate_hz),
        }  # fmt: skip
        blocks, room = ({}, None) if mission is None else (mission.blocks, mission.precautions.get("room"))
        vehicle = {"type": "vehicle", **vehicle_description(vehicle_file, world, seed, blocks)}
        descriptions = [vehicle, fields, route_description(route, name, laps, room)]
        with self._lock:
            self._drive, self._descriptions = drive, descriptions

    def on_record(
        self, record: Record, truth: Motion | None = None, battery_v: float = NAN, late_ms: float = NAN
    ) -> None:
        """Store a tick without waiting."""
        if (drive := self._drive) is not None:
            drive.ticks.append(RecordedTick(record, truth, battery_v, late_ms))
            drive.tick_count += 1

    def drive(self) -> tuple[DriveRows | None, list[JsonObject]]:
        """Return the rows of the present or last drive, or None, and the messages that precede its first frame."""
        with self._lock:
            return self._drive, self._descriptions
