"""Driving with the keys of the terminal: arrows or w a s d, space stops, q ends.

A terminal tells presses, not releases. So a key counts for HOLD_S after it was last heard, which the
repeat of a key that is held down renews; then the command falls back to zero.
"""

import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

import numpy as np

HOLD_S = 0.6  # longer than the pause before a held key repeats
FORWARD, BACKWARD, LEFT, RIGHT = "forward", "backward", "left", "right"
KEYS = {
    "w": FORWARD, "s": BACKWARD, "a": LEFT, "d": RIGHT,
    "\x1b[A": FORWARD, "\x1b[B": BACKWARD, "\x1b[D": LEFT, "\x1b[C": RIGHT,
    "\xe0H": FORWARD, "\xe0P": BACKWARD, "\xe0K": LEFT, "\xe0M": RIGHT,
}  # fmt: skip


class Keyboard:
    """Turns keys into commands: `with Keyboard(limit) as hand: teach(vehicle_file, hand)`."""

    def __init__(
        self,
        limit: np.ndarray,
        share: float = 0.5,
        read: Callable[[], list[str]] | None = None,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._size = share * np.where(np.isfinite(limit), limit, 1.0)
        self._read, self._now = read, now
        self._heard = {word: -np.inf for word in (FORWARD, BACKWARD, LEFT, RIGHT)}
        self._close: Callable[[], Any] = lambda: None

    def __enter__(self) -> "Keyboard":
        if self._read is None:
            self._read, self._close = open_terminal()
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._close()

    def __call__(self) -> np.ndarray:
        """The command (n,) wanted now; KeyboardInterrupt at q."""
        now = self._now()
        for key in self._read() if self._read is not None else []:
            if key in ("q", "\x03"):
                raise KeyboardInterrupt
            if key == " ":
                self._heard = dict.fromkeys(self._heard, -np.inf)
            elif key in KEYS:
                self._heard[KEYS[key]] = now
        held = {word: float(now - heard <= HOLD_S) for word, heard in self._heard.items()}
        ahead, left = held[FORWARD] - held[BACKWARD], held[LEFT] - held[RIGHT]
        u = np.zeros(len(self._size))
        u[0], u[-1] = ahead, left
        return u * self._size


def open_terminal() -> tuple[Callable[[], list[str]], Callable[[], Any]]:
    """(read the keys that wait, give the terminal back). msvcrt on Windows, termios elsewhere."""
    try:
        import msvcrt
    except ImportError:
        return _open_unix()

    def read() -> list[str]:
        keys = []
        while msvcrt.kbhit():  # pyright: ignore
            key = msvcrt.getwch()  # pyright: ignore
            keys.append("\xe0" + msvcrt.getwch() if key in ("\0", "\xe0") else key.lower())  # pyright: ignore
        return keys

    return read, lambda: None


def _open_unix() -> tuple[Callable[[], list[str]], Callable[[], Any]]:
    import os
    import select
    import sys

    from baqueano.errors import UsageError

    try:
        import termios
        import tty
    except ImportError as error:
        raise UsageError(
            "this terminal cannot be asked for single keys: give the drive as a list of commands."
        ) from error
    if not sys.stdin.isatty():
        raise UsageError("driving by keys needs a terminal; here the input is a file or a pipe.")
    fd = sys.stdin.fileno()
    before = termios.tcgetattr(fd)
    tty.setcbreak(fd)

    def read() -> list[str]:
        text = ""
        while select.select([fd], [], [], 0.0)[0]:
            text += os.read(fd, 64).decode(errors="ignore")
        return split_keys(text)

    return read, lambda: termios.tcsetattr(fd, termios.TCSADRAIN, before)


def split_keys(text: str) -> list[str]:
    """Single keys of what a terminal sent: "w\\x1b[A" is w and an arrow."""
    keys, at = [], 0
    while at < len(text):
        size = 3 if text.startswith("\x1b[", at) else 1
        keys.append(text[at : at + size] if size == 3 else text[at].lower())
        at += size
    return keys
