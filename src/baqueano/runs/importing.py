"""Other people's recordings as runs: `import_run("cpm_run_a")`.

The ticks are the instants of the file that [ticks] names. `applied` is the command in force during the
interval that ends at the tick; sensors keep their own instants and arrive with the next tick. No regular grid
is assumed.
"""

import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from baqueano.errors import FileError
from baqueano.geometry import wrap
from baqueano.runs import bag, doubts
from baqueano.runs.column_map import ColumnMap, Entry, FileSpec, Signal, data_folders, load_map
from baqueano.runs.doubts import Doubt
from baqueano.runs.run import Channel, Event, Run, TruthLog
from baqueano.runs.table import Table, read_table
from baqueano.runs.timing import rows_in_order, times
from baqueano.runs.units import unit
from baqueano.runs.writer import versions
from baqueano.signals import NANOSECONDS


class Imported(NamedTuple):
    """A run from elsewhere and what was seen on the way."""

    run: Run
    doubts: tuple[Doubt, ...]

    @property
    def verdict(self) -> str:
        """USABLE, or WARN where something had to be left out or was doubted."""
        return "WARN" if any(d.level == "warning" for d in self.doubts) else "USABLE"

    def rows(self) -> list[dict[str, Any]]:
        """The doubts as flat dicts."""
        start = int(self.run.t_ns[0])
        return [
            {
                "level": d.level,
                "doubt": d.code,
                "t_s": None if d.t_ns is None else (d.t_ns - start) * 1e-9,
                "text": d.text,
            }
            for d in self.doubts
        ]

    def table(self) -> str:
        """The doubts, one per line."""
        return "\n".join(f"{d.level:8} {d.code:20} {d.text}" for d in self.doubts)


class Source(NamedTuple):
    """A file of the map, read: its rows in the order of time."""

    spec: FileSpec
    table: Table
    t_ns: np.ndarray


def import_run(
    column_map: ColumnMap | Path | str,
    files: list[Path | str] | dict[str, Path | str] | None = None,
    vehicle_text: str = "",
) -> Imported:
    """The run that a map makes of its files.

    `files`: a path for each [files.NAME] by name, or one path for all that have none in the map. FileError
    where the recording contradicts its map; what is only noticed stands in the doubts, and as events in the
    run.
    """
    m = column_map if isinstance(column_map, ColumnMap) else load_map(column_map)
    found: list[Doubt] = []
    paths = _paths(m, files or {})
    sources = {name: _source(m, spec, paths[name], found) for name, spec in m.files.items()}
    ticks = sources[m.ticks].t_ns
    if len(ticks) < 3:
        raise FileError(
            f"{sources[m.ticks].table.label} leaves {len(ticks)} rows for the ticks of a run; at least 3 "
            "are needed."
        )
    first, t_ns, applied = _applied(m, sources, ticks, found)
    sensors = {name: _channel(signal, sources, t_ns, found) for name, signal in m.sensors.items()}
    truth = None if m.truth is None else _truth(m.truth, sources, t_ns, found)
    metadata = versions() | {
        "kind": "import",
        "map": m.name,
        "map_text": m.text,
        "commands": ", ".join(m.names),
    }
    metadata["files"] = ", ".join(sorted({path.name for path in paths.values()}))
    run = Run(
        _name(m, paths),
        None,
        t_ns,
        applied,
        sensors=sensors,
        truth=truth,
        vehicle_text=vehicle_text,
        metadata=metadata,
    )
    if first:
        found.append(
            Doubt(
                "no command yet",
                "info",
                int(t_ns[0]),
                f"{first} ticks before the first command were left out",
            )
        )
    found += doubts.look(run, m)
    judged = doubts.judged(list(dict.fromkeys(found)), m)  # two parts of one file have the same gaps
    events = tuple(Event(d.t_ns or int(t_ns[0]), d.level, "import", f"{d.code}: {d.text}") for d in judged)
    object.__setattr__(run, "events", tuple(sorted(events, key=lambda e: e.t_ns)))
    return Imported(run, judged)


def _name(m: ColumnMap, paths: dict[str, Path]) -> str:
    """The map's, or that of the file where the map is for many files."""
    given = [paths[name] for name, spec in m.files.items() if spec.path is None]
    return given[0].name.split(".csv")[0].split(".bag")[0] if given else m.name


def _paths(m: ColumnMap, files: Any) -> dict[str, Path]:
    told: dict[str, Path] = {}
    named = [str(path).partition("=") for path in files]
    if not isinstance(files, dict) and files and all(name in m.files for name, *_ in named):  # NAME=PATH
        files = {name: path for name, _, path in named}
    if isinstance(files, dict):
        told = {name: Path(path) for name, path in files.items()}
    elif files:
        open_names = [name for name, spec in m.files.items() if spec.path is None]
        if not open_names and len({spec.path for spec in m.files.values()}) == 1:
            open_names = list(m.files)
        if len(files) > 1 or not open_names:
            raise FileError(
                f"{m.path.name} has the files {', '.join(m.files)}, "
                f"{'all with a path' if not open_names else 'and one path is given for all'}; say which is "
                "which: "
                f"{next(iter(m.files))}=PATH"
            )
        told = dict.fromkeys(open_names, Path(files[0]))
    for name in told:
        if name not in m.files:
            raise FileError(f"{m.path.name} has no [files.{name}]; it has {', '.join(m.files)}.")
    return {name: told[name] if name in told else _found(m, spec) for name, spec in m.files.items()}


def _found(m: ColumnMap, spec: FileSpec) -> Path:
    if spec.path is None:
        raise FileError(
            f"{m.path.name} [files.{spec.name}] has no path, so it is given on the command line: "
            f"baqueano runs import {m.path.stem} FILE"
        )
    folders = [m.path.parent, *data_folders()]
    for folder in folders:
        if (folder / spec.path).exists():
            return folder / spec.path
    looked = ", ".join(str(folder) for folder in folders)
    raise FileError(
        f"{m.path.name} [files.{spec.name}] path = {spec.path!r}: there is no such file in {looked}. Say "
        "where the "
        "recordings are: set BAQUEANO_DATA to their folder"
    )


def _source(m: ColumnMap, spec: FileSpec, path: Path, found: list[Doubt]) -> Source:
    label = path.name if spec.topic is None else f"{path.name} {spec.topic}"
    if bag.is_bag(path):
        table = bag.read_topic(path, spec.topic, _columns(m, spec), path.name)
    else:
        if spec.topic is not None:
            raise FileError(
                f"{path.name} is no bag, but {m.path.name} [files.{spec.name}] asks for topic {spec.topic!r}."
            )
        table = read_table(path, spec.options, label)
    found += [Doubt("cut line", "warning", None, f"{label}: {note}") for note in table.notes]
    for column in sorted(_columns(m, spec)):
        table.text(column)  # they are all there
    if not len(table.lines):
        raise FileError(f"{label} has names of columns but no rows. Is it the right file?")
    table = _chosen(table, spec)
    t_ns, known = times(table, spec, m.start_ns, m.path.name)
    if not known.all():
        text = f"{label}: {np.count_nonzero(~known)} rows without a time were left out"
        found.append(Doubt("no time", "warning", None, text))
        table, t_ns = table.only(known), t_ns[known]
    if not len(t_ns):
        raise FileError(f"{label}: no row is left by where = {spec.where}. Are column and value right?")
    keep = rows_in_order(table, t_ns, spec, _columns(m, spec), m, found)
    table, t_ns = table.only(keep), t_ns[keep]
    if spec.new_when is not None:
        new = np.diff(table.numbers(spec.new_when), prepend=np.nan) != 0
        table, t_ns = table.only(new), t_ns[new]
    return Source(spec, table, t_ns)


def _columns(m: ColumnMap, spec: FileSpec) -> set[str]:
    """The columns of a file that the map uses."""
    signals = [m.command, *m.sensors.values(), *([m.truth] if m.truth else [])]
    used = {spec.time, *spec.where, *([spec.new_when] if spec.new_when else [])}
    for signal in signals:
        if signal.file == spec.name:
            for entry in signal.entries:
                used |= {*_quaternion(entry), *(c for c in (entry.column, entry.times) if c)}
    return used


def _quaternion(entry: Entry) -> list[str]:
    if entry.quaternion is None:
        return []
    if len(entry.quaternion) == 1:
        return [f"{entry.quaternion[0]}.{axis}" for axis in "xyzw"]
    return list(entry.quaternion)


def _chosen(table: Table, spec: FileSpec) -> Table:
    """The rows that `where` asks for: a value, or {min = …, max = …, not = …}."""
    for column, wanted in spec.where.items():
        if isinstance(wanted, str):
            keep = np.array([cell == wanted for cell in table.text(column)], dtype=bool)
        else:
            values = table.numbers(column)
            limits = wanted if isinstance(wanted, dict) else {"min": wanted, "max": wanted}
            if set(limits) - {"min", "max", "not"}:
                raise FileError(f"[files.{spec.name}] where {column}: known are a value, min, max and not.")
            keep = (values >= limits.get("min", -np.inf)) & (values <= limits.get("max", np.inf))
            keep &= values != limits.get("not", np.nan)
        table = table.only(keep)
    return table


def _values(signal: Signal, source: Source) -> np.ndarray:
    """(rows, entries) in SI, by (1) of column_map."""
    columns = []
    for entry in signal.entries:
        known = unit(entry.unit)
        if entry.quaternion is not None:
            x, y, z, w = (source.table.numbers(name) for name in _quaternion(entry))
            column = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        else:
            column = source.table.numbers(entry.column or "") * (known.si if known else 1.0)
            _check_header(entry)
        if entry.derivative:
            step = np.diff(column)
            step = wrap(step) if known and known.measures == "angle" else step
            column = np.concatenate([[np.nan], step / (np.diff(source.t_ns) / NANOSECONDS)])
        column = entry.scale * column + entry.offset
        columns.append(column if entry.times is None else column * source.table.numbers(entry.times))
    return np.column_stack(columns)


def _check_header(entry: Entry) -> None:
    """A column that is called `speed [km/h]` is not in m/s."""
    told = re.search(r"[\[(]([^\[()\]]+)[\])]\s*$", entry.column or "")
    said, known = unit(told[1]) if told else None, unit(entry.unit)
    named = said is not None and said.measures not in ("ratio", "raw")
    if named and known is not None and said != known and known.measures != "raw":
        raise FileError(
            f'{entry.key} unit = "{entry.unit}", but the name of its column says {entry.column!r}; '
            f'write unit = "{told[1] if told else ""}"'
        )


def _known(signal: Signal, source: Source, found: list[Doubt]) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of the rows that have all their numbers."""
    values = _values(signal, source)
    whole = np.asarray(np.isfinite(values).all(axis=1))
    first = 1 if any(e.derivative for e in signal.entries) else 0  # a rate has no first value
    lost = np.count_nonzero(~whole[first:])
    if lost:
        where = int(source.t_ns[first:][~whole[first:]][0])
        text = f"[{signal.key}]: {lost} of {len(whole)} rows have no number (NaN, empty) and were left out"
        found.append(Doubt("missing", "warning", where, text))
    if not whole.any():
        raise FileError(
            f"[{signal.key}] has not one row with all its numbers in {source.table.label}. Are its columns "
            "right?"
        )
    return source.t_ns[whole], values[whole]


def _applied(
    m: ColumnMap, sources: dict[str, Source], ticks: np.ndarray, found: list[Doubt]
) -> tuple[int, np.ndarray, np.ndarray]:
    """How many ticks had no command yet, the others, and (N, n) the command in force up to each."""
    t_ns, u = _known(m.command, sources[m.command.file], found)
    if m.in_force == "from":
        at = np.searchsorted(t_ns, ticks, side="left") - 1
    else:
        at = np.searchsorted(t_ns, ticks, side="left")
    inside = (at >= 0) & (at < len(t_ns))
    if not inside.any():
        raise FileError(
            f"{m.path.name}: no tick of [files.{m.ticks}] has a command of [files.{m.command.file}]: the "
            "times of the "
            f"first are {_span(ticks)}, of the second {_span(t_ns)}. Shift one of them: shift_s = …"
        )
    first = int(np.argmax(inside))
    return first, ticks[inside], u[at[inside]]


def _span(t_ns: np.ndarray) -> str:
    return f"{t_ns[0] / NANOSECONDS:.3f} s to {t_ns[-1] / NANOSECONDS:.3f} s"


def _sampled(
    signal: Signal, sources: dict[str, Source], ticks: np.ndarray, found: list[Doubt]
) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of a signal: as measured, or brought to the ticks."""
    source = sources[signal.file]
    t_ns, values = _known(signal, source, found)
    if t_ns[-1] < ticks[0] or t_ns[0] > ticks[-1]:
        raise FileError(
            f"[{signal.key}] in {source.table.label} lies at {_span(t_ns)}, the ticks at {_span(ticks)}: "
            "not on one clock. "
            f"Write in [files.{signal.file}]: shift_s = …"
        )
    if signal.sample == "measured":
        return t_ns, values
    inside = ticks[(ticks >= t_ns[0]) & (ticks <= t_ns[-1])]
    if signal.sample == "hold":
        return inside, values[np.searchsorted(t_ns, inside, side="right") - 1]
    x = (t_ns - t_ns[0]) / NANOSECONDS
    angles = [unit(e.unit).measures == "angle" for e in signal.entries]  # pyright: ignore[reportOptionalMemberAccess]
    columns = [np.unwrap(c) if a else c for c, a in zip(values.T, angles, strict=True)]
    return inside, np.column_stack([np.interp((inside - t_ns[0]) / NANOSECONDS, x, c) for c in columns])


def _channel(signal: Signal, sources: dict[str, Source], ticks: np.ndarray, found: list[Doubt]) -> Channel:
    t_ns, z = _sampled(signal, sources, ticks, found)
    if signal.kind == "pose":
        z = np.column_stack([z[:, :2], wrap(z[:, 2])])
    return Channel(t_ns, t_ns, z)


def _truth(signal: Signal, sources: dict[str, Source], ticks: np.ndarray, found: list[Doubt]) -> TruthLog:
    t_ns, values = _sampled(signal, sources, ticks, found)
    unknown = np.full((len(t_ns), 3), np.nan)
    eta = np.column_stack([values[:, :2], wrap(values[:, 2])])
    return TruthLog(t_ns, eta, values[:, 3:] if values.shape[1] == 6 else unknown, unknown)
