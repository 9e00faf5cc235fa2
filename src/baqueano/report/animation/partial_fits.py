"""Show the intervals of a fit narrowing with more data: one fit for each length of the drive."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.diagnostics import Verdict

if TYPE_CHECKING:
    from baqueano.identify import Fit

QUANTILE_95 = 1.96


class PartialFit(NamedTuple):
    """The estimates of a fit to the first seconds of a drive."""

    seconds: float
    verdict: Verdict
    relative_error: np.ndarray  # (p,) estimate over the truth, minus 1; NaN without an estimate
    half_width: np.ndarray  # (p,) half-width of the 95 % interval, relative to the truth


def partial_fits(
    fits: Sequence[tuple[float, "Fit"]], names: Sequence[str], truth: Sequence[float]
) -> list[PartialFit]:
    """Return a stage per (seconds, fit) for the parameters `names` with the nonzero true values `truth`."""
    partial_fits = []
    for seconds, fit in fits:
        rows = {row["name"]: row for row in fit.rows()}
        pairs = [(rows[name]["estimate"], rows[name]["std"]) for name in names]
        value, std = np.array([[np.nan if x is None else x for x in pair] for pair in pairs]).T
        true_values = np.asarray(truth)
        partial_fits.append(
            PartialFit(
                seconds, fit.verdict, value / true_values - 1.0, QUANTILE_95 * std / np.abs(true_values)
            )
        )
    return partial_fits
