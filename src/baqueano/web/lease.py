"""The lease: one browser drives at a time, by explicit hand-over, as long as its beats count.

    a beat counts if its number grows and the picture that it names is not older than HOLDS_S + the way there and
    back, or is the newest there is                                                                             (1)
    HOLDS_S without a beat that counts      the lease ends                                                      (2)

Nobody makes a beat here: who looks at a frozen picture, or has hidden the page, loses the vehicle.
"""

import time
from collections.abc import Callable

from baqueano.diagnostics import Severity, note
from baqueano.errors import SafetyStop

HOLDS_S = 0.3


class Lease:
    """The holder, any object with a `name`; None where nobody drives."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._holder: object = None
        self._name = ""
        self._n, self._until_s = 0, 0.0

    @property
    def holder(self) -> object:
        """Return who holds it just now.  (2)"""
        if self._holder is not None and self._now() > self._until_s:
            self._holder = None
        return self._holder

    @property
    def left_s(self) -> float:
        """Return how long it holds without another beat."""
        return max(0.0, self._until_s - self._now()) if self.holder is not None else 0.0

    def take(self, who: object, name: str) -> None:
        """Hold it from now on. SafetyStop while somebody else does."""
        if self.holder is not None and self._holder is not who:
            raise SafetyStop(note("web.lease-taken", Severity.ERROR, name=self._name))
        self._holder, self._name = who, name
        self._n, self._until_s = 0, self._now() + HOLDS_S

    def give(self, who: object, to: object = None, name: str = "") -> None:
        """Give it to somebody else, or to nobody. SafetyStop by one who does not hold it."""
        self.check(who)
        self._holder = None
        if to is not None:
            self.take(to, name)

    def check(self, who: object) -> None:
        """SafetyStop by one who does not hold it."""
        if who is None or self.holder is not who:
            raise SafetyStop(note("web.lease-needed", Severity.ERROR))

    def beat(self, who: object, n: int, age_s: float, way_s: float = 0.0) -> bool:
        """Return True if this beat counts: of the holder, newer than the last, before a fresh picture.  (1)"""
        if who is None or self.holder is not who or n <= self._n:
            return False
        self._n = n
        if not age_s <= HOLDS_S + way_s:
            return False
        self._until_s = self._now() + HOLDS_S
        return True

    def left(self, who: object) -> bool:
        """Somebody has gone; return True if it was the holder."""
        if self._holder is not who:
            return False
        self._holder = None
        return True
