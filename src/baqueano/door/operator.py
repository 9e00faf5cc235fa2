"""Store the requests of the operator. One client, the holder, has the right to drive; its silence stops the vehicle.

  SILENCE_S without a message of the holder   the vehicle stops, unless the mission is unattended             (1)
  a command older than SILENCE_S              is ignored                                                      (2)

The holder is a browser through its page, or a laptop by ssh. Both send a heartbeat every 50 ms, six of them within
SILENCE_S. Any client can stop the vehicle. The clients' messages arrive in another thread than the loop's. Both threads
can call the methods at any time.
"""

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from baqueano.diagnostics import Diagnostic, Severity, StopReason, note, stop
from baqueano.errors import SafetyStop

STOP_COMMAND = "baqueano robot stop HOST"
MAX_CHANGES = 64  # maximum number of changes of gains that wait for the next tick
SILENCE_S = 0.3  # 0.5 s is guaranteed; the loop and the firmware need the rest


class Operator:
    """The mailbox between the clients, which send commands and stops, and the loop, which reads them."""

    def __init__(self, now_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._now_ns = now_ns
        # reentrant, because a signal handler of the same thread can stop the vehicle in any method
        self._lock = threading.RLock()
        self._last_beat_ns = -(1 << 62)
        self._u: np.ndarray | None = None
        self._u_ns = -(1 << 62)
        self._holder: Any = None
        self._missions: deque[tuple[str, bool, str]] = deque(maxlen=1)
        self._stop: Diagnostic | None = None
        self._quit, self.is_clear_requested = False, False  # the last: a client has requested to clear a stop
        self._marks = 0
        self._changes: deque[tuple[str, object]] = deque(maxlen=MAX_CHANGES)
        self._busy = False  # a mission is driven or waits

    # called by the door

    def record_heartbeat(self, client: object) -> None:
        """Record a heartbeat of `client`, if it is the holder."""
        if client is self._holder:
            self._last_beat_ns = self._now_ns()

    def set_holder(self, client: object) -> None:
        """Make `client` the holder. Raise SafetyStop while another client is the holder."""
        with self._lock:
            self._check_only_holder(client)
            self._holder = client
        self.record_heartbeat(client)

    def revoke_holder(self, client: object) -> None:
        """Revoke the right of `client` to drive, if it is the holder.

        If its mission is still in progress, the mission ends by (1).
        """
        with self._lock:
            if self._holder is client:
                self._holder = None

    def is_holder(self, client: object) -> bool:
        """Return True if `client` is the holder."""
        return client is self._holder

    @property
    def is_busy(self) -> bool:
        """Return True while a mission is in progress or waits."""
        return self._busy

    def check_admission(self, client: object) -> None:
        """Raise SafetyStop if a mission of `client` would be refused now.

        It is refused if a mission is in progress or waits, or if another client is the holder.
        """
        with self._lock:
            if self._busy and client is self._holder:
                raise SafetyStop(note("door.own-mission", Severity.ERROR))
            # its holder has disconnected: heartbeats of a new holder must not keep it alive
            if self._busy and self._holder is None:
                raise SafetyStop(note("door.mission", Severity.ERROR, STOP_COMMAND))
            self._check_only_holder(client)

    def queue_mission(self, client: object, mission: str, *, attended: bool = True, name: str = "") -> None:
        """Make `client` the holder, and queue its mission in JSON. Raise SafetyStop as `check_admission` does.

        The client recognises the messages about its mission by `name`. `attended` is True if the silence of the
        holder stops the mission.
        """
        self.check_admission(client)
        self.set_holder(client)
        self._busy, self._quit = True, False
        self._missions.append((mission, attended, name))

    def set_command(self, client: object, u: object) -> None:
        """Set the command (n,) of the holder; ignore other clients and values that are not finite."""
        if client is self._holder:
            u = np.asarray(u, dtype=float)
            if u.ndim == 1 and np.all(np.isfinite(u)):
                self._u, self._u_ns = u, self._now_ns()
            self.record_heartbeat(client)

    def record_mark(self, client: object) -> None:
        """Record that the vehicle is on its mark now, if `client` is the holder."""
        if client is self._holder:
            self._marks += 1

    def set_gain(self, client: object, path: str, value: object) -> None:
        """Set a gain from the next tick on.

        Raise SafetyStop if `client` is not the holder, or no mission is in progress.
        """
        if client is not self._holder or not self._busy:
            raise SafetyStop(note("door.not-holder", Severity.ERROR))
        self._changes.append((path, value))

    def stop(self, reason: Diagnostic) -> None:
        """Stop the vehicle on request of any client; the first reason is kept."""
        with self._lock:
            self._stop = self._stop or reason

    def request_end(self, client: object) -> None:
        """End the drive regularly, if `client` is the holder."""
        if client is self._holder:
            self._quit = True

    # called by the loop

    def command(self, n: int) -> np.ndarray:
        """Return the present command (n,) of the holder, zeros if it is too old or has another length.  (2)"""
        u = self._u
        is_fresh = u is not None and len(u) == n and self._now_ns() - self._u_ns <= SILENCE_S * 1e9
        return u.copy() if is_fresh and u is not None else np.zeros(n)

    @property
    def is_end_requested(self) -> bool:
        """Return True if the holder has ended the drive."""
        return self._quit

    def pop_mission(self) -> tuple[str, bool, str] | None:
        """Remove and return the waiting mission: (JSON, attended, name), or None without one."""
        return self._missions.popleft() if self._missions else None

    def stop_reason(self, *, attended: bool = True) -> Diagnostic | None:
        """Return the reason to stop the vehicle, or None.  (1)"""
        if self._stop is not None:
            return self._stop
        silent_s = (self._now_ns() - self._last_beat_ns) * 1e-9
        if attended and silent_s > SILENCE_S:
            return stop(StopReason.HOLDER_SILENT, silent_ms=1e3 * min(silent_s, 99.0))
        return None

    def pop_changes(self) -> list[tuple[str, object]]:
        """Return the gains set since the last call, as (path, value)."""
        return [self._changes.popleft() for _ in range(len(self._changes))]

    def pop_mark_count(self) -> int:
        """Return the number of marks by the holder since the last call."""
        mark_count, self._marks = self._marks, 0
        return mark_count

    def discard_requests(self, reason: Diagnostic | None) -> None:
        """Discard the command, the requests to end or to clear a stop, and the stop with this `reason`.
        A stop with another reason remains.
        """
        with self._lock:
            self._stop = None if self._stop == reason else self._stop
            self.is_clear_requested, self._quit, self._u = False, False, None

    def record_mission_end(self) -> None:
        """Record that the mission has ended, so that another can be requested."""
        self._busy = False

    def _check_only_holder(self, client: object) -> None:
        if self._holder is None or self._holder is client:
            return
        if self._busy:
            raise SafetyStop(note("door.other-driver", Severity.ERROR, STOP_COMMAND))
        raise SafetyStop(note("door.other-reservation", Severity.ERROR))
