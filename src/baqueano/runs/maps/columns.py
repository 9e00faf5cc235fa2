"""Define the content of a map: files and their clocks, signals and the source of each value.

column_map.py parses the text of a map into these classes; importing/ makes runs with them.
"""

import math
from pathlib import Path
from typing import NamedTuple

from baqueano.contracts.values import JsonObject
from baqueano.runs.maps.mount import Mount
from baqueano.runs.maps.units import unit

KINDS = {  # kind of sensor → quantity of each channel
    "imu": ("acceleration", "acceleration", "angular rate"),
    "wheels": ("speed", "speed"),
    "odometer": ("speed",),
    "pose": ("length", "length", "angle"),
    "mark": ("length",),
    "tags": ("length", "length"),
    "beacon": ("length",),
    "rangefinder": ("length",),
    "compass": ("angle",),
    "encoders": ("speed", "speed"),
    "battery": ("voltage",),
}


class FileSpec(NamedTuple):
    """A file, or a topic of a bag, with its clock."""

    name: str
    path: str | None  # None: given on the command line
    topic: str | None
    time: str
    time_unit: str
    time_rest: tuple[str, str] | None  # a second column that is added to the time, and its unit
    shift_s: float
    where: JsonObject
    new_when: str | None  # rows are used if this column changes; the others repeat the last measurement
    repeats: str | None  # "first" or "last": the row to keep of several rows with the same time
    backwards: str | None  # "drop": omit rows that are not later than a previous row
    split: str | None  # a new run for each value of this column
    split_gap_s: float | None  # a new run after a longer pause, and if the time steps back
    rate_hz: float | None  # rate of the rows of a file without a column of time
    options: JsonObject  # for reading the text of the file


class Entry(NamedTuple):
    """An entry of a signal: its source in the file, its unit and its conversion."""

    key: str  # place of the entry in the map
    column: str | None
    quaternion: tuple[str, ...] | None
    unit: str
    scale: float
    offset: float
    times: str | None
    backward: JsonObject  # column = the value at which the sign of the signal is changed
    derivative: bool
    wraps: float | None  # counts after which a counter begins again
    constant: float | None = None
    radius_m: float = 1.0
    counts_per_turn: float | None = None  # of an encoder

    @property
    def si_factor(self) -> float:
        """Return the factor from the column's unit to SI; for an encoder the angle of one count."""
        if self.counts_per_turn is not None:
            return 2.0 * math.pi / self.counts_per_turn
        entry_unit = unit(self.unit)
        return entry_unit.si_factor if entry_unit else 1.0

    @property
    def is_absent(self) -> bool:
        """Return True if this quantity is not measured: its constant is NaN."""
        return self.constant is not None and self.constant != self.constant


class ColumnSignal(NamedTuple):
    """A signal and the sources of its values."""

    key: str
    file: str
    kind: str | None
    sample: str
    entries: tuple[Entry, ...]
    mount: Mount = Mount()  # of a truth; for a sensor only its clock

    @property
    def is_rate(self) -> bool:
        """Return True if all values are differences of two rows: means over the time between them."""
        return all(entry.derivative or entry.is_absent for entry in self.entries)


class ColumnMap(NamedTuple):
    """A complete map."""

    name: str
    path: Path
    text: str
    start_ns: int  # added to all times
    accept: frozenset[str]  # findings that the author of the map has checked
    files: dict[str, FileSpec]
    ticks: str
    names: tuple[str, ...]
    in_force: str
    command: ColumnSignal
    sensors: dict[str, ColumnSignal]
    truth: ColumnSignal | None  # three entries (η), or six (η, ν)
    wheels: bool = False  # the command is given wheel by wheel, left and right
