"""Estimate → reference. Put yours beside `repeat.py`, or name it in the vehicle file as "file.py:Class".

init() -> state;   step(state, estimate) -> (state, Reference)

How yours gets its route: the fields of its class that are named `t_s`, `eta`, `nu`, `closed`, or `route` for all four,
are filled with the route that is driven; `laps` with the laps. A guide without them makes its own references. It needs
no way onto the route, no pause and no way back: `InTurn` and `AtPace` go around any guide.
"""

from baqueano.contracts.blocks import Guide
from baqueano.guides.drive_to import DriveTo
from baqueano.guides.first_drive_pulses import CarefulGuide
from baqueano.guides.idle import Idle
from baqueano.guides.in_turn import InTurn
from baqueano.guides.pace import AtPace
from baqueano.guides.playback import Playback
from baqueano.guides.repeat import Repeat, RepeatState
from baqueano.guides.repeat_by_progress import ProgressState, RepeatByProgress
from baqueano.guides.route import Route
from baqueano.guides.shapes import SinuousCircle

__all__ = [
    "AtPace",
    "CarefulGuide",
    "DriveTo",
    "Guide",
    "Idle",
    "InTurn",
    "Playback",
    "Repeat",
    "RepeatByProgress",
    "Route",
    "SinuousCircle",
]
