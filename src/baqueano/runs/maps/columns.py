"""The content of a map: files and their clocks, signals and the source of each number.

The text of a map becomes this in column_map.py, and runs are made by it in importing/.
"""

import math
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from baqueano.runs.maps.mount import Mount
from baqueano.runs.maps.units import unit

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject

KINDS = {  # what the numbers of a sensor measure
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
    """A file, or a topic of a bag, and its clock."""

    name: str
    path: str | None  # None: given on the command line
    topic: str | None
    time: str
    time_unit: str
    time_rest: tuple[str, str] | None  # a second column that is added to the time, and its unit
    shift_s: float
    where: "JsonObject"
    new_when: str | None  # rows count where this column changes; the others hold the last measurement
    repeats: str | None  # "first" or "last" of rows with one time
    backwards: str | None  # "drop" rows that are not later than one before
    split: str | None  # a new run where this column changes
    split_gap_s: float | None  # a new run after a pause that is longer, and where the time begins again
    rate_hz: float | None  # of the rows of a file without a column of time
    options: "JsonObject"  # how its text is read


class Entry(NamedTuple):
    """A number of a signal."""

    key: str  # its place in the map
    column: str | None
    quaternion: tuple[str, ...] | None
    unit: str
    scale: float
    offset: float
    times: str | None
    backward: "JsonObject"  # column = the value at which the signal is meant backward
    derivative: bool
    wraps: float | None  # counts after which a counter begins again
    constant: float | None = None
    radius_m: float = 1.0
    counts_per_turn: float | None = None  # of an encoder

    @property
    def si(self) -> float:
        """SI units of one unit of the column; of a count of an encoder the angle."""
        if self.counts_per_turn is not None:
            return 2.0 * math.pi / self.counts_per_turn
        unit_of_entry = unit(self.unit)
        return unit_of_entry.si if unit_of_entry else 1.0

    @property
    def absent(self) -> bool:
        """Return True if nothing measures this number."""
        return self.constant is not None and self.constant != self.constant


class ColumnSignal(NamedTuple):
    """A signal and where its numbers come from."""

    key: str
    file: str
    kind: str | None
    sample: str
    entries: tuple[Entry, ...]
    mount: Mount = Mount()  # of a truth; of a sensor its clock alone


class ColumnMap(NamedTuple):
    """A whole map."""

    name: str
    path: Path
    text: str
    start_ns: int  # added to all times
    accept: frozenset[str]  # doubts that the author of the map has looked into
    files: dict[str, FileSpec]
    ticks: str
    names: tuple[str, ...]
    in_force: str
    command: ColumnSignal
    sensors: dict[str, ColumnSignal]
    truth: ColumnSignal | None  # three entries (η), or six (η, ν)
    wheels: bool = False  # the command is given wheel by wheel, left and right
