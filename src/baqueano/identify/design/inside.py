"""Any signal, kept inside a room: what would leave it is replaced, chunk by chunk.

A chunk of the signal is allowed if the cloud of possible vehicles (belief.py), after driving it, can still
come to rest inside the room and the limits of speed:

    allowed(x, chunk)  ⇔  corridor of x under (chunk, then no command for COAST_S) inside                  (1)

Where a chunk is not allowed, these stand in its place, the first that is allowed: the chunk with all signs turned; with
the first channel's alone turned (a car drives back with the wheel as it was); with the others turned; all of
these at a half, then at a quarter of the size; no command. If (1) held before, no command is always allowed
now, because it is the rest of what was checked then: the drive stays inside from the first chunk to the
last. A vehicle that needs longer than COAST_S to stop is seen by the corridor of the whole drive, which is
told with it.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.diagnostics import fault
from baqueano.errors import AnswerNo, UsageError
from baqueano.identify.design.belief import Cloud, believed

if TYPE_CHECKING:
    from baqueano.identify.design.room import Room
    from baqueano.vehicle_file.file import VehicleFile
    from baqueano.vehicles import VehicleState

CHUNK_S = 0.5
COAST_S = 2.0  # without command, in which a small vehicle comes to rest
RESERVE_M = 0.01  # that a chunk leaves for what the floor does to a vehicle that waits, and between samples
SAMPLE_S = 0.05  # between the poses that are looked at: with 10 m/s² a path bulges by 3 mm between them
SIZES = (1.0, 0.5, 0.25)
VEHICLES = 128  # that are believed possible: the standard deviation of their place is then known to 6 %
AT_ONCE = 2  # alternatives that are driven to their end together: mostly the first is allowed


class Contained(NamedTuple):
    """A signal that stays in a room."""

    u: np.ndarray  # (N, n)
    margin_m: float  # least distance between the corridor and the walls, (1) of room.py
    replaced: float  # part of the chunks that were not driven as asked
    eta: np.ndarray  # (L, N, 3) where the possible vehicles go


def contained(
    u: np.ndarray,
    vehicle_file: "VehicleFile",
    room: "Room",
    *,
    cloud: Cloud | None = None,
    seed: int = 0,
    backend: str = "auto",
) -> Contained:
    """`u` (N, n), one row a tick, with all that could leave `room` replaced.  (1)

    `cloud`: the vehicles that it might be, else those of `vehicle_file`, drawn by `seed`. UsageError for another shape;
    AnswerNo where they leave the room even without a command.

    >>> from baqueano.identify.design import room_of
    >>> from baqueano.vehicle_file import load
    >>> small = load("small")
    >>> safe = contained(np.tile([1.0, 0.0, 0.0], (200, 1)), small, room_of(small, "2x2"))  # 1 m ahead, and on
    >>> print(safe.u.shape, f"{100 * safe.replaced:.0f} % replaced, {safe.margin_m > 0.0}")
    (200, 3) 50 % replaced, True
    """
    u = np.array(u, dtype=float)
    if u.ndim != 2 or u.shape[1] != vehicle_file.vehicle.commands or not len(u):
        raise UsageError(fault("signal.shape", rows=u.shape, commands=vehicle_file.vehicle.commands))
    if cloud is None:
        cloud = Cloud(vehicle_file, believed(vehicle_file, vehicles=VEHICLES), seed, backend)
    state, rate = cloud.at(room.start), vehicle_file.rate_hz
    chunk = max(1, round(CHUNK_S * rate))
    out, poses, changed = np.empty_like(u), [], 0
    for begin in range(0, len(u), chunk):
        asked = u[begin : begin + chunk]
        options = alternatives(asked)
        best, state, driven = _first_allowed(cloud, room, state, options, begin)
        out[begin : begin + chunk] = options[best]
        poses.append(driven)
        changed += not np.array_equal(options[best], asked)
    eta = np.concatenate(poses, axis=1)
    margin = float(room.margin(eta))
    if margin < 0.0:
        raise AnswerNo(
            fault("room.too-small", width_m=room.width_m, height_m=room.height_m, beyond_m=-margin)
        )
    return Contained(out, margin, changed / len(poses), eta)


def alternatives(asked: np.ndarray) -> np.ndarray:
    """(C, T, n): what may stand for a chunk (T, n), in order; the last is no command."""
    n = asked.shape[1]
    first = np.where(np.arange(n) == 0, -1.0, 1.0)
    signs = (np.ones(n), -np.ones(n), first, -first)
    both = [size * sign * asked for size in SIZES for sign in signs]
    return np.stack([*both, np.zeros_like(asked)])


def first_allowed(
    cloud: Cloud, room: "Room", state: "VehicleState", options: Sequence[np.ndarray], tick: int
) -> tuple[int, "VehicleState", np.ndarray] | None:  # fmt: skip
    """The first of the options (T, n) that is allowed, the cloud after it and its poses (L, T, 3). None if none
    is.  (1)"""
    stride = max(1, round(SAMPLE_S * cloud.rate_hz))
    rate_hz, ticks = cloud.rate_hz / stride, len(options[0])
    drives = cloud.under([state] * len(options), options, tick)
    seen = [eta[:, ticks % stride :: stride] for _, eta in drives]
    may = [k for k, eta in enumerate(seen) if room.margin(eta) >= RESERVE_M]
    still = np.zeros((round(COAST_S * cloud.rate_hz), options[0].shape[1]))
    for at in range(0, len(may), AT_ONCE):
        some = may[at : at + AT_ONCE]
        coasts = cloud.under([drives[k][0] for k in some], [still] * len(some), tick + ticks)
        for k, (_, eta) in zip(some, coasts, strict=True):
            whole = np.concatenate([seen[k], eta[:, ::stride]], axis=1)
            if room.margin(whole) >= RESERVE_M and room.slow(whole, rate_hz):
                return k, *drives[k]
    return None


def _first_allowed(
    cloud: Cloud, room: "Room", state: "VehicleState", options: np.ndarray, tick: int
) -> tuple[int, "VehicleState", np.ndarray]:
    """Which of the options (C, T, n) is driven, the cloud after it, and the poses (L, T, 3) during it."""
    for begin, end in ((0, 1), (1, len(options))):  # mostly what is asked is allowed
        found = first_allowed(cloud, room, state, list(options[begin:end]), tick)
        if found is not None:
            return begin + found[0], *found[1:]
    return len(options) - 1, *cloud.drive(state, options[-1], tick)
