"""Join a pair of pipes to a socket: the pipes of ssh, or of a parent process, also on Windows."""

import os
import socket
import threading
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from baqueano.errors import RobotUnreachable

PIECE = 1 << 16


def attach(path: Path, coming: BinaryIO, going: BinaryIO) -> None:
    """Join a pair of pipes to the socket `path` of the service until one side ends.

    Raise RobotUnreachable if no service listens there.
    """
    from baqueano.door.remote import nobody_there  # it loads numpy, which the page does not need

    line = socket.socket(socket.AF_UNIX)
    try:
        line.connect(str(path))
    except OSError as error:
        from baqueano.door.remote import nobody_there  # it reads runs, which a page process does not

        raise RobotUnreachable(nobody_there(path, error)) from error
    join(line, coming, going)


def join(line: socket.socket, coming: BinaryIO, going: BinaryIO) -> None:
    """Forward the bytes in both directions until one side ends."""

    def back() -> None:
        with suppress(OSError, ValueError):
            while data := line.recv(PIECE):
                going.write(data)
                going.flush()

    backwards = threading.Thread(target=back, name="pipe", daemon=True)
    backwards.start()
    with line, suppress(OSError):
        while data := os.read(coming.fileno(), PIECE):
            line.sendall(data)
        line.shutdown(socket.SHUT_RDWR)
