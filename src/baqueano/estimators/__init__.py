"""Estimators turn measurements into an estimate of pose and velocity.

    init(eta=None) -> belief;   step(belief, tick) -> (belief, Estimate)

`eta` (3,) is the pose at the start. An estimator whose `init` does not have an argument starts at the origin. `step` is
called at every tick, even when no measurement arrived: then it predicts, and the covariance grows.

To add an estimator, put its file beside `ekf.py`, or name it in the vehicle file as "file.py:Class".
"""

from baqueano.contracts.blocks import Estimator
from baqueano.estimators.augmented_ekf import AugmentedEkf
from baqueano.estimators.complementary import Complementary
from baqueano.estimators.dead_reckoning import DeadReckoning
from baqueano.estimators.ekf import Belief, Ekf
from baqueano.estimators.inertial import Inertial
from baqueano.estimators.perfect_state import PerfectState, TrueState
from baqueano.estimators.unscented import Unscented
from baqueano.on_demand import unknown_names

__all__ = [
    "AugmentedEkf",
    "Complementary",
    "DeadReckoning",
    "Ekf",
    "Estimator",
    "Inertial",
    "PerfectState",
    "TrueState",
    "Unscented",
]

__getattr__ = unknown_names(__name__)
