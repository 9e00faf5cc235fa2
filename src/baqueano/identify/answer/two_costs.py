"""Which of the two costs to believe, in one sentence with its figures.

Three things decide: whether a moving floor explains the run better than a still one (prediction.py, (4)), whether
the innovations are white, and how far the two answers are apart.

    floor still                         the simulation: both say the same, and it is the harder test of a model
    floor moves, innovations white      the innovations: the simulation's errors are a walk, neighbours no news
    coloured, but far less, one answer  the innovations, whose error bars know of it: a push that lasts
    coloured as before, or two answers  neither, the simulation rather: what the model lacks passes for a floor

    ϱ = Σ_l ρ(l) / √(L/n)                                                                                  (1)

is the autocorrelation ρ of residuals, summed over the L lags of `LONG_S`, in standard deviations of what white
ones show: the long memory of a floor below a noise that hides it from neighbour to neighbour.
"""

from collections.abc import Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from baqueano.identify.solve.prediction import Likely

RARE = 1e-3  # chance below which a still floor is not believed
LONG_S = 2.0  # over which the colour of residuals is summed
TWO = 0.01  # chance that one answer passes for two: beyond its quantile the two are not one
LEFT = 0.5  # of the colour of the simulation: a floor that explains the smaller part of it is none
CLIP = 3.0  # standard deviations: an outlier is not colour
UNITS = ("m/s", "m/s", "rad/s")


class Compared(NamedTuple):
    """The two answers for what is known of both."""

    names: Sequence[str]  # (p,)
    simulated: np.ndarray  # (p,)
    simulated_sd: np.ndarray  # (p,)
    predicted: np.ndarray  # (p,)
    predicted_sd: np.ndarray  # (p,)

    @property
    def limit(self) -> float:
        """Standard errors by which the largest of p differences of one answer seldom differs (Bonferroni)."""
        return NormalDist().inv_cdf(1.0 - TWO / 2.0 / max(1, len(self.names)))

    @property
    def apart(self) -> tuple[float, str]:
        """The largest difference in standard errors, and whose it is; 0 where nothing is known of both."""
        sd = np.maximum(self.simulated_sd, self.predicted_sd)
        with np.errstate(invalid="ignore", divide="ignore"):
            off = np.abs(self.simulated - self.predicted) / sd
        off = np.where(np.isfinite(off), off, 0.0)
        k = int(np.argmax(off)) if len(off) else 0
        return (float(off[k]), self.names[k].removeprefix("model.")) if len(off) else (0.0, "")


class Preferred(NamedTuple):
    """The cost to believe, and why."""

    cost: str  # "simulation" or "innovations"
    why: str  # one sentence
    white: bool  # the innovations


def preferred(
    likely: Likely, axes: Sequence[int], both: Compared, simulated: float, predicted: float
) -> Preferred:
    """Which to believe; `simulated` and `predicted` are ϱ of the residuals and of the innovations.  (1)"""
    white = not likely.info.coloured
    apart, name = both.apart
    two = apart > both.limit
    far = f"the two are {apart:.1f} standard errors apart at most{f' ({name})' if two else ''}"
    odds = f"likelihood ratio {likely.ratio:.1f}, by chance {_chance(likely.chance)}"
    walk = f"autocorrelation over {LONG_S:g} s {simulated:.0f} times what white residuals show"
    if likely.chance >= RARE:
        why = (
            f"believe the simulation error: a floor that moves explains no more ({odds}; {walk}), {far}, and a "
            "simulation is the harder test of a model"
        )
        return Preferred("simulation", why, white)
    floor = _floor(likely, axes)
    if white or not (two or predicted > LEFT * simulated):
        rest = (
            "" if white else "; the push lasts, or a term is missing: the error bars know of the colour left"
        )
        rest += "; these are two answers: let a run that was held out judge them" if two else ""
        why = (
            f"believe the innovations: the floor disturbs the vehicle by {floor} ({odds}), so the errors of a "
            f"simulation are a walk ({walk}, of the innovations {predicted:.0f}), {far}{rest}"
        )
        return Preferred("innovations", why, white)
    why = (
        f"believe neither before the model is better, and the simulation error rather: {far}, and the innovations "
        f"are not white (autocorrelation over {LONG_S:g} s {predicted:.0f} times that of white ones, of the "
        f"simulation {simulated:.0f}), so what looks like a floor of {floor} ({odds}) is what the model lacks"
    )
    return Preferred("simulation", why, white)


def long_colour(residuals: Sequence[np.ndarray], has: Sequence[np.ndarray], dt_s: float) -> float:
    """ϱ of the channel where it is largest, residuals (N, m) per piece in standard deviations.  (1)"""
    lags, m = max(1, round(LONG_S / dt_s)), residuals[0].shape[1]
    total, power, pairs = np.zeros(m), np.zeros(m), np.zeros(m)
    for r, there in zip(residuals, has, strict=True):
        count = there.sum(axis=0)
        x = np.clip(r, -CLIP, CLIP) * there
        x = (x - x.sum(axis=0) / np.maximum(count, 1.0)) * there
        total += np.sum(x * _ahead(x, lags), axis=0)
        power += np.sum(x * x, axis=0)
        pairs += np.sum(there * _ahead(there, lags), axis=0)
    variance = np.maximum(power, 1e-300) / np.maximum(sum(there.sum(axis=0) for there in has), 1.0)
    return float(np.max(total / (variance * np.sqrt(np.maximum(pairs, 1.0)))))


def _ahead(x: np.ndarray, lags: int) -> np.ndarray:
    """Σ of the next `lags` rows (N, m)."""
    sums = np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(x, axis=0)])
    last = np.minimum(np.arange(len(x)) + lags + 1, len(x))
    return sums[last] - sums[1:]


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
