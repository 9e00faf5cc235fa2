"""Result of `study marks`: of each lap the worst error, what was claimed then, and how often the truth lay within.

claimed position    2.45 σ along the longest axis: the 95 % region of two numbers                     (1)
NEES                eᵀ P⁻¹ e / 3 of (x, y, ψ): 1 where the claim is true, below where it is cautious   (2)

A robot keeps the route if no lap takes it more than WORST_M beside it, in truth, and it is never stopped.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject, TableRow
    from baqueano.study.marks.drives import Laps
from baqueano.diagnostics import Verdict
from baqueano.language import number
from baqueano.language import translated as _
from baqueano.study.marks.drives import Laps

WITHIN_2, WITHIN_3 = 5.991, 7.815  # χ² of 2 and 3 numbers, 95 %
SETTLED = 3  # laps after which the scale of the gyro is known
SHOWN = (1, 2, 3, 10, 25, 50)
WORST_M, LEAST_KEPT, LEAST_WITHIN, MOST_NEES = 0.10, 0.90, 0.90, 1.6


class Lap(NamedTuple):
    """A lap of a robot."""

    shape: str
    read: str  # "all read" or "faults"
    seed: int
    lap: int  # from 1
    stopped: bool
    position_m: float  # worst error of the estimate
    claimed_m: float  # largest radius of (1)
    heading_rad: float  # worst error
    claimed_rad: float  # largest 1.96 σ
    across_m: float  # farthest beside the route, in truth
    within: float  # share of the samples whose pose lies in the 95 % region
    nees: float  # mean of (2)


def laps_of(driven: "Laps", shape: str, read: str, seeds: list[int], laps: int) -> list[Lap]:
    """Return the laps of all robots of a drive."""
    e, P, per = driven.error, driven.cov, len(driven.error) // laps
    square = np.einsum("tni,tnij,tnj->tn", e, np.linalg.inv(P), e)
    far, heading_errors = np.hypot(e[..., 0], e[..., 1]), np.abs(e[..., 2])
    radius = np.sqrt(WITHIN_2 * np.linalg.eigvalsh(P[..., :2, :2])[..., -1])
    angle, across = 1.96 * np.sqrt(P[..., 2, 2]), np.abs(driven.across)
    out = []
    for lap in range(laps):
        t = slice(lap * per, (lap + 1) * per)
        worst = [x[t].max(axis=0) for x in (far, radius, heading_errors, angle, across)]
        means = (square[t] <= WITHIN_3).mean(axis=0), square[t].mean(axis=0) / 3.0
        for i, seed in enumerate(seeds):
            figures = [float(x[i]) for x in (*worst, *means)]
            out.append(Lap(shape, read, seed, lap + 1, bool(driven.stopped[i]), *figures))
    return out


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """All laps."""

    drives: tuple[Lap, ...]
    robots: int
    laps: int
    refused: tuple[int, ...]  # robots whose fit was refused: they did not drive

    def rows(self) -> list["TableRow"]:
        """Return a row for each shape, way of reading and lap of SHOWN, the last one, and all laps after SETTLED."""
        out = []
        for shape, read in dict.fromkeys((d.shape, d.read) for d in self.drives):
            of = [d for d in self.drives if (d.shape, d.read) == (shape, read)]
            for lap in (*(k for k in SHOWN if k < self.laps), self.laps):
                out.append(_row(shape, read, str(lap), [d for d in of if d.lap == lap]))
            if later := [d for d in of if d.lap > SETTLED]:
                keeps = [
                    _keeps([d for d in of if d.seed == seed]) for seed in dict.fromkeys(d.seed for d in of)
                ]
                out.append(_row(shape, read, self._later, later) | {"kept": float(np.mean(keeps))})
        return out

    @property
    def reasons(self) -> tuple[str, ...]:
        """Say which bound is not kept: worst errors where all tags are read, all else with faults too."""
        out = (
            [_("the fits of robots {robots} were refused", robots=", ".join(map(str, self.refused)))]
            if self.refused
            else []
        )
        for row in self.rows():
            place, lap = f"{_(row['shape'])}, {_(row['read'])}", row["lap"]
            if lap == str(self.laps) and row["across_p95_m"] > WORST_M:
                out.append(
                    _(
                        "{where}, lap {lap}: {distance} beside the route, 10 cm expected",
                        where=place,
                        lap=lap,
                        distance=_cm(row["across_p95_m"]),
                    )
                )
            if lap != self._later:
                continue
            if row["read"] == "all read" and row["position_worst_m"] > WORST_M:
                out.append(
                    _(
                        "{where}: the estimate is {distance} off, 10 cm expected",
                        where=place,
                        distance=_cm(row["position_worst_m"]),
                    )
                )
            if row["kept"] < LEAST_KEPT:
                out.append(
                    _(
                        "{where}: {kept:.0%} of the robots keep the route, 90 % expected",
                        where=place,
                        kept=row["kept"],
                    )
                )
            if row["within"] < LEAST_WITHIN:
                out.append(
                    _(
                        "{where}: {within:.0%} within the 95 % region, 90 % expected",
                        where=place,
                        within=row["within"],
                    )
                )
            if row["nees"] > MOST_NEES:
                out.append(
                    _(
                        "{where}: NEES {nees:.2f}, at most {most:g} expected",
                        where=place,
                        nees=row["nees"],
                        most=MOST_NEES,
                    )
                )
        if stops := len({(d.shape, d.read, d.seed) for d in self.drives if d.stopped}):
            out.append(_("{stopped} drives were stopped", stopped=stops))
        return tuple(out)

    @property
    def verdict(self) -> Verdict:
        """WARN where a bound is not kept, else USABLE."""
        return Verdict.WARN if self.reasons else Verdict.USABLE

    @property
    def _later(self) -> str:
        return f"{SETTLED + 1}-{self.laps}"

    def table(self) -> str:
        """Return the rows for people."""
        head = f"{_('shape'):11}{_('tags'):10}{_('lap'):>6}{_('position, cm: true'):>20}{_('claimed'):>9}"
        head += f"{_('heading, °: true'):>18}{_('claimed'):>9}{_('within'):>8}{'NEES':>6}"
        head += f"{_('beside, cm'):>18}{_('kept'):>6}"
        lines = [
            _(
                "{robots} robots; worst of a lap: its median, 95 % quantile and largest; median of the claims",
                robots=self.robots,
            ),
            head,
            "-" * len(head),
        ]
        for r in self.rows():
            place, across = (
                " ".join(f"{number(100.0 * r[f'{of}_{q}_m']):.1f}" for q in QUANTILES)
                for of in ("position", "across")
            )
            angle = " ".join(f"{number(np.degrees(r[f'heading_{q}_rad'])):.1f}" for q in QUANTILES)
            share_kept = f"{number(r['kept']):.0%}" if "kept" in r else ""
            lines.append(
                f"{_(r['shape']):11}{_(r['read']):10}{r['lap']:>6}{place:>20}"
                f"{number(100.0 * r['claimed_m']):9.1f}{angle:>18}"
                f"{number(np.degrees(r['claimed_rad'])):9.1f}{number(r['within']):8.1%}"
                f"{number(r['nees']):6.2f}{across:>18}{share_kept:>6}"
            )
        return "\n".join(
            [*lines, "", f"{_(self.verdict)}: {'; '.join(self.reasons) or _('all bounds are kept')}"]
        )


QUANTILES = {"median": 0.5, "p95": 0.95, "worst": 1.0}


def _keeps(laps: list[Lap]) -> bool:
    return all(lap.across_m <= WORST_M and not lap.stopped for lap in laps)


def _cm(metres: float) -> str:
    return f"{number(100.0 * metres):.0f} cm"


def _row(shape: str, read: str, lap: str, of: list[Lap]) -> "JsonObject":
    row: TableRow = {"shape": shape, "read": read, "lap": lap, "laps": len(of)}
    for name in ("position_m", "heading_rad", "across_m"):
        figures, (quantity, unit) = [getattr(d, name) for d in of], name.split("_")
        row |= {
            f"{quantity}_{quantile}_{unit}": float(np.quantile(figures, q))
            for quantile, q in QUANTILES.items()
        }
    for name in ("claimed_m", "claimed_rad"):
        row[name] = float(np.median([getattr(d, name) for d in of]))
    return row | {name: float(np.mean([getattr(d, name) for d in of])) for name in ("within", "nees")}
