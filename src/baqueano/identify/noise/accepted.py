"""Is the noise true on runs that it was not found on? The filter as it would be written, number by number.

    NIS_c = Σ_t y_c² / S_cc / N   over the readings of number c in the held-out runs, 1 if the noise is true (1)

y are the innovations of the filter (augmented_ekf.py) with their covariance S; beyond FAR standard deviations they
count as FAR. The interval of (1) is that of drawing blocks of BLOCK_S with replacement: innovations of a real vehicle
are not white. A number agrees where its interval reaches from 1/CLOSE to CLOSE. Where one does not, the own runs do not
show the noise of this vehicle. Then it is found again over all runs (filter_noise.py); what still disagrees is told.
"""

from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import JsonObject, Tree
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.estimators.augmented.state import layout
from baqueano.estimators.augmented_ekf import AugmentedEkf
from baqueano.identify.noise.filter_noise import FAR
from baqueano.identify.noise.most_likely import example_of, ticks_of
from baqueano.identify.noise.speed_channels import ratio_of_blocks
from baqueano.runs.run import Run
from baqueano.signals import Tick, seconds
from baqueano.symbolic import scan

BLOCK_S = 2.0  # longer than innovations are correlated, as in held_out.py
CLOSE = 1.2  # of a variance: nearer than that, a filter is none the worse


class FilterBelief(StrEnum):
    """How far the noise of a filter may be believed."""

    TRUE = "true"
    TOO_SURE = "too sure"
    TOO_CAREFUL = "too careful"
    CANNOT_TELL = "cannot tell"


class Nis(NamedTuple):
    """The NIS of a number on the held-out runs, with its interval of 95 %."""

    name: str  # "imu[2]"
    mean: float
    low: float  # NaN of too few blocks
    high: float

    @property
    def verdict(self) -> FilterBelief:
        """Return what the NIS says of the noise."""
        if not np.isfinite(self.low):
            return FilterBelief.CANNOT_TELL
        if self.low > CLOSE:
            return FilterBelief.TOO_SURE
        return FilterBelief.TOO_CAREFUL if self.high < 1.0 / CLOSE else FilterBelief.TRUE

    @property
    def disagrees(self) -> bool:
        """Return True where chance does not explain the NIS."""
        return self.verdict in (FilterBelief.TOO_SURE, FilterBelief.TOO_CAREFUL)


class Accepted(NamedTuple):
    """Verdict of held-out runs on the noise that is written."""

    message: Diagnostic
    disagrees: bool  # after the noise was found again, too


def accepted(
    ekf: AugmentedEkf, found_again: Callable[[], AugmentedEkf], unseen: Sequence[Run], backend: str = "auto"
) -> tuple[AugmentedEkf, Accepted]:
    """Return the filter whose noise is to be written: `ekf` if the `unseen` runs agree with it, else that of
    `found_again()`, the noise over all runs; and one sentence."""
    runs, first = ", ".join(run.name for run in unseen), nis_of(ekf, unseen, backend)
    told = [one for one in first if one.verdict != FilterBelief.CANNOT_TELL]
    if not told:
        return ekf, Accepted(note("noise.too-short", runs=runs), False)
    off = [one for one in told if one.disagrees]
    if not off:
        return ekf, Accepted(note("noise.holds", runs=runs, nis=_figures(told)), False)
    ekf = found_again()
    names = {one.name for one in off}
    then = [one for one in nis_of(ekf, unseen, backend) if one.name in names or one.disagrees]
    still = [one for one in then if one.disagrees]
    told_again: JsonObject = {"runs": runs, "nis": _figures(off), "again": _figures(then)}
    if not still:
        return ekf, Accepted(note("noise.found-again", **told_again), False)
    sure, careful = (
        [one.name for one in still if one.verdict == belief]
        for belief in (FilterBelief.TOO_SURE, FilterBelief.TOO_CAREFUL)
    )
    why = note("noise.still-off", Severity.WARNING, **told_again, too_sure=sure, too_careful=careful)
    return ekf, Accepted(why, True)


def nis_of(ekf: AugmentedEkf, runs: Sequence[Run], backend: str = "auto") -> list[Nis]:
    """Return the NIS of each number that corrects, in the order of the layout.  (1)"""
    its = layout(ekf)
    names = [f"{name}[{i}]" for name, rows in zip(its.names, its.at, strict=True) for i in rows]

    def step(belief: Tree, tick: Tick) -> tuple[Tree, Tree]:
        belief, estimate = ekf.row(belief, tick)
        y, S = estimate.innovation, estimate.innovation_cov
        assert y is not None
        assert S is not None
        return belief, y**2 / np.diagonal(S)

    squares, counts = [], []
    for run in runs:
        ticks = ticks_of(run, ekf, len(run.t_ns))
        kernel = scan(step, ekf.init(), example_of(ekf), backend=backend)
        square = np.asarray(kernel.run(ticks)[1])
        came = np.isfinite(square)
        block = (seconds(ticks.t_ns, int(ticks.t_ns[0])) // BLOCK_S).astype(int)
        square = np.minimum(np.where(came, square, 0.0), FAR**2)
        squares.append(np.stack([np.bincount(block, column) for column in square.T], axis=1))
        counts.append(np.stack([np.bincount(block, column) for column in came.T], axis=1))
    return [
        _nis(names[k], np.concatenate(squares)[:, k], np.concatenate(counts)[:, k])
        for k in np.flatnonzero(np.any(its.moving > 0.0, axis=1))
    ]


def _nis(name: str, square: np.ndarray, count: np.ndarray) -> Nis:
    there = count > 0.0
    if not there.any():
        return Nis(name, *[float("nan")] * 3)
    return Nis(name, *(one**2 for one in ratio_of_blocks(square[there], count[there])))


def _figures(found: Sequence[Nis]) -> str:
    return ", ".join(f"{one.name}: {one.mean:.2f} ({one.low:.2f} … {one.high:.2f})" for one in found)
