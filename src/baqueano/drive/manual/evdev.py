"""Read a device of Linux's input layer, /dev/input/eventN: its abilities, its present state and its events.

  struct input_event     long sec, long µs, u16 kind, u16 code, s32 value: 24 bytes, 16 in a program of 32 bits    (1)
  struct input_absinfo   s32 value, low, high, fuzz, flat, resolution                                              (2)
  request                direction << 30 | bytes << 16 | 'E' << 8 | number                                         (3)

Source: the kernel's include/uapi/linux/input.h, input-event-codes.h and asm-generic/ioctl.h. The layout (1) depends on
the size of `long` in the program that reads ("@l" of struct), and not on the kernel.
"""

import errno
import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

KEY, ABS = 0x01, 0x03  # kinds of events; SYN is 0
SYN, REPORT, DROPPED = 0x00, 0, 3
X, Y = 0x00, 0x01
LONGEST_NAME, KEYS, AXES = 256, 0x300, 0x40
# (1), by the size of a long in bytes
EVENT_LAYOUTS = {4: struct.Struct("=iiHHi"), 8: struct.Struct("=qqHHi")}
AXIS_LAYOUT = struct.Struct("=6i")
MAX_EVENTS = 64  # maximum number of events of one read


class InputEvent(NamedTuple):
    """A change of a key or an axis: type of event, code and new value."""

    event_type: int
    code: int
    value: int


class Axis(NamedTuple):
    """The value and the range of an axis.  (2)"""

    value: int
    low: int
    high: int
    rest_width: int  # a smaller deflection from the middle is rest


def ioctl_code(number: int, size: int) -> int:
    """Return the code of an ioctl call that reads `size` bytes.  (3)"""
    return 2 << 30 | size << 16 | ord("E") << 8 | number


class InputDevice:
    """The input device at `path`.

    All methods raise OSError if the device cannot be opened, is of another kind, or is unplugged.
    """

    def __init__(self, path: Path, long_bytes: int = struct.calcsize("@l")) -> None:
        import fcntl

        self._event, self._ioctl = EVENT_LAYOUTS[long_bytes], fcntl.ioctl
        self._fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            self.keys, self.axes = self._supported_codes(KEY, KEYS), self._supported_codes(ABS, AXES)
            self.name = self._read_ioctl(0x06, LONGEST_NAME).partition(b"\0")[0].decode(errors="replace")
        except OSError:
            self.close()
            raise

    def axis(self, code: int) -> Axis:
        """Return the value and the range of the axis with this code."""
        value, low, high, _, rest_width, _ = AXIS_LAYOUT.unpack(
            self._read_ioctl(0x40 + code, AXIS_LAYOUT.size)
        )
        return Axis(value, low, high, rest_width)

    def pressed_codes(self) -> set[int]:
        """Return the codes of the keys that are pressed now."""
        return _one_bits(self._read_ioctl(0x18, KEYS // 8))

    def read(self) -> list[InputEvent]:
        """Return the events since the last call."""
        events: list[InputEvent] = []
        while True:
            try:
                data = os.read(self._fd, MAX_EVENTS * self._event.size)
            except BlockingIOError:
                return events
            if not data:
                raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
            events += [InputEvent(*fields[2:]) for fields in self._event.iter_unpack(data)]

    def close(self) -> None:
        """Close the file."""
        os.close(self._fd)

    def _supported_codes(self, event_type: int, max_code: int) -> set[int]:
        return _one_bits(self._read_ioctl(0x20 + event_type, max_code // 8))

    def _read_ioctl(self, number: int, size: int) -> bytes:
        call: Callable[..., Any] = self._ioctl
        answer = bytearray(size)
        call(self._fd, ioctl_code(number, size), answer, True)
        return bytes(answer)


def _one_bits(bits: bytes) -> set[int]:
    return {8 * k + bit for k, byte in enumerate(bits) for bit in range(8) if byte >> bit & 1}
