"""Choose pieces of motion and their order for the largest information that the room allows.

    max over sequences (i_1 … i_n)  J(Σ_k F_{i_k})     subject to  the corridor of the sequence inside    (1)
    J(A + F) ≤ J(A) + tr(J'(A) F)                                                                         (2)
    pose_l ← pose_l ∘ end_{i,l}                                                                           (3)

The search is first greedy, one piece after the other. Then it exchanges (Fedorov): each place in turn receives the most
informative piece with which the whole sequence stays inside. (2) is an upper bound, as J is concave except for its
nuisance, and selects the pieces to evaluate exactly. PRICE reduces J for the distance between beginning and end of a
piece. The corridor contains the possible vehicles. Their paths through a sequence are composed of their paths through
the pieces (3).
"""

from collections.abc import Sequence

import numpy as np

from baqueano.identify.design.motion_library import in_map
from baqueano.identify.design.room import DEVIATIONS, Room, reach

CLOSER = 24  # pieces that are evaluated exactly at once, those of the highest bound first
DEEP = 320  # pieces that are tried for one place
PRICE = 1.0  # in J, of a piece that ends one room away from where it began
NEAR = 25.0  # price in J for a reach of one room, in the choice of pieces that stay near
SWEEPS = 2  # over all places, at most, before new pieces are added


class Composer:
    """Search of (1) over a library of pieces that may grow."""

    def __init__(self, room: Room, places: int, interest: int) -> None:
        self.room, self.places, self.interest = room, places, interest
        self.chosen: list[int] = []
        self.F = np.zeros((0, 0, 0, 0))
        self.price = np.zeros(0)
        self.reach = np.zeros(0)  # largest distance from the beginning of the piece, in rooms
        self.path = np.zeros((0, 0, 0, 3))
        self.xy = np.zeros((2, 0, 0, 0), np.float32)  # (2, P, S, L) the same, for sums over the vehicles
        self.upper = np.zeros((0, 0))  # (P, M q (q + 1) / 2) the upper triangles of F, for sums over all

    def grow(self, F: np.ndarray, path: np.ndarray) -> None:
        """Add pieces: their information F (P, M, q, q) for M possible vehicles, and the poses `path` (P, L, S, 3) of
        all possible vehicles along them. The last pose is the pose at rest."""
        upper = F[:, :, *np.triu_indices(F.shape[-1])].reshape(len(F), -1)
        self.upper = upper if not len(self.F) else np.concatenate([self.upper, upper])
        self.F = F if not len(self.F) else np.concatenate([self.F, F])
        self.path = path if not len(self.path) else np.concatenate([self.path, path])
        xy = np.ascontiguousarray(path[..., :2].transpose(3, 0, 2, 1), np.float32)
        self.xy = xy if not self.xy.size else np.concatenate([self.xy, xy], axis=1)
        away = np.sqrt(np.mean(np.sum(self.xy**2, axis=0), axis=-1)) / np.min(self.room.free)
        self.reach = np.max(away, axis=-1)
        distance = self.path[:, :, -1, :2]
        self.price = PRICE * np.sqrt(np.mean(np.sum(distance**2, axis=-1), axis=-1)) / np.min(self.room.free)

    def score(self, F: np.ndarray) -> np.ndarray:
        """Return J (…,) of F (…, M, q, q), from the Cholesky factor of F + I with the nuisance first."""
        root = np.linalg.cholesky((F + np.eye(F.shape[-1]))[..., ::-1, ::-1])
        ends = np.diagonal(root, axis1=-2, axis2=-1)[..., -self.interest :]
        return np.mean(2.0 * np.sum(np.log(ends), axis=-1), axis=-1)

    def search(self) -> float:
        """Fill the places, or improve the pieces in them, and return J minus the price of the pieces."""
        if not self.chosen:
            self._greedy()
        best = float(self.score(self.F[self.chosen].sum(axis=0)) - self.price[self.chosen].sum())
        for _ in range(SWEEPS):
            before = best
            self._sort()
            for place in range(self.places):
                best = self._exchange(place, best)
            if best <= before:
                break
        return best

    def restart(self, path: np.ndarray, some: np.ndarray) -> float:
        """Search again from the beginning, with only `some` of the pieces and with other vehicles. `path`
        (P, L, S, 3) contains the poses of these vehicles along all pieces."""
        self.chosen, self.path = [], path[some]
        self.F, self.upper, self.price = self.F[some], self.upper[some], self.price[some]
        self.reach = self.reach[some]
        self.xy = np.ascontiguousarray(self.path[..., :2].transpose(3, 0, 2, 1), np.float32)
        return self.search()

    def substitutes(
        self, chosen: list[int], place: int, pose: np.ndarray, prices: Sequence[float], count: int
    ) -> list[int]:
        """Return pieces for `place` that should stay inside from the poses (L, 3) on. For each of the `prices` of
        their reach, the `count` best in addition to the other pieces of `chosen` are returned, in order."""
        rest_of_pieces = [*chosen[:place], *chosen[place + 1 :]]
        rest = self.F[rest_of_pieces].sum(axis=0)
        some = np.argsort(-self._upper_bound(rest) + self.price)[:DEEP]
        some = some[self._margin(pose[None], some) >= 0.0]
        score = self.score(rest + self.F[some])
        best = [some[np.argsort(times * self.reach[some] - score)][:count] for times in prices]
        return list(dict.fromkeys(np.concatenate(best).tolist()))

    def keep(self, count: int) -> np.ndarray:
        """Keep only the `count` pieces with the highest bound in addition to the chosen pieces, and return the
        indices of all pieces kept.

        The chosen pieces, the first piece, and `count` // 4 pieces that stay near are kept too.
        """
        bound = self._upper_bound(self.F[self.chosen].sum(axis=0))
        near = np.argsort(NEAR * self.reach - bound)[: count // 4]
        survivors = np.unique([0, *self.chosen, *near, *np.argsort(self.price - bound)[:count].tolist()])
        self.F, self.upper, self.path = self.F[survivors], self.upper[survivors], self.path[survivors]
        self.price, self.reach, self.xy = self.price[survivors], self.reach[survivors], self.xy[:, survivors]
        self.chosen = np.searchsorted(survivors, self.chosen).tolist()
        return survivors

    def _greedy(self) -> None:
        total, pose = np.zeros(self.F.shape[1:]), self._start()
        for _ in range(self.places):
            place = self._first_inside(total, pose, [], -np.inf)
            k = 0 if place is None else place[0]
            self.chosen.append(k)
            total = total + self.F[k]
            pose = in_map(pose, self.path[k, :, -1])

    def _sort(self) -> None:
        """Sort the chosen pieces by price, the highest last, if that order stays inside: such pieces leave the
        position uncertain. J stays the same."""
        order = sorted(self.chosen, key=lambda k: self.price[k])
        if self._inside(self._start(), np.array(order[:1]), order[1:])[0]:
            self.chosen = order

    def _exchange(self, place: int, best: float) -> float:
        """Put a better piece in the place if the search finds one. Return J of the sequence minus its price."""
        before, after = self.chosen[:place], self.chosen[place + 1 :]
        pose = self._start()
        for k in before:
            pose = in_map(pose, self.path[k, :, -1])
        rest_of_pieces = [*before, *after]
        paid = float(self.price[rest_of_pieces].sum())
        first_inside = self._first_inside(self.F[rest_of_pieces].sum(axis=0), pose, after, best + paid + 1e-6)
        if first_inside is None:
            return best
        self.chosen[place] = first_inside[0]
        return first_inside[1] - paid

    def _first_inside(
        self, rest: np.ndarray, pose: np.ndarray, after: list[int], least: float
    ) -> tuple[int, float] | None:
        """Return the index of a good piece in addition to F = `rest` (M, q, q), and J minus its price. Return None if
        no tested piece exceeds `least`. At most the DEEP pieces with the highest bounds are tested. The piece and
        all pieces of `after` must stay inside from the poses (L, 3) on."""
        order = np.argsort(-self._upper_bound(rest) + self.price)
        for at in range(0, min(len(order), DEEP), CLOSER):
            some = order[at : at + CLOSER]
            scores = self.score(rest + self.F[some]) - self.price[some]
            better = np.flatnonzero(scores > least)
            if len(better):
                fits = better[self._inside(pose, some[better], after)]
                if len(fits):
                    k = fits[np.argmax(scores[fits])]
                    return int(some[k]), float(scores[k])
            elif at:
                return None
        return None

    def _upper_bound(self, rest: np.ndarray) -> np.ndarray:
        """Return an upper bound (P,) of the increase of J if a piece is added to F = `rest` (M, q, q).  (2)"""
        whole, k = rest + np.eye(rest.shape[-1]), self.interest
        slope = np.linalg.inv(whole)
        slope[:, k:, k:] -= np.linalg.inv(whole[:, k:, k:])
        twice = 2.0 * slope - slope * np.eye(rest.shape[-1])
        return self.upper @ twice[:, *np.triu_indices(rest.shape[-1])].ravel() / len(rest)

    def _start(self) -> np.ndarray:
        return np.tile(np.array(self.room.start), (self.path.shape[1], 1))

    def _inside(self, pose: np.ndarray, pieces: np.ndarray, after: list[int]) -> np.ndarray:
        """Return a mask (C,): True if the corridor of a piece, followed by all of `after`, stays in the room from
        the poses (L, 3) on.  (3)"""
        fits = self._margin(pose[None], pieces) >= 0.0
        poses = in_map(pose, self.path[pieces][:, :, -1])
        for k in after:
            candidates = np.flatnonzero(fits)
            if not len(candidates):
                break
            fits[candidates] = self._margin(poses[candidates], np.array([k])) >= 0.0
            poses[candidates] = in_map(poses[candidates], self.path[k, :, -1])
        return fits

    def _margin(self, pose: np.ndarray, pieces: np.ndarray) -> np.ndarray:
        """Return `Room.margin` (C,) of the pieces from the poses (C, L, 3). A single pose or piece applies to all."""
        margins, each = [], np.full(pose.shape[1], 1.0 / pose.shape[1], np.float32)
        for at, far in zip(self._at(pose, pieces), self.room.free, strict=True):
            mean = at @ each
            sd = np.sqrt(np.maximum((at * at) @ each - mean * mean, 0.0))
            furthest = reach(at.min(axis=-1), mean, at.max(axis=-1))
            margins.append(far - np.max(np.maximum(furthest, np.abs(mean) + DEVIATIONS * sd), axis=-1))
        return np.minimum(*margins)

    def _at(self, pose: np.ndarray, pieces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return x and y (C, S, L) along the pieces from the poses (C, L, 3). A single pose or piece applies to all."""
        pose = pose.astype(np.float32)[:, None]  # to a tenth of a millimetre
        c, s = np.cos(pose[..., 2]), np.sin(pose[..., 2])
        x, y = self.xy[:, pieces]
        return pose[..., 0] + c * x - s * y, pose[..., 1] + s * x + c * y
