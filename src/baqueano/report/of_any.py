"""The page of any result."""

from pathlib import Path

from baqueano.diagnostics import fault
from baqueano.errors import UsageError
from baqueano.identify import Fit
from baqueano.report.of_fit import page_of_fit
from baqueano.report.of_run import page_of_run
from baqueano.report.page import Page
from baqueano.runs import Run


def report(result: Run | Fit, path: str | Path | None = None, alignment: str = "none") -> Page:
    """Return the page about a run or a fit, and write it to `path`, if that is given. `alignment` as in
    `compare`. UsageError for another result, or where matplotlib or jinja2 is missing.

    >>> from baqueano.simulate import simulate
    >>> from baqueano.vehicle_file import load
    >>> page = report(simulate(load("small"), [[0.5, 0.0, 0.1]] * 100))
    >>> [section.title for section in page.sections]
    ['Path', 'Speed', 'Commands', 'Measurements', 'What the run holds']
    """
    if isinstance(result, Run):
        page = page_of_run(result, alignment)
    elif isinstance(result, Fit):
        page = page_of_fit(result)
    else:
        raise UsageError(fault("front.no-page", found=type(result).__name__))
    if path is not None:
        page.save(path)
    return page
