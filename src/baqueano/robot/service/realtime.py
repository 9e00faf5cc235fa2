"""Grants of the system to a control loop, and notifications to it.

SCHED_FIFO wakes a loop of 100 Hz in time (`doctor --jitter` measures it on yours). Memory is locked page by page as it
is touched, so that no tick waits for the disk: to lock all that is mapped makes buffers and stacks resident that are
never used. What was made at the start leaves the rounds of the garbage collector, uncollected. docs/benchmarks.md has
the figures.
"""

import ctypes
import gc
import os
import socket
from contextlib import suppress
from typing import Any

from baqueano.language import translated as _

PRIORITY = 40  # below the kernel's own threads at 50
MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4


def claimed(priority: int = PRIORITY) -> list[str]:
    """Asks for a real-time priority and locked memory; what was granted, in words. Threads and programs that start
    later do not inherit the priority. Garbage is collected from now on."""
    grants = []
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
        grants.append(_("real-time priority {priority}", priority=priority))
    except (AttributeError, OSError) as error:
        grants.append(_("no real-time priority ({error}): ticks may be some milliseconds late", error=error))
    try:
        if ctypes.CDLL(None, use_errno=True).mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT):
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
        grants.append(_("memory locked"))
    except (AttributeError, OSError) as error:
        grants.append(_("memory not locked ({error})", error=error))
    gc.freeze()
    gc.enable()
    return grants


class Systemd:
    """Words to systemd, if it asked for any; nothing happens elsewhere."""

    def __init__(self, address: str | None = None) -> None:
        socket_path = os.environ.get("NOTIFY_SOCKET") if address is None else address
        self._line: Any = None
        if socket_path and hasattr(socket, "AF_UNIX"):
            self._line = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._line.setblocking(False)
            self._to = "\0" + socket_path[1:] if socket_path.startswith("@") else socket_path

    def say(self, words: str) -> None:
        """READY=1, WATCHDOG=1, STATUS=…; lost if systemd does not listen just now."""
        if self._line is not None:
            with suppress(OSError):
                self._line.sendto(words.encode(), self._to)

    def close(self) -> None:
        """End the notifications."""
        if self._line is not None:
            self._line.close()
