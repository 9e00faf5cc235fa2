"""Detect a lost terminal by a heartbeat, because a lost network is not reported as the end of the input.

  every QUERY_PERIOD_S      ESC [ 5 n, a status query, which the terminal answers by ESC [ 0 n              (1)
  no answer for MAX_SILENCE_S   the terminal, or the connection to it, is lost                              (2)
  no answer for MAX_FIRST_ANSWER_S  at the start: this terminal never answers; a command lasts a short time (3)

The answers arrive in order, so each belongs to the oldest query; the time between the two is the round trip. If this
program was delayed, it did not send queries, so silence does not prove a loss. The time of (2) therefore begins at the
last answer, or QUERY_PERIOD_S before the oldest unanswered query if that is later.
"""

from collections import deque
from collections.abc import Callable
from statistics import median

QUERY = b"\x1b[5n"
QUERY_PERIOD_S = 0.1
MAX_SILENCE_S = 0.35  # 0.5 s is guaranteed; transmission, loop, slew and firmware need the rest
MAX_FIRST_ANSWER_S = 1.0


class Heartbeat:
    """A monitor of the terminal by its answers. `query_message` sends bytes to it; the caller passes the time [s]."""

    def __init__(self, query_message: Callable[[bytes], object]) -> None:
        self._send_query = query_message
        self._query_times_s: deque[float] = deque(maxlen=100)
        self._last_s, self._last_answer_s = float("-inf"), float("-inf")
        self._last_check_s, self._paused_s = float("-inf"), float("-inf")
        self._trips_ms: deque[float] = deque(maxlen=20)
        self.has_answered = False  # True once the terminal has answered

    def poll(self, now_s: float) -> None:
        """Send a query if one is due."""
        if now_s - self._last_check_s > QUERY_PERIOD_S:  # this program was delayed: answers have waited here
            self._paused_s = now_s
        self._last_check_s = now_s
        if now_s - self._last_s >= QUERY_PERIOD_S:
            self._last_s = now_s
            self._query_times_s.append(now_s)
            self._send_query(QUERY)

    def record_answer(self, now_s: float) -> None:
        """Record an answer of the terminal, received at this time [s]."""
        self.has_answered, self._last_answer_s = True, now_s
        if self._query_times_s:
            query_s = self._query_times_s.popleft()
            if query_s >= self._paused_s:
                self._trips_ms.append(1e3 * (now_s - query_s))

    def silence_s(self, now_s: float) -> float:
        """Return the time [s] without an answer, 0 if the terminal never answered or no query is open.  (2)"""
        if not self.has_answered or not self._query_times_s:
            return 0.0
        return now_s - max(self._last_answer_s, self._query_times_s[0] - QUERY_PERIOD_S)

    def is_lost(self, now_s: float) -> bool:
        """Return True if the terminal, or the connection to it, is lost.  (2)"""
        return self.silence_s(now_s) > MAX_SILENCE_S

    @property
    def round_trip_ms(self) -> float:
        """Return the median round trip to the terminal [ms], NaN while it is unknown."""
        return median(self._trips_ms) if self._trips_ms else float("nan")
