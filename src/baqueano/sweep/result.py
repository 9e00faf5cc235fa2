"""Result of a sweep: values of each drive, medians of each combination of blocks, differences from a reference."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.result import Result, shorten, wrap_sentences
from baqueano.diagnostics import Diagnostic, Severity, Verdict, note
from baqueano.messages import text, verdict_line
from baqueano.messages.language import number
from baqueano.messages.language import translate as _
from baqueano.messages.text_table import LINE_LETTERS, text_table
from baqueano.sweep.error_segments import ErrorSegments
from baqueano.sweep.figures import RMS_FIGURES, SINGLE_FIGURES
from baqueano.sweep.paired import UNKNOWN, PairedDifference, paired_difference

if TYPE_CHECKING:
    from baqueano.contracts.values import TableRow

ALL_FIGURES = {**RMS_FIGURES, **SINGLE_FIGURES}
BLOCKS = (  # names of results, in the order of the tables
    ("across_rms_m", "across_max_m", "speed_error_m_s", "effort", "roughness_1_s", "joining_m", "laps"),
    ("ate_m", "ate_heading_rad", "rpe_m", "rpe_heading_rad"),
    ("nees_pose", "nees_velocity", "nis"),
)
SHORT_FIGURES = (
    "across_rms_m",
    "across_max_m",
    "speed_error_m_s",
    "effort",
    "ate_m",
    "rpe_m",
    "rpe_heading_rad",
    "nis",
)
MAIN_FIGURES = ("across_rms_m", "ate_m")  # the table shows the difference of the first of these that is known
FILE_CLASS = re.compile(r"(?P<file>[^ ]*[/\\.][^ :]*):(?P<name>\w+)")
MAX_LABEL_LETTERS = 32  # characters of a label


class SweepCombination(NamedTuple):
    """A combination of blocks.

    Attributes
    ----------
    label : str
        The names of the blocks that vary.
    estimator, controller, guide : str
        The names of the blocks.

    Examples
    --------
    >>> SweepCombination("pd", "ekf", "pd", "repeat").label
    'pd'
    """

    label: str
    estimator: str
    controller: str
    guide: str


class SweepDrive(NamedTuple):
    """The results of a drive of a combination.

    Attributes
    ----------
    combination : SweepCombination
        The blocks.
    name : str
        Vehicle, route and seed; the same in each combination.
    figures : dict of float
        Results by their names, which contain their units [unit of each]; NaN if not known.
    pieces : dict of ErrorSegments
        Segments of each rms value, by which drives are compared.
    stop_code : str
        Code of the reason why the drive was stopped, or "".
    stop_reason : Diagnostic, optional
        The reason, which names the line of a faulty block; None without a stop.

    Examples
    --------
    >>> SweepDrive(SweepCombination("pd", "ekf", "pd", "repeat"), "seed 1", {"nis": 1.0}, {}, "").figures["nis"]
    1.0
    """

    combination: SweepCombination
    name: str
    figures: dict[str, float]
    pieces: dict[str, ErrorSegments]
    stop_code: str
    stop_reason: Diagnostic | None = None


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SweepResult(Result):
    """The drives of several combinations under the same conditions.

    Attributes
    ----------
    drives : tuple of SweepDrive
        The drives, combination by combination.
    requested_drives : int
        Number of drives of the call. After Ctrl-C, `drives` contains fewer drives.
    reference : str
        Label of the combination with which the others are compared.

    Examples
    --------
    >>> from baqueano.guides.shapes import circle
    >>> result = bq.sweep(bq.load("small"), routes=circle(0.3, 0.2), controllers=["kanayama", "lqr"], processes=1)
    >>> print(result.difference("lqr", "across_rms_m").ratio < 1.1)
    True
    """

    drives: tuple[SweepDrive, ...]
    requested_drives: int
    reference: str

    def __repr__(self) -> str:
        lines = self._lines([[name for name in SHORT_FIGURES if self._has(name)][:4]])
        return shorten(lines[:3], lines[3:], [verdict_line(self.verdict, self.reasons)])

    def rows(self) -> list["TableRow"]:
        """Return a flat row for each combination and drive."""
        return [
            {
                "combination": drive.combination.label, "estimator": drive.combination.estimator,
                "controller": drive.combination.controller,
                "guide": drive.combination.guide, "drive": drive.name,
                **{name: drive.figures.get(name, float("nan")) for name in ALL_FIGURES}, "stopped": drive.stop_code,
            }
            for drive in self.drives
        ]  # fmt: skip

    def combinations(self) -> list["TableRow"]:
        """Return a row per combination: the median of each result over its drives, and the ratios of the rms values."""
        rows = []
        for label, drives in self._by_combination().items():
            row: TableRow = {
                "combination": label,
                "drives": len(drives),
                "stopped": sum(bool(d.stop_code) for d in drives),
            }
            for name in ALL_FIGURES:
                x = np.array([d.figures.get(name, np.nan) for d in drives])
                finite = x[np.isfinite(x)]
                row[name] = float(np.median(finite)) if finite.size else float("nan")
            for name in RMS_FIGURES:
                difference = self.difference(label, name)
                row |= {
                    f"{name}_ratio": difference.ratio,
                    f"{name}_low": difference.low,
                    f"{name}_high": difference.high,
                }
            rows.append(row)
        return rows

    def difference(self, label: str, figure: str) -> PairedDifference:
        """Return the ratio of a result of the combination `label` to the reference, over the drives that both have."""
        by_label = self._by_combination()
        drives, references = ({d.name: d for d in by_label.get(name, ())} for name in (label, self.reference))
        drive_pairs = [(drives[name], references[name]) for name in drives if name in references]
        pairs = [
            (a.pieces[figure], b.pieces[figure])
            for a, b in drive_pairs
            if figure in a.pieces and figure in b.pieces
        ]
        return paired_difference([a for a, _b in pairs], [b for _a, b in pairs]) if pairs else UNKNOWN

    @property
    def verdict(self) -> Verdict:
        """Return WARN if there are reasons, else DONE."""
        return Verdict.WARN if self.reasons else Verdict.DONE

    @property
    def reasons(self) -> tuple[Diagnostic, ...]:
        """Return a warning for each combination with stopped drives, and a warning if drives are missing."""
        reasons = []
        for label, drives in self._by_combination().items():
            if stopped_drives := [drive for drive in drives if drive.stop_code]:
                cause = stopped_drives[0].stop_reason or stopped_drives[0].stop_code
                figures = {"count": len(stopped_drives), "drives": len(drives), "cause": cause}
                reasons.append(note("sweep.stopped", Severity.WARNING, subject=label, **figures))
        if len(self.drives) < self.requested_drives:
            count, total = len(self.drives), self.requested_drives
            reasons.append(note("sweep.part", Severity.WARNING, count=count, total=total))
        return tuple(reasons)

    def table(self) -> str:
        """Return the medians of each combination, and the ratio to the reference, as a text table."""
        head, *lines = self._lines(BLOCKS)
        meanings = self.meanings()
        if any("[-]" in line for line in lines):
            meanings.append(("[-]", _("too few drives for an interval")))
        lines = [*wrap_sentences([head], LINE_LETTERS), *lines, "", *text_table("<<", *meanings)]
        return "\n".join([*lines, "", verdict_line(self.verdict, self.reasons)])

    def meanings(self) -> list[tuple[str, str]]:
        """Return the headings of the known results that have the same meaning, and this meaning."""
        headings: dict[str, dict[str, None]] = {}
        for figure in (ALL_FIGURES[name] for name in self.figure_names()):
            headings.setdefault(figure.meaning, {})[_(figure.heading)] = None
        return [(", ".join(words), _(meaning)) for meaning, words in headings.items()]

    def _by_combination(self) -> dict[str, list[SweepDrive]]:
        drives: dict[str, list[SweepDrive]] = {}
        for drive in self.drives:
            drives.setdefault(drive.combination.label, []).append(drive)
        return drives

    def main_figure(self) -> str:
        """Return the name of the result by which combinations are compared first."""
        available = [
            name
            for name in MAIN_FIGURES
            if any(np.isfinite(d.figures.get(name, np.nan)) for d in self.drives)
        ]
        return available[0] if available else MAIN_FIGURES[-1]

    def figure_names(self) -> list[str]:
        """Return the names of the results that at least one drive has; the results of the vehicle are first."""
        return [name for names in BLOCKS for name in names if self._has(name)]

    def _has(self, name: str) -> bool:
        return any(np.isfinite(d.figures.get(name, np.nan)) for d in self.drives)

    def _lines(self, blocks: Sequence[Sequence[str]]) -> list[str]:
        """Return a line on the drives, and the lines of one or more tables for each block of known results."""
        rows, main = self.combinations(), self.main_figure()
        short_labels = _short_labels([row["combination"] for row in rows])
        labels = list(short_labels.values())
        table_lines: list[str] = []
        for block in blocks:
            columns = [_column(name, rows) for name in block if self._has(name)]
            if columns and not table_lines and len(rows) > 1:
                columns.insert(1, [_("ratio"), "", *map(self._ratio, rows)])
            for lines in _tables(labels, columns):
                table_lines += ["", *lines] if table_lines else lines
        code = "sweep.head-ratio" if len(rows) > 1 else "sweep.head"
        drives = max((row["drives"] for row in rows), default=0)
        heading, reference = _(ALL_FIGURES[main].heading), short_labels.get(self.reference, self.reference)
        return [text(note(code, drives=drives, figure=heading, reference=reference)), *table_lines]

    def _ratio(self, row: "TableRow") -> str:
        main = self.main_figure()
        if row["combination"] == self.reference or not np.isfinite(row[f"{main}_ratio"]):
            return "1" if row["combination"] == self.reference else "-"
        if not np.isfinite(row[f"{main}_low"]):
            return f"{number(row[f'{main}_ratio']):.2f} [-]"
        return _(
            "{ratio:.2f} [{low:.2f}, {high:.2f}]",
            **{end: row[f"{main}_{end}"] for end in ("ratio", "low", "high")},
        )


def _short_labels(labels: Sequence[str]) -> dict[str, str]:
    """Return a short name of each label: with the class alone instead of file.py:Class, if this name is unique.

    Otherwise the file replaces the class, such as ana/my_controller.
    """
    for part in ("name", "file"):
        short_labels = {
            label: FILE_CLASS.sub(lambda match, part=part: match[part].removesuffix(".py"), label)
            for label in labels
        }
        if len(set(short_labels.values())) == len(short_labels):
            return short_labels
    return dict(zip(labels, labels, strict=True))


def _column(name: str, rows: Sequence["TableRow"]) -> list[str]:
    """Return the cells of a column: heading, unit, and the value of each row."""
    figure = ALL_FIGURES[name]
    values = (row[name] * figure.scale for row in rows)
    return [_(figure.heading), figure.unit, *(f"{number(x):.3g}" if np.isfinite(x) else "-" for x in values)]


def _tables(labels: Sequence[str], columns: Sequence[Sequence[str]]) -> list[list[str]]:
    """Return the lines of as many tables as the columns need, each at most LINE_LETTERS wide. A label of more than
    MAX_LABEL_LETTERS has its own line, above its values.
    """
    width = min(max(map(len, labels)), MAX_LABEL_LETTERS)
    column_widths = [max(map(len, column)) + 2 for column in columns]
    tables: list[list[list[str]]] = []
    left = 0
    for column, letters in zip(columns, column_widths, strict=True):
        if letters > left:
            tables.append([])
            left = LINE_LETTERS - width
        tables[-1].append([f"{cell:>{letters}}" for cell in column])
        left -= letters
    blocks_of_lines = []
    for table in tables:
        heads, units, *values = ("".join(cells) for cells in zip(*table, strict=True))
        lines = [f"{'':{width}}{words}" for words in (heads, units.rstrip()) if words]
        for label, words in zip(labels, values, strict=True):
            lines += [f"{label:{width}}{words}"] if len(label) <= width else [label, f"{'':{width}}{words}"]
        blocks_of_lines.append(lines)
    return blocks_of_lines
