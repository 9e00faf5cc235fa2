"""A sign of life of the terminal: a Wi-Fi that is dead sends no end of file, and a key that is held is silent.

    every ASK_S           ESC [ 5 n, "how are you", which each terminal answers by itself: ESC [ 0 n          (1)
    GONE_S no answer      the terminal, or the way to it, is gone                                             (2)
    START_S no answer     at the start: this terminal never answers, and must not be trusted with a held key  (3)

The answers come in order, so each belongs to the oldest question; between the two lies the round trip. While this
program itself was held up it asked nothing, and a silence that nobody broke says nothing: (2) counts from the last
answer, but from no earlier than ASK_S before the oldest question that waits.
"""

from collections import deque
from collections.abc import Callable
from statistics import median

ASK = b"\x1b[5n"
ASK_S = 0.1
GONE_S = 0.35  # 0.5 s is promised: answers on their way, the loop, the slew and the firmware take their part
START_S = 1.0


class Heartbeat:
    """Ask the terminal by `ask` for a sign of life; the caller gives the time."""

    def __init__(self, query_message: Callable[[bytes], object]) -> None:
        self._ask = query_message
        self._query_times_s: deque[float] = deque(maxlen=100)
        self._last_s, self._answer_s = float("-inf"), float("-inf")
        self._looked_s, self._paused_s = float("-inf"), float("-inf")
        self._trips_ms: deque[float] = deque(maxlen=20)
        self.answers = False  # whether it ever did

    def look(self, now_s: float) -> None:
        """Asks when it is due."""
        if now_s - self._looked_s > ASK_S:  # held up: what waits to be read has waited here, not on its way
            self._paused_s = now_s
        self._looked_s = now_s
        if now_s - self._last_s >= ASK_S:
            self._last_s = now_s
            self._query_times_s.append(now_s)
            self._ask(ASK)

    def answered(self, now_s: float) -> None:
        """An answer came."""
        self.answers, self._answer_s = True, now_s
        if self._query_times_s:
            query_s = self._query_times_s.popleft()
            if query_s >= self._paused_s:
                self._trips_ms.append(1e3 * (now_s - query_s))

    def silent_s(self, now_s: float) -> float:
        """Seconds for which a terminal that gives answers has given none; else 0.  (2)"""
        if not self.answers or not self._query_times_s:
            return 0.0
        return now_s - max(self._answer_s, self._query_times_s[0] - ASK_S)

    def gone(self, now_s: float) -> bool:
        """(2)."""
        return self.silent_s(now_s) > GONE_S

    @property
    def trip_ms(self) -> float:
        """The median round trip to the terminal [ms]; NaN while none is known."""
        return median(self._trips_ms) if self._trips_ms else float("nan")
