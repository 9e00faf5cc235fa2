"""ssh: the way to a HOST, and its commands, on this terminal.

ssh … -- HOST COMMAND      what stands behind -- is never an option of ssh, even with a - in front
"""

import codecs
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import IO, TextIO

from baqueano.errors import RobotUnreachable, UsageError
from baqueano.printable import one_line, printable

LONGEST = 16 << 20  # bytes of an answer
LAST_S = 1.0  # for the last words of a program that has ended


def there(host: str) -> list[str]:
    """Return where HOST is in the words of ssh: "user@name" or "user@name:port". UsageError for what is no HOST."""
    name, colon, port = host.rpartition(":")
    port_words, name = (["-p", port], name) if colon and port.isdigit() else ([], host)
    computer = name.rpartition("@")[2]
    if (
        not computer
        or name.startswith("-")
        or computer.startswith("-")
        or name != one_line(name)
        or " " in name
    ):
        raise UsageError(
            f'HOST "{one_line(host)}": expected the name of a vehicle that ssh reaches, which begins with a letter or '
            "a digit and without a space. Type it as pilot@rover.local"
        )
    return [*port_words, "--", name]


def ssh(host: str, command: str, *options: str) -> list[str]:
    """Return what runs `command` at HOST. UsageError where HOST is not a computer."""
    if host in ("emulated", "simulated"):
        raise UsageError(
            f"{host} is not a vehicle: expected a vehicle that ssh reaches, pilot@rover.local, or "
            f"nothing, for what is plugged in here. Drives are what it can do: baqueano experiment --robot {host}"
        )
    if host.startswith(("/", "COM")):
        raise UsageError(
            f"{host}: expected a vehicle that ssh reaches, pilot@rover.local. The port of an Uno that is plugged in "
            f"here stands in the vehicle file; or type: --set robot.port={host}"
        )
    return [
        "ssh", "-T", "-o", "ConnectTimeout=8", "-o", "ServerAliveInterval=5", *options, *there(host), command
    ]  # fmt: skip


def run(command: list[str], given: bytes = b"", answers: bool = True) -> tuple[bytes, int]:
    """Return what a program answers on stdout, and its exit code; what it says to people is shown as it comes. With
    `answers` False all of it is for people. `given` is its stdin, else it has this program's."""
    with tempfile.TemporaryFile() as file:
        file.write(given)
        file.seek(0)
        program = subprocess.Popen(
            command, stdin=file if given else None, stdout=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=0
        )
        out, err = _pipe(program.stdout), _pipe(program.stderr)
        with program, shown((err, sys.stderr), *([] if answers else [(out, sys.stdout)])):
            try:
                return answer(out) if answers else b"", program.wait()
            except BaseException:
                program.kill()
                raise


def answer(stream: IO[bytes]) -> bytes:
    """Return all that comes of a stream. RobotUnreachable where that is more than LONGEST bytes."""
    said = bytearray()
    while data := os.read(stream.fileno(), 1 << 16):
        said += data
        if len(said) > LONGEST:
            raise RobotUnreachable(
                f"the vehicle answered more than {LONGEST >> 20} MB, and was not heard to its end."
            )
    return bytes(said)


@contextmanager
def shown(*streams: tuple[IO[bytes], TextIO]) -> Iterator[None]:
    """Shows what comes of each stream meanwhile, printable (printable.py)."""
    threads = [threading.Thread(target=_show, args=each, daemon=True) for each in streams]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        for thread in threads:
            thread.join(LAST_S)


def _show(of: IO[bytes], to: TextIO) -> None:
    """Forward byte by byte: a question for a password ends without a newline. A raw terminal of ssh needs \\r."""
    decoder = codecs.getincrementaldecoder("utf-8")("replace")
    while True:
        try:
            data = os.read(of.fileno(), 1 << 16)
        except (OSError, ValueError):
            return
        text = printable(decoder.decode(data, final=not data).replace("\r", ""))
        with suppress(OSError, ValueError):  # a terminal that is gone does not end the work
            to.write(text.replace("\n", "\r\n") if to.isatty() else text)
            to.flush()
        if not data:
            return


def _pipe(stream: IO[bytes] | None) -> IO[bytes]:
    assert stream is not None
    return stream
