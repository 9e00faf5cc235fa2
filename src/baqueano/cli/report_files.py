"""Define the options for the files of a report, the same for every command: a page, and its figures one by one."""

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from baqueano.cli import options
from baqueano.cli.terminal import print_message, show_activity
from baqueano.diagnostics import note
from baqueano.errors import UsageError
from baqueano.messages.printable import baqueano_command

if TYPE_CHECKING:
    from baqueano.contracts.result import Result
    from baqueano.report import Page


@dataclass(frozen=True)
class ReportFiles:
    """The files of a report that a user requests: `page`, and each figure in the folder `figures`."""

    page: Path | None
    figures: Path | None
    file_format: str
    width: str | float | None  # of the figures: "column", "page" or millimetres
    table: Path | None = None
    decimal: str = "."  # of the table

    def __bool__(self) -> bool:
        return self.page is not None or self.figures is not None

    def save(self, page: "Page", path: Path | None = None) -> list[Path]:
        """Write the requested files, and return their paths. `path` is the page if none is requested."""
        path = self.page or path
        files = [] if path is None else [page.save(path)]
        if self.figures is not None:
            files += page.save_figures(self.figures, self.file_format, self.width)
        return files

    def write(
        self, make_page: Callable[[], "Page"], path: Path | None = None, *, reproducible: bool = False
    ) -> None:
        """Write the requested files of the page that `make_page` returns, and print their places.

        `path` is the page if none is requested. With `reproducible`, the page contains the command line of the user.
        """
        with show_activity(note("cli.drawing")):
            page = make_page()
            if reproducible:
                page = replace(page, reproduce=baqueano_command(*sys.argv[1:]))
            files = self.save(page, path)
        if self.page or path:
            print_message(note("cli.report", page=files.pop(0)))
        if self.figures is not None:
            print_message(note("cli.figures", count=len(files), folder=self.figures))

    def write_table(self, result: "Result", caption: str = "", blocks: object = None) -> None:
        """Write the rows of a result as the requested table, if any; `caption` and `blocks` are for LaTeX."""
        if self.table is not None:
            from baqueano.report.tables import save_result

            path = save_result(result, self.table, self.decimal, caption, blocks)
            print_message(note("cli.table", path=path))

    def write_page(self, result: "Result") -> None:
        """Write the requested files, if any, of a result: its table, and its page with the command line of the user."""
        self.write_table(result)
        if self:
            from baqueano.report.pages.result_page import build_page

            self.write(lambda: build_page(result), reproducible=True)


def _report_files(
    figures: Path | None, file_format: str, width: str | None,
    page: Path | None = None, table: Path | None = None, decimal: str = ".",
) -> ReportFiles:  # fmt: skip
    """Return the requested files. Raise UsageError for an invalid width, format or ending."""
    report = ReportFiles(page, figures, file_format, _width(width), table, decimal)
    _check_folder(report, width)
    _check_table(report)
    return report


def _with_figures(*page_options: options.Decorator) -> options.Decorator:
    """Return a decorator that adds the options; the command receives them as the argument `report`."""
    return options.combine_options(*page_options, *_FIGURES, options.collect("report", _report_files))


decimal = click.option(
    "--decimal",
    type=click.Choice([".", ","]),
    default=".",
    help="Decimal sign of the CSV file; with ',' the columns are separated by ';'.",
)
_FIGURES = (
    click.option(
        "--figures",
        type=click.Path(path_type=Path, file_okay=False),
        help="Also write each figure as a file into this folder.",
    ),
    click.option(
        "--format", "file_format", type=click.Choice(["svg", "pdf", "png"]), default="svg", show_default=True,
        help="Format of the files of --figures.",
    ),
    click.option(
        "--width", metavar="column|page|MM", help="Width of the files of --figures: column, page, or millimetres."
    ),
)  # fmt: skip
figure_options = _with_figures()
report_options = _with_figures(
    click.option("--report", "page", type=click.Path(path_type=Path), help="Also write an HTML report."),
    click.option("--table", type=click.Path(path_type=Path), help="Also write the rows, as .csv or .tex."),
    decimal,
)


def _width(argument: str | None) -> str | float | None:
    """Return a width as a name or as a number of millimetres. Raise UsageError for an invalid width."""
    if argument is None:
        return None
    from baqueano.report.page import check_format

    try:
        width: str | float = float(argument)
    except ValueError:
        width = argument
    check_format("svg", width)
    return width


def _check_table(report: ReportFiles) -> None:
    """Raise UsageError, before the command computes, if --table has an unknown file extension."""
    if report.table is not None:
        from baqueano.report.tables import table_suffix

        table_suffix(report.table)


def _check_folder(report: ReportFiles, width: str | None) -> None:
    """Raise UsageError if a format or a width is given without a folder for the figures."""
    if report.figures is not None:
        return
    source = click.get_current_context().get_parameter_source("file_format")
    if width is not None:
        raise UsageError.of("cli.figures-absent", option="--width", value=width)
    if source is ParameterSource.COMMANDLINE:
        raise UsageError.of("cli.figures-absent", option="--format", value=report.file_format)
