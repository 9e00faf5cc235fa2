"""Plan missions by name, as a page requests them: a kind, a shape or a stored route, and values, but never a path.

  {kind: "teach", name, shape, size_m, speed_m_s, closed}     manual if `shape` is missing
  {kind: "repeat", route, laps, blocks}     blocks: role → kind, instead of the file's blocks
  {kind: "experiment", signal, seconds}
  {kind: "drive"}, {kind: "first drive"}

All kinds accept three more fields: `seed`, `shake`, a list of faults (worlds/faults/), and `fast_until_s`. The ticks do
not wait until this drive time. A whole mission in JSON, as the laptop sends it to a robot, contains its vehicle file
and the user's blocks.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from baqueano.contracts.values import JsonObject
from baqueano.door.frames.descriptions import ROLES
from baqueano.drive.mission import Mission, unpack
from baqueano.errors import FileError, UsageError
from baqueano.guides.route import Route
from baqueano.guides.shapes import shape
from baqueano.runs.folder import plain_label
from baqueano.runs.route_file import read_route
from baqueano.vehicle_file import load
from baqueano.vehicle_file.file import VehicleFile
from baqueano.vehicle_file.text.toml_text import read_text
from baqueano.worlds.faults.fault import Fault
from baqueano.worlds.faulty_world import MAX_FAULTS

SIZE_M, SPEED_M_S = 1.0, 0.25  # defaults of a shape
DEFAULT_DURATION_S = 60.0  # default duration of an experiment
MAX_DURATION_S = 3600.0


@dataclass(frozen=True, eq=False)
class MissionPlan:
    """A mission, its vehicle file, and the options of its simulation and its result."""

    mission: Mission
    vehicle_file: VehicleFile
    name: str = ""  # name of its route
    route_name: str = ""  # the name under which a taught route is stored
    closed: bool | None = None  # True for a closed route; None: closed if the drive returned to its start
    seed: int | None = None
    faults: tuple[Fault, ...] = ()
    fast_until_s: float = 0.0  # drive time until which the ticks do not wait

    def __post_init__(self) -> None:
        object.__setattr__(self, "mission", self.mission.with_durations(self.vehicle_file))

    @property
    def start(self) -> np.ndarray:
        """Return the pose (3,) at the start."""
        return self.mission.start_pose


@contextmanager
def mission_plan(
    mission_json: str, vehicle_file: VehicleFile, routes: "StoredRoutes", seed: int
) -> Iterator[MissionPlan]:
    """Yield the plan of a mission in JSON, which is a whole mission or a request by name.

    Raise UsageError or FileError if it is not a valid mission.
    """
    try:
        request = json.loads(mission_json)
        is_complete = "format" in request
        seed = int(request.get("seed", seed))
        kind = str(request["kind"])
        shake, fast_until_s = request.pop("shake", []), _checked_number(request, "fast_until_s", 0.0)
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise UsageError.of("mission.damaged", kind=type(error).__name__, error=error) from error
    if not isinstance(shake, list) or len(shake) > MAX_FAULTS:
        raise UsageError.of("shake.too-many", maximum=MAX_FAULTS)
    faults = tuple(Fault.parse(fault_request) for fault_request in shake)
    if not is_complete:
        yield replace(
            _named_plan(kind, request, vehicle_file, routes, seed), faults=faults, fast_until_s=fast_until_s
        )
        return
    extra_keys = ("seed", "shake", "fast_until_s")
    mission = Mission.from_json(json.dumps({k: v for k, v in request.items() if k not in extra_keys}))
    with TemporaryDirectory(prefix="baqueano-") as folder:
        vehicle_file = unpack(mission, Path(folder))
        yield MissionPlan(mission, vehicle_file, seed=seed, faults=faults, fast_until_s=fast_until_s)


def reload_if_changed(vehicle_file: VehicleFile) -> VehicleFile:
    """Return the vehicle file, read again if it has changed on the disk, as after gains were written.

    Raise FileError if it is broken.
    """
    if (
        vehicle_file.path is None
        or vehicle_file.on_disk is None
        or read_text(vehicle_file.path) == vehicle_file.on_disk
    ):
        return vehicle_file
    return load(vehicle_file.path)


class StoredRoutes:
    """The routes in a folder, by name."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def path(self, name: str) -> Path:
        """Return the path of the route with this name. Raise FileError for a name with forbidden characters."""
        if not name or plain_label(name) != name:
            raise FileError.of("door.route-name", value=repr(name))
        return self.folder / f"{name}.csv"

    def read(self, name: str) -> Route:
        """Return the stored route with this name. Raise FileError if it does not exist."""
        if not (path := self.path(name)).is_file():
            raise FileError.of("door.no-route", value=repr(name), valid=[*self.names()])
        return read_route(path)

    def names(self) -> list[str]:
        """Return the names of all stored routes."""
        return sorted(path.stem for path in self.folder.glob("*.csv") if plain_label(path.stem) == path.stem)

    def rows(self) -> list[JsonObject]:
        """Return name, closed, length [m] and duration [s] of each route that can be read."""
        rows: list[JsonObject] = []
        for name in self.names():
            try:
                route = self.read(name)
            except FileError:
                continue
            length_m = float(np.sum(np.hypot(*np.diff(route.eta[:, :2], axis=0).T)))
            seconds = float(route.t_s[-1])
            rows.append(
                {"name": name, "closed": bool(route.closed), "length_m": length_m, "seconds": seconds}
            )
        return rows


def _named_plan(
    kind: str, request: JsonObject, vehicle_file: VehicleFile, routes: StoredRoutes, seed: int
) -> MissionPlan:
    match kind:
        case "teach":
            stored_name = str(request.get("name") or "lesson")
            routes.path(stored_name)  # an invalid name is refused before the vehicle moves
            if (shape_name := request.get("shape")) is None:
                is_closed = request.get("closed")
                return MissionPlan(
                    Mission("teach"),
                    vehicle_file,
                    route_name=stored_name,
                    closed=None if is_closed is None else bool(is_closed),
                    seed=seed,
                )
            route = shape(
                str(shape_name),
                _checked_number(request, "size_m", SIZE_M),
                _checked_number(request, "speed_m_s", SPEED_M_S),
            )
            return MissionPlan(
                Mission("teach", route=route),
                vehicle_file,
                stored_name,
                stored_name,
                bool(route.closed),
                seed,
            )
        case "repeat":
            name = str(request.get("route", ""))
            laps = max(0, round(_checked_number(request, "laps", 1)))
            mission = Mission("repeat", route=routes.read(name), laps=laps, blocks=_replaced_blocks(request))
            return MissionPlan(mission, vehicle_file, name, seed=seed)
        case "experiment":
            from baqueano.simulate.excitation import excitation

            length_s = min(_checked_number(request, "seconds", DEFAULT_DURATION_S), MAX_DURATION_S)
            signal = str(request.get("signal", "random_steps")).replace("-", "_")
            u = excitation(signal, vehicle_file.command.limit, length_s, vehicle_file.rate_hz, seed)
            return MissionPlan(Mission("experiment", u=u), vehicle_file, seed=seed)
    return MissionPlan(Mission(kind), vehicle_file, seed=seed)


def _replaced_blocks(request: JsonObject) -> dict[str, str]:
    """Return the blocks of a repetition, role → kind, that replace the file's blocks.

    Raise UsageError if they are malformed.
    """
    blocks = request.get("blocks", {})
    is_mapping = isinstance(blocks, dict) and set(blocks) <= set(ROLES)
    if not is_mapping or not all(isinstance(kind, str) for kind in blocks.values()):
        raise UsageError.of("mission.damaged", kind="TypeError", error="blocks")
    return dict(blocks)


def _checked_number(request: JsonObject, name: str, default: float) -> float:
    try:
        value = float(request.get(name, default))
    except (TypeError, ValueError):
        value = float("nan")
    if not np.isfinite(value):
        raise UsageError.of("door.not-a-number", name=name, value=repr(request.get(name)))
    return value
