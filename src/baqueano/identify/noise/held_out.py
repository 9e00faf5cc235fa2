"""Test the noise of a filter on held-out runs and on a simulation.

    NIS_c = Σ_t y_c² / S_cc / N   over readings of channel c in the held-out runs, 1 if the noise is correct (1)
    NEES_s = Σ_t e_s² / P_ss / N  of state s over drives of the fitted vehicle with this noise               (2)

y are the innovations of the filter with their covariance S, limited to ROBUST_SIGMA standard deviations. Innovations of
a real vehicle are not white, so the interval of (1) comes from blocks of BLOCK_S, drawn with replacement. A channel
agrees if its interval contains a value from 1/CLOSE_FACTOR to CLOSE_FACTOR. If a channel disagrees, the runs of the fit
do not show the noise of this vehicle: it is estimated again over all runs (filter_noise.py), and channels that still
disagree are reported. A state agrees within CLOSE_FACTOR_ON_DRIVES; each drive of (2) is one block
(simulate/assumed_noise.py).
"""

from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from baqueano.contracts.values import JsonObject, Tree
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.estimators.augmented.state import layout
from baqueano.estimators.augmented_ekf import AugmentedEkf
from baqueano.identify.noise.filter_noise import ROBUST_SIGMA
from baqueano.identify.noise.speed_channels import ratio_of_blocks
from baqueano.messages.language import mark as N_
from baqueano.runs.filter_ticks import example_filter_tick, ticks_of
from baqueano.runs.run import Run
from baqueano.signals import Tick, seconds
from baqueano.simulate.assumed_noise import simulated_errors
from baqueano.symbolic import scan
from baqueano.symbolic.scan import Scan

BLOCK_S = 2.0  # longer than innovations are correlated
CLOSE_FACTOR = 1.2  # factor on a variance: a smaller error does not degrade a filter
# factor on the variance of a state: larger, because consider scales and slips are partly nonlinear
CLOSE_FACTOR_ON_DRIVES = 1.5
STATES = ("x", "y", N_("heading"), "v_x", "v_y", N_("yaw rate"))


class NoiseVerdict(StrEnum):
    """Verdict on the noise of a filter."""

    TRUE = "true"
    TOO_SURE = "too sure"
    TOO_CAREFUL = "too cautious"
    CANNOT_TELL = "cannot tell"


class NormalisedSquare(NamedTuple):
    """The NIS of a channel or the NEES of a state, with its 95 % interval."""

    name: str  # "imu[2]", "heading"
    mean: float
    low: float  # NaN with too few blocks
    high: float
    close_factor: float  # factor within which the mean agrees with 1

    @property
    def verdict(self) -> NoiseVerdict:
        """Return the verdict on the noise."""
        if not np.isfinite(self.low):
            return NoiseVerdict.CANNOT_TELL
        if self.low > self.close_factor:
            return NoiseVerdict.TOO_SURE
        return NoiseVerdict.TOO_CAREFUL if self.high < 1.0 / self.close_factor else NoiseVerdict.TRUE

    @property
    def disagrees(self) -> bool:
        """Return True if the filter is overconfident or conservative."""
        return self.verdict in (NoiseVerdict.TOO_SURE, NoiseVerdict.TOO_CAREFUL)


class Acceptance(NamedTuple):
    """Verdict of held-out runs on the noise that is written."""

    message: Diagnostic
    disagrees: bool  # True if the noise still disagrees after the new estimate, or on simulated drives


def accept_or_refit(
    ekf: AugmentedEkf,
    refit: Callable[[], AugmentedEkf],
    validation_runs: Sequence[Run],
    backend: str = "auto",
) -> tuple[AugmentedEkf, Acceptance]:
    """Return the filter whose noise is written, and the verdict. The filter is `ekf` if the `validation_runs` agree
    with it or are too short for a test, else `refit()`, with the noise over all runs."""
    runs, kernel = ", ".join(run.name for run in validation_runs), _filter_scan(ekf, backend)
    squares = nis_of(ekf, validation_runs, kernel)
    decisive = [square for square in squares if square.verdict != NoiseVerdict.CANNOT_TELL]
    if not decisive:
        return ekf, Acceptance(note("noise.too-short", runs=runs), False)
    disagreeing, code = [square for square in decisive if square.disagrees], "noise.holds"
    figures: JsonObject = {"runs": runs, "nis": _figures(decisive)}
    if disagreeing:
        ekf, code = refit(), "noise.estimated-again"
        kernel, names = _filter_scan(ekf, backend), {square.name for square in disagreeing}
        squares = nis_of(ekf, validation_runs, kernel)
        again = [square for square in squares if square.name in names or square.disagrees]
        figures |= {"nis": _figures(disagreeing), "again": _figures(again)}
        if remaining := [square for square in again if square.disagrees]:
            figures |= {"states": _by_consistency(remaining)}
            return ekf, Acceptance(note("noise.still-off", Severity.WARNING, **figures), True)
    nees = nees_of(ekf, validation_runs[0], kernel)
    if disagreeing_states := [square for square in nees if square.disagrees]:
        figures = {"nees": _figures(nees), "states": _by_consistency(disagreeing_states)}
        return ekf, Acceptance(note("noise.nees-off", Severity.WARNING, **figures), True)
    if nees and not disagreeing:
        code, figures = "noise.holds-simulated", figures | {"nees": _figures(nees)}
    return ekf, Acceptance(note(code, **figures), False)


def nis_of(ekf: AugmentedEkf, runs: Sequence[Run], kernel: Scan) -> list[NormalisedSquare]:
    """Return the NIS of each channel that corrects the motion, in the order of the layout.  (1)"""
    filter_layout = layout(ekf)
    names = [f"{name}[{i}]" for name, i in filter_layout.channel_entries]
    squares, counts = [], []
    for run in runs:
        ticks = ticks_of(run, ekf, len(run.t_ns))
        square = np.asarray(kernel.run(ticks)[1][0])
        is_present = np.isfinite(square)
        block = (seconds(ticks.t_ns, int(ticks.t_ns[0])) // BLOCK_S).astype(int)
        square = np.minimum(np.where(is_present, square, 0.0), ROBUST_SIGMA**2)
        squares.append(np.stack([np.bincount(block, column) for column in square.T], axis=1))
        counts.append(np.stack([np.bincount(block, column) for column in is_present.T], axis=1))
    square, count = np.concatenate(squares), np.concatenate(counts)
    return [
        _normalised_square(names[k], square[:, k], count[:, k], CLOSE_FACTOR)
        for k in np.flatnonzero(np.any(filter_layout.moving_mask > 0.0, axis=1))
    ]


def nees_of(ekf: AugmentedEkf, run: Run, kernel: Scan) -> list[NormalisedSquare]:
    """Return the NEES of each state on drives like `run`, or an empty list if they cannot be simulated.  (2)"""
    e, P = simulated_errors(ekf, run, kernel)
    square = e**2 / np.diagonal(P, axis1=2, axis2=3)
    count = np.full(len(square), float(square.shape[1]))
    return [
        _normalised_square(name, square[:, :, k].sum(axis=1), count, CLOSE_FACTOR_ON_DRIVES)
        for k, name in enumerate(STATES if len(square) else ())
    ]


def _filter_scan(ekf: AugmentedEkf, backend: str) -> Scan:
    """Return a scan of the filter whose outputs are y²/S (m,), η, ν and the covariance."""

    def step(belief: Tree, tick: Tick) -> tuple[Tree, Any]:
        belief, estimate = ekf.row(belief, tick)
        y, S = estimate.innovation, estimate.innovation_cov
        assert y is not None
        assert S is not None
        return belief, (y**2 / np.diagonal(S), estimate.eta, estimate.nu, estimate.cov)

    return scan(step, ekf.init(), example_filter_tick(ekf), backend=backend)


def _normalised_square(
    name: str, square: np.ndarray, count: np.ndarray, close_factor: float
) -> NormalisedSquare:
    has, (mean, low, high) = count > 0.0, (float("nan"),) * 3
    if has.any():
        mean, low, high = ratio_of_blocks(square[has], count[has])
    return NormalisedSquare(name, mean**2, low**2, high**2, close_factor)


def _by_consistency(squares: Sequence[NormalisedSquare]) -> list[Diagnostic]:
    """Return the channels or states for which the filter is overconfident, and those for which it is conservative."""
    codes = {NoiseVerdict.TOO_SURE: "noise.too-small-for", NoiseVerdict.TOO_CAREFUL: "noise.too-large-for"}
    return [
        note(code, states=[note("noise.state", name=square.name) for square in group])
        for verdict, code in codes.items()
        if (group := [square for square in squares if square.verdict == verdict])
    ]


def _figures(noise: Sequence[NormalisedSquare]) -> list[Diagnostic]:
    return [
        note("noise.square", name=square.name, mean=square.mean, low=square.low, high=square.high)
        for square in noise
    ]
