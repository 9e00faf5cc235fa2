"""Read the map of an import, in TOML: file, column, signal, unit and clock of each quantity.

    [files.NAME]   path, topic (bags), time, time_unit, shift_s, where = {column = value}, new_when, …
                   split = "COLUMN", split_gap_s: many runs from one file
    [ticks]        file
    [command]      file, names, in_force = "from" or "until" (its time), u = [entries] or wheels = [left, right]
    [sensors.NAME] file, kind, z = [entries], sample = "measured", "hold" or "linear", shift_s
    [truth]        file, eta = [entries], nu = [entries], shift_s, lever_arm_m, heading_rad (mount.py)

    value = (scale · radius · column · unit + offset) · times                                              (1)

An entry is {column, unit, scale, radius_m, offset, times, backward, derivative, wraps, counts_per_turn}, or
{quaternion = [x, y, z, w]}, or {constant, unit}. Defaults never change a value silently: if a required key is missing,
the message shows the line to write. docs/importing.md explains every key with examples.
"""

import math
import os
import re
from pathlib import Path
from typing import Any

from baqueano.diagnostics import Diagnostic, fault, nearest, note
from baqueano.errors import FileError, error_cause
from baqueano.messages.printable import baqueano_command
from baqueano.runs.maps.columns import KINDS, ColumnMap, ColumnSignal, Entry, FileSpec
from baqueano.runs.maps.mount import KEY_TYPES, parse_mount
from baqueano.runs.maps.units import all_units, canonical_name, nearest_units_text, unit, unit_list
from baqueano.signals import is_sensor_name
from baqueano.vehicle_file.text.toml_text import parse_toml

ETA_MEASURES, NU_MEASURES = ("length", "length", "angle"), ("speed", "speed", "angular rate")
RATES = {"angle": "angular rate", "length": "speed", "speed": "acceleration"}  # quantity → its derivative
ROLLED_MEASURE = {"angle": "length", "angular rate": "speed"}  # quantity of a wheel → quantity at its rim
MAX_INTEGER = 2**63  # limit of an integer; integers of Python are unlimited
MAX_MAP_LETTERS = 1_000_000  # maximum number of characters of a map; a recording can have more
REST_COMMAND: dict[str, Any] = {
    "in_force": "from", "names": ["u_x", "u_y", "u_psi"], "u": [{"constant": 0.0}] * 3,
}  # fmt: skip
CSV_KEYS = {"delimiter": str, "decimal": str, "encoding": str, "header": bool, "comment": str}


def maps_folder() -> Path:
    """Return the folder of the maps that come with the package."""
    return Path(__file__).parent


def data_folders() -> list[Path]:
    """Return the folders to search for recordings: BAQUEANO_DATA if it is set, else ../shared/data next to the current
    folder or the repository.
    """
    if data_folder := os.environ.get("BAQUEANO_DATA"):
        return [Path(data_folder)]
    return [start.parent / "shared" / "data" for start in (Path.cwd(), Path(__file__).parents[4])]


def load_map(name_or_path: Path | str) -> ColumnMap:
    """Return the map at a path, or the package's map with this name. Raise FileError if it is absent or unreadable."""
    path, shipped_path = Path(name_or_path), maps_folder() / f"{name_or_path}.toml"
    if not path.is_file() and shipped_path.is_file():
        path = shipped_path
    try:
        if not (text := _first_characters(path)).strip():
            fix = baqueano_command("runs", "import", "RECORDING.csv", "--draft", "MAP.toml")
            raise FileError.of("map.empty", fix, path=path)
        return _Parser(path, text, _tree(path, text)).map()
    except FileNotFoundError:
        hint = nearest(str(name_or_path), sorted(p.stem for p in maps_folder().glob("*.toml")))
        raise FileError.of("map.absent", absent_path=path, value=name_or_path, suggestion=hint) from None
    except ValueError as error:
        if path.suffix.lower() != ".toml" and shipped_path.is_file():
            return load_map(shipped_path)
        raise FileError(_not_a_map_note(path, error)) from error
    except OSError as error:
        code = "map.folder" if path.is_dir() else "map.not-read"
        raise FileError.of(code, path=path, error=error) from error


def _tree(path: Path, text: str) -> dict[str, Any]:
    """Return the tables of a map.
    Raise ValueError if it is not TOML. For other faults, raise FileError if the suffix is .toml, else ValueError.
    """
    try:
        return parse_toml(text, path.name)
    except FileError as error:
        if path.suffix.lower() == ".toml":
            raise
        raise ValueError(str(error)) from error


def _first_characters(path: Path) -> str:
    """Return the first MAX_MAP_LETTERS characters of a file: a whole map, or the beginning of a recording."""
    with path.open(encoding="utf-8-sig") as stream:
        return stream.read(MAX_MAP_LETTERS)


def _not_a_map_note(path: Path, error: ValueError) -> Diagnostic:
    """Return the fault of a file that is not TOML: a wrong map if its suffix is .toml, else probably a recording."""
    if path.suffix.lower() == ".toml":
        code = "map.not-read" if isinstance(error, UnicodeDecodeError) else "map.not-toml"
        return fault(code, path=path, error=str(error))
    draft_name = f"{path.stem}.toml" if not Path(f"{path.stem}.toml").exists() else "MAP.toml"
    fix, error_words = baqueano_command("runs", "import", path, "--draft", draft_name), str(error)
    # tomllib gives the place only in its text
    if (position := re.search(r"at line (\d+), column (\d+)", error_words)) is None:
        return fault("map.recording", fix, path=path)
    return fault("map.recording-or-wrong", fix, path=path, line=int(position[1]), column=int(position[2]))


def _expectation(value: str, measures: str, is_derivative: bool) -> Diagnostic:
    """Return the correction for an entry that measures the quantity `value` but must measure `measures`.
    The correction is other units, or another key.
    """
    rate = "" if is_derivative else RATES.get(value, "")
    find_measure = ROLLED_MEASURE.get
    ending_by_measure = {find_measure(value): "rolls", rate: "rate", find_measure(rate): "rate-of-rolling"}
    ending = f"-or-{ending_by_measure[measures]}" if measures in ending_by_measure else ""
    return note(f"expect.measures{ending}", measures=measures, valid=unit_list(measures))


class _Parser:
    """A parser of one map, with a method for each kind of table. The methods raise FileError for a wrong table."""

    def __init__(self, path: Path, text: str, tree: dict[str, Any]) -> None:
        self.path, self.text, self.tree = path, text, tree

    def map(self) -> ColumnMap:
        """Return the parsed map."""
        top = self.keys("", self.tree, {
            "format": int, "name": str, "about": str, "accept": list, "start_ns": int, "files": dict,
            "ticks": dict, "command": dict, "sensors": dict, "truth": dict
        })  # fmt: skip
        if top.get("format") != 1:
            raise self.error("format", top.get("format"), note("expect.format"))
        tables = self.require(top, "files", note("expect.files"))
        files = {
            name: self.file_spec(name, self.table(f"files.{name}", spec)) for name, spec in tables.items()
        }
        self.file_names = list(files)
        sensors = {name: self.sensor(name, spec) for name, spec in top.get("sensors", {}).items()}
        ticks = top.get("ticks", {}) if len(files) == 1 else self.require(
            top, "ticks", note("expect.ticks")
        )  # fmt: skip
        self.keys("ticks", ticks, {"file": str})
        if "command" not in top and (sensors or "truth" in top):  # the vehicle is at rest
            top["command"] = REST_COMMAND | ticks
        signal, names, in_force, has_wheel_commands = self.command(
            self.require(top, "command", note("expect.table", key="command"))
        )
        return ColumnMap(
            str(top.get("name", self.path.stem)), self.path, self.text, top.get("start_ns", 0),
            frozenset(map(str, top.get("accept", []))), files, self.find_file("ticks", ticks), names,
            in_force, signal, sensors, self.truth(top["truth"]) if "truth" in top else None, has_wheel_commands
        )  # fmt: skip

    def command(self, spec: dict[str, Any]) -> tuple[ColumnSignal, tuple[str, ...], str, bool]:
        """Parse [command]: signal, names of its entries, `in_force`, and True if it has a command for each wheel."""
        self.keys("command", spec, {"file": str, "names": list, "in_force": str, "u": list, "wheels": list})
        in_force = spec.get("in_force")
        if in_force not in ("from", "until"):
            raise self.error(
                "[command] in_force", in_force,
                note("expect.in-force")
            )  # fmt: skip
        wheels = "wheels" in spec
        if wheels == ("u" in spec):
            raise self.error(
                "[command] u", spec.get("u"), note("expect.u-or-wheels")
            )  # fmt: skip
        measures = (None,) * (2 if wheels else len(spec["u"]))
        signal = self.signal("command", spec, "wheels" if wheels else "u", measures, None)
        names = tuple(map(str, spec.get("names", ["u_x", "u_y", "u_psi"] if wheels else [])))
        if len(names) != (3 if wheels else len(signal.entries)):
            count = len(signal.entries)
            advice = note("expect.three-names") if wheels else note("expect.names", count=count)
            raise self.error("[command] names", list(names), advice)
        return signal, names, in_force, wheels

    def file_spec(self, name: str, spec: dict[str, Any]) -> FileSpec:
        """Parse [files.NAME]."""
        key = f"files.{name}"
        self.keys(key, spec, CSV_KEYS | {
            "path": str, "topic": str, "time": str, "time_unit": str, "time_rest": dict, "shift_s": float,
            "where": dict, "new_when": str, "repeats": str, "backwards": str, "split": str, "split_gap_s": float,
            "rate_hz": float
        })  # fmt: skip
        time, time_unit = self.clock(key, spec)
        for option_name, choices in (
            ("repeats", ("first", "last")),
            ("backwards", ("drop",)),
            ("decimal", (".", ",")),
        ):
            if option_name in spec and spec[option_name] not in choices:
                raise self.error(
                    f"[{key}] {option_name}",
                    spec[option_name],
                    note("expect.one-of", key=option_name, valid=[f'"{a}"' for a in choices]),
                )
        if len(spec.get("delimiter", ",")) != 1:
            raise self.error(f"[{key}] delimiter", spec["delimiter"], note("expect.delimiter"))
        options = {option: spec[option] for option in CSV_KEYS if option in spec}
        return FileSpec(
            name, spec.get("path"), spec.get("topic"), time, time_unit, self.second_part(key, spec),
            float(spec.get("shift_s", 0.0)), spec.get("where", {}), spec.get("new_when"), spec.get("repeats"),
            spec.get("backwards"), spec.get("split"), spec.get("split_gap_s"), spec.get("rate_hz"), options
        )  # fmt: skip

    def clock(self, key: str, spec: dict[str, Any]) -> tuple[str, str]:
        """Return the time column and its unit; ("", "s") if the rows have a constant rate."""
        is_bag, time = "topic" in spec, spec.get("time")
        if "rate_hz" in spec and time is None and not is_bag:
            if not spec["rate_hz"] > 0.0:
                raise self.error(f"[{key}] rate_hz", spec["rate_hz"], note("expect.rate"))
            return "", "s"
        if not time or "rate_hz" in spec:
            raise self.error(f"[{key}] time", time, note("expect.time-of-bag" if is_bag else "expect.time"))
        time_unit = spec.get("time_unit", "ns" if is_bag and time in ("bag", "header.stamp") else None)
        clock_unit = unit(time_unit) if time_unit else None
        if time_unit != "iso8601" and (clock_unit is None or clock_unit.measures != "time"):
            raise self.error(
                f"[{key}] time_unit", time_unit, note("expect.time-unit", valid=unit_list("time"))
            )
        return time, str(time_unit)

    def second_part(self, key: str, spec: dict[str, Any]) -> tuple[str, str] | None:
        """Return column and unit of the second part of a time in two columns; None if the time is in one column."""
        second_part = spec.get("time_rest")
        if second_part is None:
            return None
        second_unit = unit(str(second_part.get("unit")))
        if (
            set(second_part) != {"column", "unit"}
            or second_unit is None
            or second_unit.measures != "time"
            or "time" not in spec
        ):
            raise self.error(f"[{key}] time_rest", second_part, note("expect.time-rest"))
        return str(second_part["column"]), str(second_part["unit"])

    def sensor(self, name: str, spec: Any) -> ColumnSignal:
        """Parse [sensors.NAME]. Each entry of a known kind must measure the quantity of that kind."""
        key = f"sensors.{name}"
        self.keys(key, self.table(key, spec), {
            "file": str, "kind": str, "z": list, "sample": str, "shift_s": float
        })  # fmt: skip
        if not is_sensor_name(name):
            raise self.error(f"[{key}]", name, note("expect.sensor-name"))
        sensor_kind = spec.get("kind", name if name in KINDS else None)
        empty_measures = (None,) * len(spec.get("z", []))
        measures = KINDS.get(sensor_kind, empty_measures) if sensor_kind else empty_measures
        return self.signal(key, spec, "z", measures, sensor_kind)

    def truth(self, spec: Any) -> ColumnSignal:
        """Parse [truth]: three entries for η, or six for η and ν."""
        kinds = {"file": str, "eta": list, "nu": list, "sample": str} | KEY_TYPES
        self.keys("truth", self.table("truth", spec), kinds)
        pose = self.signal("truth", spec, "eta", ETA_MEASURES, "pose")
        if "nu" not in spec:
            return pose
        velocity = self.signal("truth", spec, "nu", NU_MEASURES, "pose")
        return pose._replace(entries=pose.entries + velocity.entries)

    def signal(
        self, key: str, spec: dict[str, Any], list_name: str, measures: Any, sensor_kind: str | None
    ) -> ColumnSignal:
        """Parse the entries under `list_name`, one for each quantity of `measures`. A quantity None accepts
        any unit."""
        entries = spec.get(list_name)
        if not entries or len(entries) != len(measures):
            advice = note("expect.entries", count=len(measures), measures=[m or "1" for m in measures])
            raise self.error(
                f"[{key}] {list_name}", entries, advice if measures else note("expect.some-entries")
            )
        sample = spec.get("sample", "measured")
        if sample not in ("measured", "hold", "linear"):
            raise self.error(f"[{key}] sample", sample, note("expect.sample"))
        signal_entries = tuple(
            self.entry(f"{key}.{list_name}[{i}]", entry, m)
            for i, (entry, m) in enumerate(zip(entries, measures, strict=True))
        )
        try:
            return ColumnSignal(
                key,
                self.find_file(key, spec),
                sensor_kind,
                sample,
                signal_entries,
                parse_mount(spec, not signal_entries[-1].is_absent),
            )
        except ValueError as error:
            raise self.error(f"[{key}] lever_arm_m", spec.get("lever_arm_m"), error_cause(error)) from error

    def entry(self, key: str, spec: object, measures: str | None) -> Entry:
        """Parse an entry of a signal. Raise FileError if a key is wrong or missing."""
        if not isinstance(spec, dict):
            raise self.error(key, spec, note("expect.entry"))
        self.keys(key, spec, {
            "column": str, "quaternion": list, "unit": str, "scale": float, "offset": float, "times": str,
            "backward": dict, "wraps": float, "derivative": bool, "constant": float, "radius_m": float,
            "counts_per_turn": float
        })  # fmt: skip
        quaternion = spec.get("quaternion")
        sources = [source for source in ("column", "quaternion", "constant") if source in spec]
        if len(sources) != 1 or (quaternion is not None and len(quaternion) not in (1, 4)):
            raise self.error(key, spec, note("expect.one-source"))
        if quaternion is not None and spec.get("unit", "rad") != "rad":
            raise self.error(f"{key} unit", spec["unit"], note("expect.no-unit"))
        new_entry = Entry(
            key, spec.get("column"), tuple(map(str, quaternion)) if quaternion else None, "",
            float(spec.get("scale", 1.0)), float(spec.get("offset", 0.0)), spec.get("times"),
            spec.get("backward", {}), bool(spec.get("derivative", False)), spec.get("wraps"),
            spec.get("constant"), float(spec.get("radius_m", 1.0)), spec.get("counts_per_turn")
        )  # fmt: skip
        if new_entry.wraps is not None and not (new_entry.derivative and new_entry.wraps > 0.0):
            raise self.error(f"{key} wraps", new_entry.wraps, note("expect.wraps"))
        if new_entry.is_absent or (new_entry.constant == 0.0 and "unit" not in spec):
            return new_entry._replace(unit="1")
        return new_entry._replace(unit=self.unit(key, spec, measures, new_entry))

    def unit(self, key: str, spec: dict[str, Any], measures: str | None, entry: Entry) -> str:
        """Return the unit of an entry. Raise FileError if it does not measure `measures`."""
        name = "rad" if entry.quaternion is not None else spec.get("unit")
        if name is None:
            advice = note("expect.unit-of", valid=unit_list(measures)) if measures else note("expect.unit")
            raise self.error(f"{key} unit", None, advice)
        unit_ = unit(name)
        if unit_ is None:
            near_names = nearest_units_text(name)
            advice = note("expect.listed-unit", suggestion=near_names or all_units())
            if measures:
                code = "expect.listed-unit-of" if near_names else "expect.measures"
                advice = note(code, suggestion=near_names, measures=measures, valid=unit_list(measures))
            raise self.error(f"{key} unit", name, advice)
        if unit_.measures == "raw" and "scale" not in spec:
            raise self.error(f"{key} scale", None, note("expect.scale"))
        self.counts(key, unit_.measures, entry)
        dimension = "angle" if unit_.measures == "counts" else unit_.measures
        quantity = RATES.get(dimension) if entry.derivative else dimension
        if "radius_m" in spec and dimension != "raw":
            quantity = ROLLED_MEASURE.get(quantity or "")
            if quantity is None:
                raise self.error(f"{key} radius_m", spec["radius_m"], note("expect.radius"))
        if measures and dimension != "raw" and quantity != measures:
            raise self.error(f"{key} unit", name, _expectation(quantity or "", measures, entry.derivative))
        return canonical_name(name)

    def counts(self, key: str, measures: str, entry: Entry) -> None:
        """Raise FileError if counts are without `counts_per_turn`, or if another unit has it."""
        per_turn = entry.counts_per_turn
        if measures == "counts" and not (per_turn is not None and per_turn > 0.0):
            raise self.error(
                f"{key} counts_per_turn", per_turn, note("expect.counts")
            )  # fmt: skip
        if measures != "counts" and per_turn is not None:
            raise self.error(f"{key} counts_per_turn", per_turn, note("expect.no-counts"))

    def find_file(self, key: str, spec: dict[str, Any]) -> str:
        """Return the file that a table names, or the only file. Raise FileError for an unknown or missing name."""
        name = spec.get("file", self.file_names[0] if len(self.file_names) == 1 else None)
        if not isinstance(name, str) or name not in self.file_names:
            advice = note("expect.file", first=self.file_names[0], valid=self.file_names)
            raise self.error(f"[{key}] file", name, advice)
        return name

    def table(self, key: str, spec: object) -> dict[str, Any]:
        """Return `spec` if it is a table, else raise FileError."""
        if not isinstance(spec, dict):
            raise self.error(f"[{key}]", spec, note("expect.table", key=key))
        return spec

    def require(self, spec: dict[str, Any], key: str, advice: Diagnostic) -> Any:
        """Return the value of the required `key`. Raise FileError if it is missing."""
        if not spec.get(key):
            raise self.error(key, spec.get(key), advice)
        return spec[key]

    def keys(self, table: str, spec: dict[str, Any], kinds: dict[str, type]) -> dict[str, Any]:
        """Return `spec` if all its keys are in `kinds` and have the right types, else raise FileError."""
        for key, value in spec.items():
            place_text = f"[{table}] {key}" if table else key
            if key not in kinds:
                suggestion = nearest(key, sorted(kinds), 0.4)
                raise FileError.of(
                    "map.unknown-key", map=self.path.name, place=place_text, suggestion=suggestion
                )
            number_types = (int, float) if kinds[key] is float else kinds[key]
            if not isinstance(value, number_types) or (isinstance(value, bool) and kinds[key] is not bool):
                raise self.error(place_text, value, note("expect.type", kind=kinds[key].__name__))
            if kinds[key] is float and key != "constant" and not abs(value) < math.inf:
                raise self.error(place_text, value, note("expect.finite"))
            if isinstance(value, int) and abs(value) > MAX_INTEGER:
                raise self.error(place_text, value, note("expect.finite"))
        return spec

    def error(self, place_text: str, value: object, advice: Diagnostic | str) -> FileError:
        """Return the error to raise, with the place, the value in the map, and the expected value."""
        code = "map.missing" if value is None else "map.wrong"
        value_text = repr(value)[:200]
        return FileError.of(code, map=self.path.name, place=place_text, value=value_text, expected=advice)
