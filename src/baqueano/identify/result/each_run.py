"""Distance of each run from the model, beside how much it moved.

A run that hardly moved is explained by no model, and −90 of it would outweigh thirty that are explained to 0.99: so
the squares of what is left and of what moved are summed over the runs. A single run is unlike the others where it is
further from the model than from its own mean, moved by more than the model errs elsewhere, and is no chance,

    g_r = log mean e² of run r,   g_r − ḡ > t_{1−α/R} s √(1 + 1/(R − 1))                                   (1)

with ḡ and s of the other runs.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.identify.covariance.clusters import students

if TYPE_CHECKING:
    from baqueano.identify.result.fit_result import ChannelFit

FAR = 2.0  # of the square about its own mean: a channel that leaves more goes by something else than the model says
OUTLIER = 4.0  # standard deviations, beyond which an error is clipped
NAMED = 3  # runs
CHANCE = 0.01  # α, of a run that is called unlike the others, where it is not


class OfRun(NamedTuple):
    """One channel in one run, in units of its own noise."""

    run: str
    left: float  # sum of the squared residuals, outliers clipped
    moved: float  # of what was measured about its mean
    samples: int

    @property
    def unlike(self) -> bool:
        """Return True where it is further from the model than from its own mean."""
        return self.left > FAR * self.moved

    @property
    def explained(self) -> float:
        """The part of what it moved that the model explains."""
        return 1.0 - self.left / self.moved if self.moved > 0.0 else 0.0


def by_channel(channels: "Sequence[ChannelFit]", one_mean: np.ndarray | None) -> dict[str, list[OfRun]]:
    """Per channel its runs; `one_mean` (m,), in the order of the first run, tells whose mean is that of all runs."""
    out: dict[str, list[OfRun]] = {}
    labels = list(dict.fromkeys(f"{c.sensor}[{c.entry}]" for c in channels))
    means = np.zeros(len(labels)) if one_mean is None else one_mean
    for label, shared in zip(labels, means, strict=True):
        fewest = 1 if shared else 2
        same = [c for c in channels if f"{c.sensor}[{c.entry}]" == label]
        same = [c for c in same if np.isfinite(c.measured).sum() >= fewest]
        known = [np.isfinite(c.measured) for c in same]
        z = [c.measured[there] for c, there in zip(same, known, strict=True)]
        mean = float(np.mean(np.concatenate(z))) if shared and z else None
        for c, there, measured in zip(same, known, z, strict=True):
            most = OUTLIER * max(c.sigma, float(np.std(measured)))
            left = np.clip(measured - c.predicted[there], -most, most)
            moved = c.predicted[there] + left
            moved = moved - (np.mean(moved) if mean is None else mean)
            left2, moved2 = (float(x @ x) / c.sigma**2 for x in (left, moved))
            out.setdefault(label, []).append(OfRun(c.run, left2, moved2, len(measured)))
    return out


def whole(runs: Sequence[OfRun]) -> OfRun:
    """The sums over all runs of a channel."""
    left, moved, samples = (sum(getattr(one, name) for one in runs) for name in ("left", "moved", "samples"))
    return OfRun("", left, moved, samples)


def unlike(channels: dict[str, list[OfRun]], hardly: bool) -> list[Diagnostic]:
    """Runs that are unlike the model in a channel, others of which carry it: those that `hardly` moved, by less than
    the model errs in the others, or those that did and are further off than chance explains."""
    out = []
    for label, runs in channels.items():
        rest = [one for one in runs if not one.unlike]
        if not rest:
            continue
        errs = whole(rest).left / max(whole(rest).samples, 1)
        small = [one.moved <= errs * one.samples for one in runs]
        found = [
            one.run
            for one, quiet in zip(runs, small, strict=True)
            if one.unlike and (quiet if hardly else not quiet and _beyond_chance(one, rest, len(runs)))
        ]
        if found:
            code, grave = (
                ("runs.hardly-moved", Severity.INFO) if hardly else ("runs.unlike-others", Severity.WARNING)
            )
            named = ", ".join(found[:NAMED]) + ", …" * (len(found) > NAMED)
            out.append(note(code, grave, subject=label, count=len(found), of=len(runs), runs=named))
    return out


def _beyond_chance(one: OfRun, rest: list[OfRun], count: int) -> bool:
    """Return True where the residual of a run is larger than the largest of `count` runs is by chance. Two runs do not
    show their scatter: then True.  (1)"""
    g = np.log([max(r.left / r.samples, 1e-300) for r in (one, *rest)])
    if len(rest) < 2:
        return True
    far = (
        students(1.0 - CHANCE / count, len(rest) - 1) * np.std(g[1:], ddof=1) * np.sqrt(1.0 + 1.0 / len(rest))
    )
    return bool(g[0] > np.mean(g[1:]) + far)
