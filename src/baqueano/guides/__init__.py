"""Estimate → reference. Put yours beside `repeat.py`, or name it in the vehicle file as "file.py:Class".

init() -> state;   step(state, estimate) -> (state, Reference)
"""

from baqueano.contracts.blocks import Guide
from baqueano.guides.first_drive_pulses import CarefulGuide
from baqueano.guides.idle import Idle
from baqueano.guides.playback import Playback
from baqueano.guides.repeat import Repeat, RepeatState
from baqueano.guides.repeat_by_progress import ProgressState, RepeatByProgress
from baqueano.guides.route import Route
from baqueano.guides.shapes import SinuousCircle

__all__ = [
    "CarefulGuide",
    "Guide",
    "Idle",
    "Playback",
    "Repeat",
    "RepeatByProgress",
    "Route",
    "SinuousCircle",
]
