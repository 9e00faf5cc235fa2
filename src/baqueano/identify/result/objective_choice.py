"""Which of the two costs to believe, in one sentence with its figures.

Three things decide: whether a moving floor explains the run better than a still one (prediction_error.py, (4)), whether
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

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, note
from baqueano.identify.estimation.prediction_error import Likely
from baqueano.identify.result.left_out import LeftOut
from baqueano.identify.result.verdict import ABOVE_NOISE

RARE = 1e-3  # chance below which a still floor is not believed
UNITS = ("m/s", "m/s", "rad/s")


class Preferred(NamedTuple):
    """The cost to believe, and why."""

    cost: str  # "simulation" or "innovations"
    why: Diagnostic
    explains: bool  # the floor what a simulation leaves
    contradicted: bool = False  # the floor, by two answers or by a larger error


def preferred(likely: Likely, axes: Sequence[int], both: LeftOut | None, times: np.ndarray) -> Preferred:
    """Return which to believe; `times` (m,) is the noise of the sensors without the floor in units of the file's, 0
    where that tells none."""
    odds: JsonObject = {"ratio": float(likely.ratio), "chance": _chance(likely.chance)}
    if likely.chance >= RARE:
        return Preferred("simulation", note("cost.floor-still", **odds), False)
    odds["floor"] = _floor(likely, axes)
    if both is None:
        return Preferred("simulation", note("cost.too-short", **odds), False)
    apart, name = both.furthest
    told = odds | {"apart": apart, "open_loop": _open_loop(both)}
    if apart > both.limit or both.worse:
        return Preferred("simulation", note("cost.neither", subject=name, **told), False, True)
    explains = not likely.info.coloured and not np.any(times > ABOVE_NOISE)
    if both.better:
        return Preferred("innovations", note("cost.innovations", **told), explains)
    return Preferred("simulation", note("cost.simulation", **told), explains)


def _open_loop(both: LeftOut) -> Diagnostic:
    """Return how the answer by the innovations does on segments that were left out."""
    if not np.isfinite(both.percent):
        return note("cost.runs-away")
    percent = abs(both.percent)
    return note("cost.smaller", percent=percent) if both.better else note("cost.larger", percent=percent)


def _floor(likely: Likely, axes: Sequence[int]) -> str:
    """The process noise with its error, axis by axis."""
    said = []
    for axis, v, sd in zip(axes, likely.noise.floor, likely.floor_sd, strict=True):
        if v > 0.0:
            error = f" ± {sd / (2.0 * np.sqrt(v)):.1g}" if np.isfinite(sd) else ""
            said.append(f"{np.sqrt(v):.2g}{error} {UNITS[axis]}")
    return ", ".join(said)


def _chance(p: float) -> str:
    return f"{p:.2g}" if p >= 1e-6 else "< 1e-6"
