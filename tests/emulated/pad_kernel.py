"""The kernel's part of one /dev/input/eventN: it answers ioctl calls, and sends events or drops them.

The bytes are those of include/uapi/linux/input.h. Events are dropped if the buffer is full. The module does not use the
package, so the system's Python can run it.
"""

import errno
import struct

SYN, KEY, ABS = 0, 1, 3
BUFFER = 64  # events that wait for a reader


class KernelDevice:
    """One emulated device. `axes`: code → [value, low, high, fuzz, flat, resolution]; `long_bytes` of the reading
    program."""

    def __init__(self, name="Emulated pad", keys=(), axes=None, long_bytes=8):
        self.name, self.keys, self.there = name, set(keys), True
        self.axes = {int(code): list(info) for code, info in (axes or {}).items()}
        self.layout = struct.Struct("=iiHHi" if long_bytes == 4 else "=qqHHi")
        self.down, self.waiting = set(), []

    def ioctl(self, request):
        """Return the bytes that this ioctl call reads."""
        number, size = request & 0xFF, request >> 16 & 0x3FFF
        if not self.there:
            raise OSError(errno.ENODEV, "No such device")
        if request >> 30 != 2 or request >> 8 & 0xFF != ord("E"):
            raise OSError(errno.ENOTTY, "Inappropriate ioctl for device")
        if number == 0x06:
            return self.name.encode()[: size - 1] + b"\0"
        if number == 0x18:
            return bits(self.down, size)
        if 0x20 <= number < 0x40:
            return bits({KEY: self.keys, ABS: self.axes}.get(number - 0x20, ()), size)
        if number - 0x40 in self.axes and size == 24:
            return struct.pack("=6i", *self.axes[number - 0x40])
        raise OSError(errno.EINVAL, "Invalid argument")

    def read(self, size):
        """Return as many whole events as fit into the buffer of the caller."""
        if not self.there:
            raise OSError(errno.ENODEV, "No such device")
        if size < self.layout.size:
            raise OSError(errno.EINVAL, "Invalid argument")
        if not self.waiting:
            raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")
        count = size // self.layout.size
        out, self.waiting = self.waiting[:count], self.waiting[count:]
        return b"".join(self.layout.pack(1, 2, *event) for event in out)

    def change(self, *events):
        """Change keys [1, code, value] and axes [3, code, value] at one time; a full buffer retains only the newest
        events."""
        for kind, code, value in events:
            if kind == KEY:
                (self.down.add if value else self.down.discard)(code)
            else:
                self.axes[code][0] = value
        for event in [*map(tuple, events), (SYN, 0, 0)]:
            if len(self.waiting) >= BUFFER:
                self.waiting = [(SYN, 3, 0)]
            self.waiting.append(event)

    def unplug(self):
        """Remove the device; its file stays open."""
        self.there = False


def bits(numbers, size):
    """Return numbers as a bit field."""
    out = bytearray(size)
    for n in numbers:
        if n < 8 * size:
            out[n // 8] |= 1 << n % 8
    return bytes(out)


def pad(**options):
    """Return a common game pad: sticks of 16 bits, ten buttons."""
    axes = {code: [0, -32768, 32767, 16, 128, 0] for code in (0, 1, 3, 4)}
    return KernelDevice(**{"name": "Emulated pad", "keys": range(0x130, 0x13B), "axes": axes} | options)


def bare_pad(**options):
    """Return a pad whose sticks are bytes; the kernel reports them as 0 until they move."""
    axes = {code: [0, 0, 255, 0, 15, 0] for code in (0, 1)}
    return KernelDevice(**{"name": "Bare pad", "keys": range(0x120, 0x12C), "axes": axes} | options)


def keyboard():
    """Return a keyboard, which the driver must not select as a game pad."""
    return KernelDevice("AT keyboard", range(1, 120))


def touchpad():
    """A place to point at, no stick that returns."""
    return KernelDevice("Touchpad", (0x14A, 0x145), {0: [0, 0, 4000, 0, 0, 40], 1: [0, 0, 3000, 0, 0, 40]})


def connect(patches, devices):
    """Let these files (path → device) be devices until the end of the test."""
    import fcntl
    import os
    from pathlib import Path

    for path in devices:
        Path(path).touch()
    by_file = {os.stat(path).st_ino: device for path, device in devices.items()}
    real_read, real_ioctl = os.read, fcntl.ioctl

    def of(fd):
        return by_file.get(os.fstat(fd).st_ino)

    def read_kernel(fd, size):
        device = of(fd)
        return real_read(fd, size) if device is None else device.read(size)

    def ioctl(fd, request, arg=0, mutate=True):
        device = of(fd)
        if device is None:
            return real_ioctl(fd, request, arg, mutate)
        answer = device.ioctl(request)
        arg[: len(answer)] = answer
        return len(answer)

    patches.setattr(os, "read", read_kernel)
    patches.setattr(fcntl, "ioctl", ioctl)
