"""Design the experiment for this vehicle in this room: `design_plan`.

1. Draw random motion primitives and compose a drive of them. In each of ROUNDS rounds, variations of the chosen
   primitives are added to the library, and better primitives replace worse ones.
2. In step 1 only a small sample of the possible vehicles drives each primitive. A small sample is too permissive, and
   the search exploits that. So all VEHICLES drive the best primitives, and the drive is composed again.
3. Each primitive ends with a coast over COVERED_FRACTION of the stopping distance. The composition reserves the rest
   of that distance, but ignores the effect of the remaining speed on the next primitive.
4. So new vehicles, which the search did not use, drive the whole plan in three orders of its primitives: as composed,
   by increasing reach, and by decreasing reach. The most informative order becomes the plan, with their poses.

The numbers of primitives and rounds are fixed, not the time: the same seed gives the same plan on every machine.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from baqueano.design.compose import (
    Composer,
    MotionPrimitive,
    PrimitiveShape,
    gentler_primitive,
    mutated_primitives,
    random_primitives,
)
from baqueano.design.containment import (
    COAST_S,
    SAMPLE_S,
    VEHICLES,
    contain_in_room,
    first_allowed_option,
    respects_speed_limits,
    wall_margin,
)
from baqueano.design.information import DriveInformation, mean_error
from baqueano.design.vehicle_cloud import VehicleCloud, VehicleDistribution, possible_vehicles
from baqueano.errors import UsageError
from baqueano.messages.language import number, translate as _
from baqueano.numerics.parallel import parallel_map
from baqueano.routes.room import Room
from baqueano.vehicle_file.file import VehicleFile
from baqueano.vehicles import VehicleState
from baqueano.worlds.noise import random_stream

PRIMITIVE_S = 4.0
COVERED_FRACTION = 0.9
# vehicles that drive all primitives: with the nominal one, 31 fill four vectors of eight lanes
LIBRARY_VEHICLES = 30
# primitives at first; rounds of variations, and variations in each round
FIRST_PRIMITIVES, ROUNDS, PRIMITIVES_PER_ROUND = 240, 5, 60
# primitives kept after a round, and those that all vehicles drive
KEPT_PRIMITIVES, FINAL_PRIMITIVES = 300, 120
INFORMATION_VEHICLES = 3  # possible vehicles over which J is the mean
NOISE_SLOTS = 8  # primitives that have different noise
# in J, for a reach of one room: each cost gives one order of the primitives to try
REACH_COSTS = (1.0, 5.0, 25.0)
TRIED_PRIMITIVES = 6  # primitives for each of these costs, and primitives driven at once


class Plan(NamedTuple):
    """An experiment, and the standard errors to expect from it."""

    u: np.ndarray  # (N, n)
    room: "Room"
    margin_m: float  # least distance between the corridor and the walls
    names: tuple[str, ...]  # of the parameters (p,)
    # (p,) expected relative standard error; 1 if the drive does not determine the parameter
    relative_std: np.ndarray
    eta: np.ndarray  # (L, N, 3) poses of the possible vehicles

    @property
    def mean_error(self) -> float:
        """Return the geometric mean of the standard errors."""
        return mean_error(self.relative_std)

    def table(self) -> str:
        """Return a table with one row for each parameter and one row for the room."""
        width = max(map(len, (*self.names, _("parameter"))))
        lines = [
            _("the expected standard errors are due only to the noise of the sensors"),
            f"{_('parameter'):{width}}  {_('expected standard error')}",
        ]
        for name, std in zip(self.names, self.relative_std, strict=True):
            lines.append(
                f"{name:{width}}  {number(100.0 * std):.3g} %"
                + (f" ({_('will hardly be visible')})" if std > 0.3 else "")
            )
        lines.append(
            _(
                "{width_m:g} × {height_m:g} m: the corridor of the body (3 standard deviations) stays "
                "{margin_cm:.1f} cm from the walls",
                width_m=self.room.width_m,
                height_m=self.room.height_m,
                margin_cm=100.0 * self.margin_m,
            )
        )
        return "\n".join(lines)


def design_plan(
    vehicle_file: VehicleFile,
    room: "Room",
    duration_s: float = 60.0,
    *,
    rest_s: float = 1.0,
    seed: int = 0,
    backend: str = "auto",
    progress: Callable[[str], object] | None = None,
) -> Plan:
    """Return the plan with the most informative commands (N, n) in `duration_s` and `room`, after `rest_s` at rest.

    `progress` is called with a text on each round; if it returns True, the search ends with the best plan so far.
    Raise UsageError if a [command] limit is not finite or all limits are 0, or for less than 1 s of motion. Raise
    AnswerNo if the vehicle cannot be kept in the room.

    >>> from baqueano.routes.room import vehicle_room
    >>> from baqueano.vehicle_file import load
    >>> small = load("small")
    >>> plan = design_plan(small, vehicle_room(small, "2x2"), 2.0, progress=lambda text: True)  # True: the first one
    >>> plan.u.shape, plan.margin_m > 0.0
    ((200, 3), True)
    """
    rate, limit = vehicle_file.rate_hz, np.asarray(vehicle_file.command.limit, dtype=float)
    ticks, rest_ticks = round(duration_s * rate), round(rest_s * rate)
    if not (np.all(np.isfinite(limit)) and np.any(limit > 0.0)):
        raise UsageError.of("design.limit", vehicle=vehicle_file.name, limit=limit.tolist())
    if ticks - rest_ticks < rate:
        raise UsageError.of("design.short", duration_s=duration_s)
    place_count = max(1, round((ticks - rest_ticks) / (PRIMITIVE_S * rate)))
    vehicles = possible_vehicles(vehicle_file, vehicle_count=VEHICLES)
    search = PlanSearch(vehicle_file, room, vehicles, place_count, seed, backend)
    search.fill((ticks - rest_ticks) // place_count / rate, limit, progress or (lambda text: False))
    u, eta = search.rollout(ticks, rest_ticks)
    if wall_margin(room, eta) < 0.0:
        signal = contain_in_room(u, vehicle_file, room, cloud=search.validation_cloud)
        u, eta = signal.u, signal.eta
    relative_std = search.drive_information.relative_std(search.drive_information.information(u))
    return Plan(
        u, room, float(wall_margin(room, eta)), search.drive_information.unknowns.names, relative_std, eta
    )


class PlanSearch:
    """Kernels, library and composer of one plan."""

    def __init__(
        self, vehicle_file: VehicleFile, room: "Room", distribution: VehicleDistribution, place_count: int,
        seed: int, backend: str,
    ) -> None:  # fmt: skip
        self.room, self.rng = room, random_stream(seed, "pieces")
        self.drive_information = DriveInformation(vehicle_file, backend)
        with ThreadPoolExecutor(1) as thread:  # the two kernels compile at the same time
            rest_commands = np.zeros((2, vehicle_file.vehicle.commands))
            future_information = thread.submit(self.drive_information.information, rest_commands)
            self.cloud = VehicleCloud(vehicle_file, distribution.subset(LIBRARY_VEHICLES), seed, backend)
            future_information.result()
        self.all_vehicles = VehicleCloud(vehicle_file, distribution, seed, backend)
        vehicle_files = possible_vehicles(vehicle_file, vehicle_count=VEHICLES, seed=seed + 1)
        self.validation_cloud = VehicleCloud(vehicle_file, vehicle_files, seed + 1, backend)
        self.thetas = [
            self.drive_information.theta(distribution.paths, x)
            for x in distribution.theta[:INFORMATION_VEHICLES]
        ]
        self.composer = Composer(room, place_count, self.drive_information.unknowns.interest_count)
        self.primitives: list[MotionPrimitive] = []
        # `fill` sets the shape when the coast of the vehicle is known
        self.shape = PrimitiveShape(0, 0, np.zeros(0))
        # zero commands for a second coast: after it 1 % of the stopping distance remains
        self.rest_commands = np.zeros((0, 0))

    def fill(self, primitive_s: float, limit: np.ndarray, progress: Callable[[str], object]) -> None:
        """Build the library of primitives of `primitive_s` [s] and compose them. If `progress` returns True, the rounds
        end."""
        coast_s = self._coast_s(limit)
        self.shape = PrimitiveShape.from_duration(primitive_s, coast_s, limit, self.cloud.rate_hz)
        self.rest_commands = np.zeros((round(min(coast_s, COAST_S) * self.cloud.rate_hz), len(limit)))
        self._add_feasible_primitives(random_primitives(self.shape, FIRST_PRIMITIVES, self.rng))
        self.composer.search()
        for turn in range(ROUNDS):
            text = _(
                "{turn} of {rounds} rounds: standard errors of {percent:.2g} %",
                turn=turn, rounds=ROUNDS, percent=100.0 * self.expected_std,
            )  # fmt: skip
            if progress(text) is True:
                break
            parents = [self.primitives[k] for k in self.composer.selected_indices]
            variations = mutated_primitives(parents, self.shape, PRIMITIVES_PER_ROUND, self.rng)
            self._add_feasible_primitives(variations)
            self.composer.search()
            self.primitives = [self.primitives[k] for k in self.composer.keep_best(KEPT_PRIMITIVES)]
        self.primitives = [self.primitives[k] for k in self.composer.keep_best(FINAL_PRIMITIVES)]
        drives = self._map_primitives(lambda k, u: self._path(self.all_vehicles, k, u, 2), self.primitives)
        is_allowed, path = zip(*drives, strict=True)
        self.composer.restart(np.stack(path), np.flatnonzero(is_allowed))
        self.primitives = [self.primitives[k] for k in np.flatnonzero(is_allowed)]

    def rollout(self, ticks: int, rest_ticks: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the commands (N, n), which begin with `rest_ticks` ticks at rest, and the poses (L, N, 3) of the
        vehicles in `validation_cloud`."""
        primitive_ticks, limit = self.shape.ticks, self.shape.limit
        commands = [primitive.u(primitive_ticks, limit) for primitive in self.primitives]

        def trial(order: list[int]) -> tuple[float, np.ndarray]:
            primitives = feasible_primitives(
                self.composer, order, commands.__getitem__, self.validation_cloud, self.room, rest_ticks
            )
            u, end_tick = np.zeros((ticks, len(limit))), rest_ticks + primitive_ticks * len(primitives)
            u[rest_ticks:end_tick] = np.concatenate([commands[k] for k in primitives])
            F = np.array([self.drive_information.information(u, theta) for theta in self.thetas])
            return float(self.composer.score(F)), u

        primitives, reach = self.composer.selected_indices, self.composer.reach
        sorted_primitives = sorted(primitives, key=lambda k: reach[k])
        with ThreadPoolExecutor() as threads:  # own threads: a drive uses those of `parallel_map`
            u = max(
                threads.map(trial, [primitives, sorted_primitives, sorted_primitives[::-1]]),
                key=lambda paths: paths[0],
            )[1]
        _, eta = self.validation_cloud.drive(self.validation_cloud.state_at(self.room.start), u)
        return u, eta

    def _coast_s(self, limit: np.ndarray) -> float:
        """Return the time [s] in which the nominal vehicle covers COVERED_FRACTION of its rolling distance. The vehicle
        rolls after one second at the limit of its first usable command."""
        second_ticks = round(self.cloud.rate_hz)
        u = np.zeros((3 * second_ticks, len(limit)))
        channel = int(np.argmax(limit > 0.0))
        u[:second_ticks, channel] = limit[channel]
        _, eta = self.cloud.drive(self.cloud.state_at(np.zeros(3)), u)
        distance_m = np.hypot(*(eta[0, second_ticks:, :2] - eta[0, second_ticks - 1, :2]).T)
        return float(np.argmax(distance_m >= COVERED_FRACTION * distance_m[-1]) + 1) / second_ticks

    def _add_feasible_primitives(self, primitives: list[MotionPrimitive]) -> None:
        """Add the primitives that respect the speed limits to the library. For each other primitive, add a gentler form
        if this form respects the limits."""
        drives = self._map_primitives(self._evaluate, primitives)
        indices = [k for k, drive in enumerate(drives) if not drive[0]]
        variants = [gentler_primitive(primitives[k], self.shape) for k in indices]
        drives += self._map_primitives(self._evaluate, variants) if variants else []
        feasible_pairs = [pair for pair in zip([*primitives, *variants], drives, strict=True) if pair[1][0]]
        self.primitives += [primitive for primitive, _ in feasible_pairs]
        F, path = (np.array([drive[k] for _, drive in feasible_pairs]) for k in (2, 1))
        self.composer.add_primitives(F, path)

    def _map_primitives(
        self, work: Callable[[int, np.ndarray], object], primitives: list[MotionPrimitive]
    ) -> list[Any]:
        """Return `work(tick, u)` for the commands u (T, n) of each primitive, computed on all cores. The first ticks
        rotate over NOISE_SLOTS spans of the noise."""
        commands = [primitive.u(self.shape.ticks, self.shape.limit) for primitive in primitives]
        first_ticks = [k % NOISE_SLOTS * self.shape.ticks for k in range(len(commands))]
        return parallel_map(work, first_ticks, commands, rows=self.cloud.size * sum(map(len, commands)))

    def _evaluate(self, tick: int, u: np.ndarray) -> tuple[bool, np.ndarray, np.ndarray | None]:
        """Return if the primitive (T, n) is allowed, its poses (L, S, 3), and its information (M, q, q). It must
        respect the speed limits, beyond which the information is None, and no possible vehicle may diverge in it."""
        is_allowed, path = self._path(self.cloud, tick, u, 4)
        if not is_allowed:
            return is_allowed, path, None
        F = np.stack([self.drive_information.information(u, theta) for theta in self.thetas])
        return bool(np.isfinite(F).all()), path, F

    def _path(self, cloud: VehicleCloud, tick: int, u: np.ndarray, count: int) -> tuple[bool, np.ndarray]:
        """Return True if the vehicles of `cloud` respect the speed limits in the primitive (T, n), and their poses (L,
        S, 3). The poses belong to every `count`-th sample. The last pose is the pose at rest."""
        stride, ticks = max(1, round(SAMPLE_S * cloud.rate_hz)), len(u)
        commands = np.concatenate([u, self.rest_commands])
        final_state, eta = cloud.drive(cloud.state_at(np.zeros(3)), commands, tick)
        samples = eta[:, stride - 1 : ticks : stride]
        is_allowed = bool(respects_speed_limits(self.room, samples, cloud.rate_hz / stride))
        poses = samples[:, count - 1 :: count], samples[:, -1:], final_state.eta[:, None]
        return is_allowed, np.concatenate(poses, axis=1)

    @property
    def expected_std(self) -> float:
        """Return the geometric mean of the expected relative standard errors of the present sequence."""
        F = self.composer.F[self.composer.selected_indices].sum(axis=0)[0]
        return mean_error(self.drive_information.relative_std(F))


def feasible_primitives(
    composer: Composer,
    order: list[int],
    commands: Callable[[int], np.ndarray],
    cloud: VehicleCloud,
    room: Room,
    rest_ticks: int,
) -> list[int]:
    """Return the indices of primitives that the vehicles of `cloud` can drive one after the other, instead of `order`.
    The drive begins after `rest_ticks` ticks at rest. `commands` returns the commands (T, n) of a primitive. The test
    is (4) of containment.py."""
    state, tick, kept_order = cloud.state_at(room.start), rest_ticks, list(order)
    if rest_ticks:
        state, _ = cloud.drive(state, np.zeros((rest_ticks, commands(0).shape[1])))
    for place in range(len(kept_order)):
        arguments = commands, cloud, room, state, tick
        other_primitives = list(dict.fromkeys(kept_order[place:]))
        options = _first_allowed_primitive(other_primitives[:1], *arguments)
        options = options or _first_allowed_primitive(other_primitives[1:], *arguments)
        if options:
            kept_order.insert(place, kept_order.pop(kept_order.index(options[0], place)))
        else:
            pose = state.eta[: composer.path.shape[1]]
            substitutes = composer.substitutes(kept_order, place, pose, REACH_COSTS, TRIED_PRIMITIVES)
            options = _first_allowed_primitive([*substitutes, 0], *arguments)
        kept_order[place], state = options or (0, cloud.drive(state, commands(0), tick)[0])
        tick += len(commands(0))
    return kept_order


def _first_allowed_primitive(
    indices: list[int],
    commands: Callable[[int], np.ndarray],
    cloud: VehicleCloud,
    room: Room,
    state: VehicleState,
    tick: int,
) -> tuple[int, VehicleState] | None:
    """Return the first of `indices` whose primitive is allowed, and the vehicle states after this primitive, or
    None."""
    for offset in range(0, len(indices), TRIED_PRIMITIVES):
        options = [commands(k) for k in indices[offset : offset + TRIED_PRIMITIVES]]
        allowed_option = first_allowed_option(cloud, room, state, options, tick)
        if allowed_option:
            return indices[offset + allowed_option[0]], allowed_option[1]
    return None
