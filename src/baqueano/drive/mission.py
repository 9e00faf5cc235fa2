"""Represent a mission as data: the same on the laptop, in a simulation and on the vehicle.

`perform` executes a mission with the functions of tasks.py and returns the run. `pack` prepares a mission to be sent:
its JSON then contains the texts of the vehicle file and of the user's blocks. The JSON contains all digits of a double.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from importlib.util import decode_source
from pathlib import Path
from typing import Any

import numpy as np

from baqueano.blocks import read_module
from baqueano.contracts.values import JsonObject
from baqueano.drive.first_drive import careful_drive
from baqueano.drive.safety.precautions import Precautions
from baqueano.drive.tasks import drive_with_driver, experiment, repeat
from baqueano.errors import FileError, UsageError
from baqueano.guides.repeat import ENDLESS_S, Repeat
from baqueano.guides.route import Route
from baqueano.runs import Run
from baqueano.standstill import with_usual_rest
from baqueano.vehicle_file import load
from baqueano.vehicle_file.file import VehicleFile

KINDS = ("experiment", "first drive", "drive", "teach", "repeat")
FORMAT_VERSION = 1
MAX_LAPS = 10**9


@dataclass(frozen=True, slots=True, eq=False)
class Mission:
    """A mission as data. The constructor raises UsageError for an unknown kind or a missing `u` or route.

    An experiment needs `u`, a repetition needs a route. The kind "teach" has a route, or None if a person drives. In
    the kind "drive" a person drives without teaching a route. UsageError is also raised for a damaged `start` or
    `precautions`.

    >>> manual_lesson = Mission("teach")
    >>> spin = Mission("experiment", u=np.tile([0.0, 0.0, 0.6], (100, 1)))
    >>> Mission.from_json(spin.to_json()).u.shape
    (100, 3)
    """

    kind: str  # one of KINDS
    u: np.ndarray | None = None  # (N, n), a command per tick
    route: Route | None = None
    laps: int = 1  # 0: without end
    hold: bool = True  # manual driving: hold the heading, if the vehicle has a gyro
    blocks: dict[str, str] = field(default_factory=dict)  # role → "file.py:Class", replaces the file's block
    # pose x, y [m], ψ [rad] of the vehicle in the map; () for the first pose of the route
    start: tuple[float, ...] = ()
    rest_s: float | None = None  # at rest before the drive along a route; None: the usual time
    precautions: JsonObject = field(default_factory=dict)  # of a repetition, as Precautions.to_json
    vehicle: str = ""  # text of the vehicle file, after `pack`
    texts: dict[str, str] = field(default_factory=dict)  # name of a file → its text, of the user's blocks
    duration_s: float | None = None  # rest and drive, after `with_durations`; None if unknown or without end

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise UsageError.of("mission.kind", kind=self.kind, valid=KINDS)
        if len(self.start) not in (0, 3):
            raise UsageError.of("mission.damaged", kind="ValueError", error=f"start = {self.start!r:.80}")
        Precautions.from_json(self.precautions)
        for kind, name in (("experiment", "u"), ("repeat", "route")):
            if self.kind == kind and getattr(self, name) is None:
                raise UsageError.of("mission.lacks", kind=kind, name=name)

    @property
    def is_manual(self) -> bool:
        """Return True if a person drives."""
        return self.kind in ("drive", "teach") and self.route is None

    @property
    def start_pose(self) -> np.ndarray:
        """Return the pose (3,) of the vehicle at the start, in the map: `start`, else the first pose of the route."""
        if self.start:
            return np.array(self.start)
        return np.zeros(3) if self.route is None else self.route.eta[0]

    def to_json(self) -> str:
        """Return the mission as one line of JSON."""
        route = None if self.route is None else {k: _with_lists(v) for k, v in self.route._asdict().items()}
        other_fields = {"start": list(self.start), "rest_s": self.rest_s, "precautions": self.precautions}
        return json.dumps(
            {
                "format": FORMAT_VERSION, "kind": self.kind, "vehicle": self.vehicle, "u": _with_lists(self.u),
                "route": route,
                "laps": self.laps, "hold": self.hold, "blocks": self.blocks, "texts": self.texts,
                **{name: value for name, value in other_fields.items() if value not in ([], None, {})},
            },
            allow_nan=False,
        )  # fmt: skip

    def with_durations(self, vehicle_file: VehicleFile) -> "Mission":
        """Return the mission with its rest in seconds, and its duration if the vehicle never waits.

        Only a drive along a route has a rest. The duration includes a start from rest and the braking at the end.
        """
        if self.route is None:
            duration_s = None if self.u is None else len(self.u) / vehicle_file.rate_hz
            return replace(self, rest_s=0.0, duration_s=duration_s)
        rest_s: float = with_usual_rest({"rest_s": self.rest_s}, vehicle_file.sensors)["rest_s"]
        is_lesson, limits = self.kind != "repeat", {}
        if not is_lesson and "acceleration_m_s2" in (values := vehicle_file.data.get("guide", {})):
            limits = {"acceleration_m_s2": values["acceleration_m_s2"]}
        laps, ends_in_motion = 1 if is_lesson else self.laps, is_lesson and self.route.closed
        guide = Repeat.along(self.route, laps, ends_in_motion, **limits)
        is_endless = guide.end_s >= ENDLESS_S
        return replace(self, rest_s=rest_s, duration_s=None if is_endless else rest_s + guide.duration_s)

    @classmethod
    def from_json(cls, text: str) -> "Mission":
        """Return the mission in this JSON, the inverse of `to_json`. Raise UsageError for any other text."""
        try:
            document = json.loads(text, parse_constant=_finite_float, parse_float=_finite_float)
            if document.pop("format") != FORMAT_VERSION:
                raise UsageError.of("mission.version")
            route, u = document.pop("route"), document.pop("u")
            for name, value in document.items():
                _check_field(name, value)
            document["start"] = tuple(map(float, document.get("start", ())))
            return cls(
                **document,
                u=None if u is None else np.atleast_2d(np.array(u, dtype=float)),
                route=None if route is None else _route_from_json(route),
            )
        except (KeyError, TypeError, ValueError, AttributeError, RecursionError, OverflowError) as error:
            raise UsageError.of("mission.damaged", kind=type(error).__name__, error=error) from error


def pack(mission: Mission, vehicle_file: VehicleFile) -> Mission:
    """Return the mission with the text of the vehicle file, and of all files with the user's blocks.

    The mission and the vehicle file name these files relative to the folder of the vehicle file. Raise FileError if two
    different files have the same name.

    >>> from baqueano.vehicle_file import load
    >>> ready = pack(Mission("first drive"), load("small"))
    >>> 'name = "small"' in ready.vehicle, ready.texts
    (True, {})
    """
    texts: dict[str, str] = {}
    folder = Path() if vehicle_file.path is None else vehicle_file.path.parent

    def pack_kind(kind: str) -> str:
        file_stem, colon, name = kind.partition(".py:")
        if not colon:
            return kind
        path = folder / f"{file_stem}.py"
        text = decode_source(path.read_bytes())
        if texts.setdefault(path.name, text) != text:
            raise FileError.of("mission.two-files", name=path.name)
        return f"{path.name}:{name}"

    blocks, vehicle = {role: pack_kind(kind) for role, kind in mission.blocks.items()}, vehicle_file.text
    for kind in filter(lambda kind: ".py:" in kind, _block_kinds(vehicle_file.data)):
        for quote in "\"'":
            vehicle = vehicle.replace(f"{quote}{kind}{quote}", f'"{pack_kind(kind)}"')
    return replace(mission, vehicle=vehicle, blocks=blocks, texts=texts)


def perform(
    mission: Mission, vehicle_file: VehicleFile, hand: Callable[[], np.ndarray] | None = None, **options: Any
) -> Run:
    """Execute a mission with the vehicle of the file, and return the run.

    `hand` returns the present command (n,) of a person. Options are as in `session.drive` and its `Conditions`; with
    the `world` `worlds.Robot`, a real vehicle drives. Raise UsageError for the kind "teach" without a route
    and without `hand`.

    >>> from baqueano.vehicle_file import load
    >>> run = perform(Mission("experiment", u=np.tile([0.0, 0.0, 0.6], (50, 1))), load("small"))
    >>> print(run.metadata["kind"], f"{run.truth.eta[-1, 2]:.1f} rad")
    experiment 1.2 rad
    """
    mission = mission.with_durations(vehicle_file)
    match mission.kind:
        case "experiment":
            assert mission.u is not None
            return experiment(vehicle_file, mission.u, **options)
        case "first drive":
            return careful_drive(vehicle_file, **options)
        case "teach" | "drive":
            driver = hand if mission.route is None else mission.route
            if driver is None:
                raise UsageError.of("mission.no-driver")
            options = {"rest_s": mission.rest_s} | options
            return drive_with_driver(vehicle_file, driver, hold=mission.hold, kind=mission.kind, **options)
    assert mission.route is not None
    precautions = Precautions.from_json(mission.precautions)
    settings = {field.name: getattr(precautions, field.name) for field in fields(precautions)}
    settings |= {"rest_s": mission.rest_s} | ({"eta": np.array(mission.start)} if mission.start else {})
    return repeat(vehicle_file, mission.route, mission.laps, **mission.blocks, **(settings | options))


def unpack(mission: Mission, folder: Path) -> VehicleFile:
    """Write the vehicle file of a mission and the user's blocks into `folder`, and return the loaded file.

    Raise UsageError for an invalid name of a block file.
    """
    for name, text in mission.texts.items():
        if Path(name).name != name or not name.endswith(".py"):
            raise UsageError.of("mission.file-name", name=repr(name))
        (folder / name).write_text(text, encoding="utf-8")
    for name in mission.texts:  # executes the user's code before a block is created
        read_module(name, folder)
    path = folder / "vehicle.toml"
    path.write_text(mission.vehicle, encoding="utf-8")
    return load(path)


def _block_kinds(data: JsonObject) -> list[str]:
    """Return every `kind` in the tables of a vehicle file."""
    tables = [t for t in data.values() if isinstance(t, dict)]
    tables += [t for t in data.get("sensors", {}).values() if isinstance(t, dict)]
    return [str(table["kind"]) for table in tables if "kind" in table]


def _finite_float(number: str) -> float:
    """Return a number in JSON as a float. Raise ValueError for NaN, Infinity, and numbers too large for a double."""
    value = float(number)
    if not abs(value) < float("inf"):
        raise ValueError(f"{number} is not finite")
    return value


def _check_field(name: str, value: object) -> None:
    """Raise ValueError if a field of a mission has the wrong type, or if the number of laps is out of range."""
    is_text_dict = isinstance(value, dict) and all(isinstance(text, str) for text in value.values())
    is_valid = {
        "laps": isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= MAX_LAPS,
        "hold": isinstance(value, bool), "blocks": is_text_dict, "texts": is_text_dict,
        "rest_s": isinstance(value, int | float) and not isinstance(value, bool) and value >= 0,
        "start": isinstance(value, list), "precautions": isinstance(value, dict),
    }  # fmt: skip
    if not is_valid.get(name, isinstance(value, str)):
        raise ValueError(f"{name} = {value!r:.80}")


def _route_from_json(document: JsonObject) -> Route:
    t_s, eta, nu = (np.array(document[name], dtype=float) for name in ("t_s", "eta", "nu"))
    return Route(t_s, eta, nu, bool(document["closed"]))


def _with_lists(x: object) -> object:
    return x.tolist() if isinstance(x, np.ndarray) else x
