"""The page of `baqueano study identification`: the table, errors against the normal density, coverage."""

from typing import TYPE_CHECKING

import numpy as np

from baqueano.report import Drawing, Headline, Page, Section, Table, draw
from baqueano.report.figures import MEASURED, MODEL, REFERENCE, TRUTH, pyplot
from baqueano.study.identification import EACH, MOST_RMSE, NAMES, Identification

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ABOUT = (
    "rmse_over_bound: root mean square error over the Cramér-Rao bound of the same runs. coverage: part of the "
    "95 % intervals that hold the truth. outlier_ratio: error with 10 % outliers over the clean one. converged: "
    "part of the wrong starts that found the end of the right one."
)
Z = "Each error in its own standard error, {} estimates, and the normal density. Beyond 4.5: at the edge."
COVERAGE = "Part of the 95 % intervals that hold the truth, with twice its scatter; in the band, by rights."
BARS = "Errors in bounds: clean, and with outliers. The line is what the fit has to keep below when clean."


def page_of_identification(study: Identification) -> Page:
    """Everything, on one page."""
    pooled, n = study.rows()[-1], len(study.trials)
    over = f"{n:,} seeds" + (f" of {study.asked:,}, stopped from the keyboard" if n < study.asked else "")
    parts: list[Table | Drawing] = [
        draw(histogram(study.z()), Z.format(study.z().size)),
        draw(coverage(study.inside), COVERAGE),
        draw(efficiency(study), BARS),
    ]
    return Page(
        title="How near to the limit a fit comes",
        subtitle=f"Case study I, 60 s each, {over}",
        verdict=study.verdict,
        headlines=[
            Headline("error / bound", f"{pooled['rmse_over_bound']:.3f}", "all parameters"),
            Headline("within the interval", f"{100 * pooled['coverage']:.1f} %", "95 % are expected"),
            Headline("with outliers", f"{pooled['outlier_ratio']:.2f} ×", "the clean error"),
            Headline(
                "wrong starts", f"{100 * pooled['converged']:.1f} %", f"converge, {study.silent} silent"
            ),
        ],
        sections=[
            Section("Table", "\n".join(study.reasons), [Table(study.rows(), ABOUT)]),
            Section("Figures", "", parts),
        ],
        reproduce=f"baqueano study identification --seeds {study.asked}",
    )


def histogram(z: np.ndarray) -> "Figure":
    """z (N, p), all together."""
    figure, axis = pyplot().subplots(figsize=(9.2, 2.8))
    grid = np.linspace(-4.5, 4.5, 200)
    axis.hist(
        np.clip(z.ravel(), -4.5, 4.5), bins=60, range=(-4.5, 4.5), density=True, color=MEASURED, alpha=0.6
    )
    axis.plot(grid, np.exp(-0.5 * grid**2) / np.sqrt(2 * np.pi), color=TRUTH, lw=1)
    axis.set_xlabel("(estimate − truth) / standard error")
    return figure


def coverage(inside: np.ndarray) -> "Figure":
    """inside (N, p) bool, by parameter."""
    part = inside.mean(axis=0)
    figure, axis = pyplot().subplots(figsize=(9.2, 2.8))
    axis.axhspan(100 * EACH[0], 100 * EACH[1], color=REFERENCE, alpha=0.25)
    axis.errorbar(
        range(len(NAMES)),
        100 * part,
        yerr=200 * np.sqrt(0.05 * 0.95 / len(inside)),
        fmt="o",
        color=MODEL,
        capsize=3,
    )
    axis.axhline(95.0, color=TRUTH, lw=1)
    axis.set_xticks(range(len(NAMES)), NAMES)
    axis.set_ylabel("inside [%]")
    return figure


def efficiency(study: Identification) -> "Figure":
    """Errors in bounds, by parameter."""
    figure, axis = pyplot().subplots(figsize=(9.2, 2.8))
    at = np.arange(len(NAMES))
    axis.bar(at - 0.2, study.rmse("clean") / study.bound, width=0.38, color=MODEL, label="clean")
    axis.bar(
        at + 0.2, study.rmse("outliers") / study.bound, width=0.38, color=MEASURED, label="10 % outliers"
    )
    axis.axhline(MOST_RMSE, color=TRUTH, lw=1)
    axis.set_xticks(at, NAMES)
    axis.set_ylabel("rmse / bound")
    axis.legend(loc="lower right")
    return figure
