"""Times several ways to do the same thing, interleaved, and tells medians as ratios.

A B C, A B C, … in one process with the garbage collector off: a machine that is shared slows all alike.
A quick case is repeated until a round of it takes LEAST_S; first calls (tracing, compiling) do not count.
"""

import gc
import time
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any, NamedTuple

LEAST_S = 0.02
ROUNDS = 7


class Case(NamedTuple):
    """One way to do it."""

    name: str
    call: Callable[[], Any]
    rounds: int = ROUNDS  # slow peers are measured fewer times


class Row(NamedTuple):
    """One line of a table of ratios."""

    name: str
    seconds: float  # median
    ratio: float  # how many times as long as the first case takes
    target: float = 0.0  # the least that the ratio should be; 0 for none
    note: str = ""
    missed: bool = False
    most: float = 0.0  # the most that the ratio should be; 0 for none


class Bench(NamedTuple):
    """One question, answered."""

    title: str
    rows: tuple[Row, ...]

    @property
    def met(self) -> bool:
        """Whether every target was reached."""
        return not any(row.missed for row in self.rows)

    def table(self) -> str:
        """For people."""
        wide = max(len(row.name) for row in self.rows)
        lines = [self.title]
        for row in self.rows:
            ratio = f"{row.ratio:10,.1f} ×" if row.ratio != 1.0 else " " * 12
            target = f"{row.target:,.3g}" if row.target else f"at most {row.most:,g}" if row.most else ""
            target = f"  (target {target}{': missed' if row.missed else ''})" if target else ""
            note = f"  {row.note}" if row.note else ""
            lines.append(f"  {row.name:<{wide}}  {in_units(row.seconds)}{ratio}{target}{note}")
        return "\n".join(lines)

    def as_rows(self) -> list[dict[str, Any]]:
        """For machines."""
        return [{"bench": self.title, **row._asdict()} for row in self.rows]


def interleaved(cases: Sequence[Case]) -> list[float]:
    """Median seconds of each case."""
    repeats = [_repeats(case) for case in cases]
    taken: list[list[float]] = [[] for _ in cases]
    gc.disable()
    try:
        for round_ in range(max(case.rounds for case in cases)):
            for case, repeat, times in zip(cases, repeats, taken, strict=True):
                if round_ < case.rounds:
                    times.append(timed(case.call, repeat))
    finally:
        gc.enable()
    return [median(times) for times in taken]


def timed(call: Callable[[], Any], repeat: int = 1) -> float:
    """Seconds of one call, the mean of `repeat`."""
    start = time.perf_counter()
    for _ in range(repeat):
        call()
    return (time.perf_counter() - start) / repeat


def measured(
    title: str,
    cases: Sequence[Case],
    targets: dict[str, float],
    notes: dict[str, str] | None = None,
    most: dict[str, float] | None = None,
) -> Bench:
    """The bench of `cases`; the first one is ours, `targets` are the least ratios by the name of the others,
    `most` the greatest."""
    seconds = interleaved(cases)
    rows = [
        row(case.name, s, seconds[0], targets, notes or {}, most)
        for case, s in zip(cases, seconds, strict=True)
    ]
    return Bench(title, tuple(rows))


def row(
    name: str,
    seconds: float,
    ours: float,
    targets: dict[str, float],
    notes: dict[str, str],
    most: dict[str, float] | None = None,
) -> Row:
    """One case beside ours."""
    target, limit, ratio = targets.get(name, 0.0), (most or {}).get(name, 0.0), seconds / ours
    missed = ratio < target or bool(limit and ratio > limit)
    return Row(name, seconds, ratio, target, notes.get(name, ""), missed, limit)


def in_units(seconds: float) -> str:
    """Three digits and a unit, eleven letters wide."""
    for factor, unit in ((1.0, "s"), (1e3, "ms"), (1e6, "µs")):
        if seconds * factor >= 1.0 or unit == "µs":
            return f"{seconds * factor:8.3g} {unit:<2}"
    raise AssertionError


def _repeats(case: Case) -> int:
    """Calls a round; the first call, which may compile, is not counted."""
    if case.rounds < ROUNDS:
        return 1
    case.call()
    return max(1, round(LEAST_S / max(timed(case.call), 1e-9)))
