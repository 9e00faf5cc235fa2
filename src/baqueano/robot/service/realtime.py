"""Request real-time rights from the system for a control loop, and notify systemd.

SCHED_FIFO wakes a loop of 100 Hz in time (`doctor --jitter` measures it on your machine). The loop also waits for the
interpreter lock. If an ordinary program preempted the thread that holds it, the loop would wait for this program, too
(priority inversion; Sha, Rajkumar and Lehoczky 1990). So the other threads that already run get
SCHED_FIFO, below the loop; one that starts later, such as the copy of a run for a client, is an ordinary thread.

Each page of memory is locked when it is first used, so that no tick waits for the disk. Locking all mapped memory would
also make unused buffers and stacks resident. Objects made at the start are excluded from garbage collection.
docs/benchmarks.md gives the results.
"""

import ctypes
import gc
import os
import socket
import threading
from contextlib import suppress
from typing import Any

from baqueano.messages.language import translate as _

PRIORITY = 40  # below the kernel's own threads at 50
MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4


def request_realtime(priority: int = PRIORITY) -> list[str]:
    """Request a real-time priority and locked memory, and return sentences about what was granted.

    The calling thread has `priority`, the other threads of this program one less. Threads and programs that start
    later do not inherit it. Existing objects are excluded from garbage collection, and the collector is switched on.
    """
    grants = []
    try:
        policy, own_id = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, threading.get_native_id()
        os.sched_setscheduler(own_id, policy, os.sched_param(priority))
        thread_ids = {thread.native_id or own_id for thread in threading.enumerate()}
        for thread_id in thread_ids - {own_id}:
            with suppress(ProcessLookupError):  # it has ended
                os.sched_setscheduler(thread_id, policy, os.sched_param(priority - 1))
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
    """A sender of notifications to systemd. If systemd did not request notifications, the calls do nothing."""

    def __init__(self) -> None:
        socket_path = os.environ.get("NOTIFY_SOCKET")
        self._line: Any = None
        if socket_path and hasattr(socket, "AF_UNIX"):
            self._line = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._line.setblocking(False)
            self._address = "\0" + socket_path[1:] if socket_path.startswith("@") else socket_path

    def notify(self, state: str) -> None:
        """Send a notification such as READY=1, WATCHDOG=1 or STATUS=…; it is lost if systemd is not ready."""
        if self._line is not None:
            with suppress(OSError):
                self._line.sendto(state.encode(), self._address)

    def close(self) -> None:
        """Close the socket."""
        if self._line is not None:
            self._line.close()
