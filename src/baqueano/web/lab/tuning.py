"""Tune gains in the worker: simulate laps, their cost landscape and a descent, with stored compiled kernels.

The vehicle is read from a file or a run. The route is a stored route, the route of the run, or a shape. A name that is
not in a list of this process is refused.
"""

import time
from collections import OrderedDict
from pathlib import Path

import numpy as np

from baqueano.contracts.names import SHAPE_NAMES
from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Verdict
from baqueano.errors import FileError, UsageError
from baqueano.guides.route import Route
from baqueano.guides.shapes import shape
from baqueano.parameter import parameters
from baqueano.runs import read_run
from baqueano.runs.route_file import read_route
from baqueano.signals import seconds
from baqueano.tune.laps import SimulatedLap, SimulatedLaps, simulated_laps
from baqueano.tune.objective import JERK_M2
from baqueano.tune.search import DIVERGED_COST, coordinates, descend, gains
from baqueano.tune.search_space import file_values
from baqueano.vehicle_file import load
from baqueano.vehicle_file.file import VehicleFile
from baqueano.vehicle_file.provenance import Provenance

SIZE_M, SPEED_M_S = 1.0, 0.25  # defaults of a shape, as in a service
MAX_POINTS, MAX_ROUTE_POINTS = 500, 1500  # maximum number of points of a drawn path and route
MAX_KERNELS = 4  # stored kernels
MAX_LAPS = 200  # maximum number of laps of one question
RUN_ROUTE = "run"


class TuningWorker:
    """The stored kernels, by vehicle, route and controller."""

    def __init__(self) -> None:
        self._laps_cache: OrderedDict[tuple[object, ...], tuple[VehicleFile, Route, SimulatedLaps]] = (
            OrderedDict()
        )

    def begin(self, request: JsonObject) -> JsonObject:
        """Return the gains with their ranges and start values, the routes, and the path of the chosen route.

        The request is {vehicle | path, routes, route, kind}.
        """
        names = route_names(request)
        name = request.get("route") or names[0]
        vehicle_file, route, laps = self._laps(request | {"route": name})
        search = laps.space
        block = search.block
        meanings = dict(_parameter_meanings(block))
        complete = bool(np.all(np.isfinite(search.file_gains)))
        rows = [
            {"name": n, "unit": "" if unit == "1" else unit, "meaning": meanings[n.partition("[")[0]],
             "low": low, "high": high, "file": file_value if complete else None, "value": first}
            for n, unit, low, high, file_value, first in zip(
                search.names, search.units, search.low.tolist(), search.high.tolist(), search.file_gains.tolist(),
                search.initial_gains.values(), strict=True)
        ]  # fmt: skip
        return {
            "gains": rows, "controller": type(block).__name__, "routes": names, "route": name, "price": JERK_M2,
            "seconds": laps.seconds, "whole": laps.is_whole_route, "ticks": round(laps.seconds * vehicle_file.rate_hz),
            "path": _path_document(route),
            "file": None if vehicle_file.path is None else vehicle_file.path.name,
        }  # fmt: skip

    def route(self, request: JsonObject) -> JsonObject:
        """Return the path of a route by its name, for the request {vehicle | path, routes, route}."""
        return {"name": request["route"]} | _path_document(_route(request))

    def lap(self, request: JsonObject) -> JsonObject:
        """Return path, cost and other results of a simulated lap with `gains`, and its computing time."""
        _, _, laps = self._laps(request)
        start_s = time.perf_counter()
        lap = laps.lap(_values(request["gains"], laps))
        return lap_json(lap) | {"ms": 1e3 * (time.perf_counter() - start_s)}

    def costs(self, request: JsonObject) -> JsonObject:
        """Return both terms of the cost of laps for the request {gains, a, b, positions: [[x, y], …]}.

        Only the gains a and b vary: x and y are their positions in [0, 1] within their ranges (search.py).
        """
        _, _, laps = self._laps(request)
        search, base = laps.space, _values(request["gains"], laps)
        a, b = (search.names.index(request[axis]) for axis in "ab")
        positions = np.clip(np.array(request["positions"], dtype=float).reshape(-1, 2)[:MAX_LAPS], 0.0, 1.0)
        lap_gains = np.tile(base, (len(positions), 1))
        for axis, k in ((0, a), (1, b)):
            lap_gains[:, k] = gains(positions[:, axis], search.low[k], search.high[k])
        return {"costs": _finite_or_none(laps.costs(lap_gains))}

    def descent(self, request: JsonObject) -> JsonObject:
        """Return the steps of a descent of the cost from `gains`: gains, positions in [0, 1], and costs.

        `price` weights the jerk.
        """
        _, _, laps = self._laps(request)
        price, search = max(0.0, float(request["price"])), laps.space
        start_s = time.perf_counter()
        start_gains = np.clip(_values(request["gains"], laps), search.low, search.high)
        descent = descend(lambda g: laps.cost_and_gradient(g, price), start_gains, search.low, search.high)
        descent_path = [*descent.path, descent.gains]
        return {
            "path": [gains.tolist() for gains in descent_path], "cost": descent.cost,
            "start_cost": float(descent.costs[0]), "laps": len(descent.costs), "seconds": time.perf_counter() - start_s,
            "places": [coordinates(gains, search.low, search.high).tolist() for gains in descent_path],
        }  # fmt: skip

    def write(self, request: JsonObject) -> JsonObject:
        """Write all gains into the vehicle file, and return its file name.

        Raise UsageError for a vehicle of the garage, which does not have a file of the user.
        """
        vehicle_file, _, laps = self._laps(request)
        if vehicle_file.path is None:
            raise UsageError.of("web.tune-garage", "baqueano new mylab", vehicle=vehicle_file.name)
        block = laps.space.with_gains(_values(request["gains"], laps))
        values = file_values(block, laps.space.names, request.get("kind") or None)
        origin = Provenance(run="tune, page", verdict=Verdict.USABLE)
        vehicle_file.with_values(values, dict.fromkeys(values, origin)).save()
        self._laps_cache.clear()
        return {"file": vehicle_file.path.name}

    def _laps(self, request: JsonObject) -> tuple[VehicleFile, Route, SimulatedLaps]:
        key = (_cache_key(request), request.get("route", ""), request.get("kind") or "")
        if key not in self._laps_cache:
            vehicle_file = requested_vehicle_file(request)
            route = _route(request)
            self._laps_cache[key] = (
                vehicle_file,
                route,
                simulated_laps(vehicle_file, route, request.get("kind") or None),
            )
            while len(self._laps_cache) > MAX_KERNELS:
                self._laps_cache.popitem(last=False)
        self._laps_cache.move_to_end(key)
        return self._laps_cache[key]


def requested_vehicle_file(request: JsonObject) -> VehicleFile:
    """Return the vehicle file of a question: the file named `vehicle`, or the file in the run at `path`."""
    from baqueano.drive.replay import recorded_vehicle_file

    if "vehicle" in request:
        return load(request["vehicle"])
    return recorded_vehicle_file(read_run(Path(request["path"])))


def route_names(request: JsonObject) -> list[str]:
    """Return the names of the possible routes: the run's route, the stored routes, and the shapes."""
    names = sorted(_route_files(request))
    return [
        *([RUN_ROUTE] if "path" in request and stored_run_route(request) is not None else []),
        *names,
        *SHAPE_NAMES,
    ]


def _route_files(request: JsonObject) -> dict[str, Path]:
    folder = request.get("routes")
    return {} if not folder else {path.stem: path for path in Path(folder).glob("*.csv")}


def _route(request: JsonObject) -> Route:
    name = request["route"]
    if name in SHAPE_NAMES:
        return shape(name, SIZE_M, SPEED_M_S)
    if name == RUN_ROUTE and "path" in request and (route := stored_run_route(request)) is not None:
        return route
    route_files = _route_files(request)
    if name not in route_files:
        raise FileError.of("door.no-route", value=repr(name)[:80], valid=route_names(request))
    return read_route(route_files[name])


def stored_run_route(request: JsonObject) -> Route | None:
    """Return the references of a run as a route; None if they are missing or do not move."""
    ref = read_run(Path(request["path"])).reference
    if ref is None:
        return None
    is_finite = np.isfinite(ref.eta).all(axis=1)
    if is_finite.sum() < 2 or not np.ptp(ref.eta[is_finite, :2], axis=0).any():
        return None
    t_ns = ref.t_ns[is_finite]
    return Route(seconds(t_ns, t_ns[0]), ref.eta[is_finite], ref.nu[is_finite], closed=False)


def _path_document(route: Route) -> JsonObject:
    x, y = np.round(route.eta[:: 1 + len(route.eta) // MAX_ROUTE_POINTS, :2].T, 4).tolist()
    return {"x": x, "y": y, "closed": bool(route.closed)}


def lap_json(lap: SimulatedLap) -> JsonObject:
    """Return a lap as data for the page: its path, its costs, and its other results."""
    stride = 1 + len(lap.x) // MAX_POINTS
    values = [lap.path_cost, lap.jerk_cost, lap.distance_rms_m, lap.distance_max_m, lap.saturated_fraction]
    path, jerk, rms, max_m, at_limit = (x if np.isfinite(x) else None for x in values)
    return {
        "x": np.round(lap.x[::stride], 4).tolist(), "y": np.round(lap.y[::stride], 4).tolist(),
        "cost": path, "jerk": jerk, "rms": rms, "most": max_m, "full": at_limit,
    }  # fmt: skip


def _parameter_meanings(block: object) -> "list[tuple[str, str]]":
    return [(name, parameter_.meaning) for name, parameter_ in parameters(block)]


def _values(numbers: object, laps: SimulatedLaps) -> np.ndarray:
    """Return gains (p,) from JSON, clipped to their bounds.

    Raise UsageError if their shape is wrong, or if a value is not finite.
    """
    try:
        values = np.array(numbers, dtype=float)
    except (TypeError, ValueError, OverflowError):
        values = np.zeros(0)
    if values.shape != laps.space.low.shape or not np.all(np.isfinite(values)):
        raise UsageError.of("web.not-understood", error="gains")
    return np.clip(values, laps.space.low, laps.space.high)


def _finite_or_none(costs: np.ndarray) -> "list[list[float | None]]":
    return [[float(x) if np.isfinite(x) and x < DIVERGED_COST else None for x in row] for row in costs]


def _cache_key(request: JsonObject) -> tuple[object, ...]:
    """Return a key that changes if the file of the vehicle, the run or the route changes."""
    paths = [Path(str(request[name])) for name in ("vehicle", "path") if name in request]
    paths += [path for name, path in _route_files(request).items() if name == request.get("route")]
    return tuple((str(path), path.stat().st_mtime_ns if path.is_file() else 0) for path in paths)
