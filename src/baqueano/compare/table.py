"""Format the table of a comparison in 80 columns: sections of rows, with a column for each run.
Columns that do not fit are printed in a block below.
"""

from collections.abc import Callable, Iterator, Sequence
from textwrap import wrap
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baqueano.compare.consistency import NOT_REPORTED
from baqueano.compare.filter_consistency import JOINT_FIGURES, STATE_NAMES
from baqueano.contracts.values import JsonObject
from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.messages.text_table import LINE_LETTERS

if TYPE_CHECKING:
    from baqueano.compare.comparison import Comparison, RunComparison
    from baqueano.compare.consistency import Band

COLUMN_LETTERS, MIN_COLUMN_LETTERS = 18, 8  # characters of the column of a run
DEGREES_PER_RAD = 180.0 / np.pi
ALIGNMENT_TITLES = {
    "none": N_("estimate − truth, rms"),
    "start": N_("estimate − truth, rms, aligned at the start"),
    "rigid": N_("estimate − truth, rms, aligned rigidly"),
}


class TableLine(NamedTuple):
    """A row of the table: the same quantity of each run."""

    label: str
    unit: str
    get_value: "Callable[[RunComparison], Any]"
    is_error: bool = False  # True if a smaller value is better
    is_main: bool = False  # True if the short table contains it


def table(comparison: "Comparison", is_short: bool = False) -> str:
    """Return the table as text, in blocks of columns. A block contains the rows that at least one of its runs has.
    A short table contains only the main rows.
    """
    sections = table_sections(comparison, is_short)
    rows = [row for section in sections for row in section["rows"]]
    width = max((len(row["label"]) + len(row["unit"]) for row in rows), default=0) + 4  # of "  label  unit"
    heads = [wrap(run.name, COLUMN_LETTERS) or [""] for run in comparison.runs]
    column_widths = [
        max(MIN_COLUMN_LETTERS, *map(len, head), *(len(row["cells"][k]) for row in rows))
        for k, head in enumerate(heads)
    ]

    def line(label: str, unit: str, cells: Sequence[str], columns_shown: Sequence[int]) -> str:
        pairs = zip(columns_shown, cells, strict=True)
        columns = "".join(f"  {cell:>{column_widths[k]}}" for k, cell in pairs)
        return f"{label}{unit:>{width - len(label)}}{columns}".rstrip()

    blocks = []
    for columns_shown in _column_ranges(column_widths, LINE_LETTERS - width):
        high = max(len(heads[k]) for k in columns_shown)
        top = [[""] * (high - len(heads[k])) + heads[k] for k in columns_shown]
        lines = [line("", "", [head[row] for head in top], columns_shown) for row in range(high)]
        for section in sections:
            title, indent = section["title"], "  " * bool(section["title"])
            cells = [[row["cells"][k] for k in columns_shown] for row in section["rows"]]
            group_lines = [
                line(indent + row["label"], row["unit"], row_cells, columns_shown)
                for row, row_cells in zip(section["rows"], cells, strict=True)
                if any(cell != "-" for cell in row_cells)
            ]
            lines += [title] * bool(title and group_lines) + group_lines
        blocks.append("\n".join(lines))
    return "\n\n".join(blocks)


def table_sections(comparison: "Comparison", is_short: bool = False) -> list[JsonObject]:
    """Return the rows that at least one run has, for a page: [{title, rows: [{label, unit, cells, best}]}].
    `best` is the column of the smallest error; None if the row is not an error or the smallest error is not unique.
    """
    sections: list[JsonObject] = []
    for title, lines in _sections(comparison):
        rows: list[JsonObject] = []
        for line in lines if not is_short else [line for line in lines if line.is_main]:
            values = [line.get_value(run) for run in comparison.runs]
            cells, best = [_cell(value) for value in values], _best_column(line, values)
            if any(cell != "-" for cell in cells):
                rows.append({"label": line.label, "unit": line.unit, "cells": cells, "best": best})
        if rows:
            sections.append({"title": title, "rows": rows})
    return sections


def _best_column(line: TableLine, values: Sequence[Any]) -> int | None:
    """Return the column of the smallest error; None if `line` is not an error or several errors are the smallest."""
    run_values = [value if isinstance(value, float) and np.isfinite(value) else None for value in values]
    sorted_values = sorted((value, k) for k, value in enumerate(run_values) if value is not None)
    if not line.is_error or len(sorted_values) < 2 or sorted_values[0][0] == sorted_values[1][0]:
        return None
    return sorted_values[0][1]


def _column_ranges(column_widths: Sequence[int], width: int) -> Iterator[range]:
    """Yield ranges of columns that fit side by side in the width `width`."""
    first = 0
    while first < len(column_widths):
        last = first + 1
        while last < len(column_widths) and sum(w + 2 for w in column_widths[first : last + 1]) <= width:
            last += 1
        yield range(first, last)
        first = last


def _sections(comparison: "Comparison") -> Iterator[tuple[str, Sequence[TableLine]]]:
    over = _("over {interval_s:g} s", interval_s=comparison.interval_s)
    duration = TableLine(_("duration"), "s", lambda j: j.duration_s, is_main=True)
    yield (
        "",
        [duration, TableLine(_("the estimate diverged at"), "s", lambda j: j.divergence_s, is_main=True)],
    )
    drift, turn = _("drift {over} (RPE)", over=over), _("drift of the heading {over}", over=over)
    lines = [
        TableLine(_("position (ATE)"), "m", lambda j: j.ate_m, is_error=True, is_main=True),
        TableLine(_("position, at the end"), "m", lambda j: j.end_error_m, is_error=True, is_main=True),
        TableLine(
            _("heading"), "°", lambda j: j.ate_heading_rad * DEGREES_PER_RAD, is_error=True, is_main=True
        ),
        TableLine(drift, "m", lambda j: j.rpe_m, is_error=True),
        TableLine(turn, "°", lambda j: j.rpe_heading_rad * DEGREES_PER_RAD, is_error=True),
        TableLine(_("speed"), "m/s", lambda j: j.speed_error_m_s, is_error=True),
        TableLine(_("yaw rate"), "rad/s", lambda j: j.yaw_rate_error_rad_s, is_error=True),
    ]
    if comparison.has_drives:
        yield from _vehicle_sections()
    yield _(ALIGNMENT_TITLES[comparison.alignment]), lines
    yield from _filter_sections(comparison)


def _vehicle_sections() -> Iterator[tuple[str, Sequence[TableLine]]]:
    """Yield the sections on path, speed and command of the vehicle. A replay does not have these sections."""
    kinds = {"true": _("true cross-track error of the vehicle"), "estimate": _("the same, as estimated")}
    for kind, title in kinds.items():
        yield title, [*_distances(f"across_{kind}"), *_paces(f"pace_{kind}")]
    yield _("cross-track distance to the path of the first run"), _distances("across_first")
    changes = TableLine(_("changes of sign, forward"), "1/s", lambda j: j.sign_changes_per_s)
    yield (
        _("command"),
        [
            changes,
            TableLine(_("ticks at a limit"), "%", lambda j: 100.0 * j.saturated_fraction, is_main=True),
        ],
    )


def _distances(name: str) -> list[TableLine]:
    return [
        TableLine(_("distance, rms"), "m", lambda j: getattr(j, name).rms_m, is_error=True, is_main=True),
        TableLine(_("distance, 95 %"), "m", lambda j: getattr(j, name).p95_m, is_error=True),
        TableLine(_("distance, largest"), "m", lambda j: getattr(j, name).max_m, is_error=True, is_main=True),
    ]


def _paces(name: str) -> list[TableLine]:
    return [
        TableLine(
            _("speed error, rms"), "m/s", lambda j: getattr(j, name).error_m_s, is_error=True, is_main=True
        ),
        TableLine(_("speed error, relative"), "%", lambda j: 100.0 * getattr(j, name).error, is_error=True),
        TableLine(
            _("speed about its 1 s mean"), "%", lambda j: 100.0 * getattr(j, name).unevenness, is_error=True
        ),
    ]


def _filter_sections(comparison: "Comparison") -> Iterator[tuple[str, Sequence[TableLine]]]:
    channels = dict.fromkeys(name for run in comparison.runs for name in run.consistency.channels)
    joint_labels = {k: _(k.removeprefix("nees_")) for k in JOINT_FIGURES if k != "nis"}
    states = {k: _(title) for k, title in STATE_NAMES.items()}
    lines = [
        TableLine(title, "", lambda j, k=k: _band(getattr(j.consistency, k)), is_main=True)
        for k, title in joint_labels.items()
    ]
    lines += [
        TableLine(title, "", lambda j, k=k: _band(j.consistency.states[k])) for k, title in states.items()
    ]
    yield _("NEES, 1 if consistent"), lines
    lines = [TableLine(_("all innovations"), "", lambda j: _band(j.consistency.nis), is_main=True)]
    for k in channels:
        lines.append(TableLine(k, "", lambda j, k=k: _band(j.consistency.channels.get(k, NOT_REPORTED))))
    lines.append(TableLine(_("correlation at lag 1"), "", lambda j: j.consistency.correlation))
    yield _("NIS, 1 if consistent"), lines
    names = dict.fromkeys(refusal.name for run in comparison.runs for refusal in run.refusals)
    lines = [TableLine(k, "", lambda j, k=k: _refusal_text(j, k)) for k in names]
    yield _("readings rejected by the estimator"), lines
    verdicts = [run.verdict for run in comparison.runs if run.verdict != "not reported"]
    yield _("covariance"), [TableLine(_("verdict"), "", lambda j: _(j.verdict))] if verdicts else []


def _refusal_text(run: "RunComparison", name: str) -> str:
    """Return the rejected readings of a channel, such as "540 of 1501"; "-" without a record or without readings."""
    for channel in run.refusals:
        if channel.name == name and channel.reading_count:
            return _("{refused} of {arrived}", refused=channel.rejected_count, arrived=channel.reading_count)
    return "-"


def _band(band: "Band") -> str:
    low, high = _nees_text(band.low), _nees_text(band.high)
    mean = f"{number(band.mean):.2g}" if band.mean < 0.1 else _nees_text(band.mean)
    return _("{mean} [{low}, {high}]", mean=mean, low=low, high=high) if np.isfinite(band.mean) else "-"


def _nees_text(x: float) -> str:
    """Return a NEES as text with about three digits."""
    return f"{number(x):{'.2f' if abs(x) < 10.0 else '.1f' if abs(x) < 100.0 else '.3g'}}"


def _cell(value: Any) -> str:
    return value if isinstance(value, str) else f"{number(value):.3g}" if np.isfinite(value) else "-"
