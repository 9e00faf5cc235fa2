"""Join a pair of pipes to a socket: the pipes of ssh, or of a parent process, even on Windows."""

import os
import socket
import threading
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from baqueano.errors import RobotUnreachable

READ_BYTES = 1 << 16


def attach(path: Path, source: BinaryIO, sink: BinaryIO) -> None:
    """Join a pair of pipes to the socket `path` of the service until one side ends.

    Raise RobotUnreachable if no service listens there.
    """
    line = socket.socket(socket.AF_UNIX)
    try:
        line.connect(str(path))
    except OSError as error:
        # that module loads numpy, which a page does not need
        from baqueano.door.remote import unreachable_service

        raise RobotUnreachable(unreachable_service(path, error)) from error
    forward_bytes(line, source, sink)


def forward_bytes(connection: socket.socket, source: BinaryIO, sink: BinaryIO) -> None:
    """Forward the bytes in both directions until one side ends."""

    def forward_answers() -> None:
        with suppress(OSError, ValueError):
            while data := connection.recv(READ_BYTES):
                sink.write(data)
                sink.flush()

    backwards = threading.Thread(target=forward_answers, name="pipe", daemon=True)
    backwards.start()
    with connection, suppress(OSError):
        while data := os.read(source.fileno(), READ_BYTES):
            connection.sendall(data)
        connection.shutdown(socket.SHUT_RDWR)
