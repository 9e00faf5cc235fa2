"""Use the terminal as a device: read single keys, write frames, and restore the settings of the terminal at the end.

The terminal is opened again, so that the non-blocking mode does not affect other programs. A terminal with a lost
network does not accept bytes and must not delay a vehicle: bytes that it does not accept are dropped.
"""

import os
import sys
from contextlib import suppress
from typing import Any, Protocol

from baqueano.drive.manual.keys import PRESS, KeyDecoder, KeyEvent
from baqueano.errors import UsageError

CURSOR_OFF, CURSOR_ON = b"\x1b[?25l", b"\x1b[?25h"
MAX_PENDING_BYTES = 4096  # maximum number of bytes that wait: frames of half a second


class Terminal(Protocol):
    """Protocol of the terminal that a `Cockpit` uses: input and output."""

    can_answer: bool  # True if the terminal can answer queries

    def read(self) -> list[KeyEvent] | None:
        """Return the events since the last call, or None once the input has ended."""
        ...

    def write(self, data: bytes) -> None:
        """Send the bytes or drop them, without waiting."""
        ...

    def set_mode(self, on_bytes: bytes, off_bytes: bytes) -> None:
        """Send `on_bytes` now, and `off_bytes` when the terminal is closed."""
        ...

    def size(self) -> tuple[int, int]:
        """Return the numbers of columns and lines."""
        ...

    def close(self) -> None:
        """Restore the settings and close the terminal."""
        ...


class UnixTerminal:
    """A Unix terminal, given by a file descriptor."""

    can_answer = True

    def __init__(self, fd: int) -> None:
        import termios
        import tty

        self._fd = os.open(os.ttyname(fd), os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self._decoder, self._pending_output, self._undo = KeyDecoder(), b"", b""
        self._previous_mode = termios.tcgetattr(self._fd)
        tty.setcbreak(self._fd)
        mode = termios.tcgetattr(self._fd)
        mode[6][termios.VSUSP] = b"\0"  # Ctrl-Z would return the terminal to the shell with these settings
        termios.tcsetattr(self._fd, termios.TCSANOW, mode)
        self.set_mode(CURSOR_OFF, CURSOR_ON)

    def read(self) -> list[KeyEvent] | None:
        """Return the events since the last call, or None once the terminal has hung up."""
        self.write(b"")
        data = b""
        try:
            while piece := os.read(self._fd, 4096):
                data += piece
        except BlockingIOError:
            return self._decoder.feed(data)
        except OSError:  # hung up
            pass
        return None if not data else self._decoder.feed(data)

    def write(self, data: bytes) -> None:
        """Queue the bytes and send what the terminal accepts; drop them if more than MAX_PENDING_BYTES bytes wait."""
        if len(self._pending_output) + len(data) <= MAX_PENDING_BYTES:
            self._pending_output += data
        if self._pending_output:
            with suppress(OSError):
                self._pending_output = self._pending_output[os.write(self._fd, self._pending_output) :]

    def set_mode(self, on_bytes: bytes, off_bytes: bytes) -> None:
        """Send `on_bytes` now, and `off_bytes` in `close`."""
        self._undo = off_bytes + self._undo
        self.write(on_bytes)

    def size(self) -> tuple[int, int]:
        """Return the numbers of columns and lines, (80, 24) if they are unknown."""
        with suppress(OSError):
            columns, lines = os.get_terminal_size(self._fd)
            if columns and lines:
                return columns, lines
        return 80, 24

    def close(self) -> None:
        """Restore the modes and settings of the terminal, and close its file."""
        import termios

        self._pending_output = b""  # drop the rest of a frame, which would be read as text
        self.write(self._undo)
        with suppress(OSError, termios.error):
            # discard answers that are still on their way, as they are not typed text
            termios.tcsetattr(self._fd, termios.TCSAFLUSH, self._previous_mode)
        os.close(self._fd)


class WindowsConsole:
    """The console of Windows, which reports only characters and arrows."""

    can_answer = False

    def read(self) -> list[KeyEvent] | None:
        """Return the keys that were pressed since the last call."""
        import msvcrt

        keys = []
        while msvcrt.kbhit():  # pyright: ignore
            key = msvcrt.getwch()  # pyright: ignore
            if key in ("\0", "\xe0"):
                arrow = {"H": "up", "P": "down", "K": "left", "M": "right"}.get(msvcrt.getwch())  # pyright: ignore
                keys += [KeyEvent(PRESS, arrow)] if arrow else []
            else:
                keys += KeyDecoder().feed(key.encode())
        return keys

    def write(self, data: bytes) -> None:
        """Write the bytes to stdout."""
        sys.stdout.write(data.decode())
        sys.stdout.flush()

    def set_mode(self, on_bytes: bytes, off_bytes: bytes) -> None:
        """Do nothing: this console does not have modes to change."""

    def size(self) -> tuple[int, int]:
        """Return (80, 24), because the size is unknown."""
        return 80, 24

    def close(self) -> None:
        """Do nothing: the settings were not changed."""


def open_terminal() -> Terminal:
    """Return the terminal of this program. Raise UsageError if the program does not have one."""
    try:
        import msvcrt  # noqa: F401
    except ImportError:
        return _open_unix_terminal()
    return WindowsConsole()


def _open_unix_terminal() -> UnixTerminal:
    try:
        import termios  # noqa: F401
    except ImportError as error:
        raise UsageError.of("keys.no-terminal-control") from error
    if not sys.stdin.isatty():
        raise UsageError.of("keys.no-terminal")
    return UnixTerminal(sys.stdin.fileno())


def terminal_proxy() -> str:
    """Return the name of a parent program that answers instead of the terminal: tmux, screen, mosh-server or zellij.

    That program continues to run after the terminal is lost. Return "" if this program does not run inside one.
    """
    for name in _ancestor_programs():
        for program in ("tmux", "screen", "mosh-server", "zellij"):
            if name.lower().startswith(program):
                return program
    return ""


def _ancestor_programs() -> list[str]:
    """Return the names of this program and its parents, nearest first; [] if the system does not list them."""
    names: list[str] = []
    pid = os.getpid()
    with suppress(OSError, ValueError, IndexError):
        while pid > 1 and len(names) < 30:
            with open(f"/proc/{pid}/stat", encoding="utf-8", errors="replace") as file:
                text = file.read()
            names.append(text[text.index("(") + 1 : text.rindex(")")])
            pid = int(text[text.rindex(")") + 1 :].split()[1])
    return names


def is_over_ssh(environment: Any = os.environ) -> bool:
    """Return True if the terminal of this program is at the other end of an SSH connection."""
    return bool(environment.get("SSH_CONNECTION") or environment.get("SSH_TTY"))
