"""Read the files of an import: their paths, their rows in order of time, and the parts of a file with several runs.

    split = "COLUMN"       a part for each value of the column, in the order of the file
    split_gap_s = 5.0      a new part after a longer pause, and if the time steps back

If several files of one map are split, their parts are matched by the value of the column; parts between pauses are
matched in order. If a value is missing in one of the files, its part is skipped. From a file that is not split, each
part receives the rows within its time.
"""

import glob
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from baqueano.diagnostics import note
from baqueano.errors import FileError
from baqueano.messages.printable import baqueano_command
from baqueano.runs.diagnostics.finding import ImportFinding
from baqueano.runs.importing.imu_axes import axis_names
from baqueano.runs.importing.joined_rows import joined_rows
from baqueano.runs.importing.timing import increasing_rows, row_times
from baqueano.runs.maps.column_map import data_folders, maps_folder
from baqueano.runs.maps.columns import ColumnMap, Entry, FileSpec
from baqueano.runs.tables import bag
from baqueano.runs.tables.table import LogTable, read_table
from baqueano.signals import NANOSECONDS

MIN_TICKS = 3  # ticks of a run
_SUFFIX = re.compile(r"\.(?:csv|bag|jsonl|ndjson)", re.IGNORECASE)


class Source(NamedTuple):
    """A file of the map after reading: its rows in order of time."""

    table: LogTable
    t_ns: np.ndarray  # (rows,) int64, increasing


class RecordingSources(NamedTuple):
    """The data of one run."""

    name: str
    sources: dict[str, Source]
    files: tuple[str, ...]  # their names
    findings: tuple[ImportFinding, ...]


class SourcePart(NamedTuple):
    """The rows of one file that belong to a part."""

    value: str  # value of the column that splits the file; "" if only pauses split it
    label: str
    table: LogTable


def find_sources(m: ColumnMap, files: object) -> Iterator[RecordingSources]:
    """Yield the parts of each set of files: the given files, or the files that the map finds."""
    for paths in _file_sets(m, files):
        findings: list[ImportFinding] = []
        tables = {name: _read_rows(m, spec, paths[name], findings) for name, spec in m.files.items()}
        names = tuple(sorted({path.name for path in paths.values()}))
        yield from _set_sources(m, _run_name(m, paths), names, tables, findings)


def _set_sources(
    m: ColumnMap,
    name: str,
    files: tuple[str, ...],
    tables: dict[str, LogTable],
    findings: list[ImportFinding],
) -> Iterator[RecordingSources]:
    parts = {file: _parts(m, spec, tables[file]) for file, spec in m.files.items() if _is_split(spec)}
    if not parts:
        sources = {file: _source(m, m.files[file], table, findings) for file, table in tables.items()}
        yield RecordingSources(name, sources, files, tuple(findings))
        return
    if m.ticks not in parts:
        raise FileError.of("import.split-not-ticks", map=m.path.name, file=next(iter(parts)), ticks=m.ticks)
    own_findings: list[ImportFinding] = list(findings)
    matches = _match_parts(m, parts, own_findings)
    undivided_sources = {
        f: _source(m, m.files[f], t, own_findings) for f, t in tables.items() if f not in parts
    }
    for k, (label, by_file) in enumerate(matches):
        own_rows: list[ImportFinding] = list(own_findings) if k == 0 else []
        part_sources = {f: _source(m, m.files[f], table, own_rows) for f, table in by_file.items()}
        t_ns = part_sources[m.ticks].t_ns
        row_masks = {f: _cut_rows(source, t_ns) for f, source in undivided_sources.items()}
        yield RecordingSources(
            f"{name}-{label}", {f: (part_sources | row_masks)[f] for f in tables}, files, tuple(own_rows)
        )


def _is_split(spec: FileSpec) -> bool:
    return spec.split is not None or spec.split_gap_s is not None


def _parts(m: ColumnMap, spec: FileSpec, table: LogTable) -> list[SourcePart]:
    """Return the parts of a file, in the order of the file."""
    rows = np.arange(len(table.lines))
    groups: list[tuple[str, np.ndarray]] = [("", rows)]
    if spec.split is not None:
        values: dict[str, int] = {}  # in the order of the file
        cells = (_plain_label(str(cell)) for cell in table.text(spec.split))
        group_numbers = np.fromiter((values.setdefault(cell, len(values)) for cell in cells), int, len(rows))
        group_ends = np.cumsum(np.bincount(group_numbers))
        groups = list(
            zip(values, np.split(np.argsort(group_numbers, kind="stable"), group_ends[:-1]), strict=True)
        )
    if spec.split_gap_s is None:
        return [SourcePart(value, value, table.select(group_rows)) for value, group_rows in groups]
    t_ns, is_known = row_times(table, spec, m.start_ns, m.path.name, [])
    parts = []
    for value, group_rows in groups:
        timed_rows = np.flatnonzero(is_known[group_rows])  # a row without a time does not split a run
        step = np.diff(t_ns[group_rows][timed_rows])
        edges = timed_rows[1:][(step < 0) | (step > spec.split_gap_s * NANOSECONDS)]
        for k, part in enumerate(np.split(group_rows, edges), 1):
            parts.append(SourcePart(value, f"{value}-{k}".lstrip("-"), table.select(part)))
    return parts


def _match_parts(
    m: ColumnMap, parts: dict[str, list[SourcePart]], findings: list[ImportFinding]
) -> list[tuple[str, dict[str, LogTable]]]:
    """Return the label of each part and its rows in each file, in the order of the ticks' file. Raise FileError if the
    files do not share a value, or if their numbers of parts differ.
    """
    if not all(m.files[name].split for name in parts):  # parts without a value are matched in order
        parts = {name: [p._replace(value="") for p in rows] for name, rows in parts.items()}
    by_file = {name: {part.value: [] for part in rows} for name, rows in parts.items()}
    for name, rows in parts.items():
        for part in rows:
            by_file[name][part.value].append(part)
    common_values = [value for value in by_file[m.ticks] if all(value in p for p in by_file.values())]
    if not common_values:
        text = "; ".join(f"[files.{name}] {_split_values_text(m, name, p)}" for name, p in by_file.items())
        raise FileError.of("import.split-no-value", map=m.path.name, value=text)
    findings += _missing_values(m, by_file)
    labelled_parts = []
    for value in common_values:
        pieces_by_field = {name: piece_by_value[value] for name, piece_by_value in by_file.items()}
        if len({len(rows) for rows in pieces_by_field.values()}) > 1:
            text = ", ".join(f"[files.{name}] {len(rows)}" for name, rows in pieces_by_field.items())
            split = m.files[m.ticks].split
            raise FileError.of("import.parts-differ", map=m.path.name, split=split, value=value, counts=text)
        for combination in zip(*pieces_by_field.values(), strict=True):
            recording = dict(zip(pieces_by_field, combination, strict=True))
            labelled_parts.append(
                (recording[m.ticks].label, {name: part.table for name, part in recording.items()})
            )
    return labelled_parts


def _missing_values(m: ColumnMap, by_file: dict[str, dict[str, list[SourcePart]]]) -> Iterator[ImportFinding]:
    """Yield a finding for each file without values that another file has; the parts of these values are skipped."""
    for name, signals in by_file.items():
        for file, file_values in by_file.items():
            unmatched_values = [value for value in file_values if value not in signals]
            if unmatched_values:
                values, m_name = _split_values_text(m, file, unmatched_values), m.path.name
                reason = note("recording.not-in-all", map=m_name, values=values, file=file, second_file=name)
                yield ImportFinding("not in all files", "warning", reason)


def _split_values_text(m: ColumnMap, name: str, values: Iterable[str]) -> str:
    """Return the column by which a file is split, with these values, as text for a message."""
    texts = list(values)
    rest_text = f", … (+ {len(texts) - 5})" if len(texts) > 5 else ""
    return f"{m.files[name].split} = {', '.join(texts[:5])}{rest_text}"


def _plain_label(label: str) -> str:
    """Return a value in the form for a run's name: "3.0" becomes "003"."""
    integer_text = label.removesuffix(".0")
    return integer_text.zfill(3) if integer_text.isdecimal() else label


def _cut_rows(source: Source, t_ns: np.ndarray) -> Source:
    """Return the rows of `source` from the first to the last tick of a part, `t_ns`, and the previous row."""
    if len(t_ns) < 2:
        return source
    step = int(np.median(np.diff(t_ns)))
    is_kept = (source.t_ns > t_ns[0] - step) & (source.t_ns <= t_ns[-1])
    is_kept[max(int(np.searchsorted(source.t_ns, t_ns[0])) - 1, 0)] = True
    return source._replace(table=source.table.rows_where(is_kept), t_ns=source.t_ns[is_kept])


def _run_name(m: ColumnMap, paths: dict[str, Path]) -> str:
    """Return the run's name: the name of the file if the map accepts different files, else the name of the map."""
    run_paths = [
        paths[name] for name, spec in m.files.items() if spec.path is None or glob.has_magic(spec.path)
    ]
    return _SUFFIX.split(run_paths[0].name)[0] if run_paths else m.name


def _file_sets(m: ColumnMap, files: Any) -> list[dict[str, Path]]:
    """Return the path of each [files.NAME], one dict per set of files.
    Raise FileError if the given files do not match the files of the map.
    """
    pairs = [str(path).partition("=") for path in files]
    if not isinstance(files, dict) and files and all(name in m.files for name, *_ in pairs):  # NAME=PATH
        files = {name: path for name, _, path in pairs}
    if files and not isinstance(files, dict):
        names = _names_for_paths(m, all_paths := [path for file in files for path in _expand(Path(file))])
        return [_with_default_paths(m, dict.fromkeys(names, path)) for path in all_paths]
    paths = {name: Path(path) for name, path in dict(files).items()}
    for name in paths:
        if name not in m.files:
            raise FileError.of("import.file-unknown", map=m.path.name, value=name, valid=m.files)
    return [_with_default_paths(m, paths | pattern_specs) for pattern_specs in _starred_files(m, paths)]


def _names_for_paths(m: ColumnMap, paths: list[Path]) -> list[str]:
    """Return the names in the map that receive paths given without a name: those without a path in the map."""
    names = [name for name, spec in m.files.items() if spec.path is None]
    if not names and len({spec.path for spec in m.files.values()}) == 1:
        names = list(m.files)
    other_names = [name for name in m.files if name not in names]
    if names and (len(paths) == 1 or not other_names):
        return names
    code, first = "import.file-shared" if names else "import.all-with-path", next(iter(m.files))
    raise FileError.of(code, map=m.path.name, files=m.files, option=other_names[:1], first=first)


def _starred_files(m: ColumnMap, paths: dict[str, Path]) -> list[dict[str, Path]]:
    """Return the files that match the only path with a * in the map, one dict each; one empty dict without a *."""
    pattern_specs = {n: s for n, s in m.files.items() if n not in paths and s.path and glob.has_magic(s.path)}
    patterns = sorted({str(spec.path) for spec in pattern_specs.values()})
    if len(patterns) > 1:
        raise FileError.of("import.stars", map=m.path.name, paths=" and ".join(map(repr, patterns)))
    if not patterns:
        return [{}]
    return [
        dict.fromkeys(pattern_specs, path) for path in _matching_paths(m, next(iter(pattern_specs.values())))
    ]


def _expand(path: Path) -> list[Path]:
    """Return the files that match a path, which can contain *. Raise FileError if a pattern does not match a file."""
    if not glob.has_magic(str(path)) or path.exists():
        return [path]
    matches = sorted(glob.glob(str(path)))
    if not matches:
        raise FileError.of("import.no-file-like", path=path)
    return [Path(match_) for match_ in matches]


def _with_default_paths(m: ColumnMap, paths: dict[str, Path]) -> dict[str, Path]:
    return {name: paths[name] if name in paths else _log_path(m, spec) for name, spec in m.files.items()}


def _log_path(m: ColumnMap, spec: FileSpec) -> Path:
    if spec.path is None:
        open_names = [name for name, s in m.files.items() if s.path is None]
        values = ["FILE"] if len(open_names) == 1 else [f"{name}=FILE" for name in open_names]
        fix = baqueano_command(
            "runs", "import", m.path.stem if m.path.parent == maps_folder() else m.path, *values
        )
        raise FileError.of("import.no-path", fix, map=m.path.name, file=spec.name)
    return _matching_paths(m, spec)[0]


def _paths_like(folder: Path, pattern: str) -> list[Path]:
    try:
        return sorted(folder.glob(pattern))
    except (OSError, ValueError, NotImplementedError, IndexError):  # no pattern
        return []


def path_exists(path: Path) -> bool:
    """Return True if the file exists, False even for a name that the system does not accept."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def _matching_paths(m: ColumnMap, spec: FileSpec) -> list[Path]:
    """Return the files next to the map or in a data folder that match the path of `spec`, which can contain *.
    Raise FileError if none matches.
    """
    path = spec.path or ""
    folders = [m.path.parent, *data_folders()]
    for folder in folders:
        matches = _paths_like(folder, path) if glob.has_magic(path) else [folder / path]
        if matches and path_exists(matches[0]):
            return matches
    folder_names = ", ".join(str(folder) for folder in folders)
    raise FileError.of(
        "import.file-absent", map=m.path.name, file=spec.name, absent_path=path, folders=folder_names
    )


def _read_rows(m: ColumnMap, spec: FileSpec, path: Path, findings: list[ImportFinding]) -> LogTable:
    """Return the rows of a file that satisfy `where`, in the file's order. Raise FileError if no row satisfies it."""
    label, column_names = path.name if spec.topic is None else f"{path.name} {spec.topic}", _columns(m, spec)
    if bag.is_bag(path):
        table = bag.read_topic(path, spec.topic, column_names, path.name)
    else:
        if spec.topic is not None:
            raise FileError.of(
                "import.no-bag", path=path.name, map=m.path.name, file=spec.name, topic=spec.topic
            )
        table = read_table(path, spec.options, label)
    findings += [
        ImportFinding("cut line", "warning", note("recording.cut-line", table=label, line=line))
        for line in table.cut
    ]
    for column in sorted(column_names):
        table.text(column)  # raises FileError for a missing column
    if not len(table.lines):
        raise FileError.of("import.no-rows", table=label)
    selection = _select(table, spec)
    if not len(selection.lines):
        raise FileError.of("import.where-empty", table=label, condition=str(spec.where))
    names = column_names | axis_names(selection.columns)
    return selection._replace(columns={name: selection.columns[name] for name in names})


def _source(m: ColumnMap, spec: FileSpec, table: LogTable, findings: list[ImportFinding]) -> Source:
    """Return the rows with a known, increasing time; with `new_when`, only the rows of a new measurement.
    Raise FileError if no time is known.
    """
    t_ns, is_known = row_times(table, spec, m.start_ns, m.path.name, findings)
    if not is_known.any():
        raise FileError.of("import.no-time", table=table.label, column=spec.time)
    if not is_known.all():
        reason = note("recording.no-time", table=table.label, count=np.count_nonzero(~is_known))
        findings.append(ImportFinding("no time", "warning", reason))
        table, t_ns = table.rows_where(is_known), t_ns[is_known]
    table, t_ns = joined_rows(table, t_ns, spec, {*table.columns}, findings)
    is_kept = increasing_rows(table, t_ns, spec, _columns(m, spec), m, findings)
    table, t_ns = table.rows_where(is_kept), t_ns[is_kept]
    if spec.new_when is not None:
        is_new = np.diff(table.numbers(spec.new_when), prepend=np.nan) != 0
        table, t_ns = table.rows_where(is_new), t_ns[is_new]
    return Source(table, t_ns)


def _columns(m: ColumnMap, spec: FileSpec) -> set[str]:
    """Return the columns of a file that the map uses."""
    signals = [m.command, *m.sensors.values(), *([m.truth] if m.truth else [])]
    second_column = spec.time_rest and spec.time_rest[0]
    column_names = {
        *spec.where,
        *(column for column in (spec.time, second_column, spec.new_when, spec.split) if column),
    }
    for signal in signals:
        if signal.file == spec.name:
            for entry in signal.entries:
                column_names |= {
                    *xyzw_columns(entry),
                    *entry.backward,
                    *(c for c in (entry.column, entry.times) if c),
                }
    return column_names


def xyzw_columns(entry: Entry) -> Sequence[str]:
    """Return the columns x, y, z, w of a quaternion entry, () for any other entry."""
    if entry.quaternion is None:
        return ()
    if len(entry.quaternion) == 1:
        return [f"{entry.quaternion[0]}.{axis}" for axis in "xyzw"]
    return entry.quaternion


def _select(table: LogTable, spec: FileSpec) -> LogTable:
    """Return the rows that satisfy `where`. A condition is a value, several values, or {min = …, max = …, not = …}."""
    for column, condition in spec.where.items():
        limits = condition if isinstance(condition, dict) else {"is": condition}
        for comparison, limit in limits.items():
            table = table.rows_where(_mask(table, spec, column, comparison, limit))
    return table


def _mask(table: LogTable, spec: FileSpec, column: str, comparison: str, limit: Any) -> np.ndarray:
    """Return a mask (rows,): True for the rows that satisfy one condition. Raise FileError for an unknown condition."""
    if comparison in ("is", "not"):
        limits = limit if isinstance(limit, list) else [limit]
        if all(isinstance(value, str | int | float) for value in limits):
            is_equal = np.any([table.has(column, value) for value in limits], axis=0)
            return is_equal if comparison == "is" else ~is_equal
    elif comparison in ("min", "max") and isinstance(limit, int | float):
        values = table.numbers(column)
        return values >= limit if comparison == "min" else values <= limit
    raise FileError.of("import.where", file=spec.name, column=column)
