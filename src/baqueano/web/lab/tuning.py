"""Tune gains in the lab worker: simulate laps, their cost landscape and a descent, by stored compiled kernels.

The vehicle is read from a file or a run. The route is a stored route, the route of the run, or a shape. A name that is
not in a list of this process is refused.
"""

import time
from collections import OrderedDict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from baqueano.diagnostics import fault
from baqueano.errors import FileError, UsageError
from baqueano.guides.shapes import SHAPE_NAMES, shape
from baqueano.runs.route_file import read_route
from baqueano.tune.laps import SimulatedLaps, simulated_laps
from baqueano.tune.rehearsal import JERK_M2
from baqueano.tune.search import UNUSABLE, descend, gains, place
from baqueano.tune.search_space import file_values

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject
    from baqueano.guides.route import Route
    from baqueano.tune.laps import SimulatedLap
    from baqueano.vehicle_file.file import VehicleFile

SIZE_M, SPEED_M_S = 1.0, 0.25  # defaults of a shape, as in a service
POINTS = 500  # most points of a drawn path
KEPT = 4  # stored kernels
MOST = 200  # most laps of one question
OF_RUN = "run"


class TuningBench:
    """The stored kernels, by vehicle, route and controller."""

    def __init__(self) -> None:
        self._laps_cache: OrderedDict[tuple[object, ...], tuple[VehicleFile, Route, SimulatedLaps]] = (
            OrderedDict()
        )

    def begin(self, word: "JsonObject") -> "JsonObject":
        """Return the gains with their ranges and start values, the routes, and the path of the chosen route.

        The request is {vehicle | path, routes, route, kind}.
        """
        names = route_names(word)
        name = word.get("route") or names[0]
        file, route, laps = self._laps(word | {"route": name})
        search = laps.space
        block = search.block
        meanings = dict(_meanings(block))
        complete = bool(np.all(np.isfinite(search.before)))
        rows = [
            {"name": n, "unit": "" if unit == "1" else unit, "meaning": meanings[n.partition("[")[0]],
             "low": low, "high": high, "file": before if complete else None, "value": first}
            for n, unit, low, high, before, first in zip(
                search.names, search.units, search.low.tolist(), search.high.tolist(), search.before.tolist(),
                search.first.values(), strict=True)
        ]  # fmt: skip
        return {
            "gains": rows, "controller": type(block).__name__, "routes": names, "route": name, "price": JERK_M2,
            "seconds": laps.seconds, "whole": laps.whole, "ticks": round(laps.seconds * file.rate_hz),
            "path": {
                "x": np.round(route.eta[:, 0], 4).tolist()[:: 1 + len(route.eta) // 1500],
                "y": np.round(route.eta[:, 1], 4).tolist()[:: 1 + len(route.eta) // 1500],
                "closed": bool(route.closed),
            },
            "file": None if file.path is None else file.path.name,
        }  # fmt: skip

    def lap(self, word: "JsonObject") -> "JsonObject":
        """Return path, cost and figures of a simulated lap with `gains`, and its computing time."""
        _, _, laps = self._laps(word)
        began = time.perf_counter()
        lap = laps.lap(_values(word["gains"], laps))
        return lap_picture(lap) | {"ms": 1e3 * (time.perf_counter() - began)}

    def costs(self, word: "JsonObject") -> "JsonObject":
        """Return both terms of the cost of laps for the request {gains, a, b, at: [[x, y], …]}.

        Only the gains a and b vary: x and y are their positions in [0, 1] within their ranges (search.py).
        """
        _, _, laps = self._laps(word)
        search, base = laps.space, _values(word["gains"], laps)
        a, b = (search.names.index(word[axis]) for axis in "ab")
        at = np.clip(np.array(word["at"], dtype=float).reshape(-1, 2)[:MOST], 0.0, 1.0)
        each = np.tile(base, (len(at), 1))
        for axis, k in ((0, a), (1, b)):
            each[:, k] = gains(at[:, axis], search.low[k], search.high[k])
        return {"costs": _finite(laps.costs(each))}

    def downhill(self, word: "JsonObject") -> "JsonObject":
        """Return the steps of a descent of the cost from `gains`: gains, positions in [0, 1], and costs.

        `price` weights the jerk.
        """
        _, _, laps = self._laps(word)
        price, search = max(0.0, float(word["price"])), laps.space
        began = time.perf_counter()
        start = np.clip(_values(word["gains"], laps), search.low, search.high)
        descent = descend(lambda g: laps.cost_and_gradient(g, price), start, search.low, search.high)
        way = [*descent.way, descent.gains]
        return {
            "way": [each.tolist() for each in way], "cost": descent.cost, "before": float(descent.costs[0]),
            "laps": len(descent.costs), "seconds": time.perf_counter() - began,
            "places": [place(each, search.low, search.high).tolist() for each in way],
        }  # fmt: skip

    def write(self, word: "JsonObject") -> "JsonObject":
        """Write all gains into the vehicle file, and return its file name.

        Raise UsageError for a vehicle of the garage, which does not have a file of the user.
        """
        from baqueano.diagnostics import Verdict
        from baqueano.vehicle_file.history import Provenance

        vehicle_file, _, laps = self._laps(word)
        if vehicle_file.path is None:
            raise UsageError(fault("web.tune-garage", "baqueano new NAME", vehicle=vehicle_file.name))
        block = laps.space.with_gains(_values(word["gains"], laps))
        values = file_values(block, laps.space.names, word.get("kind") or None)
        origin = Provenance(run="tune, page", verdict=Verdict.USABLE)
        vehicle_file.with_values(values, dict.fromkeys(values, origin)).save()
        self._laps_cache.clear()
        return {"file": vehicle_file.path.name}

    def _laps(self, word: "JsonObject") -> "tuple[VehicleFile, Route, SimulatedLaps]":
        key = (_stamp(word), word.get("route", ""), word.get("kind") or "")
        if key not in self._laps_cache:
            vehicle_file = file_of(word)
            route = _route(word)
            self._laps_cache[key] = (
                vehicle_file,
                route,
                simulated_laps(vehicle_file, route, word.get("kind") or None),
            )
            while len(self._laps_cache) > KEPT:
                self._laps_cache.popitem(last=False)
        self._laps_cache.move_to_end(key)
        return self._laps_cache[key]


def file_of(word: "JsonObject") -> "VehicleFile":
    """Return the vehicle file of a question: the file named `vehicle`, or the file in the run at `path`."""
    from baqueano.drive.verbs import vehicle_of
    from baqueano.runs import read_run
    from baqueano.vehicle_file import load

    return load(word["vehicle"]) if "vehicle" in word else vehicle_of(read_run(Path(word["path"])))


def route_names(word: "JsonObject") -> list[str]:
    """Return the names of the possible routes: the run's route, the stored routes, and the shapes."""
    names = sorted(_route_files(word))
    return [*([OF_RUN] if "path" in word and _of_run(word) is not None else []), *names, *SHAPE_NAMES]


def _route_files(word: "JsonObject") -> dict[str, Path]:
    folder = word.get("routes")
    return {} if not folder else {path.stem: path for path in Path(folder).glob("*.csv")}


def _route(word: "JsonObject") -> "Route":
    name = word["route"]
    if name in SHAPE_NAMES:
        return shape(name, SIZE_M, SPEED_M_S)
    if name == OF_RUN and "path" in word and (route := _of_run(word)) is not None:
        return route
    route_files = _route_files(word)
    if name not in route_files:
        raise FileError(fault("door.no-route", found=repr(name)[:80], known=route_names(word)))
    return read_route(route_files[name])


def _of_run(word: "JsonObject") -> "Route | None":
    """Return the references of a run as a route; None if they are missing or do not move."""
    from baqueano.guides.route import Route
    from baqueano.runs import read_run
    from baqueano.signals import seconds

    ref = read_run(Path(word["path"])).reference
    if ref is None:
        return None
    good = np.isfinite(ref.eta).all(axis=1)
    if good.sum() < 2 or not np.ptp(ref.eta[good, :2], axis=0).any():
        return None
    t_ns = ref.t_ns[good]
    return Route(seconds(t_ns, t_ns[0]), ref.eta[good], ref.nu[good], False)


def lap_picture(lap: "SimulatedLap") -> "JsonObject":
    """Return a lap as data for the page: its path, its costs, and its figures."""
    every = 1 + len(lap.x) // POINTS
    figures = [lap.path_cost, lap.jerk_cost, lap.distance_rms_m, lap.distance_max_m, lap.saturated]
    path, jerk, rms, most, full = (x if np.isfinite(x) else None for x in figures)
    return {
        "x": np.round(lap.x[::every], 4).tolist(), "y": np.round(lap.y[::every], 4).tolist(),
        "cost": path, "jerk": jerk, "rms": rms, "most": most, "full": full,
    }  # fmt: skip


def _meanings(block: object) -> "list[tuple[str, str]]":
    from baqueano.parameter import parameters

    return [(name, parameter_.meaning) for name, parameter_ in parameters(block)]


def _values(numbers: object, laps: SimulatedLaps) -> np.ndarray:
    """Return gains (p,) from JSON, clipped to their bounds.

    Raise UsageError if their shape is wrong, or if a number is not finite.
    """
    try:
        values = np.array(numbers, dtype=float)
    except (TypeError, ValueError, OverflowError):
        values = np.zeros(0)
    if values.shape != laps.space.low.shape or not np.all(np.isfinite(values)):
        raise UsageError(fault("web.not-understood", error="gains"))
    return np.clip(values, laps.space.low, laps.space.high)


def _finite(costs: np.ndarray) -> "list[list[float | None]]":
    return [[float(x) if np.isfinite(x) and x < UNUSABLE else None for x in row] for row in costs]


def _stamp(word: "JsonObject") -> tuple[object, ...]:
    """Return a key that changes if the file of the vehicle, the run or the route changes."""
    paths = [Path(str(word[name])) for name in ("vehicle", "path") if name in word]
    paths += [path for name, path in _route_files(word).items() if name == word.get("route")]
    return tuple((str(path), path.stat().st_mtime_ns if path.is_file() else 0) for path in paths)
