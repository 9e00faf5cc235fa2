"""Provide a serial line for the link: found by its stable name, non-blocking, reopened after a disconnection.

Opening the line resets an Uno by its signal DTR, so the line is opened once and kept open. Then the boot-loader waits a
second or two, and the firmware sends INFO without a request. A service that starts opens the line first
(`reset_uno_early`) and loads the rest of its code during that time. For that reason this module does not import numpy.
"""

import errno
import glob
import os
import select
import threading
import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from baqueano.diagnostics import Diagnostic, fault
from baqueano.errors import BaqueanoError, RobotUnreachable, UsageError
from baqueano.robot.uno.frames import BAUD, PROTOCOL, AskInfo, Info

if TYPE_CHECKING:
    from baqueano.robot.uno.link import Uno

WRITE_TIMEOUT_S = 0.01  # time limit of a write; the rest is dropped
REOPEN_PERIOD_S = 0.25  # between attempts to open a disconnected line
READ_PERIOD_S = 0.02
BOOT_TIMEOUT_S = 4.0  # including the boot-loader
BY_ID = "/dev/serial/by-id/*"
OTHER_PORTS = ("/dev/ttyACM*", "/dev/ttyUSB*")


class SerialPort:
    """The serial line at `path`. Its methods raise OSError while the line is not open."""

    def __init__(self, path: str, baud: int = BAUD) -> None:
        self.path, self.baud = path, baud
        self._serial: Any = None

    @property
    def is_open(self) -> bool:
        """Return True if the line was opened and no error has closed it since."""
        return self._serial is not None

    def open(self) -> None:
        """Open the line. Raise OSError if that fails."""
        import serial

        try:
            # SerialException is an OSError
            self._serial = serial.Serial(
                self.path, self.baud, timeout=0, write_timeout=WRITE_TIMEOUT_S, exclusive=True
            )
        except Exception as error:
            if type(error).__module__ != "termios":  # of a line that was disconnected while it was opened
                raise
            raise OSError(errno.EIO, os.strerror(errno.EIO), self.path) from error

    def close(self) -> None:
        """Close the line."""
        line, self._serial = self._serial, None
        if line is not None:
            with suppress(OSError):
                line.close()

    def write(self, data: bytes) -> None:
        """Send the bytes within WRITE_TIMEOUT_S. The receiver discards an incomplete frame because of its CRC."""
        if self._serial is None:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF), self.path)
        self._serial.write(data)

    def read(self) -> bytes:
        """Return the bytes that have arrived since the last call."""
        if self._serial is None:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF), self.path)
        try:
            return self._serial.read(4096)
        except OSError:
            self.close()
            raise

    def wait(self, seconds: float) -> None:
        """Wait until bytes arrive, at most for this time [s]."""
        serial = self._serial
        if serial is None:
            time.sleep(seconds)
            return
        try:
            select.select([serial.fileno()], [], [], seconds)
        except (OSError, ValueError):  # the line was closed during the wait
            time.sleep(seconds)


def reset_uno_early(path: Path) -> Callable[[], object]:
    """Open the line that a vehicle file names, which resets its Uno, and return the function that closes it.

    Open the line again before you call that function. Otherwise the close drops DTR, and the next opening
    resets the Uno again. If the file or the line is not found, nothing is opened; their later use reports the error.
    """
    try:
        hardware = tomllib.loads(path.read_text(encoding="utf-8")).get("robot", {})
        line = os.open(find_port(hardware.get("port", "auto")), os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except (BaqueanoError, OSError, ValueError, AttributeError, TypeError, RecursionError):
        return lambda: None
    return partial(os.close, line)


@contextmanager
def open_uno(port: str = "auto") -> "Iterator[Uno]":
    """Yield the Uno at a port, which a separate thread reads, and disarm it at the end. "auto" finds the only line.

    Raise RobotUnreachable without a line, or if no firmware with this protocol answers within BOOT_TIMEOUT_S. Raise
    UsageError for "auto" if there are several lines.

    >>> from baqueano.robot.uno.frames import Driver
    >>> with open_uno() as uno:
    ...     kept = uno.settings()  # the wiring stored in its EEPROM
    >>> print(Driver(kept.driver).name)
    L298N
    """
    from baqueano.robot.uno.link import Uno

    path = find_port(port)
    line = SerialPort(path)
    try:
        line.open()
    except OSError as error:
        raise RobotUnreachable(_open_error(path, error)) from error
    uno, end_event = Uno(line), threading.Event()
    listener = threading.Thread(
        target=read_continuously, args=(line, uno, end_event), name="uno", daemon=True
    )
    listener.start()
    try:
        firmware_info(uno, path)
        yield uno
    finally:
        uno.disarm()
        end_event.set()
        listener.join()
        line.close()


def read_continuously(port: SerialPort, uno: "Uno", stop: threading.Event) -> None:
    """Read the line until `stop` is set, and open it again after each disconnection."""
    while not stop.is_set():
        if port.is_open:
            port.wait(READ_PERIOD_S)
            uno.pump()
        elif not stop.wait(REOPEN_PERIOD_S):
            try:
                port.open()
            except OSError:
                continue
            uno.on_reopen()


def firmware_info(uno: "Uno", path: str) -> Info:
    """Return the firmware's INFO.

    Raise RobotUnreachable if INFO does not arrive within BOOT_TIMEOUT_S, or for another protocol.
    """
    end_s = time.monotonic() + BOOT_TIMEOUT_S
    while True:
        try:
            info = uno.request(AskInfo(), Info)
            break
        except RobotUnreachable:
            if time.monotonic() > end_s:
                raise
    if info.protocol != PROTOCOL:
        raise RobotUnreachable.of(
            "uno.protocol",
            "baqueano robot flash",
            path=path,
            firmware_protocol=info.protocol,
            package_protocol=PROTOCOL,
        )
    return info


def find_port(port: str) -> str:
    """Return the path of the serial line; "auto" finds the only line of this computer.

    For "auto", raise RobotUnreachable without a line, and UsageError if there are several lines.
    """
    if port != "auto":
        return port
    ports = sorted(glob.glob(BY_ID)) or sorted(p for pattern in OTHER_PORTS for p in glob.glob(pattern))
    if not ports:
        raise RobotUnreachable.of("uno.no-line")
    if len(ports) > 1:
        raise UsageError.of("uno.several-lines", count=len(ports), lines=ports, first=ports[0])
    return ports[0]


def _open_error(path: str, error: OSError) -> Diagnostic:
    if error.errno in (errno.EACCES, errno.EPERM):
        user = os.environ.get("USER", "you")
        return fault("uno.port-not-allowed", f"sudo usermod -aG dialout {user}", user=user, path=path)
    if error.errno in (errno.EAGAIN, errno.EWOULDBLOCK, errno.EBUSY):
        return fault("uno.port-in-use", f"sudo fuser -v {path}", path=path)
    return fault("uno.port-not-opened", "ls /dev/serial/by-id", path=path, error=error)
