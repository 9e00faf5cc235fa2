"""Measurements → estimate. Put yours beside `ekf.py`, or name it in the vehicle file as "file.py:Class".

    init(eta=None) -> belief;   step(belief, tick) -> (belief, Estimate)

`eta` (3,) is the pose at the start; an estimator whose `init` takes nothing begins at its own origin.

`step` is called at every tick, also when no sensor has anything to say: predict then, and let the
covariance grow.
"""

from baqueano.contracts.blocks import Estimator
from baqueano.estimators.augmented_ekf import AugmentedEkf
from baqueano.estimators.complementary import Complementary
from baqueano.estimators.dead_reckoning import DeadReckoning
from baqueano.estimators.ekf import Belief, Ekf
from baqueano.estimators.inertial import Inertial
from baqueano.estimators.known_state import KnownState, StateOfWorld
from baqueano.estimators.unscented import Unscented

__all__ = [
    "AugmentedEkf",
    "Complementary",
    "DeadReckoning",
    "Ekf",
    "Estimator",
    "Inertial",
    "KnownState",
    "StateOfWorld",
    "Unscented",
]
