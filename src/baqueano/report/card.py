"""Show the card of a result in a notebook: its name and verdict, its main rows, and the whole table to expand."""

import html
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import singledispatch

from baqueano.calibration.result import Calibration
from baqueano.compare import Comparison
from baqueano.compare.corridor_forecast import CorridorForecast
from baqueano.contracts.result import Tabular
from baqueano.contracts.values import TableRow
from baqueano.diagnostics import note
from baqueano.drive import FirstDrive, TeachResult
from baqueano.drive.closure import Closure
from baqueano.guides.route import Route
from baqueano.identify import Fit
from baqueano.identify.result.fit_result import verdict_lines
from baqueano.messages import list_item, text, texts
from baqueano.messages.language import mark as N_, percent_text, shown_unit, translate as _
from baqueano.report.fit_report import parameter_row
from baqueano.report.page import TONES, cell
from baqueano.routes.examine import RouteReport
from baqueano.runs import Run
from baqueano.runs.importing.recordings import ImportedRun
from baqueano.tune import TuneResult
from baqueano.validation.forecast import Forecast
from baqueano.validation.held_out import Validation
from baqueano.validation.parameter_drift import ParameterHistory
from baqueano.vehicle_file.block_check import BlockCheck
from baqueano.vehicle_file.file import VehicleFile

MAX_ROWS, MAX_SENTENCES, MAX_COLUMNS = 12, 5, 8  # rows, sentences and columns; the rest is unfolded
DETAILS_LABEL = note("front.whole")
COLOURS = {"good": "#1f7a3a", "warn": "#a86400", "bad": "#b3261e", "plain": "#33567f"}
STYLE = """
.baqueano { font: 13.5px/1.5 system-ui, "Segoe UI", Roboto, Arial, sans-serif; max-width: 54rem; }
.baqueano .name { font-size: 15px; font-weight: 650; }
.baqueano .verdict { color: #fff; border-radius: 1em; padding: .1em .7em; margin-left: .6em; font-size: 11.5px;
  font-weight: 600; letter-spacing: .03em; }
.baqueano table { border-collapse: collapse; margin: .5em 0; font-variant-numeric: tabular-nums; }
.baqueano th, .baqueano td { text-align: left; padding: .16em 1.4em .16em 0; border: 0;
  border-bottom: 1px solid rgba(127, 127, 127, .25); background: none; }
.baqueano th { font-weight: 600; opacity: .7; }
.baqueano .number { text-align: right; }
.baqueano p { margin: .25em 0; }
.baqueano summary { cursor: pointer; opacity: .75; }
.baqueano pre { font-size: 12px; line-height: 1.35; overflow-x: auto; background: none; margin: .3em 0; }
"""


@dataclass(frozen=True)
class Card:
    """The contents of a card."""

    title: str
    verdict: str = ""
    rows: Sequence[TableRow] = ()
    lines: Sequence[str] = field(default=())


def card_html(result: Tabular) -> str:
    """Return the card of a result as HTML without a script."""
    card, details = make_card(result), html.escape(result.table())
    colour = COLOURS[TONES.get(card.verdict, "plain")]
    badge = f'<span class="verdict" style="background: {colour}">{html.escape(_(card.verdict))}</span>'
    paragraphs = "".join(f"<p>{html.escape(list_item(line.removeprefix('- ')))}</p>" for line in card.lines)
    open_tag = "" if card.rows or card.lines else " open"
    details_html = (
        f"<details{open_tag}><summary>{text(DETAILS_LABEL)}</summary><pre>{details}</pre></details>"
    )
    head = f'<span class="name">{html.escape(card.title)}</span>{badge if card.verdict else ""}'
    return f'<div class="baqueano"><style>{STYLE}</style>{head}{_table(card.rows)}{paragraphs}{details_html}</div>'


def _table(rows: Sequence[TableRow]) -> str:
    if not rows:
        return ""
    rows_shown = [{key: cell(value, key) for key, value in row.items()} for row in rows[:MAX_ROWS]]
    number_keys = {key for key in rows[0] if any(isinstance(row[key], int | float) for row in rows)}

    def line(tag: str, values: dict[str, str]) -> str:
        attributes = {key: ' class="number"' if key in number_keys else "" for key in values}
        cells = "".join(
            f"<{tag}{attributes[key]}>{html.escape(value)}</{tag}>" for key, value in values.items()
        )
        return f"<tr>{cells}</tr>"

    hidden_count = len(rows) - MAX_ROWS
    more_html = (
        f"<p>{html.escape(text(note('front.rows-more', rows=hidden_count)))}</p>" if hidden_count > 0 else ""
    )
    heads = {key: _(key.replace("_", " ")) for key in rows[0]}
    return f"<table>{line('th', heads)}{''.join(line('td', row) for row in rows_shown)}</table>{more_html}"


@singledispatch
def make_card(result: Tabular) -> Card:
    """Return the card of a result: its name, its verdict and its main rows. By default the name is the result's type.
    The default rows are `rows()`, if they do not have too many columns.
    """
    rows = result.rows()
    table_rows = rows if rows and len(rows[0]) <= MAX_COLUMNS else []
    return Card(type(result).__name__, str(getattr(result, "verdict", "")), table_rows)


@make_card.register(Fit)
def _fit_card(result: Fit) -> Card:
    title = text(note("front.card-fit", vehicle=result.file.name, runs=result.runs))
    return Card(
        title,
        result.verdict,
        [parameter_row(row) for row in result.rows()],
        verdict_lines(result)[:MAX_SENTENCES],
    )


@make_card.register(Run)
def _run_card(result: Run) -> Card:
    kind = result.metadata.get("kind", "run")
    title = text(note("front.card-run", run=result.name, kind=_(kind), duration_s=result.duration_s))
    names = {"topic": "topic", "count": "count", "rate_hz": "rate [Hz]", "gaps": "gaps"}
    rows = [{heading: row[name] for name, heading in names.items()} for row in result.rows()]
    events = [event.sentence for event in result.events if event.level != "info"]
    return Card(title, "", rows, events[:MAX_SENTENCES])


@make_card.register(Comparison)
def _comparison_card(result: Comparison) -> Card:
    rows = [
        {
            "run": run.name, "time [s]": run.duration_s, N_("across its path [cm rms]"): 100.0 * run.across_true.rms_m,
            N_("error of the position [cm rms]"): 100.0 * run.ate_m,
            N_("NEES of the velocity"): run.consistency.nees_velocity.mean,
            "NIS": run.consistency.nis.mean, "covariance": run.verdict,
        }
        for run in result.runs
    ]  # fmt: skip
    return Card(
        text(note("front.card-comparison", runs=len(rows))),
        result.verdict,
        rows,
        result.sentences[:MAX_SENTENCES],
    )


@make_card.register(TuneResult)
def _tune_card(result: TuneResult) -> Card:
    rows = [
        {"gain": gain.name, "value": gain.value, "unit": shown_unit(gain.unit), "in the file": gain.file_value,
         "cost at × 0.8 [%]": 100.0 * (gain.cost_at_lower_gain - 1.0),
         "at × 1.25 [%]": 100.0 * (gain.cost_at_higher_gain - 1.0)}
        for gain in result.gains
    ]  # fmt: skip
    title = text(note("front.card-tuned", vehicle=result.vehicle_file.name))
    return Card(title, result.verdict, rows, texts(result.reasons))


@make_card.register(BlockCheck)
def _check_card(result: BlockCheck) -> Card:
    title = text(note("front.card-check", block=result.block, role=_(result.role)))
    return Card(
        title,
        result.verdict,
        (),
        texts(result.findings) or [text(note("cli.block-correct", block=result.block))],
    )


@make_card.register(Forecast)
def _forecast_card(result: Forecast) -> Card:
    return Card(text(note("front.card-forecast")), "", (), result.sentences)


@make_card.register(CorridorForecast)
def _corridor_card(result: CorridorForecast) -> Card:
    return Card(text(note("front.card-forecast")), result.verdict, (), result.table().splitlines())


@make_card.register(Route)
def _route_card(result: Route) -> Card:
    return Card(text(note("front.card-route")), "", (), (repr(result),))


@make_card.register(RouteReport)
def _examined_route_card(result: RouteReport) -> Card:
    return Card(text(note("front.card-route")), result.verdict, (), result.table().splitlines())


@make_card.register(TeachResult)
def _teach_card(result: TeachResult) -> Card:
    run = make_card(result.run)
    return Card(text(note("front.card-route")), "", run.rows, (repr(result.route), *run.lines))


@make_card.register(VehicleFile)
def _vehicle_card(result: VehicleFile) -> Card:
    return Card(text(note("front.card-vehicle", vehicle=result.name)), "", result.rows(), (repr(result),))


@make_card.register(ImportedRun)
def _import_card(result: ImportedRun) -> Card:
    run = make_card(result.run)
    return Card(
        run.title,
        result.verdict,
        run.rows,
        [finding.advice for finding in result.without_common_findings.findings][:MAX_SENTENCES],
    )


@make_card.register(FirstDrive)
def _first_drive_card(result: FirstDrive) -> Card:
    return Card(
        text(note("front.card-first-drive", run=result.run.name)), "", (), result.table().splitlines()
    )


@make_card.register(Closure)
def _closure_card(result: Closure) -> Card:
    rows = [row for row in result.rows() if row["std"] == row["std"]]
    return Card(
        text(note("front.card-closure")), "", rows, [line.strip() for line in result.table().splitlines()]
    )


@make_card.register(Calibration)
def _calibration_card(result: Calibration) -> Card:
    rows = [
        {"name": value.name, "value": value.value, "± 95 %": value.half_width, "unit": value.unit}
        for value in result.numbers
    ]
    return Card(
        text(note("front.card-calibration", run=result.run)), result.verdict, rows, texts(result.reasons)
    )


@make_card.register(Validation)
def _validation_card(result: Validation) -> Card:
    rows = [
        {"run": figure.run, "channel": figure.channel, "error": figure.error, "unit": shown_unit(figure.unit),
         "explained": percent_text(figure.explained_fraction)}
        for figure in result.figures
    ]  # fmt: skip
    return Card(text(note("front.card-validation")), result.verdict, rows, [result.sentence])


@make_card.register(ParameterHistory)
def _history_card(result: ParameterHistory) -> Card:
    title = text(note("front.card-history", vehicle=result.last.file.name, runs=len(result.runs)))
    rows = [
        {"parameter": change.name.removeprefix("model."), "before": change.first_value, N_("after"): change.last_value,
         "unit": shown_unit(change.unit)}
        for change in result.changes
    ]  # fmt: skip
    sentences = texts([change.message for change in result.changes]) or [
        _("No parameter changed beyond its error bars.")
    ]
    return Card(title, result.verdict, rows, sentences[:MAX_SENTENCES])
