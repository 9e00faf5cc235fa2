"""Import recordings as runs: `import_run("cpm_run_a")`, `import_runs("trials.toml", ["log.csv"])`.

The ticks are the instants of the file that [ticks] names. `applied_commands` contains the command during the
interval that ends at the tick. Sensors keep their own instants and arrive with the next tick. Ticks can be irregular.
Several files, or a file that is split (sources.py), become several runs.
"""

import re
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from baqueano.contracts.calls import checked_call
from baqueano.contracts.result import Result, shorten
from baqueano.contracts.values import TableRow
from baqueano.diagnostics import Diagnostic, note
from baqueano.errors import FileError
from baqueano.geometry import wrap
from baqueano.messages import english_text
from baqueano.messages.language import translate as _
from baqueano.messages.printable import baqueano_command
from baqueano.messages.text_table import text_table
from baqueano.runs.container.writer import versions
from baqueano.runs.diagnostics import cross_checks
from baqueano.runs.diagnostics.finding import ImportFinding
from baqueano.runs.importing.direction import unsigned_speeds, without_unknown_direction
from baqueano.runs.importing.full_scale import without_full_scale
from baqueano.runs.importing.imu_axes import axis_findings
from baqueano.runs.importing.joined_rows import is_slower_topic
from baqueano.runs.importing.rates import counter_findings, is_wrapped_angle, rates, times_ns
from baqueano.runs.importing.sources import MIN_TICKS, RecordingSources, Source, find_sources, xyzw_columns
from baqueano.runs.maps.column_map import load_map
from baqueano.runs.maps.columns import KINDS, ColumnMap, ColumnSignal, Entry
from baqueano.runs.maps.units import unit
from baqueano.runs.run import MEANS_KEY, Channel, Event, Run, TruthLog
from baqueano.signals import NANOSECONDS
from baqueano.vehicles.drivetrain import unmix

MAX_SIMILAR_LINES = 3  # lines of a kind of finding


class ImportedRun(NamedTuple):
    """An imported run and the findings that arose during its import."""

    run: Run
    findings: tuple[ImportFinding, ...]

    _repr_html_ = Result._repr_html_
    plot = Result.plot
    to_pandas = Result.to_pandas

    @property
    def verdict(self) -> str:
        """Return WARN if a finding is a warning, such as excluded or doubtful data, else USABLE."""
        return "WARN" if any(d.level == "warning" for d in self.findings) else "USABLE"

    @property
    def without_common_findings(self) -> "ImportedRun":
        """Return the import without the findings that every import with this kind of map produces."""
        return self._replace(findings=tuple(d for d in self.findings if not d.usual))

    def __repr__(self) -> str:
        findings = self.without_common_findings.table().splitlines()
        return shorten([self.run.table().partition("\n")[0]], findings, [_(self.verdict)])

    def rows(self) -> list[TableRow]:
        """Return the findings as flat dicts."""
        start = int(self.run.t_ns[0])
        return [
            {
                "level": d.level,
                "finding": d.code,
                "t_s": None if d.t_ns is None else (d.t_ns - start) * 1e-9,
                "text": d.advice,
            }
            for d in self.findings
        ]

    def table(self) -> str:
        """Return one line per finding. Of a kind with more than MAX_SIMILAR_LINES findings, return only the first
        finding and the number of findings."""
        finding_counts = Counter((d.level, d.code) for d in self.findings)
        lines: dict[object, list[str]] = {}
        for k, d in enumerate(self.findings):
            n = finding_counts[d.level, d.code]
            tail = f" ({_('and {more} more such', more=n - 1)})" if n > MAX_SIMILAR_LINES else ""
            line = [_(d.level), _(d.code), f"{d.advice}{tail}"]
            lines.setdefault((d.level, d.code) if tail else k, line)
        return "\n".join(text_table("<<<", *lines.values()))


class ImportedRuns(NamedTuple):
    """Several imported runs, each with the findings of its import."""

    imported_runs: tuple[ImportedRun, ...]

    @property
    def verdict(self) -> str:
        """Return WARN if the verdict of a run is WARN, else USABLE."""
        return "WARN" if any(run.verdict == "WARN" for run in self.imported_runs) else "USABLE"

    def rows(self) -> list[TableRow]:
        """Return the findings about all runs as flat dicts."""
        return [{"run": run.run.name} | row for run in self.imported_runs for row in run.rows()]

    def table(self) -> str:
        """Return a line per kind of finding: the number of runs with it, and the sentence of the first finding."""
        first: dict[tuple[str, str], ImportFinding] = {}
        counts: dict[tuple[str, str], int] = {}
        for run in self.imported_runs:
            for d in {d.code: d for d in reversed(run.without_common_findings.findings)}.values():
                first.setdefault((d.level, d.code), d)
                counts[d.level, d.code] = counts.get((d.level, d.code), 0) + 1
        lines = []
        for (level, code), d in first.items():
            runs, total = counts[level, code], len(self.imported_runs)
            advice = _("in {runs} of {of} runs; the first: {advice}", runs=runs, of=total, advice=d.advice)
            lines.append([_(level), _(code), advice])
        return "\n".join(text_table("<<<", *lines)) or _("nothing in the data was doubtful")


@checked_call('bq.import_run("map.toml", ["recording.csv"])')
def import_run(
    column_map: ColumnMap | Path | str,
    files: Path | str | list[Path | str] | dict[str, Path | str] | None = None,
    vehicle_text: str = "",
) -> ImportedRun:
    r"""Import the files of a recording by a map, and return their run in SI units.

    Parameters
    ----------
    column_map : ColumnMap, path or str
        A map, its path, or the name of a map of the package; docs/importing.md describes maps.
    files : path, list or dict, optional
        A path for each [files.NAME] by name, or one path for all files without a path in the map.
    vehicle_text : str
        Text of the vehicle file, stored in the run.

    Returns
    -------
    ImportedRun
        The run and the findings about it, which the run also contains as events.

    Raises
    ------
    FileError
        If the recording contradicts its map, or contains several runs.

    Examples
    --------
    >>> _ = Path("log.csv").write_text("t_ms,duty\n0,0\n20,50\n40,50\n60,40\n")
    >>> _ = Path("log.toml").write_text('''format = 1
    ... name = "log"
    ... files.log = { time = "t_ms", time_unit = "ms" }
    ... command = { names = ["u"], in_force = "from", u = [{ column = "duty", unit = "raw", scale = 0.01 }] }
    ... ''')
    >>> log = import_run("log.toml", ["log.csv"])
    >>> log.run.t_s.tolist(), log.run.applied_commands.ravel().tolist(), log.verdict
    ([0.0, 0.02, 0.04], [0.0, 0.5, 0.5], 'USABLE')
    """
    m = column_map if isinstance(column_map, ColumnMap) else load_map(column_map)
    runs = import_runs(m, files, vehicle_text)
    if len(runs) > 1:
        line = baqueano_command("runs", "import", m.path)
        raise FileError.of("import.several-runs", map=m.path.name, count=len(runs), line=line)
    return runs[0]


def import_runs(
    column_map: ColumnMap | Path | str,
    files: Path | str | list[Path | str] | dict[str, Path | str] | None = None,
    vehicle_text: str = "",
) -> list[ImportedRun]:
    """Return all runs of the files of a map, in order: one per file, or one per part of a split file.
    Parts with fewer ticks than a run needs are skipped, and a finding of the first run reports them. Raise FileError as
    `import_run` does, and if all parts are too short."""
    m = column_map if isinstance(column_map, ColumnMap) else load_map(column_map)
    runs, failures, source = [], [], None
    for recording in find_sources(m, [files] if isinstance(files, str | Path) else files or {}):
        if len(recording.sources[m.ticks].t_ns) < MIN_TICKS:
            failures.append(recording.name)
            source = recording.sources[m.ticks]
        else:
            runs.append(_import_part(m, recording, vehicle_text))
    if missing_signs := unsigned_speeds([finding for run in runs for finding in run.findings]):
        runs = [_with_findings(run.run, m, [*run.findings, *missing_signs]) for run in runs]
    if not runs and source:
        figures = {"table": source.table.label, "rows": len(source.t_ns), "parts": len(failures)}
        raise FileError.of("import.too-short", **figures, minimum=MIN_TICKS)
    if failures:
        reason = note("recording.short-parts", count=len(failures), minimum=MIN_TICKS, names=failures[:5])
        first = runs[0]
        runs[0] = first._replace(findings=(*first.findings, ImportFinding("short", "warning", reason)))
    return runs


def _import_part(m: ColumnMap, recording: RecordingSources, vehicle_text: str) -> ImportedRun:
    """Return the run of one part, with its findings."""
    sources, findings = recording.sources, list(recording.findings)
    first, t_ns, applied_commands = _applied_commands(m, sources, sources[m.ticks].t_ns, findings)
    sensors = {name: _channel(signal, sources, t_ns, findings) for name, signal in m.sensors.items()}
    for signal in m.sensors.values():
        source = sources[signal.file]
        findings += [*axis_findings(signal, source.table), *counter_findings(signal, source)]
    truth = None if m.truth is None else _truth(m.truth, sources, t_ns, findings)
    metadata = versions() | {
        "kind": "import",
        "map": m.name,
        "map_text": m.text,
        "commands": ", ".join(m.names),
        "files": ", ".join(recording.files),
    }
    if means := [name for name, s in m.sensors.items() if s.sample == "measured" and s.is_rate]:
        metadata[MEANS_KEY] = ", ".join(means)
    run = Run(
        recording.name, None, t_ns, applied_commands, sensors=sensors, truth=truth, vehicle_text=vehicle_text,
        metadata=metadata
    )  # fmt: skip
    if first:
        is_usual, reason = first == 1 and m.in_force == "from", note("recording.no-command-yet", count=first)
        findings.append(ImportFinding("no command yet", "info", reason, t_ns=int(t_ns[0]), usual=is_usual))
    if all(entry.constant == 0.0 for entry in m.command.entries):
        findings.append(
            ImportFinding("no command", "info", note("recording.no-command"), t_ns=int(t_ns[0]), usual=True)
        )
    findings += cross_checks.cross_check(run, m)
    return _with_findings(run, m, findings)


def _with_findings(run: Run, m: ColumnMap, findings: list[ImportFinding]) -> ImportedRun:
    """Return the run with its findings as events, without the readings that they exclude."""
    run, findings = without_unknown_direction(run, m, findings)
    findings = list(dict.fromkeys(findings))  # two parts of one file have the same gaps
    result = cross_checks.accept_errors(findings, m)
    events = tuple(
        Event(d.t_ns or int(run.t_ns[0]), d.level, "import", english_text(d.diagnostic), d.diagnostic)
        for d in result
    )
    object.__setattr__(run, "events", tuple(sorted(events, key=lambda e: e.t_ns)))
    return ImportedRun(run, result)


@np.errstate(divide="ignore", invalid="ignore", over="ignore")  # what is not finite is not known
def _values(signal: ColumnSignal, source: Source) -> np.ndarray:
    """Return the values (rows, entries) in SI, by (1) of column_map."""
    columns = []
    for entry in signal.entries:
        entry_unit = unit(entry.unit)
        if entry.quaternion is not None:
            x, y, z, w = (source.table.numbers(name) for name in xyzw_columns(entry))
            column = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        elif entry.constant is not None:
            column = np.full(len(source.t_ns), entry.constant * entry.si_factor)
        else:
            column = source.table.numbers(entry.column or "") * entry.si_factor
            _check_header(entry)
        if entry.derivative:
            step = np.diff(np.where(np.isfinite(column), column, np.nan))
            if entry.wraps is not None:
                turn = entry.wraps * entry.si_factor
                step = step - turn * np.rint(step / turn)  # the shorter direction around the circle
            elif entry_unit and entry_unit.measures == "angle" and is_wrapped_angle(column):
                step = wrap(step)
            column = rates(step, np.diff(source.t_ns) / NANOSECONDS, signal.is_rate)
        column = entry.scale * entry.radius_m * column + entry.offset
        column = column if entry.times is None else column * source.table.numbers(entry.times)
        for name, value in entry.backward.items():
            column = np.where(source.table.has(name, value), -column, column)
        columns.append(column)
    return np.column_stack(columns)


def _check_header(entry: Entry) -> None:
    """Raise FileError if the column name states another unit than the map: `speed [km/h]` with m/s in the map."""
    header_match = re.search(r"[\[(]([^\[()\]]+)[\])]\s*$", entry.column or "")
    header_unit, map_unit = unit(header_match[1]) if header_match else None, unit(entry.unit)
    has_unit = header_unit is not None and header_unit.measures not in ("ratio", "raw", "counts")
    if has_unit and map_unit is not None and header_unit != map_unit and map_unit.measures != "raw":
        raise FileError.of(
            "import.unit-of-name",
            key=entry.key,
            value=entry.unit,
            column=entry.column,
            unit_name=header_match[1] if header_match else "",
        )


def _finite_rows(
    signal: ColumnSignal, source: Source, findings: list[ImportFinding]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the mask (rows,) of the rows with all values, and their values.
    A finding reports the missing values. Raise FileError if no row is left.
    """
    values = _values(signal, source)
    present_columns = [k for k, entry in enumerate(signal.entries) if not entry.is_absent]
    is_complete = np.asarray(np.isfinite(values[:, present_columns]).all(axis=1))
    has_rate = any(e.derivative for e in signal.entries)
    # a rate needs both neighbours
    rows = slice(int(has_rate), -1 if has_rate and not signal.is_rate else None)
    lost_rows = np.count_nonzero(~is_complete[rows])
    if lost_rows:
        first_ns = int(source.t_ns[rows][~is_complete[rows]][0])
        reason = note("recording.missing", key=signal.key, excluded_rows=lost_rows, rows=len(is_complete))
        level = "info" if is_slower_topic(np.flatnonzero(is_complete)) else "warning"
        findings.append(ImportFinding("missing", level, reason, t_ns=first_ns))
    if not is_complete.any():
        raise FileError.of("import.no-row", key=signal.key, table=source.table.label)
    return is_complete, without_full_scale(signal, source, values, findings)[is_complete]


def _applied_commands(
    m: ColumnMap, sources: dict[str, Source], ticks: np.ndarray, findings: list[ImportFinding]
) -> tuple[int, np.ndarray, np.ndarray]:
    """Return the number of ticks before the first command, the ticks (N,) [ns] with a command, and their commands
    (N, n). Raise FileError if no tick has a command.
    """
    is_complete, u = _finite_rows(m.command, sources[m.command.file], findings)
    t_ns = sources[m.command.file].t_ns[is_complete]
    if m.wheels:
        u = np.array([unmix("two_wheels", w) for w in u])
    if m.in_force == "from":
        rows_before = np.searchsorted(t_ns, ticks, side="left") - 1
    else:
        rows_before = np.searchsorted(t_ns, ticks, side="left")
    is_within = (rows_before >= 0) & (rows_before < len(t_ns))
    if not is_within.any():
        raise FileError.of(
            "import.no-command",
            map=m.path.name,
            ticks=m.ticks,
            commands=m.command.file,
            ticks_span=_span(ticks),
            commands_span=_span(t_ns),
        )
    first = int(np.argmax(is_within))
    return first, ticks[is_within], u[rows_before[is_within]]


def _span(t_ns: np.ndarray) -> Diagnostic:
    return note("import.span", first_s=t_ns[0] / NANOSECONDS, last_s=t_ns[-1] / NANOSECONDS)


def _sample(
    signal: ColumnSignal, sources: dict[str, Source], ticks: np.ndarray, findings: list[ImportFinding]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times and arrivals (M,) [ns] and values (M, m) of a signal, as measured or resampled at the ticks.
    Raise FileError if all its times are before or after the ticks.
    """
    source = sources[signal.file]
    is_complete, values = _finite_rows(signal, source, findings)
    t_ns, arrival_ns = (times[is_complete] for times in times_ns(signal, source))
    if t_ns[-1] < ticks[0] or t_ns[0] > ticks[-1]:
        raise FileError.of(
            "import.clocks-differ",
            key=signal.key,
            table=source.table.label,
            span=_span(t_ns),
            ticks_span=_span(ticks),
            file=signal.file,
        )
    if signal.sample == "measured":
        return t_ns, arrival_ns, values
    ticks_within = ticks[(ticks >= t_ns[0]) & (ticks <= t_ns[-1])]
    if signal.sample == "hold":
        return ticks_within, ticks_within, values[np.searchsorted(t_ns, ticks_within, side="right") - 1]
    x, x_ticks = (t_ns - t_ns[0]) / NANOSECONDS, (ticks_within - t_ns[0]) / NANOSECONDS
    angles = [not e.derivative and unit(e.unit).measures == "angle" for e in signal.entries]  # pyright: ignore[reportOptionalMemberAccess]
    columns = [np.unwrap(c) if a else c for c, a in zip(values.T, angles, strict=True)]
    return ticks_within, ticks_within, np.column_stack([np.interp(x_ticks, x, c) for c in columns])


def _channel(
    signal: ColumnSignal, sources: dict[str, Source], ticks: np.ndarray, findings: list[ImportFinding]
) -> Channel:
    t_ns, arrival_ns, z = _sample(signal, sources, ticks, findings)
    angles = [measures == "angle" for measures in KINDS.get(signal.kind or "", ())]
    if any(angles):
        z = np.where(angles, wrap(z), z)
    return Channel(t_ns, arrival_ns, z)


def _truth(
    signal: ColumnSignal, sources: dict[str, Source], ticks: np.ndarray, findings: list[ImportFinding]
) -> TruthLog:
    t_ns, _, values = _sample(signal, sources, ticks, findings)
    nan_rates = np.full((len(t_ns), 3), np.nan)
    eta = np.column_stack([values[:, :2], wrap(values[:, 2])])
    return TruthLog(
        t_ns, *signal.mount.body_motion(eta, values[:, 3:] if values.shape[1] == 6 else nan_rates), nan_rates
    )
