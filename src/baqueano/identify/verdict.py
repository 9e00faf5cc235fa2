"""USABLE, WARN or REFUSED, with reasons: a fit that ended is not yet a fit to drive with.

REFUSED   the search did not converge; the model explains nothing; most of what was asked for is not seen.
WARN      a parameter at its bound, weakly seen or not seen; residuals that are coloured and large, or far
          above the sensors' noise in the file; many outliers.
USABLE    none of these.

What the vehicle can never show does not count.
"""

from typing import Any, NamedTuple

import numpy as np

from baqueano.identify.intervals import COLOUR
from baqueano.identify.search import LACKING

EXPLAINS = 0.5  # part of the variance that the best channel must be explained
UNSEEN = 0.5  # part of the parameters that may stay unseen
ABOVE_NOISE = 3.0  # times the noise of the file that residuals may have
OUTLIER, OUTLIERS = 4.0, 0.02  # standard deviations, and part of the samples that may lie beyond


class Evidence(NamedTuple):
    """What a verdict rests on."""

    names: tuple[str, ...]  # (p,)
    estimate: np.ndarray  # (p,)
    bound: np.ndarray  # (p,)
    weak: np.ndarray  # (p,)
    frozen: int  # parameters whose command never moved
    unobservable: tuple[str, ...]
    channels: Any  # ChannelFit, run by run, the channels in one order
    converged: bool
    colour: np.ndarray  # (m,)
    believed: np.ndarray | None  # (m,) noise in the file, 0: not told; None: σ was given


def judge(e: Evidence) -> tuple[str, tuple[str, ...]]:
    """The verdict and its reasons."""
    if refused := _refused(e):
        return "REFUSED", tuple(refused)
    if doubts := _doubts(e):
        return "WARN", tuple(doubts)
    return "USABLE", ("converged, and the model explains what was measured",)


def _refused(e: Evidence) -> list[str]:
    out = []
    if not e.converged:
        out.append("the search did not converge: begin closer with start={…}, or free less")
    best = max((c.explained for c in e.channels if np.isfinite(c.explained)), default=0.0)
    if not best > EXPLAINS:
        out.append(
            f"of no channel does the model explain more than {100.0 * max(best, 0.0):.0f} %: did the vehicle "
            f"move, and do the signs and units of commands and sensors agree with the file?"
        )
    asked = len(e.names) - e.frozen
    unseen = asked - int(np.sum(np.isfinite(e.estimate)))
    if unseen > UNSEEN * asked:
        out.append(f"{unseen} of {asked} parameters do not show in what was measured")
    return out


def _doubts(e: Evidence) -> list[str]:
    out = []
    for k in np.flatnonzero(e.bound):
        side = "low" if e.bound[k] < 0 else "high"
        out.append(f"{short(e.names[k])} is at its {side} bound, {e.estimate[k]:.4g}")
    if e.weak.any():
        said = ", ".join(short(e.names[k]) for k in np.flatnonzero(e.weak))
        out.append(f"{said}: known with a large error only")
    if e.unobservable:
        out.append(f"not seen: {len(e.unobservable)}, see below")
    lacking = [
        label
        for label, c, channel in zip(_labels(e), e.colour, e.channels, strict=False)
        if abs(c) > COLOUR and channel.explained < 1.0 - LACKING**2
    ]
    if lacking:
        out.append(
            f"what is left of {', '.join(lacking)} is coloured and large: the model lacks something there"
        )
    return out + _loud(e)


def _loud(e: Evidence) -> list[str]:
    """Residuals far above the noise of the file, and outliers."""
    out, labels = [], _labels(e)
    believed = np.zeros(len(labels)) if e.believed is None else e.believed
    for label, c, known in zip(labels, e.channels, believed, strict=False):
        if known > 0.0 and c.sigma > ABOVE_NOISE * known:
            times = c.sigma / known
            out.append(f"what is left of {label}, {c.sigma:.3g}, is {times:.0f} times the noise in the file")
    for label, far in zip(labels, _beyond(e), strict=True):
        if far > OUTLIERS:
            out.append(f"{100.0 * far:.1f} % of {label} lie beyond {OUTLIER:.0f} standard deviations")
    return out


def _beyond(e: Evidence) -> np.ndarray:
    """(m,) part of each channel beyond OUTLIER, over all runs."""
    m = len(e.colour)
    counts, beyond = np.zeros(m), np.zeros(m)
    for k, c in enumerate(e.channels):
        counts[k % m] += np.sum(np.isfinite(c.measured))
        beyond[k % m] += np.sum(np.abs(c.measured - c.predicted) > OUTLIER * c.sigma)
    return beyond / np.maximum(counts, 1.0)


def _labels(e: Evidence) -> list[str]:
    return [f"{c.sensor}[{c.entry}]" for c in e.channels[: len(e.colour)]]


def short(name: str) -> str:
    """A path as it is told to people."""
    return name.removeprefix("model.")
