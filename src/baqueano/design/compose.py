"""Choose motion primitives and their order for the largest information that the room allows.

    primitive = a few levels of each command, each held for some time;  the return;  no command until rest
    max over sequences (i_1 … i_n)  J(Σ_k F_{i_k})     subject to  the corridor of the sequence inside    (1)
    J(A + F) ≤ J(A) + tr(J'(A) F)                                                                         (2)
    pose_l ← pose_l ∘ end_{i,l}                                                                           (3)

Each primitive begins and ends at rest, so its information (information.py) adds up over a sequence. The search is first
greedy, one primitive after the other. Then primitives are exchanged (Fedorov): place after place receives the most
informative primitive with which the whole sequence stays inside. (2) is an upper bound, because J is concave except for
its nuisance part. It selects the primitives to evaluate exactly. END_COST reduces J for the distance between beginning
and end of a primitive. The corridor contains the possible vehicles (vehicle_cloud.py). Their paths through a sequence
are composed of their paths through the primitives (3).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baqueano.design.containment import CORRIDOR_SIGMA, reach
from baqueano.routes.room import Room

LEVELS = (1, 2, 3, 5, 8, 13)
RETURN_KINDS = 4  # kinds of return; the last kind is without a return
GENTLE_FACTOR = 1.0 / 3.0  # factor on the turning channels of a gentler primitive


class MotionPrimitive(NamedTuple):
    """A short motion from rest to rest: its commands, and the kind of its return to the start."""

    # (T, n) relative to the limit, over the whole length of a primitive without its coast
    outbound: np.ndarray
    return_kind: int  # 0 all signs, 1 the first channel's, 2 the others', 3 none

    def u(self, ticks: int, limit: np.ndarray) -> np.ndarray:
        """Return the commands (ticks, n).  (1)"""
        n, is_first = len(limit), np.arange(len(limit)) == np.argmax(limit > 0.0)
        u = np.zeros((ticks, n))
        if self.return_kind == RETURN_KINDS - 1:
            u[: len(self.outbound)] = self.outbound
        else:
            signs = -np.ones(n), np.where(is_first, -1.0, 1.0), np.where(is_first, 1.0, -1.0)
            half_outbound = self.outbound[: len(self.outbound) // 2]
            u[: 2 * len(half_outbound)] = np.concatenate(
                [half_outbound, half_outbound * signs[self.return_kind]]
            )
        return u * limit


class PrimitiveShape(NamedTuple):
    """Length, coast and limits that all primitives share."""

    ticks: int
    coast_ticks: int  # number of these ticks with command 0, at the end
    limit: np.ndarray  # (n,)

    @classmethod
    def from_duration(
        cls, primitive_s: float, coast_s: float, limit: np.ndarray, rate_hz: float
    ) -> "PrimitiveShape":
        """Return the shape of primitives of `primitive_s` [s] at `rate_hz`. In the last `coast_s` [s] of a primitive,
        at most 40 % of it, the command is 0."""
        ticks = max(4, round(primitive_s * rate_hz))
        return cls(ticks, min(2 * ticks // 5, round(coast_s * rate_hz)), np.asarray(limit, dtype=float))

    @property
    def moving_channels(self) -> np.ndarray:
        """Return the indices of the usable channels, whose limit is above 0."""
        return np.flatnonzero(self.limit > 0.0)


def random_primitives(shape: PrimitiveShape, count: int, rng: np.random.Generator) -> list[MotionPrimitive]:
    """Return `count` random primitives. The first primitive stays at rest. Levels, durations and their number are
    random; the search computes the exact information of each primitive, so it only needs variety. Small levels show dry
    friction and dead zones. A return reverses all signs (two wheels), only those of the first channel (a car), or only
    the others. Primitives of the last kind, such as circles, do not return."""
    length = shape.ticks - shape.coast_ticks
    primitives = [MotionPrimitive(np.zeros((length, len(shape.limit))), RETURN_KINDS - 1)]
    while len(primitives) < count:
        outbound, return_kind = np.zeros((length, len(shape.limit))), int(rng.integers(RETURN_KINDS))
        used_ticks = length if return_kind == RETURN_KINDS - 1 else length // 2
        for j in shape.moving_channels:
            outbound[:used_ticks, j] = _levels(rng, used_ticks)
        if rng.random() < 0.25:  # only one channel moves
            outbound[:, rng.permutation(shape.moving_channels)[1:]] = 0.0
        primitives.append(MotionPrimitive(outbound, return_kind))
    return primitives


def mutated_primitives(
    parents: Sequence[MotionPrimitive], shape: PrimitiveShape, count: int, rng: np.random.Generator
) -> list[MotionPrimitive]:
    """Return `count` primitives. Each primitive differs from a parent in one or two changes."""
    primitives = []
    for _ in range(count):
        primitive = parents[int(rng.integers(len(parents)))]
        for _ in range(int(rng.integers(1, 3))):
            primitive = _mutation(primitive, parents[int(rng.integers(len(parents)))], shape, rng)
        primitives.append(primitive)
    return primitives


def gentler_primitive(primitive: MotionPrimitive, shape: PrimitiveShape) -> MotionPrimitive:
    """Return the primitive with all usable channels except the first reduced to a third, for a vehicle that would slide
    in curves. If only one channel is usable, this channel is reduced."""
    other_channels = shape.moving_channels[1:] if len(shape.moving_channels) > 1 else shape.moving_channels
    outbound = primitive.outbound.copy()
    outbound[:, other_channels] *= GENTLE_FACTOR
    return MotionPrimitive(outbound, primitive.return_kind)


def map_poses(pose: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Return the poses `path` (…, 3) in the map. They are given relative to `pose` (…, 3)."""
    c, s = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    x, y = path[..., 0], path[..., 1]
    xy = pose[..., 0] + c * x - s * y, pose[..., 1] + s * x + c * y
    return np.stack([*xy, pose[..., 2] + path[..., 2]], axis=-1)


def _mutation(
    primitive: MotionPrimitive,
    second_primitive: MotionPrimitive,
    shape: PrimitiveShape,
    rng: np.random.Generator,
) -> MotionPrimitive:
    outbound = primitive.outbound.copy()
    mode = int(rng.integers(8))
    j = int(rng.choice(shape.moving_channels))
    used_ticks = len(outbound) if primitive.return_kind == RETURN_KINDS - 1 else len(outbound) // 2
    a, b = np.sort(rng.integers(0, used_ticks + 1, 2))
    if mode < 4:  # another level for some ticks
        b = min(used_ticks, a + 1 + int(rng.integers(1, max(2, used_ticks // 3))))
        outbound[a:b, j] = _level(rng)
    elif mode == 4:
        outbound[:, j] = np.clip(outbound[:, j] * rng.uniform(0.5, 1.5), -1.0, 1.0)
    elif mode == 5:
        outbound[a:] = second_primitive.outbound[a:]
    elif mode == 6:
        outbound[:, j] = second_primitive.outbound[:, j] * rng.choice([-1.0, 1.0])
    else:
        return MotionPrimitive(outbound, int(rng.integers(RETURN_KINDS)))
    return MotionPrimitive(outbound, primitive.return_kind)


def _levels(rng: np.random.Generator, ticks: int) -> np.ndarray:
    """Return a random level in [−1, 1] for each tick (ticks,); it changes a few times."""
    count = int(rng.choice(LEVELS))
    cuts = np.sort(rng.uniform(0.0, 1.0, count - 1))
    level_index = np.searchsorted(cuts, (np.arange(ticks) + 0.5) / ticks)
    return np.array([_level(rng) for _ in range(count)])[level_index]


def _level(rng: np.random.Generator) -> float:
    draw = rng.random()
    magnitude = 0.0 if draw < 0.15 else 1.0 if draw < 0.5 else rng.uniform(0.03, 1.0)
    return float(magnitude * rng.choice([-1.0, 1.0]))


# primitives that are evaluated exactly together; those with the highest bounds are first
EXACT_PRIMITIVES = 24
MAX_TRIED_PRIMITIVES = 320  # primitives that are tried for one place
END_COST = 1.0  # in J, of a primitive that ends one room away from where it began
REACH_COST = 25.0  # cost in J for a reach of one room, to choose primitives that stay near
MAX_SWEEPS = 2  # over all places, at most, before new primitives are added


class Composer:
    """Search of (1) over a library of primitives, to which primitives can be added."""

    def __init__(self, room: Room, place_count: int, interest_count: int) -> None:
        self.room, self.place_count, self.interest_count = room, place_count, interest_count
        self.selected_indices: list[int] = []
        self.F = np.zeros((0, 0, 0, 0))
        self.cost = np.zeros(0)
        self.reach = np.zeros(0)  # largest distance from the beginning of the primitive, in rooms
        self.path = np.zeros((0, 0, 0, 3))
        # (2, P, S, L) x and y of `path`, for sums over the vehicles
        self.xy = np.zeros((2, 0, 0, 0), np.float32)
        # (P, M q (q + 1) / 2) the upper triangles of F, for sums over all
        self.upper_triangles = np.zeros((0, 0))

    def add_primitives(self, F: np.ndarray, path: np.ndarray) -> None:
        """Add primitives: their information F (P, M, q, q) for M possible vehicles, and the poses `path` (P, L, S, 3)
        of all possible vehicles along them. The last pose is the pose at rest."""
        triangles = F[:, :, *np.triu_indices(F.shape[-1])].reshape(len(F), -1)
        xy = np.ascontiguousarray(path[..., :2].transpose(3, 0, 2, 1), np.float32)
        if len(self.F):
            triangles, F, path, xy = (
                np.concatenate(pair, axis=axis)
                for *pair, axis in (
                    (self.upper_triangles, triangles, 0), (self.F, F, 0), (self.path, path, 0), (self.xy, xy, 1),
                )
            )  # fmt: skip
        self.upper_triangles, self.F, self.path, self.xy = triangles, F, path, xy
        room_m = np.min(self.room.free_half_width_m)
        self.reach = np.max(np.sqrt(np.mean(np.sum(xy**2, axis=0), axis=-1)), axis=-1) / room_m
        end_offset = path[:, :, -1, :2]
        self.cost = END_COST * np.sqrt(np.mean(np.sum(end_offset**2, axis=-1), axis=-1)) / room_m

    def score(self, F: np.ndarray) -> np.ndarray:
        """Return J (…,) of F (…, M, q, q). It is computed from the Cholesky factor of F + I, with the nuisance
        first."""
        root = np.linalg.cholesky((F + np.eye(F.shape[-1]))[..., ::-1, ::-1])
        diagonal = np.diagonal(root, axis1=-2, axis2=-1)[..., -self.interest_count :]
        return np.mean(2.0 * np.sum(np.log(diagonal), axis=-1), axis=-1)

    def search(self) -> float:
        """Fill the places, or improve the primitives in them, and return J minus the cost of the primitives."""
        if not self.selected_indices:
            self._fill_greedily()
        best_score = float(
            self.score(self.F[self.selected_indices].sum(axis=0)) - self.cost[self.selected_indices].sum()
        )
        for _ in range(MAX_SWEEPS):
            previous_score = best_score
            self._sort_by_cost()
            for place in range(self.place_count):
                best_score = self._improve_place(place, best_score)
            if best_score <= previous_score:
                break
        return best_score

    def restart(self, path: np.ndarray, kept_primitives: np.ndarray) -> float:
        """Search again from the beginning, with only `kept_primitives` and with other vehicles. `path`
        (P, L, S, 3) contains the poses of these vehicles along all primitives."""
        self.selected_indices, self.path = [], path
        self.xy = np.ascontiguousarray(path[..., :2].transpose(3, 0, 2, 1), np.float32)
        self._retain_primitives(kept_primitives)
        return self.search()

    def _retain_primitives(self, primitives: np.ndarray) -> None:
        """Keep only these primitives."""
        for name in ("F", "upper_triangles", "path", "cost", "reach"):
            setattr(self, name, getattr(self, name)[primitives])
        self.xy = self.xy[:, primitives]

    def substitutes(
        self, plan: list[int], place: int, pose: np.ndarray, reach_costs: Sequence[float], count: int
    ) -> list[int]:
        """Return indices of primitives for `place` that stay inside from the poses (L, 3) on. For each of the
        `reach_costs` of their reach, the `count` primitives that are best together with the other primitives of
        `plan` are returned, in order."""
        other_primitives = [*plan[:place], *plan[place + 1 :]]
        other_information = self.F[other_primitives].sum(axis=0)
        candidates = np.argsort(-self._upper_bound(other_information) + self.cost)[:MAX_TRIED_PRIMITIVES]
        candidates = candidates[self._margin(pose[None], candidates) >= 0.0]
        score = self.score(other_information + self.F[candidates])
        cost_orders = [
            candidates[np.argsort(times * self.reach[candidates] - score)][:count] for times in reach_costs
        ]
        return list(dict.fromkeys(np.concatenate(cost_orders).tolist()))

    def keep_best(self, count: int) -> np.ndarray:
        """Keep only the `count` primitives with the highest bounds, and some others. Return the indices of all
        primitives kept. The others are the chosen primitives, the first primitive, and `count` // 4 primitives that
        stay near."""
        bound = self._upper_bound(self.F[self.selected_indices].sum(axis=0))
        near_primitives = np.argsort(REACH_COST * self.reach - bound)[: count // 4]
        used_indices = np.unique(
            [0, *self.selected_indices, *near_primitives, *np.argsort(self.cost - bound)[:count].tolist()]
        )
        self._retain_primitives(used_indices)
        self.selected_indices = np.searchsorted(used_indices, self.selected_indices).tolist()
        return used_indices

    def _fill_greedily(self) -> None:
        total, pose = np.zeros(self.F.shape[1:]), self._start()
        for _ in range(self.place_count):
            first_inside = self._first_inside(total, pose, [], -np.inf)
            k = 0 if first_inside is None else first_inside[0]
            self.selected_indices.append(k)
            total = total + self.F[k]
            pose = map_poses(pose, self.path[k, :, -1])

    def _sort_by_cost(self) -> None:
        """Sort the chosen primitives by cost, the highest last, if that order stays inside. After primitives with a
        high cost the position is uncertain. J does not change."""
        order = sorted(self.selected_indices, key=lambda k: self.cost[k])
        if self._stays_inside(self._start(), np.array(order[:1]), order[1:])[0]:
            self.selected_indices = order

    def _improve_place(self, place: int, best_score: float) -> float:
        """Put a better primitive in the place if the search finds one. Return J of the sequence minus the cost of its
        primitives."""
        earlier_primitives, later_primitives = (
            self.selected_indices[:place],
            self.selected_indices[place + 1 :],
        )
        pose, other_pieces = self._start(), [*earlier_primitives, *later_primitives]
        for k in earlier_primitives:
            pose = map_poses(pose, self.path[k, :, -1])
        cost = float(self.cost[other_pieces].sum())
        first_inside = self._first_inside(
            self.F[other_pieces].sum(axis=0), pose, later_primitives, best_score + cost + 1e-6
        )
        if first_inside is None:
            return best_score
        self.selected_indices[place] = first_inside[0]
        return first_inside[1] - cost

    def _first_inside(
        self, other_information: np.ndarray, pose: np.ndarray, later_primitives: list[int], min_score: float
    ) -> tuple[int, float] | None:
        """Return the index of a good primitive to add to F = `other_information` (M, q, q), and J minus the cost of the
        primitive. Return None if no tested primitive exceeds `min_score`. At most the MAX_TRIED_PRIMITIVES primitives
        with the highest bounds are tested. The primitive and all `later_primitives` must stay inside from the poses
        (L, 3) on."""
        order = np.argsort(-self._upper_bound(other_information) + self.cost)
        for offset in range(0, min(len(order), MAX_TRIED_PRIMITIVES), EXACT_PRIMITIVES):
            candidates = order[offset : offset + EXACT_PRIMITIVES]
            scores = self.score(other_information + self.F[candidates]) - self.cost[candidates]
            better_indices = np.flatnonzero(scores > min_score)
            if len(better_indices):
                feasible_pairs = better_indices[
                    self._stays_inside(pose, candidates[better_indices], later_primitives)
                ]
                if len(feasible_pairs):
                    k = feasible_pairs[np.argmax(scores[feasible_pairs])]
                    return int(candidates[k]), float(scores[k])
            elif offset:
                return None
        return None

    def _upper_bound(self, other_information: np.ndarray) -> np.ndarray:
        """Return an upper bound (P,) of the increase of J if a primitive is added to F = `other_information` (M, q, q).
        (2)"""
        k, q = self.interest_count, other_information.shape[-1]
        gradient = np.linalg.inv(other_information + np.eye(q))
        gradient[:, k:, k:] -= np.linalg.inv(other_information[:, k:, k:] + np.eye(q - k))
        weights = 2.0 * gradient - gradient * np.eye(q)
        return self.upper_triangles @ weights[:, *np.triu_indices(q)].ravel() / len(other_information)

    def _start(self) -> np.ndarray:
        return np.tile(np.array(self.room.start), (self.path.shape[1], 1))

    def _stays_inside(
        self, pose: np.ndarray, primitives: np.ndarray, later_primitives: list[int]
    ) -> np.ndarray:
        """Return a mask (C,), True for each primitive whose corridor stays in the room, with all `later_primitives`.
        The primitives begin at the poses (L, 3). (3)"""
        is_inside = self._margin(pose[None], primitives) >= 0.0
        poses = map_poses(pose, self.path[primitives][:, :, -1])
        for k in later_primitives:
            candidates = np.flatnonzero(is_inside)
            if not len(candidates):
                break
            is_inside[candidates] = self._margin(poses[candidates], np.array([k])) >= 0.0
            poses[candidates] = map_poses(poses[candidates], self.path[k, :, -1])
        return is_inside

    def _margin(self, pose: np.ndarray, primitives: np.ndarray) -> np.ndarray:
        """Return the least distance (C,) [m] to a wall if the primitives begin at the poses (C, L, 3); see
        `Room.margin`. A single pose or primitive is used for all."""
        margins, mean_weights = [], np.full(pose.shape[1], 1.0 / pose.shape[1], np.float32)
        xy = self._positions(pose, primitives)
        for coordinates, limit in zip(xy, self.room.free_half_width_m, strict=True):
            mean = coordinates @ mean_weights
            std = np.sqrt(np.maximum((coordinates * coordinates) @ mean_weights - mean * mean, 0.0))
            max_distance = reach(coordinates.min(axis=-1), mean, coordinates.max(axis=-1))
            margins.append(
                limit - np.max(np.maximum(max_distance, np.abs(mean) + CORRIDOR_SIGMA * std), axis=-1)
            )
        return np.minimum(*margins)

    def _positions(self, pose: np.ndarray, primitives: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return x and y (C, S, L) [m] along the primitives, which begin at the poses (C, L, 3). A single pose or
        primitive is used for all."""
        pose = pose.astype(np.float32)[:, None]  # accurate to 0.1 mm
        c, s = np.cos(pose[..., 2]), np.sin(pose[..., 2])
        x, y = self.xy[:, primitives]
        return pose[..., 0] + c * x - s * y, pose[..., 1] + s * x + c * y
