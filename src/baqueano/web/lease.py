"""Manage the right to drive. One browser, the holder, has it at a time, while its heartbeats are valid.

  a heartbeat is valid if its number grows and the picture that it names is not older than LEASE_S plus the
  round-trip time, or is the newest picture                                                                   (1)
  the right ends after LEASE_S without a valid heartbeat                                                      (2)

The holder can pass the right to another browser. The server does not create heartbeats: a browser with a frozen picture
or a hidden page loses the right.
"""

import time
from collections.abc import Callable, Iterator

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Severity, note
from baqueano.errors import SafetyStop
from baqueano.web.guard import Role
from baqueano.web.visitor import Visitor

LEASE_S = 0.3


class Lease:
    """The right to drive, and its holder: any object, or None if no browser has the right."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._holder: object = None
        self._name = ""
        self._n, self._end_s = 0, 0.0

    @property
    def holder(self) -> object:
        """Return the present holder, or None if the right is free or has ended.  (2)"""
        if self._holder is not None and self._now() > self._end_s:
            self._holder = None
        return self._holder

    @property
    def remaining_s(self) -> float:
        """Return the time [s] after which the right ends without another heartbeat, 0 if it is free."""
        return max(0.0, self._end_s - self._now()) if self.holder is not None else 0.0

    def acquire(self, visitor: object, name: str) -> None:
        """Give the right to drive to `visitor`. Raise SafetyStop while another visitor is the holder."""
        if self.holder is not None and self._holder is not visitor:
            raise SafetyStop(note("web.lease-taken", Severity.ERROR, name=self._name))
        self._holder, self._name = visitor, name
        self._n, self._end_s = 0, self._now() + LEASE_S

    def pass_to(self, visitor: object, to: object = None, name: str = "") -> None:
        """Pass the right to `to`, or end it if `to` is None. Raise SafetyStop if `visitor` is not the holder."""
        self.check_holder(visitor)
        self._holder = None
        if to is not None:
            self.acquire(to, name)

    def check_holder(self, visitor: object) -> None:
        """Raise SafetyStop if `visitor` is not the holder."""
        if visitor is None or self.holder is not visitor:
            raise SafetyStop(note("web.lease-needed", Severity.ERROR))

    def renew(self, visitor: object, n: int, age_s: float, round_trip_s: float = 0.0) -> bool:
        """Renew the right and return True if this heartbeat is valid; return False otherwise.  (1)

        `n` is its number, `age_s` [s] the age of its picture, `round_trip_s` [s] the round-trip time.
        """
        if visitor is None or self.holder is not visitor or n <= self._n:
            return False
        self._n = n
        if not age_s <= LEASE_S + round_trip_s:
            return False
        self._end_s = self._now() + LEASE_S
        return True

    def on_disconnect(self, visitor: object) -> bool:
        """End the right if `visitor`, which has disconnected, is the holder; return True in that case."""
        if self._holder is not visitor:
            return False
        self._holder = None
        return True


def lease_messages(lease: Lease, visitors: list[Visitor]) -> Iterator[tuple[Visitor, JsonObject]]:
    """Yield, for each visitor, the message about the right to drive. It names other possible drivers to the holder."""
    holder = lease.holder
    for visitor in visitors:
        other_names = [v.name for v in visitors if v.role == Role.DRIVE and v is not visitor]
        yield visitor, {
            "type": "lease", "driver": getattr(holder, "name", None), "until_ms": round(1e3 * lease.remaining_s),
            "you": visitor is holder, "watching": len(visitors) - (holder is not None),
            "others": other_names if visitor is holder else [],
        }  # fmt: skip
