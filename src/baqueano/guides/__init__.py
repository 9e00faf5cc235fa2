"""Estimate → reference. Put yours beside `repeat.py`, or name it in the vehicle file as "file.py:Class".

init() -> state;   step(state, estimate) -> (state, Reference)
"""

from typing import Any, Protocol

from baqueano.guides.first_drive_pulses import CarefulGuide
from baqueano.guides.idle import Idle
from baqueano.guides.playback import Playback
from baqueano.guides.repeat import Repeat, RepeatState
from baqueano.guides.repeat_by_progress import ProgressState, RepeatByProgress
from baqueano.guides.route import Route
from baqueano.guides.shapes import SinuousCircle
from baqueano.signals import Estimate, Reference

__all__ = [
    "CarefulGuide",
    "Guide",
    "Idle",
    "Playback",
    "ProgressState",
    "Repeat",
    "RepeatByProgress",
    "RepeatState",
    "Route",
    "SinuousCircle",
]


class Guide(Protocol):
    """Any block of this room."""

    def init(self) -> Any:
        """The state before the first tick."""
        ...

    def step(self, state: Any, estimate: Estimate, /) -> tuple[Any, Reference]:
        """One tick: the next state, and the pose and velocity (3,) to be at."""
        ...
