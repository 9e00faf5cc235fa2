"""Write the page about a result, and its figures as files, with `report` and `build_page`."""

from functools import singledispatch
from pathlib import Path

import numpy as np

from baqueano.calibration.at_rest import RestMeasurement
from baqueano.compare import Comparison
from baqueano.compare.corridor_forecast import CorridorForecast
from baqueano.contracts.calls import checked_call
from baqueano.contracts.result import Tabular
from baqueano.drive import FirstDrive, TeachResult
from baqueano.errors import UsageError
from baqueano.identify import Fit
from baqueano.messages import texts
from baqueano.messages.language import number, translate as _
from baqueano.messages.printable import baqueano_command
from baqueano.report.card import make_card
from baqueano.report.fit_report import fit_page
from baqueano.report.page import Headline, Page, Section, Table, check_format, draw
from baqueano.report.pages.at_rest import rest_page
from baqueano.report.pages.parameter_drift import drift_page
from baqueano.report.pages.route import route_page
from baqueano.report.plots import plot_comparison
from baqueano.report.run_report import run_page
from baqueano.routes import RouteReport
from baqueano.runs import Run
from baqueano.runs.importing.recordings import ImportedRun
from baqueano.validation.parameter_drift import ParameterHistory

MAX_HEADLINES = 4  # runs: more do not fit into one row


@checked_call('bq.report(run, "report.html")')
def report(
    result: Tabular,
    path: str | Path | None = None,
    alignment: str = "none",
    *,
    figures: str | Path | None = None,
    file_format: str = "svg",
    width: str | float | None = None,
) -> Page:
    """Return the page about a result; write the page and its figures on request.

    Parameters
    ----------
    result : Run, Fit, Comparison, CorridorForecast, SweepResult, RestMeasurement, RouteReport or ParameterHistory
        The subject of the page. The results of `teach`, of an import and of a first drive have the page of their run.
    path : path, optional
        File to which the page is written, as self-contained HTML.
    alignment : str
        Alignment of the estimate of a run with the truth, as in `compare`.
    figures : path, optional
        Folder to which each figure of the page is written, such as "01-path.svg".
    file_format : str
        Format of these figures: "svg", "pdf" or "png".
    width : str or float [mm], optional
        Width of these figures: "column", "page" or a number; by default as on the page.

    Returns
    -------
    Page
        The page with its tables and drawings.

    Raises
    ------
    UsageError
        For another type of result, format or width, a `path` of a figure, or if matplotlib or jinja2 is missing.

    Examples
    --------
    >>> from baqueano.simulate import simulate
    >>> from baqueano.vehicle_file import load
    >>> page = report(simulate(load("small"), [[0.5, 0.0, 0.1]] * 100))
    >>> [section.title for section in page.sections]
    ['Path', 'Speed', 'Commands', 'Measurements', 'Content of the run']
    """
    check_format(file_format, width)
    page = build_page(result, alignment)
    if path is not None:
        page.save(path)
    if figures is not None:
        page.save_figures(figures, file_format, width)
    return page


@singledispatch
def build_page(result: Tabular, alignment: str = "none") -> Page:
    """Return the page about a result. Raise UsageError for a type of result without a page."""
    raise UsageError.of("front.no-page", value=type(result).__name__)


@build_page.register(TeachResult)
@build_page.register(ImportedRun)
@build_page.register(FirstDrive)
def _replay_page(result: TeachResult | ImportedRun | FirstDrive, alignment: str = "none") -> Page:
    return run_page(result.run, alignment)


@build_page.register(Comparison)
def comparison_page(result: Comparison, alignment: str = "none") -> Page:
    """Return the page about a comparison: the errors of each run, and the consistency of its estimator."""
    card = make_card(result)
    caption = _("Errors of each run; the bar is the range of a consistent filter in 95 % of runs.")
    sentences = [f"{run.name}: {sentence}" for run in result.runs for sentence in run.sentences]
    figure = plot_comparison(result)
    runs_with_truth = [run for run in result.runs if np.isfinite(run.across_true.rms_m)]
    return Page(
        title=card.title,
        subtitle=", ".join(run.name for run in result.runs),
        verdict=result.verdict,
        headlines=[
            Headline(run.name, f"{number(100.0 * run.across_true.rms_m):.2g} cm", _("across its path"))
            for run in runs_with_truth[:MAX_HEADLINES]
        ],
        sections=[
            Section(
                _("Errors and consistency"),
                "\n".join([*texts(result.reasons), *sentences]),
                [Table(list(card.rows)), *([] if figure is None else [draw(figure, caption)])],
            )
        ],
        reproduce=baqueano_command("compare", *(run.name for run in result.runs)),
    )


build_page.register(Run, run_page)
build_page.register(CorridorForecast, lambda result, alignment="none": run_page(result.run))
build_page.register(Fit, lambda result, alignment="none": fit_page(result))
build_page.register(RestMeasurement, lambda result, alignment="none": rest_page(result))
build_page.register(ParameterHistory, lambda result, alignment="none": drift_page(result))
build_page.register(RouteReport, lambda result, alignment="none": route_page(result))
