"""Draft a map from the column names of a CSV file. A unit that the name does not state is `unit = "?"`."""

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from baqueano.errors import FileError, UsageError
from baqueano.messages.language import translate as _
from baqueano.messages.printable import baqueano_command
from baqueano.runs.diagnostics.physical_limits import FULL_COMMANDS, PULSE_RANGE_US
from baqueano.runs.importing import column_names as headers
from baqueano.runs.importing.column_names import plain_name
from baqueano.runs.importing.geographic import east_north_entries
from baqueano.runs.importing.imu_axes import ImuColumns, SignedColumn, imu_columns
from baqueano.runs.importing.rates import counter_period
from baqueano.runs.maps.units import unit
from baqueano.runs.tables.table import LogTable, read_table

UNKNOWN = "?"
SUFFIX_UNITS = {  # ends of names → unit
    "ms": "ms", "us": "us", "ns": "ns", "s": "s", "sec": "s", "mm": "mm", "cm": "cm", "m": "m", "deg": "deg",
    "grados": "deg", "gps": "deg/s", "grados_s": "deg/s",
    "rad": "rad", "dps": "deg/s", "deg_s": "deg/s", "rad_s": "rad/s", "rads": "rad/s", "rps": "turn/s", "rpm": "rpm",
    "g": "g", "mg": "mg", "m_s2": "m/s^2", "mps2": "m/s^2", "ms2": "m/s^2", "m_s": "m/s", "mps": "m/s",
    "mm_s": "mm/s", "cm_s": "cm/s", "km_h": "km/h", "kmh": "km/h", "percent": "%", "pct": "%", "v": "V", "mv": "mV",
}  # fmt: skip
MAX_BATTERY_V = 200.0  # a larger number is in mV
KINDS = {"imu": ("acceleration", "acceleration", "angular rate"), "eta": ("length", "length", "angle")}


def draft_map(recording: Path | str, *others: Path | str, path: Path | str | None = None) -> str:
    r"""Draft a map for CSV files with the same columns. The unit of a column is "?" if its name does not state it.

    Parameters
    ----------
    recording, *others : path
        The CSV files.
    path : path, optional
        The file of the map, which is written if it does not exist yet.

    Returns
    -------
    str
        The map in TOML.

    Raises
    ------
    FileError
        If a file cannot be read, or if the file `path` exists.
    UsageError
        If the files have different columns.

    Examples
    --------
    >>> _ = Path("log.csv").write_text("t_ms,duty\n0,0\n20,50\n")
    >>> "time_unit" in draft_map("log.csv", path="log.toml"), Path("log.toml").exists()
    (True, True)
    """
    if path is not None and Path(path).exists():
        raise FileError.of("cli.file-exists", "--draft FILE.toml", path=path)
    table, encoding = _read_in_any_encoding(recording := Path(recording))
    for file in map(Path, others):
        columns = _read_in_any_encoding(file)[0].columns
        if missing_names := [name for name in table.columns if name not in columns]:
            fix = baqueano_command("runs", "import", file, "--draft", file.with_suffix(".toml").name)
            figures = {"table": file.name, "first": recording.name, "columns": missing_names}
            raise UsageError.of("import.draft-columns", fix, **figures)
    free_columns = list(table.columns)
    lines = [f"format = 1\nname = {_quoted(recording.stem)}", *_tables(table, free_columns, encoding)]
    if free_columns:
        lines.append(f"\n# {_('columns that are not used:')} {', '.join(free_columns)}")
    map_text = "\n".join(lines) + "\n"
    if path is not None:
        Path(path).write_text(map_text, encoding="utf-8", newline="\n")
    return map_text


def _read_in_any_encoding(path: Path) -> tuple[LogTable, str]:
    """Return the table of a CSV file, and the encoding that the map must name; "" if it is detected."""
    try:
        return read_table(path, {}), ""
    except FileError as error:
        codes = {"table.not-encoded": "cp1252", "table.utf-16": str(error.diagnostic.figures.get("encoding"))}
        if error.diagnostic.code not in codes:
            raise
        encoding = codes[error.diagnostic.code]
        return read_table(path, {"encoding": encoding}), encoding


def _tables(table: LogTable, free_columns: list[str], encoding: str) -> Iterator[str]:
    """Yield each table of the map, and remove its columns from `free_columns`."""
    yield _file_table(table, free_columns, encoding)
    commands = _command_table(table, free_columns)
    signals = list(_signal_tables(table, free_columns))
    at_rest = _("no column looks like a command: without [command] the vehicle is at rest")
    column_text = _(
        "no column looks like a command or a measurement: write [command], [sensors.NAME] or [truth]"
    )
    yield commands or f"\n# {at_rest if signals else column_text}"
    yield from signals


def _file_table(table: LogTable, free_columns: list[str], encoding: str) -> str:
    """Return the table of the file, with its encoding and its column of time."""
    title = "\n[files.log]" + (f'\nencoding = "{encoding}"' if encoding else "")
    if time := headers.take_column(free_columns, headers.TIME_PATTERN) or _take_clock(table, free_columns):
        return f'{title}\ntime = {_quoted(time)}\ntime_unit = "{_time_unit(table, time)}"'
    time_text = _("no column looks like a time: write the rows per second")
    return f"{title}\nrate_hz = 0.0                        # {time_text}"


def _command_table(table: LogTable, free_columns: list[str]) -> str:
    """Return the table of the commands, or "" without one. Columns that are named as commands come before columns that
    can also be measurements: a left and a right one without further name, and a twist."""
    if twist := headers.take_all(free_columns, headers.TWIST_COMMANDS) or headers.take_all(
        free_columns, headers.TWIST_COMMANDS[:2]
    ):
        return _twist_commands(twist)
    named_columns = [name for name in free_columns if re.search(headers.COMMAND_PATTERN, plain_name(name))]
    if pair := headers.take_pair(free_columns, headers.COMMAND_PATTERN) or headers.take_pair(
        free_columns, headers.SETPOINT_PATTERN
    ):
        return _wheel_commands(table, free_columns, pair)
    if named_columns:
        return _named_commands(table, free_columns, named_columns)
    if pair := headers.take_all(free_columns, headers.BARE_SIDES):
        remark = _("if these columns are measurements, not commands: write them as z of [sensors.wheels]")
        return _wheel_commands(table, free_columns, pair, f"{'':28}# {remark}")
    if twist := headers.take_all(free_columns, headers.TWIST_PATTERNS):
        remark = _("if it is measured, not a command: write it as z of [sensors.odometer]")
        return _twist_commands(twist, f"{'':28}# {remark}")
    return ""


def _wheel_commands(table: LogTable, free_columns: list[str], pair: list[str], remark: str = "") -> str:
    """Return the table of the commands of two wheels. Remove their direction pins from `free_columns`."""
    span, pins = _span(table, *pair), headers.take_pair(free_columns, headers.PIN_PATTERN) or ["", ""]
    entries = (  # both wheels share a full duty
        _with_pin(_wheel_command(table, column, span), table, column, pin)
        for column, pin in zip(pair, pins, strict=True)
    )
    comment = _('"until": a row ends its command')
    title = f'\n[command]{remark}\nin_force = "from"                    # {comment}'
    return f"{title}\nwheels = [\n{_list_lines(entries)}\n]"


def _named_commands(table: LogTable, free_columns: list[str], columns: list[str]) -> str:
    """Return the table of commands of a vehicle without two driven wheels. Remove their columns from `free_columns`."""
    is_steering = [bool(re.search(headers.STEERING_PATTERN, plain_name(column))) for column in columns]
    if 0 < sum(is_steering) < len(is_steering):  # a car; a further angle is measured
        columns = [columns[is_steering.index(kind)] for kind in (False, True)]
    free_columns[:] = [column for column in free_columns if column not in columns]
    entries = (_command(column, _span(table, column)) for column in columns)
    return _command_list("", ", ".join(map(_quoted, columns)), entries)


def _twist_commands(twist: list[str], remark: str = "") -> str:
    """Return the table of a commanded speed and yaw rate, and a sideways speed if `twist` has a third column."""
    sideways = "{ constant = 0 }" if len(twist) < 3 else _entry(twist[2], "speed")
    entries = _entry(twist[0], "speed"), sideways, _entry(twist[1], "angular rate")
    return _command_list(remark, '"u_x", "u_y", "u_psi"', iter(entries))


def _command_list(remark: str, names: str, entries: Iterator[str]) -> str:
    return f'\n[command]{remark}\nin_force = "from"\nnames = [{names}]\nu = [\n{_list_lines(entries)}\n]'


def _signal_tables(table: LogTable, free_columns: list[str]) -> Iterator[str]:
    """Yield the tables of the sensors and of the truth, and remove their columns from `free_columns`."""
    yield from _wheel_tables(table, free_columns)
    imu = imu_columns(table, free_columns)
    free_columns[:] = [name for name in free_columns if name not in {column.name for column in imu.entries}]
    compass = headers.take_column(free_columns, headers.COMPASS_PATTERN)
    truth, heading = _truth_entries(table, free_columns, is_heading_enough=bool(compass))
    if battery := headers.take_column(free_columns, headers.BATTERY_PATTERN):
        size_unit = "mV" if _span(table, battery)[1] > MAX_BATTERY_V else "V"
        yield _table("[sensors.battery]", "z", [_entry(battery, "voltage", size_unit)])
    if compass := compass or heading:
        remark = _("left is positive: a compass that counts clockwise needs scale = -1.0")
        yield _table(f"[sensors.compass]                    # {remark}", "z", [_entry(compass, "angle")])
    if any(column.name for column in imu.entries):
        entries = [
            _signed_entry(column, measures, imu.accel_unit)
            for column, measures in zip(imu.entries, KINDS["imu"], strict=True)
        ]
        yield _table(f"[sensors.imu]{'' if imu.is_level else _level_remark(imu)}", "z", entries)
    if truth:
        yield _table("[truth]", "eta", truth)


def _table(title: str, key: str, entries: Iterable[str]) -> str:
    return f"\n{title}\n{key} = [\n{_list_lines(entries)}\n]"


def _wheel_tables(table: LogTable, free_columns: list[str]) -> Iterator[str]:
    """Yield the table of two wheels, of a speed, or of one encoder: of the first of them that has columns."""
    if wheels := headers.take_pair(
        free_columns, f"{headers.SPEED_PATTERN}|{headers.SPEED_ENDING}|{headers.COUNT_PATTERN}"
    ):
        yield _table("[sensors.wheels]", "z", (_wheel(table, column) for column in wheels))
    elif speed := headers.take_column(free_columns, headers.FORWARD_PATTERN):
        yield _table("[sensors.odometer]", "z", [_entry(speed, "speed")])
    elif encoder := headers.take_column(free_columns, rf"{headers.ENCODER_PATTERN}|(^|_)(rpm|rps)(_|$)"):
        yield _table("[sensors.odometer]", "z", [_wheel(table, encoder)])


def _truth_entries(
    table: LogTable, free_columns: list[str], is_heading_enough: bool
) -> tuple[list[str], str]:
    """Return the entries of the true pose, and the column of a heading without a position, which is a compass.

    `is_heading_enough` is True if there is another compass: then a heading alone is an entry of the truth.
    """
    x, y, psi = (headers.take_column(free_columns, name) for name in headers.POSE_PATTERNS)
    positions = [] if x or y else _east_north_entries(table, free_columns)
    quaternion = [] if psi else headers.take_all(free_columns, headers.QUATERNION_PATTERNS)
    if not (x or y or positions or is_heading_enough):
        return [], psi
    if not (x or y or psi or positions):
        return [], ""
    entries = [
        _signed_entry(SignedColumn(name, 1), measures, ("", 1.0))
        for name, measures in zip((x, y, psi), KINDS["eta"], strict=True)
    ]
    heading = _clockwise(entries[2]) if positions and psi else entries[2]
    return [*(positions or entries[:2]), _quaternion_entry(quaternion) or heading], ""


def _east_north_entries(table: LogTable, free_columns: list[str]) -> list[str]:
    """Return the entries of x (east) and y (north) from such columns, or from longitude and latitude; [] without
    them. Remove the columns from `free_columns`.
    """
    if columns := headers.take_all(free_columns, headers.EAST_NORTH_PATTERNS):
        return [_entry(column, "length") for column in columns]
    columns = headers.take_all(free_columns, headers.GEOGRAPHIC_PATTERNS)
    numbers = east_north_entries(*(table.numbers(column) for column in columns)) if columns else ()
    remark = _("metres to the east and to the north of the first position")
    return [
        f'{{ column = {_quoted(column)}, unit = "raw", scale = {scale!r}, offset = {offset!r} }},   # {remark}'
        for column, (scale, offset) in zip(columns, numbers, strict=bool(numbers))
    ]


def _clockwise(entry: str) -> str:
    """Return the entry of a heading that counts clockwise from north, beside positions to the east and to the north."""
    remark = _("clockwise from north? if it counts to the left from east, remove scale and offset")
    return entry.replace(" }", f", scale = -1.0, offset = {np.pi / 2:.6f} }},   # {remark}")


def _quaternion_entry(columns: Sequence[str]) -> str:
    """Return the entry of a heading from the columns x, y, z, w of a quaternion, "" without them."""
    return f"{{ quaternion = [{', '.join(map(_quoted, columns))}] }}" if columns else ""


def _level_remark(imu: ImuColumns) -> str:
    axes = ", ".join(map(str, imu.entries))
    figures = {"column": imu.vertical_axis, "mean": imu.mean, "axes": axes}
    remark = _("{column} is {mean:.3g} on average: forward, left and turning left are {axes}", **figures)
    return f"{'':24}# {remark}"


def _signed_entry(column: SignedColumn, measures: str, accel_unit: tuple[str, float]) -> str:
    """Return an entry with its sign. `accel_unit`: unit and scale of an accelerometer whose name does not state it."""
    entry, scale = _entry(column.name, measures), float(column.sign)
    if measures == "acceleration" and accel_unit[0] and f'"{UNKNOWN}"' in entry:
        entry, scale = entry.replace(UNKNOWN, accel_unit[0]), scale * accel_unit[1]
    return entry.replace(" }", f", scale = {scale:#.6g} }}") if column.name and scale != 1.0 else entry


def _take_clock(table: LogTable, free_columns: list[str]) -> str:
    """Return the first column with a unit of time whose numbers increase, and remove it from `free_columns`, or ""."""
    for column in free_columns:
        if _unit(column, "time") != UNKNOWN:
            t = table.numbers(column)
            steps = np.diff(t[np.isfinite(t)])
            if len(steps) and np.min(steps) >= 0.0 and np.median(steps) > 0.0:
                free_columns.remove(column)
                return column
    return ""


def _unit(name: str, measures: str) -> str:
    """Return the unit at the end of a column's name; UNKNOWN if the name does not end with a unit of this quantity."""
    parts = plain_name(name).split("_")
    if re.search(headers.ROS_PATTERN, plain_name(name)) and measures in headers.ROS_UNITS:
        return headers.ROS_UNITS[measures]
    for ending in ("_".join(parts[-2:]), parts[-1]):
        unit_ = unit(SUFFIX_UNITS.get(ending, UNKNOWN))
        if len(parts) > 1 and unit_ is not None and unit_.measures == measures:
            return SUFFIX_UNITS[ending]
    return UNKNOWN


def _time_unit(table: LogTable, column: str) -> str:
    """Return the unit of a time column, from its name or from its steps."""
    unit_name = _unit(column, "time")
    if unit_name != UNKNOWN:
        return unit_name
    try:
        t = table.numbers(column)
    except FileError:
        return "iso8601"
    steps = np.diff(t[np.isfinite(t)])
    if not len(steps):
        return UNKNOWN
    step = float(np.median(steps))
    return "s" if step < 1.0 else "ms" if step < 1e3 else "us" if step < 1e6 else "ns"


def _span(table: LogTable, *columns: str) -> tuple[float, float]:
    """Return the least value and the largest magnitude of columns."""
    numbers = np.concatenate([table.numbers(column) for column in columns])
    return float(np.nanmin(numbers, initial=np.inf)), float(np.nanmax(np.abs(numbers), initial=0.0))


def _command(column: str, span: tuple[float, float]) -> str:
    min_value, max_value = span
    for measures in ("ratio", "angle"):
        if (unit_name := _unit(column, measures)) != UNKNOWN:
            return f'{{ column = {_quoted(column)}, unit = "{unit_name}" }}'
    if max_value <= 1.0:
        return f'{{ column = {_quoted(column)}, unit = "1" }}'
    if PULSE_RANGE_US[0] <= min_value and max_value <= PULSE_RANGE_US[1]:
        keys = "scale = 0.002, offset = -3.0"
        remark = _("pulses of 1000 to 2000 µs, with 1500 in the middle?")
    else:
        full_count = next((full for full in FULL_COMMANDS[1:] if max_value <= full), max_value)
        keys = f"scale = {1.0 / full_count:.6g}"
        remark = _("{value:g} becomes 1: is that the full command?", value=full_count)
    return f'{{ column = {_quoted(column)}, unit = "raw", {keys} }},   # {remark}'


def _wheel_command(table: LogTable, column: str, span: tuple[float, float]) -> str:
    """Return the entry of a command of a wheel: a voltage, a speed with its unit, or a duty."""
    if re.search(headers.VOLTAGE_PATTERN, plain_name(column)) or _unit(column, "voltage") != UNKNOWN:
        return _entry(column, "voltage", "V")
    has_unit = any(_unit(column, measures) != UNKNOWN for measures in ("angular rate", "speed"))
    return _wheel(table, column) if has_unit else _command(column, span)


def _with_pin(entry: str, table: LogTable, column: str, pin: str) -> str:
    """Return the entry with its direction pin. Backward is the rarer of two levels while the motor is driven."""
    levels, counts = np.unique(
        table.numbers(pin)[table.numbers(column) != 0.0] if pin else [], return_counts=True
    )
    if not pin or len(levels) > 2 or not np.isin(levels, (-1.0, 0.0, 1.0)).all():
        return entry
    backward = levels[np.argmin(counts)] if len(levels) == 2 else float(not np.any(levels == 1.0))
    remark = _("{pin} = {level:g}: is this backward?", pin=pin, level=backward)
    entry = entry.replace(" }", f", backward = {{ {_quoted(pin)} = {backward:g} }} }}", 1)
    return f"{entry}; {remark}" if "},   #" in entry else f"{entry},   # {remark}"


def _wheel(table: LogTable, column: str) -> str:
    unit_name = _unit(column, "angular rate")
    if (
        re.search(headers.COUNT_PATTERN, plain_name(column))
        and _unit(column, "speed") == unit_name == UNKNOWN
    ):
        counts = table.numbers(column)
        if np.array_equal(counts, np.round(counts)):
            remark = _("counts in a turn of the wheel, and its radius")
            keys = 'unit = "counts", counts_per_turn = 0, derivative = true, radius_m = 0.0'
            if period := counter_period(counts):
                keys += f", wraps = {period}"
            return f"{{ column = {_quoted(column)}, {keys} }},   # {remark}"
    if unit_name != UNKNOWN:
        remark = _("the radius of the wheel")
        return f'{{ column = {_quoted(column)}, unit = "{unit_name}", radius_m = 0.0 }},   # {remark}'
    return _entry(column, "speed")


def _entry(column: str, measures: str, usual_unit: str = UNKNOWN) -> str:
    if not column:
        return "{ constant = nan }"
    unit_name = _unit(column, measures)
    return f'{{ column = {_quoted(column)}, unit = "{usual_unit if unit_name == UNKNOWN else unit_name}" }}'


def _list_lines(entries: Iterable[str]) -> str:
    return "\n".join(f"  {entry}" if "},   #" in entry else f"  {entry}," for entry in entries)


def _quoted(name: str) -> str:
    """Return a name as a string of TOML."""
    return json.dumps(name, ensure_ascii=False)
