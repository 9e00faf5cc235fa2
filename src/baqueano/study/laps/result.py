"""Result of `study laps`: for each fix and route the share of robots that stay on the route, the errors, and the NEES.

NEES        eᵀ P⁻¹ e / 3 of (x, y, ψ): 1 for a consistent filter, less for a conservative one                      (1)
within      share of the samples with eᵀ P⁻¹ e ≤ χ²₃, while σ_ψ is at most MAX_HEADING_STD_RAD           (2)
forecast    mean over the robots of P(|n| < d / σ), d = MAX_DISTANCE_M, σ the largest in corridor_forecast.py  (3)

A robot stays on the route if its true distance from the route is at most MAX_DISTANCE_M in all laps, and it is never
stopped.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.compare.corridor import MAX_HEADING_STD_RAD
from baqueano.contracts.values import TableRow
from baqueano.diagnostics import Verdict
from baqueano.messages import verdict_line
from baqueano.messages.language import number, translate as _
from baqueano.messages.text_table import text_table

if TYPE_CHECKING:
    from baqueano.study.laps.drives import Laps

CHI_SQUARE_95_3 = 7.815  # 95 % quantile of χ² with 3 degrees of freedom
SETTLING_LAPS = 3  # laps after which the gyro scale is estimated
MAX_DISTANCE_M, MIN_KEPT_SHARE, MIN_WITHIN_SHARE, MAX_NEES, MAX_FORECAST_ERROR = 0.10, 0.90, 0.90, 1.6, 0.10


class LapCase(NamedTuple):
    """A case of the study: a route, a fix, a gyro, and readings with or without faults."""

    route: str
    fix: str
    gyro: str
    read: str  # "all read" or "faults"


class Lap(NamedTuple):
    """One lap of a robot, until its end or until the stop."""

    case: LapCase
    seed: int
    lap: int  # from 1
    is_complete: bool  # without a stop
    position_m: float  # worst error of the estimate
    across_m: float  # largest true distance from the route
    region_share: float  # fraction (2); NaN if the heading is lost
    nees: float  # mean of (1) over the samples of (2)


class FullDrive(NamedTuple):
    """A whole drive of a robot."""

    case: LapCase
    seed: int
    touches: bool  # True if the robot touched a wall
    forecast: float  # probability to stay on the route, computed before the drive; NaN without a forecast


def robot_laps(
    drives: "Laps", case: LapCase, seeds: Sequence[int], laps: int, samples_per_lap: int
) -> list[Lap]:
    """Return the laps of all robots of a drive, `samples_per_lap` samples each."""
    e, P = drives.error, drives.cov
    square = np.einsum("tni,tnij,tnj->tn", e, np.linalg.inv(P), e)
    square = np.where(np.sqrt(P[..., 2, 2]) <= MAX_HEADING_STD_RAD, square, np.nan)
    distance_m, cross_track_m = np.hypot(e[..., 0], e[..., 1]), np.abs(drives.cross_track_m)
    lap_results = []
    for lap in range(laps):
        t = slice(lap * samples_per_lap, (lap + 1) * samples_per_lap if lap < laps - 1 else None)
        for i, seed in enumerate(seeds):
            lap_rows = drives.drives[t, i]
            if not lap_rows.any():
                continue
            squares = square[t, i][lap_rows & np.isfinite(square[t, i])]
            claims = (
                (float(np.mean(squares <= CHI_SQUARE_95_3)), float(np.mean(squares)) / 3.0)
                if len(squares)
                else (np.nan,) * 2
            )
            worst_errors = float(distance_m[t, i][lap_rows].max()), float(cross_track_m[t, i][lap_rows].max())
            lap_results.append(Lap(case, seed, lap + 1, bool(lap_rows.all()), *worst_errors, *claims))
    return lap_results


@dataclass(frozen=True, slots=True, eq=False)
class LapStudy:
    """Result of the study: all laps and drives."""

    drives: tuple[Lap, ...]
    full_drives: tuple[FullDrive, ...]
    robots: int
    laps: int
    refused_robots: tuple[int, ...]  # robots whose fit was refused: they did not drive

    def rows(self) -> list[TableRow]:
        """Return a flat row for each case."""
        return [self._row(case) for case in dict.fromkeys(uno.case for uno in self.full_drives)]

    def _row(self, case: LapCase) -> TableRow:
        full_drives = [w for w in self.full_drives if w.case == case]
        case_laps = [d for d in self.drives if d.case == case]
        first, last = ([d for d in case_laps if d.lap == lap] for lap in (1, self.laps))
        later_laps = [d for d in case_laps if d.lap > SETTLING_LAPS]
        stops = [
            max(d.lap for d in case_laps if d.seed == w.seed)
            for w in full_drives
            if not self._is_whole(case_laps, w.seed)
        ]
        keeps = [
            self._is_whole(case_laps, w.seed)
            and max(d.across_m for d in case_laps if d.seed == w.seed) <= MAX_DISTANCE_M
            for w in full_drives
        ]
        return case._asdict() | {
            "robots": len(full_drives),
            "success_share": float(np.mean(keeps)),
            "forecast": float(np.mean([w.forecast for w in full_drives])),
            "first_across_p95_m": _quantile([d.across_m for d in first], 0.95),
            "last_across_p95_m": _quantile([d.across_m for d in last], 0.95),
            "across_worst_m": _quantile([d.across_m for d in case_laps], 1.0),
            "position_worst_m": _quantile([d.position_m for d in later_laps], 1.0),
            "region_share": _mean([d.region_share for d in case_laps]),
            "nees": _mean([d.nees for d in case_laps]),
            "stopped": len(stops),
            "stop_lap_median": _quantile([float(lap) for lap in stops], 0.5),
            "wall_contacts": sum(w.touches for w in full_drives),
        }

    def _is_whole(self, case_laps: list[Lap], seed: int) -> bool:
        return sum(d.is_complete for d in case_laps if d.seed == seed) == self.laps

    @property
    def reasons(self) -> tuple[str, ...]:
        """Return a sentence on refused fits, and one for each missed bound: all bounds with tags; walls, coverage
        and NEES with the other fixes."""
        reasons = []
        if self.refused_robots:
            reasons.append(
                _("the fits of robots {robots} were refused", robots=", ".join(map(str, self.refused_robots)))
            )
        for row in self.rows():
            case = ", ".join(_(row[name]) for name in LapCase._fields)
            problems = _missed_bounds(row, self.laps)
            reasons += [_("{where}: {what}", where=case, what=problem) for problem in problems]
        return tuple(reasons)

    @property
    def verdict(self) -> Verdict:
        """Return WARN if a bound is missed, else USABLE."""
        return Verdict.WARN if self.reasons else Verdict.USABLE

    def table(self) -> str:
        """Return the rows as a text table."""
        lines = [
            _(
                "{robots} robots, {laps} laps. Cross-track error: 95 % quantile of the first and of the "
                "last lap, and the largest of all. Estimate: its largest error after lap {settled}",
                robots=self.robots,
                laps=self.laps,
                settled=SETTLING_LAPS,
            )
        ]
        cells = []
        for r in self.rows():
            cross_track_text = " ".join(
                _cm_text(r[name]) for name in ("first_across_p95_m", "last_across_p95_m", "across_worst_m")
            )
            stops = f"{r['stopped']}, {number(r['stop_lap_median']):.0f}" if r["stopped"] else "0"
            chance = f"{number(r['success_share']):.0%}", _share_text(r["forecast"])
            estimate = _cm_text(r["position_worst_m"]), _share_text(r["region_share"])
            labels, nees = (_(r[name]) for name in LapCase._fields), f"{number(r['nees']):.2f}"
            cells.append([*labels, *chance, cross_track_text, *estimate, nees, stops])
        head = [
            _("route"), _("fix"), _("gyro"), _("readings"), _("kept"), _("forecast"), _("cross, cm"),
            _("estimate, cm"), _("within"), "NEES", _("stopped, in lap"),
        ]  # fmt: skip
        lines += text_table("<<<<>>>>>>>", head, *cells)
        return "\n".join([*lines, "", verdict_line(self.verdict, self.reasons, _("all bounds are met"))])


def _missed_bounds(row: TableRow, laps: int) -> Iterator[str]:
    """Yield a sentence for each bound that a row misses."""
    if row["wall_contacts"]:
        yield _("{robots} robots touched a wall", robots=row["wall_contacts"])
    if row["region_share"] < MIN_WITHIN_SHARE:
        yield _("{within:.0%} are within the 95 % region; expected 90 %", within=row["region_share"])
    if row["nees"] > MAX_NEES:
        yield _("NEES {nees:.2f}; expected at most {most:g}", nees=row["nees"], most=MAX_NEES)
    if row["fix"] != "tags":
        return
    if row["gyro"] == "uncalibrated":
        if abs(row["forecast"] - row["success_share"]) > MAX_FORECAST_ERROR:
            figures = {"kept": row["success_share"], "forecast": row["forecast"]}
            yield _("{kept:.0%} of the robots keep to the route; the forecast was {forecast:.0%}", **figures)
        return
    if row["last_across_p95_m"] > MAX_DISTANCE_M:
        distance = f"{number(100.0 * row['last_across_p95_m']):.0f} cm"
        yield _("lap {lap}: {distance} from the route; expected at most 10 cm", lap=laps, distance=distance)
    if row["read"] == "no reading lost" and row["position_worst_m"] > MAX_DISTANCE_M:
        distance = f"{number(100.0 * row['position_worst_m']):.0f} cm"
        yield _("the error of the estimate is {distance}; expected at most 10 cm", distance=distance)
    if row["route"] != "sinuous" and row["success_share"] < MIN_KEPT_SHARE:
        yield _("{kept:.0%} of the robots keep to the route; expected 90 %", kept=row["success_share"])
    if row["stopped"]:
        yield _("{stopped} drives were stopped", stopped=row["stopped"])


def _quantile(values: list[float], q: float) -> float:
    return float(np.quantile(values, q)) if values else float("nan")


def _mean(values: list[float]) -> float:
    finite_values = [value for value in values if np.isfinite(value)]
    return float(np.mean(finite_values)) if finite_values else float("nan")


def _cm_text(metres: float) -> str:
    return f"{number(100.0 * metres):.1f}" if np.isfinite(metres) else "-"


def _share_text(share: float) -> str:
    return f"{number(share):.1%}" if np.isfinite(share) else "-"
