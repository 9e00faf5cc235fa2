"""Build a library of short drives, each from rest to rest, as parts of an experiment.

    piece = a few levels of each command, each held for some time;  the return;  no command until rest           (1)

The levels, their durations and their number are random (seeded). The search computes the exact information of each
piece, so it only needs variety. Some levels are full, some are 0, the others are random: small levels show dry
friction and dead zones. There are four kinds of return. The first reverses all signs (a vehicle with two wheels
returns on its arc). The second reverses only the signs of the first channel (a car returns), the third only the other
signs. The fourth kind does not have a return. Circles stay in a room, and a signal that ends where it began does not
need a return. Variations of good pieces differ from their parent in one or two changes. The library does not depend
on the vehicle, but channels with limit 0 are not used. Each piece begins and ends at rest. So its information
(information.py) does not depend on other pieces, and adds up over a sequence. The paths of the possible vehicles
(vehicle_cloud.py) are composed in the same way.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

LEVELS = (1, 2, 3, 5, 8, 13)
RETURN_KINDS = 4  # kinds of return; the last kind is without a return
GENTLE_FACTOR = 1.0 / 3.0  # factor on the turning channels of a gentler piece


class MotionPiece(NamedTuple):
    """A piece of motion: its commands, and the kind of its return to the start."""

    outbound: np.ndarray  # (T, n) relative to the limit, over the whole length of a piece without its coast
    return_kind: int  # 0 all signs, 1 the first channel's, 2 the others', 3 none

    def u(self, ticks: int, limit: np.ndarray) -> np.ndarray:
        """Return the commands (ticks, n).  (1)"""
        n, is_first = len(limit), np.arange(len(limit)) == np.argmax(limit > 0.0)
        u = np.zeros((ticks, n))
        if self.return_kind == RETURN_KINDS - 1:
            u[: len(self.outbound)] = self.outbound
        else:
            sign = (-np.ones(n), np.where(is_first, -1.0, 1.0), np.where(is_first, 1.0, -1.0))[
                self.return_kind
            ]
            half = self.outbound[: len(self.outbound) // 2]
            u[: 2 * len(half)] = np.concatenate([half, half * sign])
        return u * limit


class PieceShape(NamedTuple):
    """Length, coast and limits that all pieces share."""

    ticks: int
    coast_ticks: int  # number of these ticks with command 0, at the end
    limit: np.ndarray  # (n,)

    @classmethod
    def of(cls, piece_s: float, coast_s: float, limit: np.ndarray, rate_hz: float) -> "PieceShape":
        """Return the shape of pieces of `piece_s` [s] at `rate_hz`.

        In the last `coast_s` [s] of a piece, at most 40 % of it, the command is 0.
        """
        ticks = max(4, round(piece_s * rate_hz))
        return cls(ticks, min(2 * ticks // 5, round(coast_s * rate_hz)), np.asarray(limit, dtype=float))

    @property
    def moving_channels(self) -> np.ndarray:
        """Return the indices of the usable channels, whose limit is above 0."""
        return np.flatnonzero(self.limit > 0.0)


def random_pieces(shape: PieceShape, count: int, rng: np.random.Generator) -> list[MotionPiece]:
    """Return `count` random pieces. The first piece stays at rest."""
    length = shape.ticks - shape.coast_ticks
    pieces = [MotionPiece(np.zeros((length, len(shape.limit))), RETURN_KINDS - 1)]
    while len(pieces) < count:
        outbound, return_kind = np.zeros((length, len(shape.limit))), int(rng.integers(RETURN_KINDS))
        ticks_used = length if return_kind == RETURN_KINDS - 1 else length // 2
        for j in shape.moving_channels:
            outbound[:ticks_used, j] = _levels(rng, ticks_used)
        if rng.random() < 0.25:  # only one channel moves
            outbound[:, rng.permutation(shape.moving_channels)[1:]] = 0.0
        pieces.append(MotionPiece(outbound, return_kind))
    return pieces


def mutated_pieces(
    parents: Sequence[MotionPiece], shape: PieceShape, count: int, rng: np.random.Generator
) -> list[MotionPiece]:
    """Return `count` pieces. Each piece differs from a parent in one or two changes."""
    pieces = []
    for _ in range(count):
        piece = parents[int(rng.integers(len(parents)))]
        for _ in range(int(rng.integers(1, 3))):
            piece = _mutation(piece, parents[int(rng.integers(len(parents)))], shape, rng)
        pieces.append(piece)
    return pieces


def gentler_piece(piece: MotionPiece, shape: PieceShape) -> MotionPiece:
    """Return the piece with all usable channels except the first reduced to a third, for a vehicle that would slide
    in curves. If only one channel is usable, this channel is reduced.
    """
    other_channels = shape.moving_channels[1:] if len(shape.moving_channels) > 1 else shape.moving_channels
    outbound = piece.outbound.copy()
    outbound[:, other_channels] *= GENTLE_FACTOR
    return MotionPiece(outbound, piece.return_kind)


def in_map(pose: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Return the poses `path` (…, 3) in the map. They are given relative to `pose` (…, 3)."""
    c, s = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    x, y = path[..., 0], path[..., 1]
    xy = pose[..., 0] + c * x - s * y, pose[..., 1] + s * x + c * y
    return np.stack([*xy, pose[..., 2] + path[..., 2]], axis=-1)


def _mutation(
    piece: MotionPiece, other_piece: MotionPiece, shape: PieceShape, rng: np.random.Generator
) -> MotionPiece:
    outbound, mode, j = piece.outbound.copy(), int(rng.integers(8)), int(rng.choice(shape.moving_channels))
    ticks_used = len(outbound) if piece.return_kind == RETURN_KINDS - 1 else len(outbound) // 2
    a, b = np.sort(rng.integers(0, ticks_used + 1, 2))
    if mode < 4:  # another level for some ticks
        b = min(ticks_used, a + 1 + int(rng.integers(1, max(2, ticks_used // 3))))
        outbound[a:b, j] = _level(rng)
    elif mode == 4:
        outbound[:, j] = np.clip(outbound[:, j] * rng.uniform(0.5, 1.5), -1.0, 1.0)
    elif mode == 5:
        outbound[a:] = other_piece.outbound[a:]
    elif mode == 6:
        outbound[:, j] = other_piece.outbound[:, j] * rng.choice([-1.0, 1.0])
    else:
        return MotionPiece(outbound, int(rng.integers(RETURN_KINDS)))
    return MotionPiece(outbound, piece.return_kind)


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
