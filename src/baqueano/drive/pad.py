"""A game pad, by what the Linux kernel says of it in /dev/input/js0.

    8 bytes a change     u32 time [ms], i16 value, u8 kind (1 button, 2 axis, + 128 at the start), u8 number  (1)
    ahead = -axis 1,  to the left = -axis 0     of the left stick, each / 32767, 0 within REST                (2)

It drives while one of HOLD_TO_RUN, the buttons under the first fingers, is held: a pad that falls on the floor drives
nothing. A pad that was unplugged ends its file, and that stops the vehicle. One that is linked by radio and loses it
goes only when the kernel gives it up, seconds later: use a cable.
"""

import os
import struct
from pathlib import Path

from baqueano.errors import UsageError

EVENT = struct.Struct("<IhBB")
BUTTON, AXIS, AT_START = 1, 2, 128
TURN_AXIS, AHEAD_AXIS = 0, 1
HOLD_TO_RUN = (4, 5)
MARK_BUTTON, STOP_BUTTON = 0, 1
REST = 0.12  # part of its way: a stick does not come back to the middle exactly


class Pad:
    """The pad at `path`."""

    def __init__(self, path: Path) -> None:
        try:
            self._fd = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
        except OSError as error:
            raise UsageError(
                f"--pad {path}: no game pad can be read there ({error.strerror}). Plug it in, or drive by keys; on "
                "Linux your user must be in the group input."
            ) from error
        self.gone = False
        self._axes: dict[int, float] = {}
        self._down: set[int] = set()
        self._rest = b""

    def read(self) -> list[int]:
        """The buttons that were pressed since the last time."""
        pressed: list[int] = []
        while data := self._bytes():
            data = self._rest + data
            whole = len(data) - len(data) % EVENT.size
            self._rest = data[whole:]
            for _, value, kind, number in EVENT.iter_unpack(data[:whole]):
                if kind & ~AT_START == AXIS:
                    self._axes[number] = max(-1.0, value / 32767.0)
                elif value:
                    self._down.add(number)
                    pressed += [] if kind & AT_START else [number]
                else:
                    self._down.discard(number)
        return pressed

    @property
    def holds(self) -> bool:
        """Whether a button that lets it drive is held."""
        return not self.gone and bool(self._down & set(HOLD_TO_RUN))

    def wanted(self) -> tuple[float, float]:
        """(ahead, to the left), each in [-1, 1].  (2)"""
        if not self.holds:
            return 0.0, 0.0
        return -self._axis(AHEAD_AXIS), -self._axis(TURN_AXIS)

    def close(self) -> None:
        """Closes the file."""
        os.close(self._fd)

    def _axis(self, number: int) -> float:
        value = self._axes.get(number, 0.0)
        beyond = max(0.0, abs(value) - REST) / (1.0 - REST)
        return beyond if value > 0.0 else -beyond

    def _bytes(self) -> bytes:
        """What is there; b"" where nothing is, or nothing will ever be."""
        if self.gone:
            return b""
        try:
            data = os.read(self._fd, 64 * EVENT.size)
        except BlockingIOError:
            return b""
        except OSError:  # ENODEV
            data = b""
        self.gone = not data
        return data
