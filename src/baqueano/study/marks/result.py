"""What `study marks` found: of each lap the worst error, what was claimed then, and how often the truth lay within.

claimed position    2.45 σ along the longest axis: the 95 % region of two numbers                     (1)
NEES                eᵀ P⁻¹ e / 3 of (x, y, ψ): 1 where the claim is true, below where it is cautious   (2)
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from baqueano.study.marks.drives import Laps

WITHIN_2, WITHIN_3 = 5.991, 7.815  # χ² of 2 and 3 numbers, 95 %
SETTLED = 3  # laps after which the scale of the gyro is known
SHOWN = (1, 2, 3, 10, 25, 50)
WORST_M, LEAST_WITHIN, MOST_NEES = 0.10, 0.90, 1.6  # of laps after SETTLED whose tags are all read


class Lap(NamedTuple):
    """One lap of one robot."""

    shape: str
    read: str  # "all read" or "faults"
    seed: int
    lap: int  # from 1
    stopped: bool
    position_m: float  # worst error
    claimed_m: float  # largest radius of (1)
    heading_rad: float  # worst error
    claimed_rad: float  # largest 1.96 σ
    within: float  # share of the samples whose pose lies in the 95 % region
    nees: float  # mean of (2)


def laps_of(driven: Laps, shape: str, read: str, seeds: list[int], laps: int) -> list[Lap]:
    """Return the laps of all robots of a drive."""
    e, P, per = driven.error, driven.cov, len(driven.error) // laps
    square = np.einsum("tni,tnij,tnj->tn", e, np.linalg.inv(P), e)
    far, turned = np.hypot(e[..., 0], e[..., 1]), np.abs(e[..., 2])
    radius = np.sqrt(WITHIN_2 * np.linalg.eigvalsh(P[..., :2, :2])[..., -1])
    angle = 1.96 * np.sqrt(P[..., 2, 2])
    out = []
    for lap in range(laps):
        t = slice(lap * per, (lap + 1) * per)
        worst = [x[t].max(axis=0) for x in (far, radius, turned, angle)]
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

    def rows(self) -> list[dict[str, Any]]:
        """Return a row for each shape, way of reading and lap of SHOWN, and one of all laps after SETTLED."""
        out = []
        for shape, read in dict.fromkeys((d.shape, d.read) for d in self.drives):
            of = [d for d in self.drives if (d.shape, d.read) == (shape, read)]
            for lap in (k for k in SHOWN if k <= self.laps):
                out.append(_row(shape, read, str(lap), [d for d in of if d.lap == lap]))
            if later := [d for d in of if d.lap > SETTLED]:
                out.append(_row(shape, read, f"{SETTLED + 1}-{self.laps}", later))
        return out

    @property
    def reasons(self) -> tuple[str, ...]:
        """Say which bound is not kept where all tags are read."""
        out = [f"the fits of robots {', '.join(map(str, self.refused))} were refused"] if self.refused else []
        for row in (r for r in self.rows() if "-" in r["lap"] and r["read"] == "all read"):
            if row["position_worst_m"] > WORST_M:
                out.append(
                    f"{row['shape']}: {row['position_worst_m']:.2f} m off, at most {WORST_M:g} m expected"
                )
            if row["within"] < LEAST_WITHIN:
                out.append(
                    f"{row['shape']}: {row['within']:.0%} within the 95 % region, at least 90 % expected"
                )
            if row["nees"] > MOST_NEES:
                out.append(f"{row['shape']}: NEES {row['nees']:.2f}, at most {MOST_NEES:g} expected")
        if stopped := len({(d.shape, d.read, d.seed) for d in self.drives if d.stopped}):
            out.append(f"{stopped} drives were stopped")
        return tuple(out)

    @property
    def verdict(self) -> str:
        """WARN where a bound is not kept, else USABLE."""
        return "WARN" if self.reasons else "USABLE"

    def table(self) -> str:
        """Return the rows for people."""
        head = f"{'shape':11}{'tags':10}{'lap':>6}{'position, cm: true':>24}{'claimed':>9}"
        head += f"{'heading, °: true':>20}{'claimed':>9}{'within':>8}{'NEES':>6}"
        lines = [
            f"{self.robots} robots; worst error of a lap: its median, 95 % quantile and largest; median of the claims",
            head,
            "-" * len(head),
        ]
        for r in self.rows():
            place = " ".join(f"{100.0 * r[f'position_{q}_m']:.1f}" for q in QUANTILES)
            angle = " ".join(f"{np.degrees(r[f'heading_{q}_rad']):.1f}" for q in QUANTILES)
            lines.append(
                f"{r['shape']:11}{r['read']:10}{r['lap']:>6}{place:>24}{100.0 * r['claimed_m']:9.1f}{angle:>20}"
                f"{np.degrees(r['claimed_rad']):9.1f}{r['within']:8.1%}{r['nees']:6.2f}"
            )
        return "\n".join([*lines, "", f"{self.verdict}: {'; '.join(self.reasons) or 'all bounds are kept'}"])


QUANTILES = {"median": 0.5, "p95": 0.95, "worst": 1.0}


def _row(shape: str, read: str, lap: str, of: list[Lap]) -> dict[str, Any]:
    place, angle = (np.array([getattr(d, name) for d in of]) for name in ("position_m", "heading_rad"))
    row: dict[str, Any] = {"shape": shape, "read": read, "lap": lap, "laps": len(of)}
    for name, q in QUANTILES.items():
        row |= {
            f"position_{name}_m": float(np.quantile(place, q)),
            f"heading_{name}_rad": float(np.quantile(angle, q)),
        }
    for name in ("claimed_m", "claimed_rad"):
        row[name] = float(np.median([getattr(d, name) for d in of]))
    return row | {name: float(np.mean([getattr(d, name) for d in of])) for name in ("within", "nees")}
