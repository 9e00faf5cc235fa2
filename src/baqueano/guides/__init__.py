"""Guides turn an estimate into a reference.

    init() -> state;   step(state, estimate) -> (state, Reference)

To add a guide, put its file beside `repeat.py`, or name it in the vehicle file as "file.py:Class".

The route of a drive fills the fields `t_s`, `eta`, `nu` and `closed` of the class, or only its field `route`. The
field `laps` receives the number of laps. A guide without these fields computes its references from other data. A guide
does not need a path onto the route, a pause or a path back: `GuideSequence` and `GuideAtPace` add them to any guide.
"""

from baqueano.contracts.blocks import Guide
from baqueano.guides.drive_to import DriveTo
from baqueano.guides.first_drive_pulses import PulseGuide
from baqueano.guides.idle import Idle
from baqueano.guides.pace import GuideAtPace
from baqueano.guides.playback import Playback
from baqueano.guides.repeat import Repeat, RepeatState
from baqueano.guides.repeat_by_progress import ProgressState, RepeatByProgress
from baqueano.guides.route import Route
from baqueano.guides.sequence import GuideSequence
from baqueano.guides.shapes import SinuousCircle
from baqueano.on_demand import unknown_names

__all__ = [
    "DriveTo",
    "Guide",
    "GuideAtPace",
    "GuideSequence",
    "Idle",
    "Playback",
    "PulseGuide",
    "Repeat",
    "RepeatByProgress",
    "Route",
    "SinuousCircle",
]

__getattr__ = unknown_names(__name__)
