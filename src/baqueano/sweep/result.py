"""Result of a sweep: the values of each drive, the medians of each cell, and the differences from a reference cell."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.result import Result, shorten
from baqueano.diagnostics import Diagnostic, Severity, Verdict, note
from baqueano.messages import text, verdict_line
from baqueano.messages.language import number
from baqueano.messages.language import translate as _
from baqueano.sweep.error_segments import ErrorSegments
from baqueano.sweep.figures import RMS_FIGURES, SINGLE_FIGURES
from baqueano.sweep.paired import UNKNOWN, PairedDifference, paired_difference

if TYPE_CHECKING:
    from baqueano.contracts.values import TableRow

ALL_FIGURES = {**RMS_FIGURES, **SINGLE_FIGURES}
BLOCKS = (  # names of results, in the order of the tables
    ("across_rms_m", "across_max_m", "speed_error_m_s", "effort", "roughness_1_s", "joined_m", "laps"),
    ("ate_m", "ate_heading_rad", "rpe_m", "rpe_heading_rad", "nees_pose", "nees_velocity", "nis"),
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
MAX_LABEL_LETTERS = 32  # characters of a label


class SweepCell(NamedTuple):
    """A combination of blocks.

    Attributes
    ----------
    label : str
        The names of the blocks that vary.
    estimator, controller, guide : str
        The names of the blocks.

    Examples
    --------
    >>> SweepCell("pd", "ekf", "pd", "repeat").label
    'pd'
    """

    label: str
    estimator: str
    controller: str
    guide: str


class SweepDrive(NamedTuple):
    """The results of a drive of a cell.

    Attributes
    ----------
    cell : SweepCell
        The blocks.
    name : str
        Vehicle, route and seed; the same in each cell.
    figures : dict of float
        Results by their names; NaN if not known.
    pieces : dict of ErrorSegments
        Segments of each rms value, by which drives are compared.
    stopped : str
        Code of the reason why the drive was stopped, or "".

    Examples
    --------
    >>> SweepDrive(SweepCell("pd", "ekf", "pd", "repeat"), "seed 1", {"nis": 1.0}, {}, "").figures["nis"]
    1.0
    """

    cell: SweepCell
    name: str
    figures: dict[str, float]
    pieces: dict[str, ErrorSegments]
    stopped: str


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SweepResult(Result):
    """The drives of several cells under the same conditions.

    Attributes
    ----------
    drives : tuple of SweepDrive
        The drives, cell by cell.
    requested : int
        Number of drives of the call. After Ctrl-C, `drives` contains fewer drives.
    reference : str
        Label of the cell with which the other cells are compared.

    Examples
    --------
    >>> from baqueano.guides.shapes import circle
    >>> result = bq.sweep(bq.load("small"), routes=circle(0.3, 0.2), controllers=["kanayama", "lqr"], processes=1)
    >>> print(f"{result.difference('lqr', 'across_rms_m').ratio < 1.0}")
    True
    """

    drives: tuple[SweepDrive, ...]
    requested: int
    reference: str

    def __repr__(self) -> str:
        lines = self._lines([[name for name in SHORT_FIGURES if self._has(name)][:4]])
        return shorten(lines[:3], lines[3:], [verdict_line(self.verdict, self.reasons)])

    def rows(self) -> list["TableRow"]:
        """Return a flat row for each cell and drive."""
        return [
            {
                "cell": drive.cell.label, "estimator": drive.cell.estimator, "controller": drive.cell.controller,
                "guide": drive.cell.guide, "drive": drive.name,
                **{name: drive.figures.get(name, float("nan")) for name in ALL_FIGURES}, "stopped": drive.stopped,
            }
            for drive in self.drives
        ]  # fmt: skip

    def cells(self) -> list["TableRow"]:
        """Return a flat row per cell: the median of each result over its drives, and the ratios of the rms values."""
        out = []
        for label, drives in self._by_cell().items():
            row: TableRow = {
                "cell": label,
                "drives": len(drives),
                "stopped": sum(bool(d.stopped) for d in drives),
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
            out.append(row)
        return out

    def difference(self, label: str, figure: str) -> PairedDifference:
        """Return the ratio of a result of the cell `label` to that of the reference, over the drives of both cells."""
        cells = self._by_cell()
        drives, references = ({d.name: d for d in cells.get(cell, ())} for cell in (label, self.reference))
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
        """Return a warning for each cell with stopped drives, and a warning if drives are missing."""
        out = [
            note(
                "sweep.stopped",
                Severity.WARNING,
                subject=row["cell"],
                stopped=row["stopped"],
                drives=row["drives"],
            )
            for row in self.cells()
            if row["stopped"]
        ]
        if len(self.drives) < self.requested:
            out.append(note("sweep.part", Severity.WARNING, done=len(self.drives), requested=self.requested))
        return tuple(out)

    def table(self) -> str:
        """Return the medians of each cell, and the ratio to the reference, as a text table."""
        return "\n".join([*self._lines(BLOCKS), "", verdict_line(self.verdict, self.reasons)])

    def _by_cell(self) -> dict[str, list[SweepDrive]]:
        out: dict[str, list[SweepDrive]] = {}
        for drive in self.drives:
            out.setdefault(drive.cell.label, []).append(drive)
        return out

    def main_figure(self) -> str:
        """Return the name of the result by which cells are compared first."""
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
        """Return the lines of a table for each block of known results; the first table also contains the ratios."""
        rows, out = self.cells(), []
        width = min(max([len(row["cell"]) for row in rows], default=4), MAX_LABEL_LETTERS) + 2
        for names in ([name for name in block if self._has(name)] for block in blocks):
            if not names:
                continue
            heads = [(_(ALL_FIGURES[name].heading), ALL_FIGURES[name].unit) for name in names]
            columns = [max(len(head), len(unit), 5) + 2 for head, unit in heads]
            ratio = "" if out else f"  {_('ratio')}"
            out += [] if not out else [""]
            for k in range(2):
                words = "".join(f"{head[k]:>{n}}" for head, n in zip(heads, columns, strict=True))
                out.append((" " * width + words + ratio * (k == 0)).rstrip())
            for row in rows:
                cells = [
                    f"{_cell(row[name] * ALL_FIGURES[name].scale):>{n}}"
                    for name, n in zip(names, columns, strict=True)
                ]
                out.append(
                    f"{row['cell'][: width - 2]:{width}}{''.join(cells)}{self._ratio(row) if ratio else ''}"
                )
        main, drives = self.main_figure(), max((row["drives"] for row in rows), default=0)
        about = {"drives": drives, "figure": _(ALL_FIGURES[main].heading), "reference": self.reference}
        return [text(note("sweep.head" if len(rows) < 2 else "sweep.head-ratio", **about)), *out]

    def _ratio(self, row: "TableRow") -> str:
        main = self.main_figure()
        if row["cell"] == self.reference or not np.isfinite(row[f"{main}_ratio"]):
            return "  1" if row["cell"] == self.reference else "  -"
        texts = [f"{number(row[f'{main}_{end}']):.2f}" for end in ("ratio", "low", "high")]
        interval = f"[{texts[1]}, {texts[2]}]" if np.isfinite(row[f"{main}_low"]) else _("interval unknown")
        return f"  {texts[0]} {interval}"


def _cell(value: float) -> str:
    return f"{number(value):.3g}" if np.isfinite(value) else "-"
