"""The external input formats: an original of each, its damaged inputs by number, and their readers."""

import json
import os
import random
import socket
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from baqueano.door.operator import Operator
from baqueano.door.sockets import Door
from baqueano.door.wire import decode, encode
from baqueano.drive import experiment
from baqueano.drive.mission import Mission
from baqueano.guides.repeat import Repeat
from baqueano.guides.route import Route
from baqueano.guides.shapes import circle
from baqueano.runs import import_runs, read_run, write_run
from baqueano.runs.maps.column_map import load_map
from baqueano.runs.maps.columns import ColumnMap, Entry
from baqueano.runs.route_file import read_route, write_route
from baqueano.vehicle_file import load
from tests.fuzz.judging import LONGEST_S, Hang, Silent
from tests.fuzz.mutators import damaged_bytes, damaged_text

MAP = """
format = 1
name = "log"

[files.log]
path = "log.csv"
time = "time_ms"
time_unit = "ms"
split_gap_s = 5.0
where = { ok = 1 }

[ticks]
file = "log"

[command]
file = "log"
in_force = "from"
wheels = [
  { column = "left_pwm", unit = "raw", scale = 0.00392157 },
  { column = "right_pwm", unit = "raw", scale = 0.00392157 },
]

[sensors.wheels]
file = "log"
z = [
  { column = "left_rpm", unit = "rpm", radius_m = 0.03 },
  { column = "right_counts", unit = "counts", counts_per_turn = 600, derivative = true, wraps = 65536, radius_m = 0.1 },
]

[sensors.imu]
file = "log"
z = [{ constant = nan }, { constant = nan }, { column = "gyro_dps", unit = "deg/s" }]

[truth]
file = "log"
eta = [{ column = "x_mm", unit = "mm" }, { column = "y_mm", unit = "mm" }, { column = "yaw_deg", unit = "deg" }]
"""
COLUMNS = "time_ms,left_pwm,right_pwm,left_rpm,right_counts,gyro_dps,x_mm,y_mm,yaw_deg,ok"
SEED = os.environ.get("BAQUEANO_FUZZ_SEED", "baqueano")


def draw(name: str, number: int) -> random.Random:
    """Return the generator of an input."""
    return random.Random(f"{SEED} {name} {number}")


@dataclass(frozen=True)
class Format:
    """A format: `open_folder(folder)` yields the reader of the input of a number."""

    name: str
    open_folder: Callable[[Path], object]


def log(rows: int = 40) -> str:
    """Return a recording of a vehicle that drives and turns."""
    lines = [COLUMNS]
    for k in range(rows):
        t, turn = 20 * k, 30.0 * np.sin(k / 7.0)
        lines.append(
            f"{t},{100 + k},{110 - k},{60 + k / 2:.2f},{(400 + 13 * k) % 65536},{turn:.3f},{4.0 * k:.1f},{k:.1f},"
            f"{0.02 * k * turn:.3f},1"
        )
    return "\n".join(lines) + "\n"


@contextmanager
def mcap(folder: Path) -> Iterator[Callable[[int], object]]:
    """A run: damage is reported, and all other data are unchanged."""
    small, paths = load("small"), [folder / "short.mcap", folder / "long.mcap"]
    runs = [
        write_run(experiment(small, np.tile([0.5, 0.0, 0.1], (n, 1))), p)
        for n, p in zip((6, 40), paths, strict=True)
    ]
    originals, wholes = [path.read_bytes() for path in runs], [read_run(path) for path in runs]
    path = folder / "input.mcap"

    def read_mutant(number: int) -> object:
        generator = draw("mcap", number)
        k = 0 if generator.random() < 0.7 else 1
        _write_new(path, damaged_bytes(originals[k], generator, tuple(originals)))
        run = read_run(path)
        if not run.notes and run != wholes[k]:
            raise Silent("the run differs from its original, and its notes are empty")
        losses = {note.code for note in run.notes} & {
            "run.vehicle-file-lost", "run.damaged", "run.damaged-often", "run.not-closed",
        }  # fmt: skip
        if run.vehicle_text != wholes[k].vehicle_text and (run.vehicle_text or not losses):
            raise Silent("another vehicle file than that of the original")
        return run

    yield read_mutant


@contextmanager
def csv(folder: Path) -> Iterator[Callable[[int], object]]:
    """An external recording, imported with an undamaged map."""
    (folder / "log.toml").write_text(MAP, encoding="utf-8")
    original, path, column_map = log(), folder / "log.csv", load_map(folder / "log.toml")

    def read_mutant(number: int) -> object:
        generator = draw("csv", number)
        _write_new(path, _damaged(original, generator, 0.5))
        runs = import_runs(column_map)
        if (rates := _yaw_rates(path.read_bytes())) is not None:
            imported_rates = np.concatenate([result.run.sensors["imu"].z[:, 2] for result in runs])
            is_whole = len(imported_rates) == len(rates)
            if is_whole and not np.allclose(imported_rates, rates, rtol=1e-12, atol=0.0):
                raise Silent("a yaw rate differs from the text")
            if not is_whole and not any(result.findings for result in runs):
                raise Silent("rows are missing, and the import reports nothing")
        return runs

    yield read_mutant


def _yaw_rates(data: bytes) -> np.ndarray | None:
    """Return the yaw rates [rad/s] that a log contains by an independent reading; None if it is not a plain table."""
    table = _table(data, COLUMNS)
    return None if table is None else np.radians(table[table[:, 9] == 1.0, 5])


def _table(data: bytes, header: str) -> np.ndarray | None:
    """Return the numbers below this header; None for another text, or for times that do not increase."""
    lines = data.decode("utf-8", "replace").split("\n")
    try:
        table = np.array([line.split(",") for line in lines[1:] if line], dtype=float)
    except ValueError:
        return None
    is_plain = lines[0] == header and table.ndim == 2 and np.all(np.isfinite(table))
    return table if is_plain and np.all(np.diff(table[:, 0]) > 0.0) else None


@contextmanager
def hand_written_map(folder: Path) -> Iterator[Callable[[int], object]]:
    """A hand-written map of an undamaged recording."""
    (folder / "log.csv").write_text(log(), encoding="utf-8")
    path = folder / "map.toml"

    def read_mutant(number: int) -> object:
        _write_new(path, _damaged(MAP, draw("map", number)))
        read = load_map(path)
        runs = import_runs(read)
        document = tomllib.loads(path.read_text(encoding="utf-8-sig"))
        if any(_differs(entry, spec) for entry, spec in _entries(read, document)):
            raise Silent("an entry of the map differs from its text")
        if (rates := _mapped_yaw_rates(document)) is not None:
            imported_rates = np.concatenate([result.run.sensors["imu"].z[:, 2] for result in runs])
            imported_rates = imported_rates[np.isfinite(imported_rates)]
            if not np.isclose(imported_rates[:, None], rates, rtol=1e-12, atol=0.0).any(axis=1).all():
                raise Silent("a yaw rate differs from its column")
        return runs

    yield read_mutant


def _entries(read: ColumnMap, document: dict[str, Any]) -> Iterator[tuple[Entry, dict[str, Any]]]:
    """Yield each entry of a map with the table that describes it."""
    tables = [(signal, document["sensors"][name]["z"]) for name, signal in read.sensors.items()]
    if "command" in document:
        tables.append((read.command, document["command"]["wheels" if read.wheels else "u"]))
    if read.truth is not None:
        tables.append((read.truth, document["truth"].get("eta", []) + document["truth"].get("nu", [])))
    for signal, specs in tables:
        yield from zip(signal.entries, specs, strict=True)


def _differs(entry: Entry, spec: dict[str, Any]) -> bool:
    """Return True if an entry has another source or another number than its table."""
    names = (
        "column", "scale", "offset", "times", "derivative", "wraps", "constant", "radius_m", "counts_per_turn",
    )  # fmt: skip
    return any(spec[name] == spec[name] != getattr(entry, name) for name in names if name in spec)


def _mapped_yaw_rates(document: dict[str, Any]) -> np.ndarray | None:
    """Return the yaw rates [rad/s] of all rows of the log by the third entry of `imu`; None if it is not plain."""
    table = document.get("sensors", {}).get("imu", {})
    spec = table.get("z", [{}] * 3)[2]
    factor = {"deg/s": np.pi / 180.0, "rad/s": 1.0}.get(spec.get("unit", ""))
    if factor is None or set(table) != {"file", "z"} or set(spec) != {"column", "unit"}:
        return None
    header, *rows = [line.split(",") for line in log().splitlines()]
    return factor * np.array([float(row[header.index(spec["column"])]) for row in rows])


@contextmanager
def vehicle(folder: Path) -> Iterator[Callable[[int], object]]:
    """A vehicle file, and the blocks that it describes."""
    originals = [load(name).text for name in ("small", "car", "case-study-1")]
    fitted_file = load("small").with_values(
        {"model.mass_kg": 0.6}, {"model.mass_kg": {"run": "a", "std": 0.1, "verdict": "USABLE"}}
    )
    originals.append(
        fitted_file.text
        + '\n[parameter_cov]\nrun = "a"\nnames = ["model.mass_kg"]\nsd = [0.1]\ncorrelation = [[1.0]]\n'
    )
    path = folder / "input.toml"

    def read_mutant(number: int) -> object:
        generator = draw("vehicle", number)
        _write_new(path, _damaged(generator.choice(originals), generator))
        file = load(path)
        document = tomllib.loads(path.read_text(encoding="utf-8"))
        numbers = {name: x for name, x in document["model"].items() if isinstance(x, float)}
        read = {name: float(getattr(file.vehicle, name)) for name in numbers if hasattr(file.vehicle, name)}
        if repr(file.data) != repr(document) or any(
            repr(x) != repr(numbers[name]) for name, x in read.items()
        ):
            raise Silent("the tables of the file, or its model, differ from its text")
        return file, repr(file), file.truth.name, file.supervisor(), file.estimator(), file.controller()

    yield read_mutant


@contextmanager
def route(folder: Path) -> Iterator[Callable[[int], object]]:
    """A taught route, and a lap along it."""
    points = circle(0.3, 0.2)
    short = points._replace(t_s=points.t_s[:12], eta=points.eta[:12], nu=points.nu[:12])
    path = write_route(short, folder / "input.csv")
    original = path.read_text(encoding="utf-8")
    header = original.splitlines()[1]

    def read_mutant(number: int) -> object:
        generator = draw("route", number)
        _write_new(path, _damaged(original, generator))
        route = read_route(path)
        if not all(np.all(np.isfinite(column)) for column in route[:3]):
            raise Silent("a route with numbers that are not finite")
        table = _table(path.read_bytes().partition(b"\n")[2], header)
        if table is not None and not np.array_equal(np.column_stack(route[:3]), table):
            raise Silent("a number of the route differs from the text")
        return Repeat.along(route), repr(route)

    yield read_mutant


WORDS = (
    {"type": "beat"}, {"type": "hand", "u": [0.1, 0.0, 0.2]}, {"type": "mark"}, {"type": "end"}, {"type": "clear"},
    {"type": "runs"},
    {"type": "stop",
     "reason": {"code": "operator.stopped", "severity": "error", "subject": "", "figures": {}, "fix": ""}},
    {"type": "fetch", "run": "0001-experiment.mcap"}, {"type": "head", "run": "0001-experiment.mcap"},
    {"type": "ping", "token": "x"},
    {"type": "mission", "mission": "{}", "attended": True, "id": "x", "door": 1},
)  # fmt: skip
MESSAGES = (
    {"type": "state", "state": "READY", "t_ns": 1, "battery_v": 7.4, "reason": None, "code": 0},
    {"type": "done", "id": "x", "run": "0001-experiment.mcap", "reason": None},
    {"type": "file", "run": "a", "data": "AAAA", "left": 0},
    {"type": "refused", "reason": "no", "code": 5},
    {"type": "runs", "runs": [{"name": "a", "size": 3}]},
)


@contextmanager
def door(folder: Path) -> Iterator[Callable[[int], object]]:
    """Messages to a vehicle and from a vehicle, and missions. The vehicle answers the message after any of them."""
    path = folder / "door"
    listening = Door(path, Operator(), folder)
    route = Route(np.arange(2.0), np.zeros((2, 3)), np.zeros((2, 3)), False)
    missions = [
        Mission("experiment", u=np.tile([0.5, 0.0, 0.1], (3, 1)), vehicle=load("small").text[:300]).to_json(),
        Mission("repeat", route=route).to_json(),
    ]
    guest = _Guest(path)

    def read_mutant(number: int) -> object:
        generator = draw("door", number)
        match generator.randrange(3):
            case 0:
                message = decode(_line(encode(dict(generator.choice(MESSAGES))), generator))
                return message and encode(message)
            case 1:
                mission = Mission.from_json(damaged_text(generator.choice(missions), generator, ","))
                numbers = [mission.u] if mission.u is not None else []
                numbers += list(mission.route[:3]) if mission.route is not None else []
                if not all(np.all(np.isfinite(column)) for column in numbers):
                    raise Silent("a mission with numbers that are not finite")
                return mission.to_json()
        word = dict(generator.choice(WORDS))
        return guest.answered(_line(json.dumps(word).encode(), generator), number)

    try:
        yield read_mutant
    finally:
        guest.close()
        listening.close()


class _Guest:
    """A connection to a door that may be closed at any message."""

    def __init__(self, path: Path) -> None:
        self.path, self.line = path, self._connected(path)

    def _connected(self, path: Path) -> socket.socket:
        line = socket.socket(socket.AF_UNIX)
        line.settimeout(LONGEST_S)
        line.connect(str(path))
        return line

    def answered(self, word: bytes, number: int) -> bytes:
        """Return the messages of the vehicle until it answers the ping after a word; Hang if it does not."""
        token, answer = f"ping-{number}".encode(), b""
        try:
            self.line.sendall(word + b'\n{"type": "ping", "token": "' + token + b'"}\n')
            while token not in answer:
                data = self.line.recv(1 << 20)
                if not data:
                    raise ConnectionError
                answer += data
        except TimeoutError:
            raise Hang from None
        except ConnectionError:  # it may disconnect the sender of this message, but not the next client
            self.close()
            self.line = self._connected(self.path)
        return answer

    def close(self) -> None:
        self.line.close()


def _line(line: bytes, generator: random.Random) -> bytes:
    return _damaged(line.decode(), generator, 0.5, ",").replace(b"\n", b" ")


def _damaged(
    original: str, generator: random.Random, byte_share: float = 0.2, separators: str = "\n"
) -> bytes:
    if generator.random() < byte_share:
        return damaged_bytes(original.encode(), generator)
    return damaged_text(original, generator, separators).encode("utf-8", "surrogatepass")


def _write_new(path: Path, data: bytes) -> None:
    """Replace a file. ext4 writes a truncated file to the disk when it is closed: 3 ms for each input."""
    path.unlink(missing_ok=True)
    path.write_bytes(data)


FORMATS = {
    "mcap": mcap, "csv": csv, "map": hand_written_map, "vehicle": vehicle, "route": route, "door": door,
}  # fmt: skip
