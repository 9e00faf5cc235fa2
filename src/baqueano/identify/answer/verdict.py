"""USABLE, WARN or REFUSED, with reasons: a fit that ended is not yet a fit to drive with.

REFUSED   the search did not converge; the model explains nothing, or is far from a channel that was believed; most
          of what was asked for is not seen, or with a large error only; a detector (doubts/) found data that cannot
          be meant.
WARN      a parameter that its bound holds back, weakly seen or not seen; residuals that are coloured and large, or
          far above the sensors' noise in the file; many outliers, or outliers to one side; a detector found what
          may have moved a parameter.
USABLE    none of these.

What the vehicle can never show does not count. What was mended, and a bound at which chance could put a parameter,
is said in the notes.
"""

from typing import Any, NamedTuple

import numpy as np

from baqueano.diagnostics import Verdict
from baqueano.identify.answer.channel_units import CHANNEL_UNITS
from baqueano.identify.doubts.finding import NOTE, REFUSED, WARN, Finding
from baqueano.identify.each_run import by_channel, unlike, whole
from baqueano.identify.solve.intervals import COLOUR
from baqueano.identify.solve.search import LACKING

EXPLAINS = 0.5  # part of the variance that the best channel must be explained
UNSEEN = 0.5  # part of the parameters that may stay unseen
ABOVE_NOISE = 3.0  # times the noise of the file that residuals may have
OUTLIER, OUTLIERS = 4.0, 0.2  # standard deviations, and part of the samples that may lie beyond; Huber's
# cost bears them as long as they fall to both sides alike
OUTLIER_CHANCE = 0.01  # below it even outliers to one side move a fit by less than its error
LEAN = 5.0  # standard deviations of a fair coin by which outliers may prefer a side


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
    found: tuple[Finding, ...] = ()  # by the detectors
    weakly: tuple[str, ...] = ()  # why those that are weak are
    moving: str = ""  # where the search did not converge, the parameter that would go on furthest
    one_mean: np.ndarray | None = (
        None  # (m,) whether a channel has one mean over all runs; None: each run its own
    )


def judge(e: Evidence) -> tuple[Verdict, tuple[str, ...]]:
    """The verdict and its reasons."""
    if refused := _refused(e):
        return Verdict.REFUSED, tuple(refused)
    if doubts := _doubts(e):
        return Verdict.WARN, tuple(doubts)
    return Verdict.USABLE, ("converged, and the model explains what was measured",)


def noted(e: Evidence) -> list[str]:
    """What is good to know and no reason to doubt; e.bound are the bounds at which chance could put a parameter."""
    out = [one.text for one in e.found if one.level == NOTE]
    out += unlike(by_channel(e.channels, e.one_mean), hardly=True)
    for k in np.flatnonzero(e.bound):
        out.append(
            f"{_at_bound(e, int(k))}, and would go beyond by less than 3 of its errors, as chance can make it"
        )
    for label, (n, above, below) in zip(_labels(e), _beyond(e), strict=True):
        far = (above + below) / max(n, 1)
        if OUTLIER_CHANCE < far <= OUTLIERS and not _lean(above, below):
            said = f"{100.0 * far:.1f} % of {label} lie beyond {OUTLIER:.0f} standard deviations"
            out.append(f"{said}: a Huber cost bears that, as long as they fall to both sides")
    return out


def _at_bound(e: Evidence, k: int) -> str:
    return f"{short(e.names[k])} is at its {'low' if e.bound[k] < 0 else 'high'} bound, {e.estimate[k]:.4g}"


def _refused(e: Evidence) -> list[str]:
    out = [one.text for one in e.found if one.level == REFUSED]
    if not e.converged:
        key = e.moving or "KEY"
        said = f"the search did not converge{f', {short(key)} still moved' if e.moving else ''}"
        out.append(
            f"{said}: begin with better numbers in the vehicle file, as --set {key}=VALUE, or free less, as --fix {key}"
        )
    explained = [c.explained for c in e.channels if np.isfinite(c.explained)]
    over_all = {label: whole(runs) for label, runs in by_channel(e.channels, e.one_mean).items()}
    best = max([0.0, *explained, *(one.explained for one in over_all.values())])
    far = {label: np.sqrt(one.left / max(one.moved, 1e-300)) for label, one in over_all.items() if one.unlike}
    if not best > EXPLAINS:
        out.append(
            f"of no channel does the model explain more than {100.0 * max(best, 0.0):.0f} %: did the vehicle "
            f"move, and do the signs and units of commands and sensors agree with the file?"
        )
    if far and best > EXPLAINS:
        out += [
            f"{label} is {times:.3g} times as far from the model as from its own mean: are its unit, "
            "scale and sign right? Or fit without it: name the others with --use"
            for label, times in far.items()
        ]
        out += [one.text for one in e.found if one.level == WARN]  # one of them may be why
    asked = len(e.names) - e.frozen
    unseen = asked - int(np.sum(np.isfinite(e.estimate)))
    weak = int(np.sum(e.weak))
    if unseen > UNSEEN * asked:
        hint = ": do axes, signs and units agree with the file?" if unseen == asked else ""
        out.append(f"{unseen} of {asked} parameters do not show in what was measured{hint}")
    elif unseen + weak > UNSEEN * asked:
        said = f"{unseen} are not seen and " if unseen else ""
        out.append(
            f"of {asked} parameters {said}{weak} have a large error only: the data are too few or too quiet; drive "
            "longer, and harder"
        )
    return out


def _doubts(e: Evidence) -> list[str]:
    out = [one.text for one in e.found if one.level == WARN]
    out += [_at_bound(e, int(k)) for k in np.flatnonzero(e.bound)]
    if e.weak.any():
        said = ", ".join(short(e.names[k]) for k in np.flatnonzero(e.weak))
        out.append(f"{said}: known with a large error only")
        out += [one.rstrip(".") for one in e.weakly]
    out += unlike(by_channel(e.channels, e.one_mean), hardly=False)
    if e.unobservable:
        out.append(f"not seen: {len(e.unobservable)}, below")
    told = {one.text.split(" ")[4] for one in e.found if one.code == "coloured"}
    lacking = [
        label
        for label, c, channel in zip(_labels(e), e.colour, e.channels, strict=False)
        if abs(c) > COLOUR and channel.explained < 1.0 - LACKING**2 and label not in told
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
    for label, (n, above, below) in zip(labels, _beyond(e), strict=True):
        far = (above + below) / max(n, 1)
        if far > OUTLIERS and n == 1:
            out.append(_one_far(e, label))
        elif far > OUTLIERS:
            out.append(f"{100.0 * far:.0f} % of {label} lie beyond {OUTLIER:.0f} standard deviations")
        elif _lean(above, below) and far > OUTLIER_CHANCE:
            out.append(
                f"{100.0 * far:.1f} % of {label} lie beyond {OUTLIER:.0f} standard deviations, {above} above and "
                f"{below} below: outliers to one side pull the fit"
            )
    return out


def _lean(above: int, below: int) -> bool:
    """Whether outliers prefer a side."""
    return bool(abs(above - below) > LEAN * np.sqrt(above + below))


def _one_far(e: Evidence, label: str) -> str:
    """Of the one reading of a channel, as of a tape: both numbers say more than 100 %."""
    same = [c for c in e.channels if f"{c.sensor}[{c.entry}]" == label]
    z, h, sigma = next(
        (c.measured[k], c.predicted[k], c.sigma)
        for c in same
        for k in np.flatnonzero(np.isfinite(c.measured - c.predicted))
    )
    units = CHANNEL_UNITS.get(same[0].sensor, ())
    unit = f" {units[same[0].entry]}" if same[0].entry < len(units) else ""
    apart = f"{abs(z - h) / sigma:.0f} standard deviations apart"
    return f"{label}: {z:.4g}{unit} was measured and the model says {h:.4g}{unit}, {apart}"


def _beyond(e: Evidence) -> list[tuple[int, int, int]]:
    """Per channel over all runs: samples, those above OUTLIER, those below."""
    m = len(e.colour)
    counts = np.zeros((m, 3), int)
    for k, c in enumerate(e.channels):
        left = (c.measured - c.predicted) / c.sigma
        counts[k % m] += [np.sum(np.isfinite(left)), np.sum(left > OUTLIER), np.sum(left < -OUTLIER)]
    return [(int(n), int(above), int(below)) for n, above, below in counts]


def _labels(e: Evidence) -> list[str]:
    return [f"{c.sensor}[{c.entry}]" for c in e.channels[: len(e.colour)]]


def short(name: str) -> str:
    """A path as it is told to people."""
    return name.removeprefix("model.")
