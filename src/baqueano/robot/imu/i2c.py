"""A device on an I2C bus of Linux: whole bursts, and no call that hangs.

A burst is one combined transfer: the register is written, and after a repeated start its bytes are read. The
Raspberry Pi's controller (i2c-bcm2835) takes one read in a transfer, and that one last: no burst here asks more.

The kernel lets a transfer on a held bus wait one second. `TIMEOUT_10MS` makes that 40 ms, which is what 16 samples of
14 bytes need at 62.5 kHz. That is the slowest clock of a Pi 3 that was set to 100 kHz. It holds for the whole bus.

A device that was cut off in the middle of a byte may hold SDA low. Nothing that a program may do through /dev/i2c-N
frees it; nine clocks on SCL by GPIO do (bus_recovery.py), and so does cutting the device's power.
"""

import errno
from dataclasses import dataclass, field
from typing import Any

from baqueano.diagnostics import fault
from baqueano.errors import RobotUnreachable, UsageError

I2C_RETRIES, I2C_TIMEOUT = 0x0701, 0x0702  # requests of linux/i2c-dev.h that smbus2 does not name
TIMEOUT_10MS = 4
HELD = (errno.ETIMEDOUT, errno.EAGAIN)  # a line does not rise; arbitration lost


@dataclass
class Device:
    """A device with registers at `address` of `path`, as "/dev/i2c-1".  Errors of a transfer are OSError."""

    path: str
    address: int
    _bus: Any = field(default=None, init=False, repr=False)
    _message: Any = field(default=None, init=False, repr=False)

    def open(self) -> None:
        """Open the bus. UsageError without Linux or smbus2, RobotUnreachable without the bus or the right to it."""
        message, bus_class = _smbus2()
        self.close()
        try:
            self._bus = bus_class(self.path)
        except FileNotFoundError:
            raise RobotUnreachable(fault("imu.no-bus", path=self.path)) from None
        except PermissionError:
            raise RobotUnreachable(fault("imu.bus-not-allowed", path=self.path)) from None
        self._message = message
        self._bound_the_wait()

    def close(self) -> None:
        """Close the bus; nothing where it is closed."""
        if self._bus is not None:
            self._bus.close()
            self._bus = None

    def read(self, register: int, count: int) -> bytes:
        """`count` bytes from `register` on, in one transfer."""
        data = self._message.read(self.address, count)
        self._transfer(self._message.write(self.address, (register,)), data)
        return bytes(data)

    def write(self, register: int, *values: int) -> None:
        """`values`, bytes, into `register` and those after it, in one transfer."""
        self._transfer(self._message.write(self.address, (register, *values)))

    def _transfer(self, *messages: object) -> None:
        if self._bus is None:
            raise OSError(errno.EBADF, f"{self.path} is closed")
        self._bus.i2c_rdwr(*messages)

    def _bound_the_wait(self) -> None:
        """Set the kernel's limit for a transfer; some adapters keep their own."""
        import fcntl

        for request, value in ((I2C_RETRIES, 0), (I2C_TIMEOUT, TIMEOUT_10MS)):
            try:
                fcntl.ioctl(self._bus.fd, request, value)
            except OSError as error:
                if error.errno not in (errno.ENOTTY, errno.EINVAL, errno.EOPNOTSUPP):
                    raise


def is_stuck_low(error: OSError) -> bool:
    """Return True if the error means a bus stuck low, and not a silent device."""
    return error.errno in HELD


def _smbus2() -> tuple[Any, Any]:
    """smbus2's message and bus classes."""
    try:
        from smbus2 import SMBus, i2c_msg
    except ImportError:
        raise UsageError(fault("imu.no-smbus")) from None
    return i2c_msg, SMBus
