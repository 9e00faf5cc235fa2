"""Result of a sweep: values of each drive, medians of each combination of blocks, differences from a reference."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.contracts.result import PrintedTable, Result, shorten, wrap_sentences
from baqueano.contracts.values import TableRow
from baqueano.diagnostics import Diagnostic, Severity, Verdict, note
from baqueano.messages import text, texts, verdict_line
from baqueano.messages.language import translate as _
from baqueano.messages.text_table import LINE_LETTERS, text_table
from baqueano.sweep.columns import median_columns, number_cell, short_labels, table_lines
from baqueano.sweep.error_segments import ErrorSegments
from baqueano.sweep.figures import ALL_FIGURES, RMS_FIGURES
from baqueano.sweep.gains import CODE
from baqueano.sweep.paired import UNKNOWN, PairedDifference, paired_difference

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
SURVIVAL_FIGURES = ("laps",)  # what a drive achieved before it stopped
MAIN_FIGURES = ("across_rms_m", "ate_m")  # the table shows the difference of the first of these that is known


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
    vehicle, route : str
        The names of the vehicle, or of the recorded run, and of the route.
    gains : str
        The vehicle file whose gains a controller "file.py:Class" has, or "code" for the defaults of its class.

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
    vehicle: str = ""
    route: str = ""
    gains: str = ""


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

    def rows(self) -> list[TableRow]:
        """Return a flat row for each combination and drive."""
        return [
            {
                "combination": drive.combination.label, "estimator": drive.combination.estimator,
                "controller": drive.combination.controller,
                "guide": drive.combination.guide, "gains": drive.gains, "drive": drive.name,
                "vehicle": drive.vehicle, "route": drive.route,
                **{name: drive.figures.get(name, float("nan")) for name in ALL_FIGURES}, "stopped": drive.stop_code,
            }
            for drive in self.drives
        ]  # fmt: skip

    def combinations(self) -> list[TableRow]:
        """Return a row per combination: the median of each result over its drives, and the ratios of the rms values.

        A stopped drive is only in the medians of SURVIVAL_FIGURES: it is shorter, so its other results are not
        comparable.
        """
        rows = []
        for label, drives in self._by_combination().items():
            row: TableRow = {
                "combination": label,
                "drives": len(drives),
                "stopped": sum(bool(d.stop_code) for d in drives),
            }
            for name in ALL_FIGURES:
                row[name] = _median(drives, name)
            for name in RMS_FIGURES:
                difference = self.difference(label, name)
                row |= {
                    f"{name}_ratio": difference.ratio,
                    f"{name}_low": difference.low,
                    f"{name}_high": difference.high,
                }
            rows.append(row)
        return rows

    def vehicles(self) -> list[str]:
        """Return the names of the vehicles, or of the recorded runs, in the order of the drives.

        Returns
        -------
        list of str
            Each name once.

        Examples
        --------
        >>> drive = SweepDrive(SweepCombination("pd", "ekf", "pd", "repeat"), "seed 1", {"ate_m": 0.1}, {}, "")
        >>> SweepResult((drive._replace(vehicle="small"),), 1, "pd").vehicles()
        ['small']
        """
        return list(dict.fromkeys(drive.vehicle for drive in self.drives))

    def ranking(self) -> list[str]:
        """Return the labels of the combinations, the best first.

        Returns
        -------
        list of str
            Labels in the order of the number of stopped drives, then of the main result; the smallest is first.

        Examples
        --------
        >>> drive = SweepDrive(SweepCombination("pd", "ekf", "pd", "repeat"), "seed 1", {"ate_m": 0.1}, {}, "")
        >>> SweepResult((drive,), 1, "pd").ranking()
        ['pd']
        """
        main = self.main_figure()
        rows = sorted(
            self.combinations(), key=lambda row: (row["stopped"], np.nan_to_num(row[main], nan=np.inf))
        )
        return [row["combination"] for row in rows]

    def by_vehicle(self) -> list[TableRow]:
        """Return the main result of each combination on each vehicle.

        Returns
        -------
        list of dict
            A row per combination: its label, and for each vehicle the median of `main_figure` over its drives [unit of
            the name]; NaN without a complete drive.

        Examples
        --------
        >>> drive = SweepDrive(SweepCombination("pd", "ekf", "pd", "repeat"), "seed 1", {"ate_m": 0.1}, {}, "")
        >>> SweepResult((drive._replace(vehicle="small"),), 1, "pd").by_vehicle()
        [{'combination': 'pd', 'small': 0.1}]
        """
        main, by_combination = self.main_figure(), self._by_combination()
        return [
            {"combination": label}
            | {name: _median([d for d in drives if d.vehicle == name], main) for name in self.vehicles()}
            for label, drives in by_combination.items()
        ]

    def difference(self, label: str, figure: str) -> PairedDifference:
        """Return the ratio of a result of a combination to that of the reference, over the drives that both completed.

        Parameters
        ----------
        label : str
            The label of the combination.
        figure : str
            The name of an rms value, such as "across_rms_m".

        Returns
        -------
        PairedDifference
            The ratio and the ends of its 95 % interval [no unit]; NaN if they are not known.

        Examples
        --------
        >>> drive = SweepDrive(SweepCombination("pd", "ekf", "pd", "repeat"), "seed 1", {"ate_m": 0.1}, {}, "")
        >>> SweepResult((drive,), 1, "pd").difference("pd", "ate_m").ratio
        nan
        """
        by_label = self._by_combination()
        drives, references = ({d.name: d for d in by_label.get(name, ())} for name in (label, self.reference))
        drive_pairs = [(drives[name], references[name]) for name in drives if name in references]
        pairs = [
            (a.pieces[figure], b.pieces[figure])
            for a, b in drive_pairs
            if figure in a.pieces and figure in b.pieces and not (a.stop_code or b.stop_code)
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

    @property
    def notes(self) -> tuple[Diagnostic, ...]:
        """Return the sources of the gains.

        Returns
        -------
        tuple of Diagnostic
            How many controllers have the gains of a vehicle file of their own, and which have those of their code.
            Empty if all have the gains of the vehicle that drives.

        Examples
        --------
        >>> drive = SweepDrive(SweepCombination("pd", "ekf", "pd", "repeat"), "seed 1", {"ate_m": 0.1}, {}, "")
        >>> SweepResult((drive,), 1, "pd").notes
        ()
        """
        firsts = {label: drives[0] for label, drives in self._by_combination().items()}
        sources = {
            label: drive.gains
            for label, drive in firsts.items()
            if drive.gains != drive.combination.controller
        }
        files = {label: source for label, source in sources.items() if source not in ("", CODE)}
        if not files:
            return ()
        first, names = next(iter(files)), short_labels(list(firsts))
        count, total = len(files), sum(bool(source) for source in sources.values())
        notes = [note("sweep.gains", count=count, total=total, label=names[first], file=files[first])]
        if labels := [names[label] for label, source in sources.items() if source == CODE]:
            notes.append(note("sweep.gains-of-code", names=labels))
        return tuple(notes)

    def table(self) -> str:
        """Return the medians of each combination, and the ratio to the reference, as a text table."""
        head, *lines = self._lines(BLOCKS)
        meanings = self.meanings()
        if any("[-]" in line for line in lines):
            meanings.append(("[-]", _("too few drives for an interval")))
        lines = [*wrap_sentences([head], LINE_LETTERS), *lines, "", *text_table("<<", *meanings)]
        if self.notes:
            lines += ["", *wrap_sentences(texts(self.notes), LINE_LETTERS)]
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
        names = short_labels([row["combination"] for row in rows])
        labels = list(names.values())
        printed_lines: list[str] = []
        for columns in self._columns(blocks):
            for lines in table_lines(labels, columns):
                printed_lines += ["", *lines] if printed_lines else lines
        if len(blocks) > 1 and len(self.vehicles()) > 1:
            figure = ALL_FIGURES[main]
            title = _("{figure} [{unit}] of each vehicle", figure=_(figure.heading), unit=figure.unit)
            values = [{k: x for k, x in row.items() if k != "combination"} for row in self.by_vehicle()]
            columns = [
                [k, "", *(number_cell(row[k] * figure.scale) for row in values)] for k in self.vehicles()
            ]
            for lines in table_lines(labels, columns):
                printed_lines += ["", title, *lines]
        code = "sweep.head-ratio" if len(rows) > 1 else "sweep.head"
        drives = max((row["drives"] for row in rows), default=0)
        heading, reference = _(ALL_FIGURES[main].heading), names.get(self.reference, self.reference)
        return [text(note(code, drives=drives, figure=heading, reference=reference)), *printed_lines]

    def _columns(self, blocks: Sequence[Sequence[str]]) -> list[list[list[str]]]:
        """Return the columns of the known results of each block."""
        shown_names = [[name for name in block if self._has(name)] for block in blocks]
        return median_columns(self.combinations(), shown_names, self.main_figure(), self.reference)

    def printed_table(self) -> PrintedTable:
        """Return the medians as data: a row for each result, and a column for each combination."""
        rows = [
            {"label": heading, "unit": unit, "cells": cells}
            for columns in self._columns(BLOCKS)
            for heading, unit, *cells in columns
        ]
        labels = short_labels([row["combination"] for row in self.combinations()])
        return PrintedTable(tuple(labels.values()), [{"title": "", "rows": rows}])


def _median(drives: Sequence[SweepDrive], name: str) -> float:
    """Return the median of a result over the drives that were not stopped, or NaN."""
    complete_drives = [drive for drive in drives if name in SURVIVAL_FIGURES or not drive.stop_code]
    x = np.array([drive.figures.get(name, np.nan) for drive in complete_drives])
    finite = x[np.isfinite(x)]
    return float(np.median(finite)) if finite.size else float("nan")
