"""Design the experiment for this vehicle in this room: `design_plan`.

1. Draw random pieces of command and compose a drive of them. In each of ROUNDS rounds, variations of the chosen
pieces are added to the library, and better pieces replace worse pieces. 2. In step 1 only a small sample of the
possible vehicles drives each piece. A small sample is too permissive, and the search exploits that. So all VEHICLES
drive the best pieces, and the drive is composed again with their paths. 3. Each piece ends with a coast over
COVERED_FRACTION of the stopping distance. The composition reserves the rest of that
   distance, but ignores the effect of the remaining speed on the next piece.
4. So new vehicles, which were not used in the search, drive the whole plan in three orders of its pieces. These are
the composed order, increasing reach and decreasing reach. The most informative order becomes the plan, with their
poses.

The numbers of pieces and rounds are fixed, not the time: the same seed gives the same plan on every machine.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baqueano.diagnostics import fault
from baqueano.errors import UsageError
from baqueano.identify.design.compose import (
    Composer,
    MotionPiece,
    PieceShape,
    gentler_piece,
    mutated_pieces,
    random_pieces,
)
from baqueano.identify.design.information import Informant, mean_error
from baqueano.identify.design.room import COAST_S, SAMPLE_S, VEHICLES, Room, contain, first_allowed
from baqueano.identify.design.vehicle_cloud import Cloud, VehicleDistribution, possible_vehicles
from baqueano.identify.parallel import parallel_map
from baqueano.messages.language import number
from baqueano.messages.language import translate as _
from baqueano.vehicles import VehicleState
from baqueano.worlds.noise import stream

if TYPE_CHECKING:
    from baqueano.vehicle_file.file import VehicleFile

PIECE_S = 4.0
COVERED_FRACTION = 0.9
# vehicles that drive all pieces: with the nominal one, 31 fill four vectors of eight lanes
SCOUT_VEHICLES = 30
# pieces at first; rounds of variations, and variations in each round
FIRST_PIECES, ROUNDS, PIECES_PER_ROUND = 240, 5, 60
KEPT_PIECES, FINAL_PIECES = 300, 120  # pieces kept after a round, and those that all vehicles drive
WEIGHED_VEHICLES = 3  # possible vehicles over which J is the mean
NOISE_SLOTS = 8  # pieces that have different noise
PRICES = (1.0, 5.0, 25.0)  # in J, for a reach of one room: each price gives one order of the pieces to try
TRIED_PIECES = 6  # pieces for each of these prices, and pieces driven at once


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
            f"{_('parameter'):{width}}  " + _("expected standard error, due only to the noise of the sensors")
        ]
        for name, sd in zip(self.names, self.relative_std, strict=True):
            lines.append(
                f"{name:{width}}  {number(100.0 * sd):.3g} %"
                + (f" ({_('will hardly be visible')})" if sd > 0.3 else "")
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
    vehicle_file: "VehicleFile",
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

    >>> from baqueano.identify.design.room import room_of
    >>> from baqueano.vehicle_file import load
    >>> small = load("small")
    >>> plan = design_plan(small, room_of(small, "2x2"), 2.0, progress=lambda text: True)  # True: the first one
    >>> plan.u.shape, plan.margin_m > 0.0
    ((200, 3), True)
    """
    rate, limit = vehicle_file.rate_hz, np.asarray(vehicle_file.command.limit, dtype=float)
    ticks, rest_ticks = round(duration_s * rate), round(rest_s * rate)
    if not (np.all(np.isfinite(limit)) and np.any(limit > 0.0)):
        raise UsageError(fault("design.limit", vehicle=vehicle_file.name, limit=limit.tolist()))
    if ticks - rest_ticks < rate:
        raise UsageError(fault("design.short", duration_s=duration_s))
    place_count = max(1, round((ticks - rest_ticks) / (PIECE_S * rate)))
    search = PlanSearch(
        vehicle_file,
        room,
        possible_vehicles(vehicle_file, vehicle_count=VEHICLES),
        place_count,
        seed,
        backend,
    )
    search.fill(
        (ticks - rest_ticks) // place_count / rate,
        limit,
        (lambda text: False) if progress is None else progress,
    )
    u, eta = search.rollout(ticks, rest_ticks)
    if room.margin(eta) < 0.0:
        contained = contain(u, vehicle_file, room, cloud=search.judge_cloud)
        u, eta = contained.u, contained.eta
    relative_std = search.informant.relative_std(search.informant.information(u))
    return Plan(u, room, float(room.margin(eta)), search.informant.unknowns.names, relative_std, eta)


class PlanSearch:
    """Kernels, library and composer of one plan."""

    def __init__(
        self,
        vehicle_file: "VehicleFile",
        room: "Room",
        belief: VehicleDistribution,
        place_count: int,
        seed: int,
        backend: str,
    ) -> None:
        self.room, self.rng = room, stream(seed, "pieces")
        self.informant = Informant(vehicle_file, backend)
        with ThreadPoolExecutor(1) as thread:  # the two kernels compile at the same time
            future = thread.submit(self.informant.information, np.zeros((2, vehicle_file.vehicle.commands)))
            self.cloud = Cloud(vehicle_file, belief.subset(SCOUT_VEHICLES), seed, backend)
            future.result()
        self.all_vehicles = Cloud(vehicle_file, belief, seed, backend)
        vehicle_files = possible_vehicles(vehicle_file, vehicle_count=VEHICLES, seed=seed + 1)
        self.judge_cloud = Cloud(vehicle_file, vehicle_files, seed + 1, backend)
        self.thetas = [self.informant.theta(belief.paths, x) for x in belief.theta[:WEIGHED_VEHICLES]]
        self.composer = Composer(room, place_count, self.informant.unknowns.interest_count)
        self.pieces: list[MotionPiece] = []
        self.shape = PieceShape(0, 0, np.zeros(0))  # `fill` sets it when the coast of the vehicle is known
        # zero commands for a second coast: after it 1 % of the stopping distance remains
        self.rest_commands = np.zeros((0, 0))

    def fill(self, piece_s: float, limit: np.ndarray, progress: Callable[[str], object]) -> None:
        """Build the library of pieces of `piece_s` [s] and compose them.

        If `progress` returns True, the rounds end.
        """
        coast_s = self._coast_s(limit)
        self.shape = PieceShape.of(piece_s, coast_s, limit, self.cloud.rate_hz)
        self.rest_commands = np.zeros((round(min(coast_s, COAST_S) * self.cloud.rate_hz), len(limit)))
        self._grow(random_pieces(self.shape, FIRST_PIECES, self.rng))
        self.composer.search()
        for turn in range(ROUNDS):
            if (
                progress(
                    _(
                        "{turn} of {rounds} rounds: standard errors of {percent:.2g} %",
                        turn=turn,
                        rounds=ROUNDS,
                        percent=100.0 * self.expected_std,
                    )
                )
                is True
            ):
                break
            parents = [self.pieces[k] for k in self.composer.chosen]
            self._grow(mutated_pieces(parents, self.shape, PIECES_PER_ROUND, self.rng))
            self.composer.search()
            self.pieces = [self.pieces[k] for k in self.composer.keep(KEPT_PIECES)]
        self.pieces = [self.pieces[k] for k in self.composer.keep(FINAL_PIECES)]
        paths = self._map_pieces(lambda tick, u: self._path(self.all_vehicles, tick, u, 2), self.pieces)
        is_slow, path = zip(*paths, strict=True)
        self.composer.restart(np.stack(path), np.flatnonzero(is_slow))
        self.pieces = [piece for piece, is_kept in zip(self.pieces, is_slow, strict=True) if is_kept]

    def rollout(self, ticks: int, rest_ticks: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the commands (N, n), which begin with `rest_ticks` ticks at rest, and the poses (L, N, 3) of the
        vehicles in `judge_cloud`.
        """
        piece_ticks, limit = self.shape.ticks, self.shape.limit
        commands = [piece.u(piece_ticks, limit) for piece in self.pieces]

        def trial(order: list[int]) -> tuple[float, np.ndarray]:
            pieces = feasible_pieces(
                self.composer, order, commands.__getitem__, self.judge_cloud, self.room, rest_ticks
            )
            u = np.zeros((ticks, len(limit)))
            u[rest_ticks : rest_ticks + piece_ticks * len(pieces)] = np.concatenate(
                [commands[k] for k in pieces]
            )
            F = np.array([self.informant.information(u, theta) for theta in self.thetas])
            return float(self.composer.score(F)), u

        pieces, reach = self.composer.chosen, self.composer.reach
        by_reach = sorted(pieces, key=lambda k: reach[k])
        with (
            ThreadPoolExecutor() as threads
        ):  # separate threads, because a drive uses the threads of `parallel_map`
            u = max(threads.map(trial, [pieces, by_reach, by_reach[::-1]]), key=lambda paths: paths[0])[1]
        _, eta = self.judge_cloud.drive(self.judge_cloud.state_at(self.room.start), u)
        return u, eta

    def _coast_s(self, limit: np.ndarray) -> float:
        """Return the time [s] in which the nominal vehicle covers COVERED_FRACTION of its rolling distance.

        The vehicle rolls after one second at the limit of its first usable command.
        """
        second_ticks = round(self.cloud.rate_hz)
        u = np.zeros((3 * second_ticks, len(limit)))
        channel = int(np.argmax(limit > 0.0))
        u[:second_ticks, channel] = limit[channel]
        _, eta = self.cloud.drive(self.cloud.state_at(np.zeros(3)), u)
        distance_m = np.hypot(*(eta[0, second_ticks:, :2] - eta[0, second_ticks - 1, :2]).T)
        return float(np.argmax(distance_m >= COVERED_FRACTION * distance_m[-1]) + 1) / second_ticks

    def _grow(self, pieces: list[MotionPiece]) -> None:
        """Add the pieces that respect the speed limits to the library.

        For each other piece, add a gentler form if this form respects the limits.
        """
        drives = self._map_pieces(self._weigh, pieces)
        too_fast = [k for k, drive in enumerate(drives) if not drive[0]]
        gentler_pieces = [gentler_piece(pieces[k], self.shape) for k in too_fast]
        drives += self._map_pieces(self._weigh, gentler_pieces) if gentler_pieces else []
        kept = [k for k, drive in enumerate(drives) if drive[0]]
        self.pieces += [[*pieces, *gentler_pieces][k] for k in kept]
        self.composer.grow(np.array([drives[k][2] for k in kept]), np.array([drives[k][1] for k in kept]))

    def _map_pieces(self, work: Callable[[int, np.ndarray], object], pieces: list[MotionPiece]) -> list[Any]:
        """Return `work(tick, u)` for the commands u (T, n) of each piece, computed on all cores.

        The first ticks rotate over NOISE_SLOTS spans of the noise.
        """
        commands = [piece.u(self.shape.ticks, self.shape.limit) for piece in pieces]
        first_ticks = [k % NOISE_SLOTS * self.shape.ticks for k in range(len(commands))]
        return parallel_map(work, first_ticks, commands, rows=self.cloud.size * sum(map(len, commands)))

    def _weigh(self, tick: int, u: np.ndarray) -> tuple[bool, np.ndarray, np.ndarray | None]:
        """Return True if the piece (T, n) respects the speed limits, its poses (L, S, 3), and its information (M, q,
        q). The information is None for a piece that exceeds the limits.
        """
        is_slow, path = self._path(self.cloud, tick, u, 4)
        F = np.stack([self.informant.information(u, theta) for theta in self.thetas]) if is_slow else None
        return is_slow, path, F

    def _path(self, cloud: Cloud, tick: int, u: np.ndarray, count: int) -> tuple[bool, np.ndarray]:
        """Return True if the vehicles of `cloud` respect the speed limits in the piece (T, n), and their poses (L, S,
        3). The poses are those of every `count`-th sample. The last pose is the pose at rest.
        """
        stride, ticks = max(1, round(SAMPLE_S * cloud.rate_hz)), len(u)
        final_state, eta = cloud.drive(
            cloud.state_at(np.zeros(3)), np.concatenate([u, self.rest_commands]), tick
        )
        samples = eta[:, stride - 1 : ticks : stride]
        is_slow = bool(self.room.is_slow(samples, cloud.rate_hz / stride))
        return is_slow, np.concatenate(
            [samples[:, count - 1 :: count], samples[:, -1:], final_state.eta[:, None]], axis=1
        )

    @property
    def expected_std(self) -> float:
        """Return the geometric mean of the expected relative standard errors of the present sequence."""
        F = self.composer.F[self.composer.chosen].sum(axis=0)[0]
        return mean_error(self.informant.relative_std(F))


def feasible_pieces(
    composer: Composer,
    order: list[int],
    commands: Callable[[int], np.ndarray],
    cloud: Cloud,
    room: Room,
    rest_ticks: int,
) -> list[int]:
    """Return the indices of pieces that the vehicles of `cloud` can drive one after the other, in place of `order`.

    The drive begins after `rest_ticks` ticks at rest. `commands` returns the commands (T, n) of a piece. The test is
    (4) of room.py.
    """
    state, tick, order_kept = cloud.state_at(room.start), rest_ticks, list(order)
    if rest_ticks:
        state, _ = cloud.drive(state, np.zeros((rest_ticks, commands(0).shape[1])))
    for place in range(len(order_kept)):
        arguments = commands, cloud, room, state, tick
        remaining = list(dict.fromkeys(order_kept[place:]))
        options = _first_allowed_piece(remaining[:1], *arguments) or _first_allowed_piece(
            remaining[1:], *arguments
        )
        if options:
            order_kept.insert(place, order_kept.pop(order_kept.index(options[0], place)))
        else:
            substitutes = composer.substitutes(
                order_kept, place, state.eta[: composer.path.shape[1]], PRICES, TRIED_PIECES
            )
            options = _first_allowed_piece([*substitutes, 0], *arguments)
        order_kept[place], state = options or (0, cloud.drive(state, commands(0), tick)[0])
        tick += len(commands(0))
    return order_kept


def _first_allowed_piece(
    indices: list[int],
    commands: Callable[[int], np.ndarray],
    cloud: Cloud,
    room: Room,
    state: VehicleState,
    tick: int,
) -> tuple[int, VehicleState] | None:
    """Return the first of `indices` whose piece is allowed, and the vehicle states after this piece, or None."""
    for offset in range(0, len(indices), TRIED_PIECES):
        options = [commands(k) for k in indices[offset : offset + TRIED_PIECES]]
        allowed = first_allowed(cloud, room, state, options, tick)
        if allowed:
            return indices[offset + allowed[0]], allowed[1]
    return None
