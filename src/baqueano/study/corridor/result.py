"""Evaluate the corridor of a filter: its coverage of the truth, and its excess width.

    d² = eᵀ P⁻¹ e of position (2) or heading (1),   coverage = share of vehicles with d² ≤ χ²(0.95)         (1)
    wider than needed = χ²(0.95) / (95 % quantile of d²): of the area of a position, of the variance of a heading   (2)

A vehicle is included while the standard deviation of its heading is at most MAX_HEADING_STD_RAD. The verdict accounts
for chance with few vehicles. A requirement is missed only if the whole 95 % interval of a coverage (Wilson 1927) is
outside the required range. By the same interval, a region is too wide if a region MAX_WIDENING times smaller still
covers more than 95 %.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from baqueano.compare.corridor import MAX_HEADING_STD_RAD, QUANTILE_95
from baqueano.contracts.values import JsonObject, TableRow
from baqueano.diagnostics import Verdict
from baqueano.estimators.covariance import CHI_SQUARE_95
from baqueano.messages import verdict_line
from baqueano.messages.language import number, translate as _
from baqueano.messages.text_table import text_table

INSTANTS_S = (10.0, 20.0, 40.0, 60.0)
COVERAGE, MAX_WIDENING = (0.90, 0.98), 1.3
# coverage; a recording has only a few windows, and its camera also has errors
RECORDING_COVERAGE = (0.85, 1.0)
MIN_VEHICLES = 10  # vehicles of a row with a verdict
CORRIDOR_PROBABILITY = 0.95
CHI_SQUARE_LIMITS = {"position": CHI_SQUARE_95, "heading": QUANTILE_95**2}


class Instant(NamedTuple):
    """Error and covariance of one vehicle at one instant."""

    error: np.ndarray  # (3,) estimated minus true pose
    cov: np.ndarray  # (3, 3) of the estimate


@dataclass(frozen=True, slots=True, eq=False)
class Corridors:
    """The corridors of all vehicles, by named instant."""

    # "10 s", "lap 1" → the vehicles that are not lost at that instant
    instants: dict[str, tuple[Instant, ...]]
    lost: dict[str, int]
    vehicles: int
    refused_robots: tuple[int, ...]  # seeds whose fit was refused: they did not drive
    # "10 s, raw" → the windows of recordings
    windows: dict[str, tuple[Instant, ...]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def rows(self) -> list[TableRow]:
        """Return a flat row with coverage and width for each instant and quantity."""
        rows = []
        for source, source_instants in (("simulated", self.instants), ("recorded", self.windows)):
            coverage, widening = (
                (COVERAGE, MAX_WIDENING) if source == "simulated" else (RECORDING_COVERAGE, np.inf)
            )
            for time_label, instants in source_instants.items():
                for quantity, limit in CHI_SQUARE_LIMITS.items():
                    row = {
                        "source": source,
                        "instant": time_label,
                        "quantity": quantity,
                        "cases": len(instants),
                    }
                    d2 = np.array([squared_distance(instant, quantity) for instant in instants])
                    rows.append(
                        row
                        | {"lost_cases": self.lost.get(time_label, 0)}
                        | _coverage_row(d2, limit, coverage, widening)
                    )
        return rows

    @property
    def reasons(self) -> tuple[str, ...]:
        """Return a sentence for each requirement that is missed."""
        return tuple(
            _(
                "{quantity} at {time}: coverage {coverage:.0f} %, {wider:.2f} × the size that is needed",
                quantity=r["quantity"],
                time=r["instant"],
                coverage=100.0 * r["coverage"],
                wider=r["width_ratio"],
            )
            for r in self.rows()
            if r["ok"] is False
        )

    @property
    def verdict(self) -> Verdict:
        """Return WARN if a requirement is missed, else USABLE."""
        return Verdict.WARN if self.reasons else Verdict.USABLE

    def table(self) -> str:
        """Return the coverage and width at each instant as a text table."""
        head = [_("at"), _("quantity"), _("cases"), _("lost"), _("coverage"), "95 %", _("× needed"), ""]
        rows = (
            [_(r["instant"]), _(r["quantity"]), str(r["cases"]), str(r["lost_cases"]),
             f"{number(100 * r['coverage']):.1f} %", f"[{number(100 * r['low']):.0f}, {number(100 * r['high']):.0f}] %",
             f"{number(r['width_ratio']):.2f}", _("NO") if r["ok"] is False else ""]
            for r in self.rows()
        )  # fmt: skip
        lines = text_table("<<>>><><", head, *rows)
        lines.append(
            _(
                "The coverage of the 95 % region must be between {low:g} and {high:g}. Its area (for a "
                "heading, its variance) must be at most {wider:g} × that of a region with 95 % of these "
                "vehicles. For windows of recordings, the coverage must be at least {of_recordings:g}.",
                low=COVERAGE[0],
                high=COVERAGE[1],
                wider=MAX_WIDENING,
                of_recordings=RECORDING_COVERAGE[0],
            )
        )
        if self.refused_robots:
            lines.append(
                _(
                    "The fits of {refused} vehicles were refused: these vehicles did not drive.",
                    refused=len(self.refused_robots),
                )
            )
        summary = _("all requirements are met")
        return "\n".join([*lines, *self.notes, verdict_line(self.verdict, self.reasons, summary)])


def squared_distance(instant: Instant, quantity: str) -> float:
    """Return d² of the position or the heading.  (1)"""
    k = slice(0, 2) if quantity == "position" else slice(2, 3)
    return float(instant.error[k] @ np.linalg.solve(instant.cov[k, k], instant.error[k]))


def has_heading(instant: Instant) -> bool:
    """Return True if the standard deviation of the heading is at most MAX_HEADING_STD_RAD."""
    return bool(instant.cov[2, 2] <= MAX_HEADING_STD_RAD**2)


def drive_corridors(
    named_instants: Sequence[tuple[str, Instant]], vehicles: int, refused_numbers: Sequence[int]
) -> Corridors:
    """Return the corridors of named instants; the names keep the order of their first occurrence."""
    names = list(dict.fromkeys(name for name, _ in named_instants))
    instants = {
        n: tuple(instant for name, instant in named_instants if name == n and has_heading(instant))
        for n in names
    }
    lost_cases = {
        n: sum(1 for name, instant in named_instants if name == n and not has_heading(instant)) for n in names
    }
    return Corridors({n: x for n, x in instants.items() if x}, lost_cases, vehicles, tuple(refused_numbers))


def _coverage_row(
    d2: np.ndarray, limit: float, coverage: tuple[float, float], max_coverage_ratio: float
) -> JsonObject:
    share_inside, n = float(np.mean(d2 <= limit)), len(d2)
    low, high = _wilson(share_inside, n)
    # coverage of a region that is `most` times narrower
    lower_share = _wilson(float(np.mean(d2 <= limit / max_coverage_ratio)), n)[0]
    ok = (
        None
        if n < MIN_VEHICLES
        else bool(low <= coverage[1] and high >= coverage[0] and lower_share <= CORRIDOR_PROBABILITY)
    )
    widening = float(limit / np.quantile(d2, CORRIDOR_PROBABILITY))
    return {"coverage": share_inside, "low": low, "high": high, "width_ratio": widening, "ok": ok}


def _wilson(share: float, n: int) -> tuple[float, float]:
    z2 = QUANTILE_95**2
    centre, half_width = share + 0.5 * z2 / n, np.sqrt(z2 * (share * (1.0 - share) / n + 0.25 * z2 / n**2))
    return float((centre - half_width) / (1.0 + z2 / n)), float((centre + half_width) / (1.0 + z2 / n))
