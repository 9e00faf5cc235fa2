"""Choose the most informative next motion among a few that a person can drive: straight, turning, in curves.

    k, i = argmin log(σ_i² + GOAL_STD²) − log(σ_i,now² + GOAL_STD²),   σ of F + F_k                               (1)

F is the information of the drive so far, F_k the information of the k-th motion from rest, σ_i the relative standard
errors. This is the first step of the search of compose.py, without walls, over motions with a name. It considers only
the parameter whose error decreases most, because a driver needs the motion for the parameter with a large error. For
an error below GOAL_STD the decrease has little weight. In a motion the vehicle moves away and returns on the same
path, so that it needs little room, or it continues in circles.
"""

from typing import NamedTuple

import numpy as np

from baqueano.diagnostics import Diagnostic, note
from baqueano.identify.design.information import Informant
from baqueano.identify.design.motion_library import RETURN_KINDS, MotionPiece

MOTION_S = 4.0
LEVELS = (1.0, 0.6, 0.35)  # of the limit
GOAL_STD = 0.01  # relative standard error that is good enough
STEP_S = 0.4  # between sudden changes
THERE_AND_BACK, ON_AND_ON = 0, RETURN_KINDS - 1


class NamedMotion(NamedTuple):
    """A motion in words and as commands."""

    words: Diagnostic
    u: np.ndarray  # (T, n)


class NextMotion(NamedTuple):
    """The motion to drive next, and the standard error of the parameter whose error it reduces most."""

    words: Diagnostic
    parameter: int  # index among those of interest
    before: float  # relative standard error
    after: float


def named_motions(limit: np.ndarray, rate_hz: float) -> list[NamedMotion]:
    """Return motions within the limits.

    The first usable channel moves forward, the last one turns. Return [] without a usable channel.
    """
    moving, ticks = np.flatnonzero(limit > 0.0), round(MOTION_S * rate_hz)
    if not len(moving):
        return []
    forward, turning = moving[0], moving[-1]
    kinds = [("straight", (forward,), THERE_AND_BACK)]
    if turning != forward:
        kinds += [("turn", (turning,), THERE_AND_BACK), ("curve", (forward, turning), THERE_AND_BACK)]
        kinds += [("circle", (forward, turning), ON_AND_ON)]
    t = np.arange(ticks) / rate_hz
    shapes = {
        "steady": np.ones(ticks), "steps": np.where(np.floor(t / STEP_S) % 2 == 0.0, 1.0, 0.0),
        "ramp": np.minimum(1.0, 2.0 * t / MOTION_S),
    }  # fmt: skip
    motions = []
    for kind, channels, return_kind in kinds:
        for shape_name, shape in shapes.items():
            for level in LEVELS if shape_name == "steady" else LEVELS[:1]:
                outbound = np.zeros((ticks, len(limit)))
                outbound[:, list(channels)] = level * shape[:, None]
                words = note(f"motion.{kind}-{shape_name}", percent=round(100.0 * level), t_s=MOTION_S)
                motions.append(NamedMotion(words, MotionPiece(outbound, return_kind).u(ticks, limit)))
    return motions


class MotionAdvisor:
    """The motions of a vehicle, and the information of each at θ."""

    def __init__(self, informant: Informant, limit: np.ndarray, rate_hz: float) -> None:
        self._informant, self._motions = informant, named_motions(limit, rate_hz)
        self._F, self._theta = np.zeros(0), np.zeros(0)  # of each motion, at θ

    def next(
        self, F: np.ndarray, theta: np.ndarray, size: np.ndarray, widening: np.ndarray
    ) -> NextMotion | None:
        """Return the motion that, after a drive with information F (q, q) [SI units], most reduces the error of one
        parameter.  (1)

        Return None for a vehicle without motions. `size` (q,) contains the sizes of the parameters. `widening` (p,) is
        the ratio of the errors of a fit to the errors that F predicts.
        """
        if not self._motions:
            return None
        if not np.array_equal(theta, self._theta):
            scale = np.outer(self._informant.unknowns.size, self._informant.unknowns.size)
            informations = [self._informant.information(motion.u, theta) / scale for motion in self._motions]
            self._F, self._theta = np.stack(informations), theta
        D, relative_std = np.outer(size, size), self._informant.relative_std
        std_before = np.minimum(widening * relative_std(F * D), 1.0)
        std_after = np.array(
            [np.minimum(widening * relative_std((F + gained) * D), 1.0) for gained in self._F]
        )
        gain = np.log(std_before**2 + GOAL_STD**2) - np.log(std_after**2 + GOAL_STD**2)
        k, i = np.unravel_index(np.argmax(gain), gain.shape)
        return NextMotion(self._motions[k].words, int(i), float(std_before[i]), float(std_after[k, i]))
