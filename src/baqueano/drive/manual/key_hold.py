"""Convert keys to a direction. The reports of the terminal determine how long a key is valid.

  RELEASES   a key is valid from its press to its release                                                   (1)
  REPEATS    the terminal reports only characters, not releases: a key is valid
                until T₁ after its press, and then until T₂ after its last repeat                           (2)
                T₁ = 0.75 s, or 1.5 · median delay in [0.3, 0.75] s once it is known
                T₂ = 0.20 s, or 3 · median gap + 8 · median |gap − median| in [0.12, 0.35] s once it is known
             and until the first repeat it commands NUDGE_SHARE of the speed: a tap is a short, slow move
  LATCHED    each press changes a set-point by SPEED_STEP; the set-point remains                                  (3)

The spread in T₂ covers the jitter of the network; docs/benchmarks.md states its cost. In (2) a terminal repeats only
the newest key. Older keys that are still held are therefore valid as long as the newest key.
"""

from collections import deque
from statistics import median

from baqueano.drive.manual.keys import LEFT_WINDOW, PRESS, RELEASE, REPEAT, KeyEvent

RELEASES, REPEATS, LATCHED = "releases", "repeats", "latched"
DIRECTIONS = {  # key → (forward, left)
    "up": (1, 0), "w": (1, 0), "8": (1, 0), "down": (-1, 0), "s": (-1, 0), "2": (-1, 0),
    "left": (0, 1), "a": (0, 1), "4": (0, 1), "right": (0, -1), "d": (0, -1), "6": (0, -1),
    "7": (1, 1), "9": (1, -1), "1": (-1, 1), "3": (-1, -1),
}  # fmt: skip
RELEASE_KEYS = ("x", "5", "0")  # keys that release all others
FIRST_S, MIN_FIRST_S, FIRST_FACTOR = 0.75, 0.3, 1.5
GAP_S, MIN_GAP_S, MAX_GAP_S, GAP_FACTOR, SPREAD_FACTOR = 0.20, 0.12, 0.35, 3.0, 8.0
NUDGE_SHARE = 0.3
SPEED_STEP = 0.1
MIN_INTERVAL_COUNT = 3  # number of delays or gaps for a median
MIN_DELAY_S = 0.15  # a shorter delay is two quick taps, because a keyboard does not repeat so early


class KeyHold:
    """A converter of key events to the direction (forward, left) that the driver commands, each in [-1, 1]."""

    def __init__(self, mode: str = REPEATS) -> None:
        self.mode = mode
        self._keys: set[str] = set()
        self._last_key, self._last_event_s, self._repeats, self._delay_s = "", float("-inf"), 0, 0.0
        self._delays: deque[float] = deque(maxlen=9)
        self._gaps: deque[float] = deque(maxlen=31)
        self._set_point = (0.0, 0.0)

    @property
    def press_validity_s(self) -> float:
        """Return T₁ of (2) [s]: how long a key is valid after its press."""
        if len(self._delays) < MIN_INTERVAL_COUNT:
            return FIRST_S
        return min(max(FIRST_FACTOR * median(self._delays), MIN_FIRST_S), FIRST_S)

    @property
    def repeat_validity_s(self) -> float:
        """Return T₂ of (2) [s]: how long a key is valid after its last repeat."""
        if len(self._gaps) < MIN_INTERVAL_COUNT:
            return GAP_S
        gap_s = median(self._gaps)
        spread_s = median(abs(interval_s - gap_s) for interval_s in self._gaps)
        return min(max(GAP_FACTOR * gap_s + SPREAD_FACTOR * spread_s, MIN_GAP_S), MAX_GAP_S)

    @property
    def is_nudge(self) -> bool:
        """Return True in (2) until the first repeat of a key. The command is then NUDGE_SHARE of the full command."""
        return self.mode == REPEATS and not self._repeats

    def release_all(self) -> None:
        """Release all keys and clear the set-point."""
        self._keys.clear()
        self._last_key, self._repeats, self._set_point = "", 0, (0.0, 0.0)

    def on_key(self, event: KeyEvent, now_s: float) -> None:
        """Process an event of a key or of the window, received at this time [s]."""
        if event.kind == LEFT_WINDOW or (event.kind == PRESS and event.key in RELEASE_KEYS):
            self.release_all()
        elif event.key not in DIRECTIONS:
            return
        elif event.kind == RELEASE:
            self._keys.discard(event.key)
        elif self.mode == LATCHED:
            forward, left = DIRECTIONS[event.key]
            self._set_point = _clip(
                self._set_point[0] + SPEED_STEP * forward, self._set_point[1] + SPEED_STEP * left
            )
        elif self.mode == RELEASES:
            self._keys.add(event.key)
        elif event.kind in (PRESS, REPEAT):
            self._on_repeat(event.key, now_s)

    def direction(self, now_s: float) -> tuple[float, float]:
        """Return (forward, left) at this time [s], each in [-1, 1]."""
        if self.mode == LATCHED:
            return self._set_point
        if self.mode == REPEATS and not self._is_held(now_s):
            self._keys.clear()
        speed_share = NUDGE_SHARE if self.is_nudge else 1.0
        forward, left = _clip(
            sum(DIRECTIONS[k][0] for k in self._keys), sum(DIRECTIONS[k][1] for k in self._keys)
        )
        return speed_share * forward, speed_share * left

    def _is_held(self, now_s: float) -> bool:
        return now_s - self._last_event_s <= (
            self.repeat_validity_s if self._repeats else self.press_validity_s
        )

    def _on_repeat(self, key: str, now_s: float) -> None:
        """Process a character in (2), which is either the repeat of a held key or a press."""
        is_held, gap_s = self._is_held(now_s), now_s - self._last_event_s
        if key == self._last_key and is_held:
            self._store_interval(gap_s)
            self._repeats += 1
        else:
            if not is_held:
                self._keys.clear()
            key_direction = DIRECTIONS[key]
            self._keys = {
                k
                for k in self._keys
                if all(a * b >= 0 for a, b in zip(DIRECTIONS[k], key_direction, strict=True))
            }
            self._last_key, self._repeats = key, 0
        self._keys.add(key)
        self._last_event_s = now_s

    def _store_interval(self, gap_s: float) -> None:
        """Store a time between two characters [s]: the delay before the first repeat, or a gap between repeats.

        The delay is stored only if a second repeat follows, because two characters can be two taps.
        """
        if self._repeats == 0:
            self._delay_s = gap_s
            return
        self._gaps.append(gap_s)
        if self._repeats == 1 and self._delay_s > max(MIN_DELAY_S, gap_s):
            self._delays.append(self._delay_s)


def _clip(forward: float, left: float) -> tuple[float, float]:
    """Return both numbers clipped to [-1, 1], without the rounding errors of sums."""
    return round(min(max(forward, -1.0), 1.0), 6), round(min(max(left, -1.0), 1.0), 6)
