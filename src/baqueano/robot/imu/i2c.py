"""Transfer whole bursts to and from a device on an I2C bus of Linux, without a call that hangs.

A burst is one combined transfer: the register is written, and after a repeated start its bytes are read. The
Raspberry Pi's controller (i2c-bcm2835) accepts one read in a transfer, and only at its end. Every burst here fulfils
this condition.

The kernel's default timeout of a transfer on a stuck bus is one second. `TIMEOUT_10MS` makes it 40 ms, which is enough
for 16 samples of 14 bytes at 62.5 kHz. That is the slowest clock of a Pi 3 that was set to 100 kHz. The timeout applies
to the whole bus.

A device that was cut off in the middle of a byte can hold SDA low. A request through /dev/i2c-N does not free the bus.
Nine clocks on SCL by GPIO free it (bus_recovery.py), and so does a power cycle of the device.
"""

import errno
import os
from dataclasses import dataclass, field
from typing import Any

from baqueano.errors import RobotUnreachable, UsageError

I2C_RETRIES, I2C_TIMEOUT = 0x0701, 0x0702  # requests of linux/i2c-dev.h that smbus2 does not define
TIMEOUT_10MS = 4
STUCK_BUS_ERRNOS = (errno.ETIMEDOUT, errno.EAGAIN)  # a line that stays low; arbitration lost


@dataclass
class I2cDevice:
    """A device with registers at `address` of the bus `path` ("/dev/i2c-1"). A failed transfer raises OSError."""

    path: str
    address: int
    _bus: Any = field(default=None, init=False, repr=False)
    _message: Any = field(default=None, init=False, repr=False)

    def open(self) -> None:
        """Open the bus.

        Raise UsageError without smbus2. Raise RobotUnreachable if the bus is missing or cannot be opened.
        """
        message, bus_class = _smbus2()
        self.close()
        try:
            self._bus = bus_class(self.path)
        except FileNotFoundError:
            raise RobotUnreachable.of("imu.no-bus", path=self.path) from None
        except PermissionError:
            raise RobotUnreachable.of("imu.bus-not-allowed", path=self.path) from None
        self._message = message
        self._set_timeout()

    def close(self) -> None:
        """Close the bus if it is open."""
        if self._bus is not None:
            self._bus.close()
            self._bus = None

    def read(self, register: int, count: int) -> bytes:
        """Return `count` bytes, read in one transfer from `register` and the following registers."""
        data = self._message.read(self.address, count)
        self._transfer(self._message.write(self.address, (register,)), data)
        return bytes(data)

    def write(self, register: int, *values: int) -> None:
        """Write the bytes `values` into `register` and the following registers, in one transfer."""
        self._transfer(self._message.write(self.address, (register, *values)))

    def _transfer(self, *messages: object) -> None:
        if self._bus is None:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF), self.path)
        self._bus.i2c_rdwr(*messages)

    def _set_timeout(self) -> None:
        """Set the kernel's timeout for a transfer. An adapter that does not support this keeps its timeout."""
        import fcntl

        for request, value in ((I2C_RETRIES, 0), (I2C_TIMEOUT, TIMEOUT_10MS)):
            try:
                fcntl.ioctl(self._bus.fd, request, value)
            except OSError as error:
                if error.errno not in (errno.ENOTTY, errno.EINVAL, errno.EOPNOTSUPP):
                    raise


def is_stuck_low(error: OSError) -> bool:
    """Return True if the error means that the bus is stuck low, False if only the device is silent."""
    return error.errno in STUCK_BUS_ERRNOS


def _smbus2() -> tuple[Any, Any]:
    """Return the message class and the bus class of smbus2. Raise UsageError if smbus2 is not installed."""
    try:
        from smbus2 import SMBus, i2c_msg
    except ImportError:
        raise UsageError.of("imu.no-smbus") from None
    return i2c_msg, SMBus
