"""Count the lost and damaged frames on the line of the Uno, at both of its ends."""

from collections import deque
from dataclasses import dataclass, field


@dataclass
class Statistics:
    """Counts of sent, received, damaged and lost frames since the start."""

    written_frames: int = 0  # frames of any kind that the line accepted
    sent_commands: int = 0  # commands sent
    # commands that the line did not accept, or that were given to an Uno that is not armed
    unsent_commands: int = 0
    received_frames: int = 0  # frames received
    lost_frames: int = 0  # frames missing in the sequence
    late_frames: int = 0  # frames received twice, or after a newer frame
    damaged_frames: int = 0  # segments received that are not frames
    resets: int = 0
    rejected_frames: int = 0  # frames that the Uno counted as damaged
    ignored_frames: int = 0  # undamaged frames that the Uno did not execute: old, of another session, refused
    overrun_bytes: int = 0  # bytes that the Uno's receiver lost
    trips_ms: deque[float] = field(default_factory=lambda: deque(maxlen=200))

    def since(self, previous: "Statistics", *names: str) -> list[int]:
        """Return the increase of each named count since `previous`."""
        return [getattr(self, name) - getattr(previous, name) for name in names]
