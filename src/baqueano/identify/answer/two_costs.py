"""Which of the two costs to believe, in one sentence with its figures.

Three things decide: whether a moving floor explains the run better than a still one (prediction.py, (4)), whether
both answers are one, and which has the smaller error in open loop on segments that it has not used (left_out.py).

    floor still                               the simulation: both say the same, and it is the harder test of a model
    floor moves, one answer, smaller error    the innovations: the simulation's errors are a walk, neighbours no news
    floor moves, one answer, larger by chance the simulation: nothing is gained
    two answers, or a larger error            neither, the simulation rather: what the model lacks passes for a floor

A floor explains what a simulation leaves where it moves, the innovations are white, none of the three contradicts, and
the noise of each sensor without the floor's part is not far above that in the file.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baqueano.identify.answer.left_out import LeftOut
from baqueano.identify.answer.verdict import ABOVE_NOISE
from baqueano.identify.solve.prediction import Likely

RARE = 1e-3  # chance below which a still floor is not believed
UNITS = ("m/s", "m/s", "rad/s")


class Preferred(NamedTuple):
    """The cost to believe, and why."""

    cost: str  # "simulation" or "innovations"
    why: str  # one sentence
    explains: bool  # the floor what a simulation leaves
    contradicted: bool = False  # the floor, by two answers or by a larger error


def preferred(likely: Likely, axes: Sequence[int], both: LeftOut | None, times: np.ndarray) -> Preferred:
    """Return which to believe; `times` (m,) is the noise of the sensors without the floor in units of the file's, 0
    where that tells none."""
    odds = f"likelihood ratio {likely.ratio:.1f}, by chance {_chance(likely.chance)}"
    if likely.chance >= RARE:
        why = f"believe the simulation error: a floor that moves explains no more ({odds})"
        return Preferred("simulation", f"{why}, and a simulation is the harder test of a model", False)
    floor = f"the floor disturbs the vehicle by {_floor(likely, axes)} ({odds})"
    if both is None:
        why = f"believe the simulation error: {floor}, but the run is too short to leave segments out"
        return Preferred("simulation", why, False)
    apart, name = both.furthest
    name, far = name.removeprefix("model."), f"the two answers are {apart:.1f} standard errors apart at most"
    judged = "on segments left out its model runs away"
    if np.isfinite(both.percent):
        change = f"{abs(both.percent):.2g} % {'smaller' if both.better else 'larger'}"
        judged = f"on segments left out its error in open loop is {change}"
    if apart > both.limit or both.worse:
        why = (
            f"believe neither before the model is better, and the simulation error rather: {far} ({name}), and of "
            f"that by the innovations, {judged}: what looks like a disturbance of {_floor(likely, axes)} ({odds}) is "
            "what the model lacks"
        )
        return Preferred("simulation", why, False, True)
    explains = not likely.info.coloured and not np.any(times > ABOVE_NOISE)
    if both.better:
        return Preferred("innovations", f"believe the innovations: {floor}, {far}, and {judged}", explains)
    why = f"believe the simulation error: {floor} and {far}, but of that by the innovations, {judged}"
    return Preferred("simulation", why, explains)


def _floor(likely: Likely, axes: Sequence[int]) -> str:
    """The process noise with its error, axis by axis."""
    said = []
    for axis, v, sd in zip(axes, likely.noise.floor, likely.floor_sd, strict=True):
        if v > 0.0:
            error = f" ± {sd / (2.0 * np.sqrt(v)):.1g}" if np.isfinite(sd) else ""
            said.append(f"{np.sqrt(v):.2g}{error} {UNITS[axis]}")
    return ", ".join(said) + " in 1 s"


def _chance(p: float) -> str:
    return f"{p:.2g}" if p >= 1e-6 else "less than 1e-6"
