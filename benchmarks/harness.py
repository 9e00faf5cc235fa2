"""Time several methods for the same task, interleaved, and report medians as ratios.

The order is A B C, A B C, … in one process without the garbage collector. So other work of the machine slows all
methods equally. A quick case is repeated until a round takes LEAST_S, and has more rounds. Short rounds are seldom
interrupted, so the median is from an undisturbed round. First calls (tracing, compiling) do not count. A case on one
processor may be measured by its processor time, independent of other work of the machine.
"""

import gc
import time
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any, NamedTuple

LEAST_S = 0.002
ROUNDS, MOST_ROUNDS = 7, 61
ENOUGH_S = 0.2  # of one case


class Case(NamedTuple):
    """One method for the task: its name and its function."""

    name: str
    call: Callable[[], Any]
    rounds: int = ROUNDS  # slow peers are measured fewer times


class Row(NamedTuple):
    """One row of a table of ratios."""

    name: str
    seconds: float  # median
    ratio: float  # time over the time of the first case
    target: float = 0.0  # least allowed ratio; 0 for none
    note: str = ""
    is_missed: bool = False
    max_ratio: float = 0.0  # largest allowed ratio; 0 for none


class Bench(NamedTuple):
    """The result of one comparison: a title and a row per case."""

    title: str
    rows: tuple[Row, ...]

    @property
    def met(self) -> bool:
        """Return True if every target was reached."""
        return not any(row.is_missed for row in self.rows)

    def table(self) -> str:
        """Return the rows as text."""
        width = max(len(row.name) for row in self.rows)
        lines = [self.title]
        for row in self.rows:
            ratio = f"{row.ratio:10,.1f} ×" if row.ratio != 1.0 else " " * 12
            target = (
                f"{row.target:,.3g}" if row.target else f"at most {row.max_ratio:,g}" if row.max_ratio else ""
            )
            target = f"  (target {target}{': missed' if row.is_missed else ''})" if target else ""
            note = f"  {row.note}" if row.note else ""
            lines.append(f"  {row.name:<{width}}  {in_units(row.seconds)}{ratio}{target}{note}")
        return "\n".join(lines)

    def as_rows(self) -> list[dict[str, Any]]:
        """Return the rows as dicts, for JSON."""
        return [{"bench": self.title, **row._asdict()} for row in self.rows]


class LeftOut(NamedTuple):
    """A bench that this machine cannot run, and the command that makes it possible."""

    title: str
    command: str
    met: bool = True

    def table(self) -> str:
        """Return a line of text with the title and the command."""
        return f"{self.title}: left out. Type: {self.command}"

    def as_rows(self) -> list[dict[str, Any]]:
        """Return an empty list: nothing was measured."""
        return []


def interleaved(cases: Sequence[Case], clock: Callable[[], float] = time.perf_counter) -> list[float]:
    """Return the median time [s] of a call of each case, measured in interleaved rounds."""
    plans = [_plan(case, clock) for case in cases]
    seconds_of_cases: list[list[float]] = [[] for _ in cases]
    gc.disable()
    try:
        for round_ in range(max(rounds for _, rounds in plans)):
            for case, (repeat, rounds), times in zip(cases, plans, seconds_of_cases, strict=True):
                if round_ < rounds:
                    times.append(timed(case.call, repeat, clock))
    finally:
        gc.enable()
    return [median(times) for times in seconds_of_cases]


def timed(call: Callable[[], Any], repeat: int = 1, clock: Callable[[], float] = time.perf_counter) -> float:
    """Return the time [s] of one call, as the mean of `repeat` calls."""
    start = clock()
    for _ in range(repeat):
        call()
    return (clock() - start) / repeat


def measured(
    title: str,
    cases: Sequence[Case],
    targets: dict[str, float],
    notes: dict[str, str] | None = None,
    limits: dict[str, float] | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> Bench:
    """Return the bench of `cases`; the first case is ours.

    `targets` are the least allowed ratios by the names of the other cases, `limits` the largest allowed ratios.
    """
    seconds = interleaved(cases, clock)
    rows = [
        row(case.name, s, seconds[0], targets, notes or {}, limits)
        for case, s in zip(cases, seconds, strict=True)
    ]
    return Bench(title, tuple(rows))


def row(
    name: str,
    seconds: float,
    own_seconds: float,
    targets: dict[str, float],
    notes: dict[str, str],
    limits: dict[str, float] | None = None,
) -> Row:
    """Return the row of one case, with its ratio to our time `own_seconds`."""
    target, limit, ratio = targets.get(name, 0.0), (limits or {}).get(name, 0.0), seconds / own_seconds
    is_missed = ratio < target or bool(limit and ratio > limit)
    return Row(name, seconds, ratio, target, notes.get(name, ""), is_missed, limit)


def in_units(seconds: float) -> str:
    """Return a time as text with three digits and a unit (s, ms, µs), eleven letters wide."""
    for factor, unit in ((1.0, "s"), (1e3, "ms"), (1e6, "µs")):
        if seconds * factor >= 1.0 or unit == "µs":
            return f"{seconds * factor:8.3g} {unit:<2}"
    raise AssertionError


def _plan(case: Case, clock: Callable[[], float]) -> tuple[int, int]:
    """Return the calls per round and the number of rounds; the first call, which may compile, is not counted."""
    if case.rounds < ROUNDS:
        return 1, case.rounds
    case.call()
    time_s = max(min(timed(case.call, 1, clock) for _ in range(2)), 1e-9)
    repeat = max(1, round(LEAST_S / time_s))
    return repeat, min(MOST_ROUNDS, max(ROUNDS, round(ENOUGH_S / (repeat * time_s))))
