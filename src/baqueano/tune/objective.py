"""The simulated drives that a search repeats, as compiled functions of the gains.

    C(g) = (1/V Σ_v C_v⁸)^(1/8),    C_v = mean over routes and seeds of the cost of vehicle v              (1)

g are the gains, V is the number of vehicles. With one vehicle (1) is its mean cost. With many vehicles it is close to
the largest cost, and differentiable everywhere:

    ∂C = Σ_v (C_v / C)⁷ ∂C_v / V                                                                          (2)

Vehicles are drawn from the covariance of the fit; a delay without a standard deviation is drawn within ±
DELAY_SPREAD_S. Many drives run as one batch (symbolic/). A few drives run one after the other, because a batch
takes longer to compile.
"""

from collections.abc import Sequence
from dataclasses import dataclass, is_dataclass, replace
from math import ceil, inf
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baqueano.contracts.blocks import Guide, OwnBlock
from baqueano.contracts.calls import checked_call
from baqueano.contracts.values import Tree
from baqueano.errors import AnswerNo, UsageError
from baqueano.geometry import compose
from baqueano.guides.route import Route
from baqueano.messages.language import mark as N_
from baqueano.parameter import parameters
from baqueano.routes.capability import Capability
from baqueano.simulate.closed_loop import (
    closed_loop,
    drive_tick_count,
    loop_system,
    parameter_start,
    sample_references,
    start_pose,
)
from baqueano.simulate.many import draw_parameters
from baqueano.simulate.open_loop import draw_noise, tick_times
from baqueano.simulate.system import Input, System, begin, parameter_vector
from baqueano.symbolic import Scan, with_value
from baqueano.tune.cost import TickErrors, Weights, tick_cost, tick_errors
from baqueano.tune.search_space import SearchSpace, search_space
from baqueano.vehicles.rk4 import row_rate_hz
from baqueano.worlds.noise import random_stream
from baqueano.worlds.simulated import tick_row_count

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

RADIAN_M = 0.1  # weight of a radian if the file contains neither a track nor a radius
HUBER_M = 0.1
OFFSET_M = 0.1  # with 0 and an exact model, feedback is not needed, and the gradient of every gain is 0
JERK_M2 = 0.1
SOFT_MAXIMUM_POWER = 8  # of (1)
DELAY_SPREAD_S = 0.01
DELAY_PATH = "model.drivetrain.delay_s"
SPEED_SAMPLES = 32  # of a route, for its speed
MIN_BATCH_DRIVES = 32  # number of drives above which a batch is compiled for gradients
MIN_BATCH_TICKS = 1_000_000  # number of ticks of all drives above which a batch is compiled for costs


class DriveErrors(NamedTuple):
    """The errors of the drives with given gains, the approach to the route included."""

    start_m: float  # distance from the reference at the start
    distance_rms_m: float
    distance_max_m: float
    heading_rms_rad: float
    saturated_fraction: float  # fraction of the ticks at a limit of the command


class _TickOutput(NamedTuple):
    """The outputs of the loop at a tick: both kernels are from one trace."""

    cost: Tree
    errors: TickErrors


class ObjectiveCase(NamedTuple):
    """A route with its simulated loop, its kernels and the noise of its seeds."""

    system: System
    rate_hz: float
    ticks: int
    cost: Scan
    figures_kernel: Scan
    speed_m_s: float  # median of the route's reference
    inputs: tuple[Input, ...] = ()  # of each seed

    def with_seeds(self, seeds: Sequence[int | None]) -> "ObjectiveCase":
        """Return the same case with the noise of these seeds; the seed None gives a drive without noise."""
        t_ns, sensors = tick_times(self.ticks, self.rate_hz), self.system.sensors
        rows = tick_row_count(1.0 / self.rate_hz)
        noise = [None if seed is None else draw_noise(sensors, seed, self.ticks, rows) for seed in seeds]
        return self._replace(inputs=tuple(Input(t_ns, x) for x in noise))


@dataclass(frozen=True, slots=True, eq=False)
class Objective:
    """Routes, seeds and vehicles, and the cost of the drives with all these routes, seeds and vehicles."""

    space: SearchSpace
    weights: Weights
    loop: str  # "perfect pose" or "estimator in the loop"
    cases: tuple[ObjectiveCase, ...]
    seed_count: int  # number of seeds of the noise of each case
    vehicles: np.ndarray  # (v, q) parameters that were drawn; (1, 0): only the file's own vehicle

    @property
    def backend(self) -> str:
        """Return the backend of the kernels."""
        return self.cases[0].cost.backend

    @property
    def speed_m_s(self) -> float:
        """Return the mean speed of the routes."""
        return float(np.mean([case.speed_m_s for case in self.cases]))

    @property
    def drive_count(self) -> int:
        """Return the number of simulated drives for one value of the cost."""
        return len(self.cases) * self.seed_count * len(self.vehicles)

    def cost(self, gains: np.ndarray) -> float:
        """Return C [m²] for the gains (p,).  (1)"""
        return float(self.costs(gains[None])[0])

    def costs(self, gains: np.ndarray) -> np.ndarray:
        """Return C (k,) for k sets of gains (k, p).  (1)"""
        return soft_maximum(self.vehicle_costs(gains))

    def vehicle_costs(self, gains: np.ndarray) -> np.ndarray:
        """Return the cost C_v (k, v) of each vehicle for k sets of gains (k, p)."""
        k, v = len(gains), len(self.vehicles)
        theta = np.concatenate([np.repeat(gains, v, axis=0), np.tile(self.vehicles, (k, 1))], axis=1)
        return self._mean(theta, 0)[0].reshape(k, v)

    def cost_and_gradient(self, gains: np.ndarray) -> tuple[float, np.ndarray]:
        """Return C and ∂C/∂gains (p,).  (2)"""
        gain_rows = np.broadcast_to(gains, (len(self.vehicles), len(gains)))
        costs, gradients = self._mean(np.concatenate([gain_rows, self.vehicles], axis=1), len(gains))
        cost = float(soft_maximum(costs[None])[0])
        if not np.isfinite(cost):
            return cost, np.full(len(gains), np.nan)
        weight = (
            (costs / cost) ** (SOFT_MAXIMUM_POWER - 1) / len(costs) if cost > 0.0 else np.zeros(len(costs))
        )
        return cost, weight @ gradients

    def drive_errors(self, gains: np.ndarray) -> DriveErrors:
        """Return the errors over all drives with the gains (p,)."""
        thetas = [np.concatenate([gains, v]) for v in self.vehicles]
        errors_by_drive = [
            case.figures_kernel.run(inputs, theta)[1]
            for case in self.cases for inputs in case.inputs for theta in thetas
        ]  # fmt: skip
        d, psi, at_limit = (np.concatenate(x) for x in zip(*errors_by_drive, strict=True))
        start_m = max(float(distances[0]) for distances, *_ in errors_by_drive)
        return DriveErrors(start_m, rms(d), float(np.max(d)), rms(psi), float(np.mean(at_limit)))

    def nominal(self) -> "Objective":
        """Return the same drives with only the vehicle of the file."""
        return replace(self, vehicles=self.vehicles[:1])

    def with_seeds(self, first_seed: int, count: int) -> "Objective":
        """Return the same drives with the noise of `count` seeds, from `first_seed` on."""
        cases = tuple(case.with_seeds(range(first_seed, first_seed + count)) for case in self.cases)
        return replace(self, cases=cases, seed_count=count)

    def _mean(self, theta: np.ndarray, derivative_count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean cost (r,) over routes and seeds for each row of θ (r, p + q), and its gradient.

        The gradient (r, slopes) is with respect to the first `derivative_count` entries of θ.
        """
        total, gradients = np.zeros(len(theta)), np.zeros((len(theta), derivative_count))
        for case in self.cases:
            mean_cost = (
                _batch_mean if self._batch_pays_off(case, len(theta), derivative_count) else _sequential_mean
            )
            cost, gradient = mean_cost(case, theta, derivative_count)
            total, gradients = total + cost, gradients + gradient
        return total / len(self.cases), gradients / len(self.cases)

    def _batch_pays_off(self, case: ObjectiveCase, row_count: int, derivative_count: int) -> bool:
        drives = row_count * self.seed_count
        if derivative_count:
            return drives >= MIN_BATCH_DRIVES
        return drives * case.ticks >= MIN_BATCH_TICKS and drives > 1


def soft_maximum(costs: np.ndarray) -> np.ndarray:
    """Return the combined cost (k,) of costs (k, v).  (1)"""
    if costs.shape[1] == 1:
        return np.where(np.isfinite(costs[:, 0]), costs[:, 0], np.inf)
    worst_case = np.max(costs, axis=1, keepdims=True)
    safe = np.where((worst_case > 0.0) & np.isfinite(worst_case), worst_case, 1.0)
    mean = safe[:, 0] * np.mean((costs / safe) ** SOFT_MAXIMUM_POWER, axis=1) ** (1.0 / SOFT_MAXIMUM_POWER)
    return np.where(np.isfinite(worst_case[:, 0]), mean, np.inf)


def _sequential_mean(
    case: ObjectiveCase, theta: np.ndarray, derivative_count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean cost (r,) over seeds for each row of θ, and the gradients (r, slopes).

    Drives run one after the other.
    """
    total, gradients = np.zeros(len(theta)), np.zeros((len(theta), derivative_count))
    for inputs in case.inputs:
        for k, row in enumerate(theta):
            if derivative_count:
                cost, gradient = case.cost.cost_and_gradient(inputs, row)
                gradients[k] += gradient[:derivative_count]
            else:
                cost = case.cost.cost(inputs, row)
            total[k] += cost
    return total / len(case.inputs), gradients / len(case.inputs)


def _batch_mean(
    case: ObjectiveCase, theta: np.ndarray, derivative_count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean cost (r,) over seeds for each row of θ, and the gradients (r, slopes), as one batch.

    All drives have the same noise.
    """
    total, gradients = np.zeros(len(theta)), np.zeros((len(theta), derivative_count))
    for inputs in case.inputs:
        cost, gradient = case.cost.batch_sums(inputs, theta, derivative_count)
        total, gradients = total + cost[:, 0], gradients + gradient[:, 0]
    return total / len(case.inputs), gradients / len(case.inputs)


@checked_call("bq.tune(robot, route)")
def tuning_objective(
    vehicle_file: "VehicleFile",
    routes: Route | Guide | Sequence[Route | Guide],
    *,
    controller: OwnBlock | None = None,
    gains: Sequence[str] | None = None,
    bounds: dict[str, tuple[float, float]] | None = None,
    laps: int = 1,
    duration_s: float | None = None,
    radian_m: float | None = None,
    huber_m: float = HUBER_M,
    jerk_m2: float = JERK_M2,
    effort_m2: float = 0.0,
    offset_m: float = OFFSET_M,
    estimator: bool = False,
    seeds: int = 1,
    draws: int = 0,
    seed: int = 0,
    backend: str = "auto",
) -> Objective:
    """Return the cost of the drives along `routes`, as compiled functions of the gains. `tune` describes the keywords.

    Raise UsageError for an invalid `offset_m` or weight, or without a route or seed. Raise AnswerNo if a command that a
    route needs has no effect.
    """
    weights = checked_weights(vehicle_file, radian_m, huber_m, jerk_m2, effort_m2)
    if not np.isfinite(offset_m):
        raise UsageError.of("tune.offset", offset_m=offset_m)
    space = search_space(vehicle_file, gains, bounds, controller)
    run_kernels: list[Any] = (
        [*routes] if isinstance(routes, list | tuple) and not isinstance(routes, Route) else [routes]
    )
    if not run_kernels or seeds < 1:
        raise UsageError.of("tune.nothing-to-drive", routes=len(run_kernels), seeds=seeds)
    for route in run_kernels:
        _check_motion(vehicle_file, route)
    systems = [
        tuning_system(loop_system(vehicle_file, route, laps, not estimator, space.block))
        for route in run_kernels
    ]
    paths_and_delay, vehicles = (
        draw_vehicles(vehicle_file, systems[0], draws, seed) if draws else ((), np.zeros((1, 0)))
    )
    paths = (*(f"controller.{name}" for name in space.names), *paths_and_delay)
    systems = [
        _with_delay_slots(system, paths_and_delay, vehicles, vehicle_file.rate_hz) for system in systems
    ]
    cases = [
        _case(vehicle_file, system, paths, weights, duration_s, offset_m, estimator, backend)
        for system in systems
    ]
    loop = N_("estimator in the loop") if estimator else N_("perfect pose")
    noise_seeds = range(seed, seed + seeds) if estimator else [None]
    each_leg = tuple(case.with_seeds(noise_seeds) for case in cases)
    return Objective(space, weights, loop, each_leg, len(noise_seeds), vehicles)


def _check_motion(vehicle_file: "VehicleFile", route: Route | Guide) -> None:
    """Raise AnswerNo if the commands do not affect the speed or the yaw rate that a route needs."""
    if not isinstance(route, Route):
        return
    v, _, r = route.nu[np.argmax(np.abs(route.nu[:, 2]))]
    if np.isinf(Capability(vehicle_file, "numpy").share(v, r)):
        figures = {"vehicle": vehicle_file.name, "speed_m_s": float(v), "yaw_rate_rad_s": float(r)}
        raise AnswerNo.of("tune.no-effect", **figures)


def _case(
    vehicle_file: "VehicleFile", system: System, paths: tuple[str, ...], weights: Weights, duration_s: float | None,
    offset_m: float, noise: bool, backend: str,
) -> ObjectiveCase:  # fmt: skip
    rate, limit = vehicle_file.rate_hz, vehicle_file.command.limit
    tick_count = drive_tick_count(system, rate) if duration_s is None else max(1, round(duration_s * rate))
    state = begin(system, compose(start_pose(system), np.array([-offset_m, offset_m, 0.0])))
    start = parameter_start(system, paths, state)

    def output(loop_output: Tree) -> _TickOutput:
        return _TickOutput(tick_cost(weights, limit, loop_output), tick_errors(limit, loop_output))

    loop = closed_loop(system, rate, noise=noise, backend=backend, paths=paths, start=start, output=output)
    kernels = loop.part("cost"), loop.part("errors")
    return ObjectiveCase(
        system, rate, tick_count, *kernels, _median_speed(system, tick_times(tick_count, rate))
    )


def _median_speed(system: System, t_ns: np.ndarray) -> float:
    """Return the median speed [m/s] of the route's reference at some of the times `t_ns` (N,)."""
    references = sample_references(system, t_ns[:: 1 + len(t_ns) // SPEED_SAMPLES].tolist())
    return float(np.median([np.hypot(reference.nu[0], reference.nu[1]) for reference in references]))


def draw_vehicles(
    vehicle_file: "VehicleFile", system: System, count: int, seed: int
) -> tuple[tuple[str, ...], np.ndarray]:
    """Return paths and values (1 + count, q) of the parameters of the vehicles; the first is the file's vehicle."""
    paths, theta, _ = draw_parameters(vehicle_file, system, count, seed)
    nominal = parameter_vector(system, paths)
    delay = getattr(getattr(system.model, "drivetrain", None), "delay_s", None)
    if delay is not None and DELAY_PATH not in paths:
        delays_s = delay + random_stream(seed, "delay").uniform(-DELAY_SPREAD_S, DELAY_SPREAD_S, count)
        paths, nominal = (*paths, DELAY_PATH), np.append(nominal, delay)
        theta = np.column_stack([theta, np.maximum(delays_s, 0.0)])
    return paths, np.vstack([nominal, theta])


def _with_delay_slots(system: System, paths: tuple[str, ...], vehicles: np.ndarray, rate_hz: float) -> System:
    """Return the system with enough slots for the longest delay that is drawn."""
    if DELAY_PATH not in paths:
        return system
    # the vehicles of the test are drawn later
    max_delay_s = float(np.max(vehicles[:, paths.index(DELAY_PATH)])) + DELAY_SPREAD_S
    slots = ceil(max_delay_s * row_rate_hz(rate_hz))
    return with_value(system, "model.drivetrain.delay_slots", max(slots, system.model.drivetrain.delay_slots))


def tuning_system(system: System) -> System:
    """Return the system that is tuned: its reference begins and ends at full speed, as in the paper.

    So the feedback has to act: gains for a gentle start alone would tolerate less delay. The steps of converters and
    timers are removed, because the slope of a staircase is 0.
    """
    if getattr(system.guide, "acceleration_m_s2", None) is not None:
        system = with_value(system, "guide.acceleration_m_s2", inf)
    blocks = [("model.drivetrain", getattr(system.model, "drivetrain", None))]
    for path, block in [*blocks, *((f"sensors.{name}", s) for name, s in system.sensors._asdict().items())]:
        for field, _ in parameters(block) if is_dataclass(block) else ():
            if field.endswith("_step"):
                system = with_value(system, f"{path}.{field}", 0.0 * getattr(block, field))
    return system


def rms(x: np.ndarray) -> float:
    """Return the root of the mean square of all entries."""
    return float(np.sqrt(np.mean(x**2)))


def checked_weights(
    vehicle_file: "VehicleFile",
    radian_m: float | None,
    huber_m: float,
    jerk_m2: float,
    effort_m2: float = 0.0,
) -> Weights:
    """Return the settings of the cost; raise UsageError if one is out of range."""
    radian_m = _heading_weight_m(vehicle_file) if radian_m is None else radian_m
    weights = Weights(radian_m, huber_m, jerk_m2, effort_m2)
    if not (radian_m >= 0.0 and huber_m > 0.0 and jerk_m2 >= 0.0 and effort_m2 >= 0.0):
        raise UsageError.of("tune.weights", **weights._asdict())
    return weights


def _heading_weight_m(vehicle_file: "VehicleFile") -> float:
    """Return half the track [m], else the platform's radius, else RADIAN_M."""
    geometry = vehicle_file.geometry
    if geometry.track_m is not None:
        return 0.5 * geometry.track_m
    return geometry.radius_m if geometry.radius_m is not None else RADIAN_M
