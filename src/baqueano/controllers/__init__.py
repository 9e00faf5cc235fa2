"""Controllers turn a reference and an estimate into a command.

    init() -> state;   step(state, reference, estimate) -> (state, Command)

To add a controller, put its file beside `pd.py`, or name it in the vehicle file as "file.py:Class". You can also derive
a class from `ModelFollower` and define only its law: the requested velocity.
"""

from baqueano.contracts.blocks import Controller
from baqueano.controllers.first_drive_pulses import PulseController
from baqueano.controllers.following.tracking import Tracking
from baqueano.controllers.heading_hold import HeadingHold
from baqueano.controllers.kanayama import Kanayama
from baqueano.controllers.lqr import Lqr
from baqueano.controllers.manual import ManualController
from baqueano.controllers.model_following import FollowerState, ModelFollower
from baqueano.controllers.mpc import Mpc
from baqueano.controllers.pd import Pd, PdState
from baqueano.controllers.pd_feedforward import PdFeedforward
from baqueano.controllers.pure_pursuit import PurePursuit
from baqueano.controllers.schedule import DelayedController, Schedule
from baqueano.controllers.stanley import Stanley
from baqueano.on_demand import unknown_names

__all__ = [
    "Controller",
    "DelayedController",
    "HeadingHold",
    "Kanayama",
    "Lqr",
    "ManualController",
    "ModelFollower",
    "Mpc",
    "Pd",
    "PdFeedforward",
    "PulseController",
    "PurePursuit",
    "Schedule",
    "Stanley",
    "Tracking",
]

__getattr__ = unknown_names(__name__)
