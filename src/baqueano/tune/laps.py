"""Simulate a lap for each set of gains with one kernel: its path, its cost, and the gradient of the cost.

    C(g, q) = C_path(g) + q C_jerk(g)                                      cost.py (1) to (3)             (1)

g: gains; q: weight of jerks. The two terms are returned separately, so another q does not need another lap.
The vehicle is the model of the file with exact pose. It starts `offset_m` behind and beside the route, as in `tune`.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.geometry import compose
from baqueano.guides.route import Route
from baqueano.simulate.closed_loop import (
    closed_loop,
    drive_tick_count,
    loop_system,
    parameter_start,
    start_pose,
)
from baqueano.simulate.open_loop import tick_times
from baqueano.simulate.system import Input, begin
from baqueano.symbolic import Scan
from baqueano.tune.cost import Weights, jerk, path_cost, tick_errors
from baqueano.tune.objective import (
    HUBER_M,
    JERK_M2,
    MIN_BATCH_TICKS,
    OFFSET_M,
    checked_weights,
    rms,
    tuning_system,
)
from baqueano.tune.search_space import SearchSpace, search_space

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

MAX_LAP_S = 60.0  # longest simulated time of a lap


class _TickCosts(NamedTuple):
    """The contributions of a tick to the cost of a lap."""

    path: Tree  # to C_path
    jerk: Tree  # to C_jerk


class _LapTick(NamedTuple):
    """The outputs of the kernel at each tick of a lap."""

    x: Tree
    y: Tree
    costs: _TickCosts
    distance_m: Tree
    at_limit: Tree


class SimulatedLap(NamedTuple):
    """A simulated lap with given gains."""

    x: np.ndarray  # (N,) [m]
    y: np.ndarray
    path_cost: float  # [m²]
    jerk_cost: float
    distance_rms_m: float
    distance_max_m: float
    saturated_fraction: float  # fraction of the ticks at a limit of the command


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedLaps:
    """The laps of a vehicle on a route, for any gains of its controller."""

    space: SearchSpace
    weights: Weights
    seconds: float  # of a lap
    is_whole_route: bool  # False: only the first MAX_LAP_S of it
    _inputs: Input
    _lap_kernel: Scan
    _cost_kernel: Scan

    @property
    def backend(self) -> str:
        """Return the backend of the kernel."""
        return self._lap_kernel.backend

    def lap(self, gains: np.ndarray) -> SimulatedLap:
        """Return the simulated lap with gains (p,)."""
        _, tick = self._lap_kernel.run(self._inputs, gains)
        costs = float(np.sum(tick.costs.path)), float(np.sum(tick.costs.jerk))
        max_distance_m, saturated_fraction = float(np.max(tick.distance_m)), float(np.mean(tick.at_limit))
        return SimulatedLap(tick.x, tick.y, *costs, rms(tick.distance_m), max_distance_m, saturated_fraction)

    def costs(self, gains: np.ndarray) -> np.ndarray:
        """Return C_path and C_jerk (L, 2) of the laps with gains (L, p)."""
        if len(gains) * len(self._inputs.t_ns) < MIN_BATCH_TICKS:
            laps = [self.lap(lap_gains) for lap_gains in gains]
            return np.array([(lap.path_cost, lap.jerk_cost) for lap in laps]).reshape(-1, 2)
        return self._cost_kernel.batch_sums(self._inputs, gains)[0]

    def cost_and_gradient(self, gains: np.ndarray, price: float) -> tuple[float, np.ndarray]:
        """Return C and ∂C/∂gains (p,) for a weight of jerks [m²].  (1)"""
        y, derivatives = self._cost_kernel.sensitivities(self._inputs, gains)
        weights = np.array(_TickCosts(1.0, price))
        return float(np.sum(y @ weights)), np.sum(weights @ derivatives, axis=0)


def simulated_laps(
    vehicle_file: "VehicleFile", route: Route, kind: str | None = None, backend: str = "auto"
) -> SimulatedLaps:
    """Return the laps of the file's vehicle on a route, or on the first MAX_LAP_S of a longer route.

    Parameters
    ----------
    vehicle_file : VehicleFile
        The identified vehicle and its controller.
    route : Route
        The route to follow once.
    kind : str, optional
        Controller that replaces the controller of the file: a kind of the package, or "file.py:Class".
    backend : str
        "auto", "c" or "python".

    Returns
    -------
    SimulatedLaps
        The laps; they are compiled at the first lap.

    Raises
    ------
    UsageError
        For a controller that does not have a gain.
    """
    space = search_space(vehicle_file, controller=kind)
    weights = checked_weights(vehicle_file, None, HUBER_M, JERK_M2)
    system = tuning_system(loop_system(vehicle_file, route, 1, perfect=True, controller=space.block))
    rate, limit = vehicle_file.rate_hz, vehicle_file.command.limit
    full_tick_count = drive_tick_count(system, rate)
    tick_count = min(full_tick_count, round(MAX_LAP_S * rate))

    def output(loop_output: Tree) -> _LapTick:
        errors, eta = tick_errors(limit, loop_output), loop_output.truth.eta
        costs = _TickCosts(path_cost(weights, loop_output), jerk(limit, loop_output))
        return _LapTick(eta[0], eta[1], costs, errors.distance_m, errors.at_limit)

    paths = tuple(f"controller.{name}" for name in space.names)
    state = begin(system, compose(start_pose(system), np.array([-OFFSET_M, OFFSET_M, 0.0])))
    start = parameter_start(system, paths, state)
    kernel = closed_loop(system, rate, noise=False, backend=backend, paths=paths, start=start, output=output)
    is_whole = tick_count == full_tick_count
    return SimulatedLaps(
        space,
        weights,
        tick_count / rate,
        is_whole,
        Input(tick_times(tick_count, rate), None),
        kernel,
        kernel.part("costs"),
    )
