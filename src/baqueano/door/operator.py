"""Whoever drives from outside: one holder at a time, whose silence stops the vehicle; anyone may stop it.

    SILENCE_S without a word of the holder      the vehicle stops, unless the mission goes on unattended        (1)
    a set-point older than SILENCE_S            is no set-point                                                 (2)

A holder who drives through a page is silent sooner: between its hand and the vehicle stands one process more.

The words come from another thread than the loop's; both ends of this mailbox may be used at any time.
"""

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from baqueano.diagnostics import Diagnostic, Severity, StopReason, note, stop
from baqueano.errors import SafetyStop

STOP = "baqueano robot stop"
MOST_CHANGES = 64  # of gains that wait for the next tick
SILENCE_S = 0.4  # 0.5 s is promised: the loop and the firmware take their part


class Operator:
    """The wanted motion."""

    def __init__(self, now_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._now_ns = now_ns
        self._lock = (
            threading.RLock()
        )  # a signal may stop the vehicle in the middle of any word of the same thread
        self._last_beat_ns = -(1 << 62)
        self._u: np.ndarray | None = None
        self._u_ns = -(1 << 62)
        self._holder: Any = None
        self._silence_s = SILENCE_S  # of that holder
        self._missions: deque[tuple[str, bool, str]] = deque(maxlen=1)
        self._stop: Diagnostic | None = None
        self._quit, self.clear_requested = False, False  # the last: somebody takes a stop away
        self._marks = 0
        self._changes: deque[tuple[str, object]] = deque(maxlen=MOST_CHANGES)
        self._busy = False  # by a mission that is driven, or waits

    # from outside

    def sign_of_life(self, who: object) -> None:
        """Take a sign of life of `who`."""
        if who is self._holder:
            self._last_beat_ns = self._now_ns()

    def hold(self, who: object, silence_s: float | None = None) -> None:
        """`who` drives from now on, and is gone after a silence of `silence_s`; SafetyStop while somebody else does."""
        with self._lock:
            self._nobody_but(who)
            self._holder = who
            self._silence_s = SILENCE_S if silence_s is None else silence_s
        self.sign_of_life(who)

    def release(self, who: object) -> None:
        """`who` has gone. The drive of a holder who did not say goodbye ends by (1)."""
        with self._lock:
            if self._holder is who:
                self._holder = None

    def holds(self, who: object) -> bool:
        """Return True if `who` drives."""
        return who is self._holder

    @property
    def silence_s(self) -> float:
        """Return the silence after which its holder is gone [s]."""
        return self._silence_s

    @property
    def taken(self) -> bool:
        """Return True while a mission is driven, or waits."""
        return self._busy

    def may_ask(self, who: object) -> None:
        """SafetyStop where a mission of `who` would be refused just now: one is driven, or waits, or somebody else
        drives."""
        with self._lock:
            if self._busy and who is self._holder:
                raise SafetyStop(note("door.own-mission", Severity.ERROR))
            if (
                self._busy and self._holder is None
            ):  # its holder has gone: a new operator must not lend it signs of life
                raise SafetyStop(note("door.mission", Severity.ERROR, STOP))
            self._nobody_but(who)

    def ask(
        self, who: object, mission: str, attended: bool = True, name: str = "", silence_s: float | None = None
    ) -> None:
        """A mission in JSON, to be driven when the vehicle is ready; SafetyStop as `may_ask`. Who asks knows it again
        by its `name`; `silence_s` as in `hold`."""
        self.may_ask(who)
        self.hold(who, silence_s)
        self._busy, self._quit = True, False
        self._missions.append((mission, attended, name))

    def want(self, who: object, u: object) -> None:
        """The command (n,) that the holder wants now."""
        if who is self._holder:
            u = np.asarray(u, dtype=float)
            if u.ndim == 1 and np.all(np.isfinite(u)):
                self._u, self._u_ns = u, self._now_ns()
            self.sign_of_life(who)

    def mark(self, who: object) -> None:
        """The vehicle is on its mark now."""
        if who is self._holder:
            self._marks += 1

    def change(self, who: object, path: str, value: object) -> None:
        """The holder sets a gain from the next tick on; SafetyStop for anybody else."""
        if who is not self._holder or not self._busy:
            raise SafetyStop(note("door.not-holder", Severity.ERROR))
        self._changes.append((path, value))

    def stop(self, reason: Diagnostic) -> None:
        """Stop, by anyone, for this reason."""
        with self._lock:
            self._stop = self._stop or reason

    def end(self, who: object) -> None:
        """The holder ends the drive, as one ends it who is done."""
        if who is self._holder:
            self._quit = True

    # of the loop

    def command(self, n: int) -> np.ndarray:
        """The command (n,) that is wanted now, zeros if it is old.  (2)"""
        u = self._u
        fresh = u is not None and len(u) == n and self._now_ns() - self._u_ns <= self._silence_s * 1e9
        return u.copy() if fresh and u is not None else np.zeros(n)

    @property
    def done(self) -> bool:
        """Return True if the holder has ended the drive."""
        return self._quit

    def next(self) -> tuple[str, bool, str] | None:
        """The mission that waits, in JSON, whether it ends with the silence of its holder, and its name."""
        return self._missions.popleft() if self._missions else None

    def stop_reason(self, attended: bool = True) -> Diagnostic | None:
        """Return why the vehicle must stop; None if nobody says so.  (1)"""
        if self._stop is not None:
            return self._stop
        silent_s = (self._now_ns() - self._last_beat_ns) * 1e-9
        if attended and silent_s > self._silence_s:
            return stop(StopReason.HOLDER_SILENT, silent_ms=1e3 * min(silent_s, 99.0))
        return None

    def changes(self) -> list[tuple[str, object]]:
        """Return the gains that were set since the last call."""
        return [self._changes.popleft() for _ in range(len(self._changes))]

    def marked(self) -> int:
        """Return the number of marks by the holder since the last call."""
        marks, self._marks = self._marks, 0
        return marks

    def forget(self, reason: Diagnostic | None) -> None:
        """Clear the handled request and the stop for `reason`; a new one stays."""
        with self._lock:
            self._stop = None if self._stop == reason else self._stop
            self.clear_requested, self._quit, self._u = False, False, None

    def free(self) -> None:
        """The mission is over: another may be asked for."""
        self._busy = False

    def _nobody_but(self, client: object) -> None:
        if self._holder is None or self._holder is client:
            return
        if self._busy:
            raise SafetyStop(note("door.somebody", Severity.ERROR, STOP))
        raise SafetyStop(note("door.somebody-waits", Severity.ERROR))
