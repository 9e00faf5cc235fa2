"""Store the ticks for all browsers: rows of float32 in frames, and a ring of the last RING_S for new browsers.

frame   uint32 stream and number, uint32 rows R, float64 time of the first row [s], R × F float32, little-endian
"""

import struct
import sys
import time
from array import array
from collections import deque
from collections.abc import AsyncIterator, Sequence

from baqueano.contracts.values import JsonObject

HEAD_LAYOUT = struct.Struct("<IId")
RING_S = 60.0  # drive time that the ring stores
MAX_ROWS = 60_000  # maximum number of rows of the ring, at any rate
MAX_FRAME_TIMES = 64  # number of frames whose age is stored
FRAME_NUMBER_COUNT = 1 << 24  # frame numbers; the higher bits are the stream
NAN = float("nan")


class Feed:
    """The newest rows of the current or last drive, for at most RING_S of drive time and MAX_ROWS rows."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.number = 0  # number of the newest frame
        self._column_indices: dict[str, int] = {}
        self._ring: deque[tuple[float, int, bytes]] = deque()  # time of the first row, rows, bytes
        self._rows = 0
        self._frame_times_s: deque[tuple[int, float]] = deque(maxlen=MAX_FRAME_TIMES)
        self._last: Sequence[float] = ()

    def begin_drive(self, names: list[str]) -> bool:
        """Begin a drive with these column names; return True if they differ from the previous names."""
        self._clear()
        if names == self.names:
            return False
        self.names, self._column_indices = names, {name: k for k, name in enumerate(names)}
        return True

    def add_rows(self, message: JsonObject) -> bytes | None:
        """Store the ticks of a message, and return them as a binary frame, or None if their columns do not match."""
        rows = message.get("x")
        try:
            if not rows or not self.names or any(len(row) != len(self.names) for row in rows):
                return None
            values = array("f", [NAN if x is None else x for row in rows for x in row])
        except (TypeError, OverflowError):
            return None
        if sys.byteorder == "big":
            values.byteswap()
        t = self._time_s(rows[0])
        if self._ring and t < self._ring[-1][0]:
            self._clear()
        self._store_rows(t, len(rows), values.tobytes())
        self._last = rows[-1]
        self.number = (self.number + 1) % FRAME_NUMBER_COUNT
        self._frame_times_s.append((self.number, time.monotonic()))
        return HEAD_LAYOUT.pack(self.number, len(rows), t) + self._ring[-1][2]

    def age_s(self, number: int) -> float:
        """Return the age [s] of the frame with this number: 0 for the newest frame, infinity for an unknown number."""
        if number == self.number:
            return 0.0
        return next(
            (time.monotonic() - made_s for n, made_s in self._frame_times_s if n == number), float("inf")
        )

    async def history(self, from_s: float = 0.0) -> "AsyncIterator[tuple[bytes, ...]]":
        """Yield the rows from the drive time `from_s` [s] on, as the parts of one frame, and then the later rows.

        The later rows arrived while the previous frame was sent, so no row is missing before the next picture. If they
        do not become fewer, the browser is slower than the drive, and the history ends. The parts are the byte strings
        of the ring and not copies, so that many waiting browsers share them.
        """
        frames = [frame for frame in self._ring if frame[0] >= from_s]
        frame_count = len(frames)
        while frames:
            number = self.number
            head = HEAD_LAYOUT.pack(number, sum(rows for _, rows, _ in frames), frames[0][0])
            yield (head, *(data for _, _, data in frames))
            missed_frames = min((self.number - number) % FRAME_NUMBER_COUNT, len(self._ring))
            if missed_frames >= frame_count:
                return
            frame_count, frames = missed_frames, list(self._ring)[len(self._ring) - missed_frames :]

    def value(self, name: str) -> float:
        """Return the newest value of a column, or NaN if the column does not exist or is empty."""
        k = self._column_indices.get(name)
        value = None if k is None or k >= len(self._last) else self._last[k]
        return NAN if value is None else float(value)

    def mean(self, name: str, within_s: float) -> tuple[float, int]:
        """Return the mean of a column over the last `within_s` seconds, and the number of values; (NaN, 0) if none."""
        k, width = self._column_indices.get(name), len(self.names)
        if k is None or not self._ring:
            return NAN, 0
        from_s, total, count = self._ring[-1][0] - within_s, 0.0, 0
        for t, rows, data in reversed(self._ring):
            if t < from_s:
                break
            values = memoryview(data).cast("f")[k : rows * width : width] if sys.byteorder == "little" else ()
            for value in values:
                if value == value:
                    total, count = total + value, count + 1
        return (total / count if count else NAN), count

    def _store_rows(self, t: float, rows: int, data: bytes) -> None:
        self._ring.append((t, rows, data))
        self._rows += rows
        while self._ring[0][0] < t - RING_S or self._rows > MAX_ROWS:
            self._rows -= self._ring.popleft()[1]

    def _time_s(self, row: Sequence[float]) -> float:
        k = self._column_indices.get("t", 0)
        return float(row[k] or 0.0)

    def _clear(self) -> None:
        self._ring.clear()
        self._rows, self._last = 0, ()


def field_rows(names: list[object], units: list[object], commands: list[str]) -> list[JsonObject]:
    """Return name, unit and group of each column; `commands` are the names of the commands."""
    return [
        {
            "name": str(name),
            "unit": "" if unit == "1" else str(unit),
            "group": column_group(str(name), commands),
        }
        for name, unit in zip(names, units, strict=False)
    ]


def column_group(name: str, commands: list[str]) -> str:
    """Return the group of a column: the name of a sensor or command, or the first part of the column's name."""
    prefix, _, remainder = name.partition(".")
    if prefix in ("u", "requested"):
        if remainder.isdecimal() and int(remainder) < len(commands):
            return commands[int(remainder)]
        return remainder
    if prefix in ("z", "model", "innov", "S"):
        return remainder.partition("[")[0]
    return "route" if name in ("progress", "cross") else prefix
