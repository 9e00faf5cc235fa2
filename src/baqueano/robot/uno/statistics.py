"""Count the lost and damaged frames on the line of the Uno, at both of its ends."""

from collections import deque
from dataclasses import dataclass, field


@dataclass
class Statistics:
    """Counts of damaged and lost frames."""

    written: int = 0  # frames of any kind that the line took
    sent: int = 0  # commands
    unsent: int = 0  # commands that the line did not take, or that came without arming
    received: int = 0  # frames
    lost: int = 0  # frames that did not come in their turn, by their sequence
    late: int = 0  # frames that came twice, or after a newer one
    damaged: int = 0  # segments that are not frames
    resets: int = 0
    spoilt: int = 0  # frames that the Uno counted as damaged
    ignored: int = 0  # frames that came whole and were not obeyed: old, of another session, refused
    overrun: int = 0  # bytes that the Uno's receiver lost
    trips_ms: deque[float] = field(default_factory=lambda: deque(maxlen=200))

    def since(self, before: "Statistics", *names: str) -> list[int]:
        """Return the increase of these counts since `before`."""
        return [getattr(self, name) - getattr(before, name) for name in names]
