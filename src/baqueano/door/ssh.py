"""Run commands at a HOST over ssh, in this terminal.

ssh … -- HOST COMMAND      ssh does not read text after -- as an option, even if it begins with -
"""

import codecs
import os
import re
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import IO, TextIO

from baqueano.errors import RobotUnreachable, UsageError
from baqueano.messages.printable import baqueano_command, one_line, printable, shell_command

MAX_ANSWER_BYTES = 16 << 20  # maximum number of bytes of an answer
LAST_OUTPUT_S = 1.0  # time to show the last output of a program that has ended


def host_args(host: str) -> list[str]:
    """Return the arguments of ssh for `host`, "user@name" or "user@name:port".

    The name can be an IPv6 address, which has colons, and is in brackets before a port: [fe80::1]:22. Raise
    UsageError if `host` does not have this form.
    """
    name, colon, port = host.rpartition(":")
    has_port = colon and re.fullmatch(r"[0-9]+", port) and (":" not in name or name.endswith("]"))
    port_words, name = (["-p", port], name) if has_port else ([], host)
    user, separator, computer = name.rpartition("@")
    computer = computer.removeprefix("[").removesuffix("]")
    name = f"{user}{separator}{computer}"
    if (
        not computer
        or name.startswith("-")
        or computer.startswith("-")
        or name != one_line(name)
        or " " in name
    ):
        raise UsageError.of("ssh.host", host=one_line(host))
    return [*port_words, "--", name]


def ssh_line(host: str, *words: str) -> str:
    """Return the line to type for a command at `host`, or for a login.

    >>> ssh_line("pilot@rover.local:2222", "sudo", "reboot")
    'ssh -p 2222 pilot@rover.local sudo reboot'
    """
    *port_words, _dashes, name = host_args(host)
    return shell_command("ssh", *port_words, name, *words)


def ssh_command(host: str, command: str, *options: str) -> list[str]:
    """Return the command line that runs `command` at `host`. Raise UsageError if `host` is not a computer."""
    if host in ("emulated", "simulated"):
        raise UsageError.of("ssh.no-hardware", baqueano_command("experiment", "--robot", host), host=host)
    if re.match(r"/|COM\d+$", host):
        raise UsageError.of("ssh.not-a-host", host=host)
    return [
        "ssh", "-T", "-o", "ConnectTimeout=8", "-o", "ServerAliveInterval=5", *options, *host_args(host), command
    ]  # fmt: skip


def run_command(
    command: list[str], input_bytes: bytes = b"", return_output: bool = True
) -> tuple[bytes, int]:
    """Run a program, and return its stdout and its exit code; show its stderr as it arrives.

    If `return_output` is False, stdout is also shown, and b"" is returned. `input_bytes` is sent to its stdin; if it
    is empty, the program reads the stdin of this program.
    """
    with tempfile.TemporaryFile() as input_file:
        input_file.write(input_bytes)
        input_file.seek(0)
        program = subprocess.Popen(
            command,
            stdin=input_file if input_bytes else None,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            bufsize=0,
        )
        output, errors = _open_pipe(program.stdout), _open_pipe(program.stderr)
        with program, print_streams((errors, sys.stderr), *([] if return_output else [(output, sys.stdout)])):
            try:
                return read_limited(output) if return_output else b"", program.wait()
            except BaseException:
                program.kill()
                raise


def read_limited(stream: IO[bytes]) -> bytes:
    """Return all bytes of a stream. Raise RobotUnreachable if the stream has more than MAX_ANSWER_BYTES bytes."""
    output = bytearray()
    while data := os.read(stream.fileno(), 1 << 16):
        output += data
        if len(output) > MAX_ANSWER_BYTES:
            raise RobotUnreachable.of("ssh.too-much", max_mb=MAX_ANSWER_BYTES >> 20)
    return bytes(output)


@contextmanager
def print_streams(*streams: tuple[IO[bytes], TextIO]) -> Iterator[None]:
    """Show the text of each source stream at its target, in printable form (printable.py), while the body runs."""
    threads = [threading.Thread(target=_copy_text, args=stream_pair, daemon=True) for stream_pair in streams]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        for thread in threads:
            thread.join(LAST_OUTPUT_S)


def _copy_text(source: IO[bytes], sink: TextIO) -> None:
    """Show the text of a stream as it arrives, because a password prompt ends without a newline.

    A raw terminal of ssh needs \\r.
    """
    decoder = codecs.getincrementaldecoder("utf-8")("replace")
    while True:
        try:
            data = os.read(source.fileno(), 1 << 16)
        except (OSError, ValueError):
            return
        text = printable(decoder.decode(data, final=not data).replace("\r", ""))
        with suppress(OSError, ValueError):  # a lost terminal does not end the work
            sink.write(text.replace("\n", "\r\n") if sink.isatty() else text)
            sink.flush()
        if not data:
            return


def _open_pipe(stream: IO[bytes] | None) -> IO[bytes]:
    assert stream is not None
    return stream
