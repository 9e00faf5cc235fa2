"""The experiment for this vehicle in this room: `designed`.

Pieces by chance, composed; then, some rounds long, children of the pieces that were chosen join the library
and what is better takes its place. A piece ends with a coast in which COVERED of the way that a vehicle at full
command still rolls is covered. What is left is carried into the next piece, and the composition does not see
it: so JUDGES other vehicles, drawn anew, drive the plan once, tick by tick, with their noise. That corridor is
told with it. Where it passes a wall the pieces are composed again for a room that is narrower by so much,
ATTEMPTS times at most, and `contained` takes care of the rest. The numbers of pieces and rounds are fixed, not
the time: the same seed gives the same plan everywhere.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from baqueano.errors import UsageError
from baqueano.identify.design.belief import Belief, Cloud, believed
from baqueano.identify.design.compose import Composer
from baqueano.identify.design.information import Informant, mean_error
from baqueano.identify.design.inside import contained
from baqueano.identify.design.pieces import Piece, Shape, children, drawn
from baqueano.identify.design.room import Room
from baqueano.worlds.noise import stream

PIECE_S = 4.0
COVERED = 0.9
ATTEMPTS = 3
JUDGES = 128  # vehicles that judge the corridor: a search finds what its own forty-eight allow by chance
FIRST, ROUNDS, EACH = 240, 8, 60  # pieces at first; rounds of children, and how many in each
KEPT = 300  # pieces from round to round
WEIGHED = 3  # possible vehicles over which J is the mean
SAMPLE_S = 0.1  # between the poses by which a piece's path is judged
BATCH = 32  # pieces driven at once


class Plan(NamedTuple):
    """An experiment, and what is to be expected of it."""

    u: np.ndarray  # (N, n)
    room: Room
    margin_m: float  # least distance between the corridor and the walls
    names: tuple[str, ...]  # of the parameters (p,)
    relative_sd: (
        np.ndarray
    )  # (p,) standard error to be expected, in parts of the value; 1 where it does not show
    eta: np.ndarray  # (L, N, 3) where the possible vehicles go

    @property
    def mean_error(self) -> float:
        """The geometric mean of the standard errors."""
        return mean_error(self.relative_sd)

    def table(self) -> str:
        """A line for each parameter, and one for the room."""
        width = max(len(name) for name in self.names)
        lines = [f"{'parameter':{width}}  expected standard error"]
        for name, sd in zip(self.names, self.relative_sd, strict=True):
            lines.append(f"{name:{width}}  {100.0 * sd:.3g} %" + (" (will hardly show)" if sd > 0.3 else ""))
        lines.append(
            f"{self.room.width_m:g} × {self.room.height_m:g} m: the corridor of the body (3 standard deviations) "
            f"stays {100.0 * self.margin_m:.1f} cm from the walls"
        )
        return "\n".join(lines)


def designed(
    vehicle_file: Any,
    room: Room,
    duration_s: float = 60.0,
    *,
    belief: Belief | None = None,
    rest_s: float = 1.0,
    seed: int = 0,
    backend: str = "auto",
) -> Plan:
    """The commands (N, n) that tell most about the parameters within `duration_s` and `room`, after `rest_s` of
    standing still."""
    rate, limit = vehicle_file.rate_hz, np.asarray(vehicle_file.command.limit, dtype=float)
    ticks, rest = round(duration_s * rate), round(rest_s * rate)
    if not (np.all(np.isfinite(limit)) and np.any(limit > 0.0)):
        raise UsageError(
            f"{vehicle_file.name}: [command] limit = {limit.tolist()}: expected the largest size of each command, "
            "finite, one of them above 0."
        )
    if ticks - rest < rate:
        raise UsageError(f"{duration_s:g} s leave less than 1 s to move: give a longer duration.")
    places = max(1, round((ticks - rest) / (PIECE_S * rate)))
    belief = believed(vehicle_file) if belief is None else belief
    search = Search(vehicle_file, room, belief, places, seed, backend)
    search.fill((ticks - rest) // places / rate, limit)
    found = _inside(search, vehicle_file, room, ticks, rest)
    sd = search.informant.relative_sd(search.informant.information(found.u))
    return Plan(found.u, room, float(room.margin(found.eta)), search.informant.of.names, sd, found.eta)


class Found(NamedTuple):
    """A composition, as it can be driven."""

    error: float
    u: np.ndarray  # (N, n)
    eta: np.ndarray  # (L, N, 3) of all possible vehicles
    margin_m: float  # of the composition before `contained` took care of it


def _inside(search: "Search", vehicle_file: Any, room: Room, ticks: int, rest: int) -> Found:
    """The best of some compositions, each for a room narrower by what the one before passed the wall."""
    found, narrower = [], 0.0
    most = float(np.min(np.minimum(0.5 * room.free, room.free - np.abs(room.start[:2]))))
    for attempt in range(ATTEMPTS):
        if attempt:
            less = {"width_m": room.width_m - narrower, "height_m": room.height_m - narrower}
            search.composer.again(replace(room, **less))
        found.append(kept_inside(search.commands(ticks, rest), vehicle_file, room, search))
        if found[-1].margin_m >= 0.0:
            break
        narrower = min(narrower - 2.0 * found[-1].margin_m + 0.01, most)
    return min(found, key=lambda one: one.error)


def kept_inside(u: np.ndarray, vehicle_file: Any, room: Room, search: "Search") -> Found:
    """`u` (N, n), or what `contained` makes of it where it leaves the room or is too fast: judged by vehicles
    that had no part in the search, of which none may touch a wall either."""
    _, eta = search.judges.drive(search.judges.at(room.start), u[None])
    eta = eta[0]
    margin = min(
        float(room.margin(eta)), float(np.min(room.free - np.max(np.abs(eta[..., :2]), axis=(0, 1))))
    )
    if margin < 0.0 or not room.slow(eta, vehicle_file.rate_hz):
        kept = contained(u, vehicle_file, room, cloud=search.judges)
        u, eta = kept.u, kept.eta
    informant = search.informant
    return Found(mean_error(informant.relative_sd(informant.information(u))), u, eta, margin)


class Search:
    """Kernels, library and composer of one plan."""

    def __init__(
        self,
        vehicle_file: Any,
        room: Room,
        belief: Belief,
        places: int,
        seed: int,
        backend: str,
    ) -> None:
        self.room, self.rng = room, stream(seed, "pieces")
        self.informant = Informant(vehicle_file, backend)
        self.cloud = Cloud(vehicle_file, belief, seed, backend)
        others = believed(vehicle_file, vehicles=JUDGES, seed=seed + 1)
        self.judges = Cloud(vehicle_file, others, seed + 1, backend)
        self.thetas = [self.informant.theta(belief.paths, x) for x in belief.theta[:WEIGHED]]
        self.composer = Composer(room, places, self.informant.of.interest)
        self.pieces: list[Piece] = []
        self.shape = Shape(0, 0, np.zeros(0))  # until `fill` knows how the vehicle rolls

    def fill(self, piece_s: float, limit: np.ndarray) -> None:
        """Makes the library, of pieces of so many seconds, and composes them."""
        with ThreadPoolExecutor(2) as threads:
            still = np.zeros((2, len(limit)))
            told = threads.submit(self.informant.information, still)  # both compile at once
            self.shape = Shape.of(piece_s, self._coast_s(limit), limit, self.cloud.rate_hz)
            told.result()
            self._grow(drawn(self.shape, FIRST, self.rng), threads)
            self.composer.search()
            for _ in range(ROUNDS):
                best = [self.pieces[k] for k in self.composer.chosen]
                self._grow(children(best, self.shape, EACH, self.rng), threads)
                self.composer.search()
                self.pieces = [self.pieces[k] for k in self.composer.keep(KEPT)]

    def commands(self, ticks: int, rest: int) -> np.ndarray:
        """(N, n) of the pieces that were chosen, after `rest` ticks of standing still."""
        u, each = np.zeros((ticks, len(self.shape.limit))), self.shape.ticks
        for k, piece in enumerate(self.composer.chosen):
            u[rest + k * each : rest + (k + 1) * each] = self.pieces[piece].u(each, self.shape.limit)
        return u

    def _coast_s(self, limit: np.ndarray) -> float:
        """The time in which the nominal vehicle, after a second of the first command at its limit, covers COVERED
        of the way that it still rolls."""
        second = round(self.cloud.rate_hz)
        u = np.zeros((3 * second, len(limit)))
        first = int(np.argmax(limit > 0.0))
        u[:second, first] = limit[first]
        _, eta = self.cloud.drive(self.cloud.at(np.zeros(3)), u[None])
        rolled = np.hypot(*(eta[0, 0, second:, :2] - eta[0, 0, second - 1, :2]).T)
        return float(np.argmax(rolled >= COVERED * rolled[-1]) + 1) / second

    def _grow(self, pieces: list[Piece], threads: ThreadPoolExecutor) -> None:
        """Takes the pieces that keep to the limits of speed into the library."""
        ticks, limit = self.shape.ticks, self.shape.limit
        batches = [pieces[at : at + BATCH] for at in range(0, len(pieces), BATCH)]
        driven = threads.map(lambda some: self._weighed(np.stack([p.u(ticks, limit) for p in some])), batches)
        for some, (slow, path, F) in zip(batches, driven, strict=True):
            self.pieces += [piece for piece, ok in zip(some, slow, strict=True) if ok]
            self.composer.grow(F, path)

    def _weighed(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Which of the pieces (P, T, n) are slow enough (P,), and of those the poses (P', L, S, 3) and the
        information (P', M, q, q)."""
        stride = max(1, round(SAMPLE_S * self.cloud.rate_hz))
        _, eta = self.cloud.drive(self.cloud.at(np.zeros(3)), u)
        slow = self.room.slow(eta, self.cloud.rate_hz)
        path = np.concatenate([eta[:, :, stride - 1 :: stride], eta[:, :, -1:]], axis=2)[slow]
        F = [[self.informant.information(one, theta) for theta in self.thetas] for one in u[slow]]
        return slow, path, np.array(F).reshape(len(path), len(self.thetas), *self._square)

    @property
    def _square(self) -> tuple[int, int]:
        q = len(self.informant.of.size)
        return q, q
