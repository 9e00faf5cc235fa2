"""The experiment for this vehicle in this room: `designed`.

Pieces by chance, composed; then, some rounds long, children of the pieces that were chosen join the library
and what is better takes its place. So far a few of the possible vehicles drive every piece. They allow more
than all of them would, the more so the longer one searches: so all VEHICLES drive the best of the library, and
with their paths it is composed again. A piece ends with a coast in which COVERED of the way that a vehicle at
full command still rolls is covered; the composition counts on the rest of that way too, but not on what the
speed that is left does to the next piece. So the plan is driven once as a whole (driven.py), by as many others
that had no part in the search: where those go is told with it. The numbers of pieces and rounds are fixed, not
the time: the same seed gives the same plan everywhere.
"""

from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from baqueano.errors import UsageError
from baqueano.identify.design.belief import Belief, Cloud, believed
from baqueano.identify.design.compose import Composer
from baqueano.identify.design.driven import driven
from baqueano.identify.design.information import Informant, mean_error
from baqueano.identify.design.inside import COAST_S, SAMPLE_S, contained
from baqueano.identify.design.pieces import Piece, Shape, children, drawn
from baqueano.identify.design.room import Room
from baqueano.worlds.noise import stream

PIECE_S = 4.0
COVERED = 0.9
VEHICLES = 128  # that are believed possible: the standard deviation of their place is then known to 6 %
SCOUTS = 24  # of them, that drive all pieces
FIRST, ROUNDS, EACH = 240, 8, 60  # pieces at first; rounds of children, and how many in each
KEPT, FINAL = 300, 120  # pieces from round to round, and those that all the vehicles drive
WEIGHED = 3  # possible vehicles over which J is the mean
BATCH = 12  # pieces driven at once
TURNS = 8  # batches that have different noise


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
    belief = believed(vehicle_file, vehicles=VEHICLES) if belief is None else belief
    search = Search(vehicle_file, room, belief, places, seed, backend)
    search.fill((ticks - rest) // places / rate, limit)
    u, eta = search.driven(ticks, rest)
    if room.margin(eta) < 0.0:
        kept = contained(u, vehicle_file, room, cloud=search.judges)
        u, eta = kept.u, kept.eta
    sd = search.informant.relative_sd(search.informant.information(u))
    return Plan(u, room, float(room.margin(eta)), search.informant.of.names, sd, eta)


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
        self.cloud = Cloud(vehicle_file, belief.some(SCOUTS), seed, backend)
        self.all = Cloud(vehicle_file, belief, seed, backend)
        others = believed(vehicle_file, vehicles=VEHICLES, seed=seed + 1)
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
            self.pieces = [self.pieces[k] for k in self.composer.keep(FINAL)]
            paths = threads.map(
                lambda batch: self._path(self.all, batch[0], batch[1], 2), self._batches(self.pieces)
            )
            slow, path = (np.concatenate(each) for each in zip(*paths, strict=True))
            self.composer.again(path, np.flatnonzero(slow))
            self.pieces = [piece for piece, ok in zip(self.pieces, slow, strict=True) if ok]

    def driven(self, ticks: int, rest: int) -> tuple[np.ndarray, np.ndarray]:
        """The commands (N, n) after `rest` ticks of standing still, and where the judges go (L, N, 3)."""
        each, limit = self.shape.ticks, self.shape.limit

        def commands(k: int) -> np.ndarray:
            return self.pieces[k].u(each, limit)

        u = np.zeros((ticks, len(limit)))
        driven(self.composer, commands, self.judges, self.room, rest)
        parts = [commands(k) for k in self.composer.chosen]
        u[rest : rest + each * len(parts)] = np.concatenate(parts)
        _, eta = self.judges.drive(self.judges.at(self.room.start), u[None])
        return u, eta[0]

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
        weighed = threads.map(lambda batch: self._weighed(*batch), self._batches(pieces))
        slow, paths, Fs = zip(*weighed, strict=True)
        self.pieces += [piece for piece, ok in zip(pieces, np.concatenate(slow), strict=True) if ok]
        self.composer.grow(np.concatenate(Fs), np.concatenate(paths))

    def _batches(self, pieces: list[Piece]) -> list[tuple[int, np.ndarray]]:
        """Ticks and commands (P, T, n) of some pieces at a time: others have other noise."""
        each, limit = self.shape.ticks, self.shape.limit
        u = np.stack([piece.u(each, limit) for piece in pieces])
        return [(at // BATCH % TURNS * each, u[at : at + BATCH]) for at in range(0, len(u), BATCH)]

    def _weighed(self, tick: int, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Which of the pieces (P, T, n) are slow enough (P,), and of those the poses (P', L, S, 3) and the
        information (P', M, q, q)."""
        slow, path = self._path(self.cloud, tick, u, 4)
        F = [[self.informant.information(one, theta) for theta in self.thetas] for one in u[slow]]
        return slow, path[slow], np.array(F).reshape(-1, len(self.thetas), *self._square)

    def _path(self, cloud: Cloud, tick: int, u: np.ndarray, each: int) -> tuple[np.ndarray, np.ndarray]:
        """Whether a cloud keeps to the limits of speed (P,) in the pieces (P, T, n), and its poses (P, L, S, 3) in
        `each` sample, the last where it comes to rest."""
        stride = max(1, round(SAMPLE_S * cloud.rate_hz))
        after, eta = cloud.drive(cloud.at(np.zeros(3)), u, tick)
        seen = eta[:, :, stride - 1 :: stride]
        coast = np.zeros((len(u), round(COAST_S * cloud.rate_hz), u.shape[2]))
        rest, _ = cloud.drive(after, coast, tick + u.shape[1])
        end = np.reshape(rest.eta, (len(u), cloud.size, 1, 3))
        slow = self.room.slow(seen, cloud.rate_hz / stride)
        return slow, np.concatenate([seen[:, :, each - 1 :: each], seen[:, :, -1:], end], axis=2)

    @property
    def _square(self) -> tuple[int, int]:
        q = len(self.informant.of.size)
        return q, q
