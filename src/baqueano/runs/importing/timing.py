"""Read the clock of an imported file: its time column as integer nanoseconds, and its rows in order of time.

A time that steps back, different rows with the same time, and a median step that is impossible for a robot are errors.
The error message contains the map line that resolves the problem. Gaps, jumps and equal repeated rows are reported.
"""

import numpy as np

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import note
from baqueano.errors import FileError
from baqueano.runs.diagnostics.finding import ImportFinding
from baqueano.runs.importing.dates import NO_TIME_NS, parse_dates
from baqueano.runs.maps.columns import ColumnMap, FileSpec
from baqueano.runs.maps.units import unit
from baqueano.runs.tables.table import LogTable
from baqueano.signals import NANOSECONDS

MIN_STEP_S, MAX_STEP_S = 5e-5, 10.0  # range of the median step of a vehicle's recording
MIN_DURATION_S = 2.0  # a shorter recording does not show a vehicle's motion
MIN_USUAL_STEP_S, MAX_USUAL_STEP_S = 4e-4, 0.5  # shorter or longer ticks of a loop are unusual
GAP_STEPS = 1.8  # times the median step
USUAL_STEP_TOLERANCE = 0.2  # of steps of a regular log
MAX_REPEAT_SHARE = 0.1  # of repeated rows in a log of changes
MIN_CLOCK_ROWS = 3  # rows after a step of the clock; fewer rows can be excluded without a loss
OVERFLOW_NS = 2**32 * 1000  # period of a counter of microseconds with 32 bits: 71.6 min
MAX_TIME_NS = 9e18  # the largest time that fits in 64 bits
MIN_CLOCK_JUMP_S = 600.0  # a longer pause is probably a clock that was set


def row_times(
    table: LogTable, spec: FileSpec, start_ns: int, map_name: str, findings: list[ImportFinding]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the times (rows,) int64 [ns], and a mask of the known times. Add a finding if their counter overflows.
    Raise FileError for times that are not plausible.
    """
    shift = start_ns + round(spec.shift_s * NANOSECONDS)
    if spec.rate_hz is not None:
        rows = table.row_indices - table.row_indices[0]
        t_ns, is_known = np.rint(rows * (NANOSECONDS / spec.rate_hz)).astype(np.int64), rows >= 0
    elif spec.time_unit == "iso8601":
        t_ns = _dates(table, spec)
        is_known = t_ns != NO_TIME_NS
        t_ns = np.where(is_known, t_ns, 0)
    else:
        t_ns, is_known = _number_times(table, spec)
        t_ns = _without_overflows(table, t_ns, is_known, shift, findings)
    if spec.time_rest is not None:
        second_part = table.numbers(spec.time_rest[0]) * (unit(spec.time_rest[1]).si_factor * NANOSECONDS)  # pyright: ignore[reportOptionalMemberAccess]
        is_known &= np.isfinite(second_part)
        t_ns = t_ns + np.rint(np.where(is_known, second_part, 0.0)).astype(np.int64)
    t_ns = t_ns + shift
    earliest = int(t_ns[is_known].min()) if is_known.any() else 0
    if earliest < 0:
        zero = start_ns + (-earliest // NANOSECONDS + 1) * NANOSECONDS
        raise FileError.of(
            "import.before-zero", table=table.label, t_s=earliest / NANOSECONDS, map=map_name, start_ns=zero
        )
    if is_known.any() and (latest_ns := t_ns[is_known].max()) >= 2**31 * NANOSECONDS:
        figures = {"t_s": latest_ns / NANOSECONDS, "unit_name": spec.time_unit}
        raise FileError.of("import.beyond-2038", table=table.label, **figures)
    return t_ns, is_known


def _number_times(table: LogTable, spec: FileSpec) -> tuple[np.ndarray, np.ndarray]:
    """Return the times (rows,) [ns] of a column of numbers, and a mask of the known times. Whole numbers stay exact."""
    si_factor = unit(spec.time_unit).si_factor  # pyright: ignore[reportOptionalMemberAccess]  the map was checked
    integers, factor = table.integers(spec.time), round(si_factor * NANOSECONDS)
    if (
        integers is not None
        and si_factor < 1.0
        and np.abs(integers.astype(float)).max(initial=0.0) * factor < MAX_TIME_NS
    ):
        return integers * factor, np.ones(len(integers), dtype=bool)
    with np.errstate(over="ignore"):  # a time that overflows is not known
        t = table.numbers(spec.time) * si_factor * NANOSECONDS
    is_known = np.abs(t) < MAX_TIME_NS
    if not is_known.any() and np.isfinite(t).any():
        latest_s = float(np.nanmax(np.where(np.isfinite(t), t, np.nan))) / NANOSECONDS
        raise FileError.of("import.beyond-2038", table=table.label, t_s=latest_s, unit_name=spec.time_unit)
    return np.rint(np.where(is_known, t, 0.0)).astype(np.int64), is_known


def _without_overflows(
    table: LogTable, t_ns: np.ndarray, is_known: np.ndarray, shift: int, findings: list[ImportFinding]
) -> np.ndarray:
    """Return the times (rows,) [ns] without the overflows of a counter of microseconds with 32 bits."""
    rows = np.flatnonzero(is_known)
    step_ns = np.diff(t_ns[rows]) + OVERFLOW_NS
    is_overflow = (step_ns > 0) & (step_ns <= MAX_STEP_S * NANOSECONDS)
    if not is_overflow.any():
        return t_ns
    t_ns = t_ns.copy()
    t_ns[rows[1:]] += OVERFLOW_NS * np.cumsum(is_overflow)
    first = rows[1:][is_overflow][0]
    reason = note(
        "recording.counter-overflow",
        table=table.label, line=table.lines[first], count=np.count_nonzero(is_overflow),
        shift_s=OVERFLOW_NS / NANOSECONDS,
    )  # fmt: skip
    findings.append(ImportFinding("counter overflow", "warning", reason, t_ns=int(t_ns[first]) + shift))
    return t_ns


def _dates(table: LogTable, spec: FileSpec) -> np.ndarray:
    cells = table.text(spec.time)
    try:
        return parse_dates(cells)
    except (ValueError, AttributeError):
        raise FileError.of("import.iso8601", table=table.label, column=spec.time, value=cells[0]) from None


def increasing_rows(
    table: LogTable,
    t_ns: np.ndarray,
    spec: FileSpec,
    used_columns: set[str],
    m: ColumnMap,
    findings: list[ImportFinding],
) -> np.ndarray:
    """Return the mask (rows,) of the rows to keep, so that time increases.
    Raise FileError if time steps back, unless the map drops such rows, and if times are repeated or not plausible.
    """
    latest_ns = np.maximum.accumulate(t_ns)
    backward_rows = np.flatnonzero(np.diff(t_ns) < 0)
    if len(backward_rows):
        i = int(backward_rows[0])
        lost_rows = np.count_nonzero(t_ns < latest_ns)
        figures: JsonObject = {
            "table": table.label, "step_s": (t_ns[i] - t_ns[i + 1]) / NANOSECONDS, "line": table.lines[i + 1],
            "count": len(backward_rows), "rows": lost_rows,
        }  # fmt: skip
        if spec.backwards != "drop":
            code = "import.clock-back" if _is_clock_back(table, t_ns, used_columns) else "import.steps-back"
            raise FileError.of(code, **figures, file=spec.name, map=m.path.name)
        findings.append(
            ImportFinding(
                "time steps back", "warning", note("recording.steps-back", **figures), t_ns=int(t_ns[i])
            )
        )
    is_kept = t_ns >= latest_ns
    is_kept[1:] &= (t_ns[1:] > latest_ns[:-1]) | (t_ns[1:] == t_ns[:-1])
    is_kept = _without_repeats(table, t_ns, is_kept, spec, used_columns, m, findings)
    step_s = np.diff(t_ns[is_kept]) / NANOSECONDS
    if len(step_s) and not _is_change_log(table.rows_where(is_kept), step_s, spec, used_columns, m):
        _check_steps(table.rows_where(is_kept), t_ns[is_kept], step_s, spec, m, findings)
    return is_kept


def _is_change_log(
    table: LogTable, step_s: np.ndarray, spec: FileSpec, used_columns: set[str], m: ColumnMap
) -> bool:
    """Return True for a file of commands alone that were logged only when they changed: at irregular times, and almost
    never twice. The steps of such a file do not show gaps.
    """
    other_files = [signal.file for signal in (*m.sensors.values(), *([m.truth] if m.truth else []))]
    if spec.name in (m.ticks, *other_files):
        return False
    rows, columns = np.arange(len(step_s)), used_columns - {spec.time}
    is_repeat = _equal_rows(table, rows, rows + 1, columns) if columns else np.ones(len(rows), dtype=bool)
    is_usual = np.abs(step_s / np.median(step_s) - 1.0) < USUAL_STEP_TOLERANCE
    return float(np.mean(is_repeat)) < MAX_REPEAT_SHARE and float(np.mean(is_usual)) < 0.5


def _is_clock_back(table: LogTable, t_ns: np.ndarray, used_columns: set[str]) -> bool:
    """Return True if most rows that are not later than the rows before them are measurements after a step of the clock.
    After such a step time continues evenly. After late rows it jumps forward. Rows that were written twice are equal
    to earlier rows.
    """
    latest_ns, step = np.maximum.accumulate(t_ns), np.diff(t_ns)
    usual_ns = float(np.median(step[step > 0])) if np.any(step > 0) else 0.0
    is_back = t_ns < latest_ns
    edges = np.flatnonzero(np.diff(np.concatenate([[0], is_back.astype(int), [0]])))
    clock_rows, lost_rows = 0, np.count_nonzero(is_back)
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        is_even = end == len(t_ns) or t_ns[end] - t_ns[end - 1] < GAP_STEPS * usual_ns
        rows = np.arange(first, end)
        earlier_index = np.minimum(np.searchsorted(latest_ns[:first], t_ns[rows]), first - 1)
        is_repeated = bool(np.all(t_ns[earlier_index] == t_ns[rows])) and bool(
            _equal_rows(table, earlier_index, rows, used_columns).all()
        )
        clock_rows += len(rows) if is_even and len(rows) >= MIN_CLOCK_ROWS and not is_repeated else 0
    return bool(2 * clock_rows > lost_rows)


def _equal_rows(table: LogTable, first: np.ndarray, second: np.ndarray, names: set[str]) -> np.ndarray:
    """Return a mask (n,), True if the rows `first` and `second` (n,) agree in the columns `names`."""
    first_rows, second_rows = table.select(first), table.select(second)
    rows = zip(
        *(zip(first_rows.text(c), second_rows.text(c), strict=True) for c in sorted(names)), strict=True
    )
    return np.array([all(a == b for a, b in row) for row in rows])


def _without_repeats(
    table: LogTable,
    t_ns: np.ndarray,
    is_kept: np.ndarray,
    spec: FileSpec,
    column_names: set[str],
    m: ColumnMap,
    findings: list[ImportFinding],
) -> np.ndarray:
    kept_rows = np.flatnonzero(is_kept)
    repeated_rows = np.flatnonzero(np.diff(t_ns[kept_rows]) == 0)
    if not len(repeated_rows):
        return is_kept
    first, second = kept_rows[repeated_rows], kept_rows[repeated_rows + 1]
    is_equal = _equal_rows(table, first, second, column_names)
    line = table.lines[second[0]]
    reason = note("recording.repeats", table=table.label, count=len(repeated_rows), line=line)
    if not is_equal.all() and spec.repeats is None:
        line = table.lines[second[~is_equal][0]]
        if rate_hz := _coarse_rate(t_ns[kept_rows]):
            count = len(kept_rows) - len(repeated_rows)
            figures = {"table": table.label, "column": spec.time, "count": count, "rows": len(kept_rows)}
            raise FileError.of(
                "import.coarse-time", **figures, rate_hz=rate_hz, file=spec.name, map=m.path.name
            )
        raise FileError.of(
            "import.repeats",
            table=table.label,
            count=len(repeated_rows),
            line=line,
            file=spec.name,
            map=m.path.name,
        )
    findings.append(ImportFinding("repeats", "warning", reason, t_ns=int(t_ns[first[0]])))
    is_kept = is_kept.copy()
    is_kept[first if spec.repeats == "last" else second] = False
    return is_kept


def _coarse_rate(t_ns: np.ndarray) -> float:
    """Return the rows per second of times that are too coarse, such as whole seconds; 0 for other repeated times.
    Then each time but the first and the last has about the same number of rows, at least three.
    """
    times_ns, counts = np.unique(t_ns, return_counts=True)
    inner_counts = counts[1:-1]
    usual_count = float(np.median(inner_counts)) if len(inner_counts) else 0.0
    is_even = (
        usual_count >= 3.0
        and float(np.mean(np.abs(inner_counts - usual_count) <= 1.0 + 0.1 * usual_count)) > 0.9
    )
    return NANOSECONDS * usual_count / float(np.median(np.diff(times_ns))) if is_even else 0.0


def _check_steps(
    table: LogTable,
    t_ns: np.ndarray,
    step_s: np.ndarray,
    spec: FileSpec,
    m: ColumnMap,
    findings: list[ImportFinding],
) -> None:
    median_step_s = float(np.median(step_s))
    if not MIN_STEP_S <= median_step_s <= MAX_STEP_S:
        possible_units = _possible_units(median_step_s, len(table.lines), spec)
        remedy = (
            note("import.time-unit", unit_name=possible_units[0]) if possible_units else note("import.time")
        )
        raise FileError.of(
            "import.step",
            table=table.label,
            unit_name=spec.time_unit,
            column=spec.time,
            step_s=median_step_s,
            file=spec.name,
            map=m.path.name,
            remedy=remedy,
        )
    if spec.name == m.ticks and not MIN_USUAL_STEP_S <= median_step_s <= MAX_USUAL_STEP_S:
        findings.append(_tick_rate(table, median_step_s, spec))
    gaps = np.flatnonzero(step_s > GAP_STEPS * median_step_s)
    gaps = gaps[np.argsort(-step_s[gaps], kind="stable")]  # the longest first
    for i in gaps[:20]:
        jump = step_s[i] > MIN_CLOCK_JUMP_S
        reason = note(
            "recording.gap", table=table.label, gap_s=step_s[i], line=table.lines[i], usual_s=median_step_s
        )
        findings.append(
            ImportFinding(
                "time jump" if jump else "gap", "error" if jump else "warning", reason, t_ns=int(t_ns[i])
            )
        )
    if len(gaps) > 20:
        reason = note("recording.more-gaps", table=table.label, count=len(gaps) - 20)
        findings.append(ImportFinding("gap", "warning", reason, t_ns=int(t_ns[gaps[20]])))


def _tick_rate(table: LogTable, median_step_s: float, spec: FileSpec) -> ImportFinding:
    """Return the finding about an unusual tick rate: an error if the ticks are too fast, a warning if they are slow."""
    reason = note(
        "recording.tick-lasts",
        table=table.label,
        unit_name=spec.time_unit,
        tick_s=median_step_s,
        rate_hz=1.0 / median_step_s,
    )
    possible_units = _possible_units(median_step_s, len(table.lines), spec)
    line = (
        note("recording.write-time-unit", unit_name=possible_units[0], file=spec.name)
        if possible_units
        else None
    )
    return ImportFinding(
        "time unit", "error" if median_step_s < MIN_USUAL_STEP_S else "warning", reason, line
    )


def _possible_units(usual_count: float, row_count: int, spec: FileSpec) -> list[str]:
    """Return the other time units with a plausible step and length, the most likely unit first."""
    file_unit = unit(spec.time_unit)
    median_step_s = usual_count / (file_unit.si_factor if file_unit else 1.0)
    steps = {
        name: median_step_s * unit_.si_factor for name in ("s", "ms", "us", "ns") if (unit_ := unit(name))
    }
    possible_units = [
        name for name, step in steps.items() if 1e-3 <= step <= MAX_STEP_S and name != spec.time_unit
    ]
    long_enough = [name for name in possible_units if row_count * steps[name] >= MIN_DURATION_S]
    return sorted(long_enough or possible_units, key=lambda name: abs(np.log(steps[name] / 0.02)))
