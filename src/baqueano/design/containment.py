"""Keep an experiment in a room: test if the possible vehicles stay in it, and make a signal with which they do.

The origin of the map is the middle of the room, and x points along its width. The positions x_l(t) of the possible
vehicles have the mean m(t) and the standard deviation s(t). With the radius ρ of the body,

    |m_x(t)| + k s_x(t) + ρ ≤ w/2,   |m_y(t)| + k s_y(t) + ρ ≤ h/2,   k = 3                               (1)
    m_v(t) + k s_v(t) ≤ fastest,     m_r(t) + k s_r(t) ≤ fastest turn,     m_vr(t) + k s_vr(t) ≤ sideways  (2)
    |m_x(t) + c (x_l(t) − m_x(t))| + ρ ≤ w/2,   also for y,   c = 1.5, for every single vehicle               (3)
    allowed(x, chunk)  ⇔  (1)-(3) are true for x under (chunk, then no command for COAST_S)               (4)

The models do not contain sliding tyres, so v r must stay below MAX_LATERAL_M_S2. A chunk that is not allowed is
replaced by the first allowed alternative. Alternatives reverse all signs, or the signs of the first channel, or the
signs of the other channels. The next alternatives are the chunk and these three at a half, then at a quarter. The
last one is a zero command, which (4) of the previous chunk has tested.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baqueano.design.vehicle_cloud import VehicleCloud, possible_vehicles
from baqueano.errors import AnswerNo, UsageError
from baqueano.routes.room import Room
from baqueano.vehicle_file.file import VehicleFile
from baqueano.vehicles import VehicleState

CORRIDOR_SIGMA = 3.0  # k of (1): one position in 370 of a normal distribution is further out
TAIL_FACTOR = 1.5  # c of (3)
CHUNK_S = 0.5
COAST_S = 2.0  # without command, in which a small vehicle comes to rest
MIN_WALL_DISTANCE_M = 0.01  # that a chunk leaves for process noise at rest, and for the path between samples
SAMPLE_S = 0.05  # between the poses that are tested: with 10 m/s² a path bulges by 3 mm between them
SIZE_FACTORS = (1.0, 0.5, 0.25)
VEHICLES = 128  # possible vehicles: the error of the standard deviation of their position is 6 %
SIMULATED_OPTIONS = 2  # alternatives that are simulated to their end together: mostly the first is allowed


def reach(low: np.ndarray, mean: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the largest distance (…,) of a vehicle from the middle, from extremes and mean of the positions.  (3)"""
    return np.maximum(np.abs(mean + TAIL_FACTOR * (low - mean)), np.abs(mean + TAIL_FACTOR * (high - mean)))


def wall_margin(room: Room, eta: np.ndarray) -> np.ndarray:
    """Return the least distance (…,) [m] over time between a wall and the poses (…, L, T, 3) of possible vehicles.
    It is negative if they leave the room. The corridor and the outermost vehicle are tested. (1), (3)"""
    xy = eta[..., :2]
    mean, std = xy.mean(axis=-3), xy.std(axis=-3)
    corridor = np.abs(mean) + CORRIDOR_SIGMA * std
    max_distance = np.maximum(corridor, reach(xy.min(axis=-3), mean, xy.max(axis=-3)))
    return np.min(room.free_half_width_m - max_distance, axis=(-2, -1))


def respects_speed_limits(room: Room, eta: np.ndarray, rate_hz: float) -> np.ndarray:
    """Return a mask (…,), True for poses (…, L, T, 3) of possible vehicles that respect the speed limits.  (2)"""
    if not np.isfinite(min(room.speed_m_s, room.turn_rad_s, room.lateral_m_s2)):
        return np.ones(eta.shape[:-3], bool)
    step = np.diff(eta, axis=-2) * rate_hz
    speed = np.hypot(step[..., 0], step[..., 1])
    half_turn_rad_s = np.pi * rate_hz
    turn = np.abs((step[..., 2] + half_turn_rad_s) % (2.0 * half_turn_rad_s) - half_turn_rad_s)
    is_within = (_upper_limit(speed) <= room.speed_m_s) & (_upper_limit(turn) <= room.turn_rad_s)
    return is_within & (_upper_limit(speed * turn) <= room.lateral_m_s2)


def _upper_limit(x: np.ndarray) -> np.ndarray:
    """Return the maximum (…,) over time of mean + k standard deviations of x (…, L, T) over the vehicles."""
    return np.max(x.mean(axis=-2) + CORRIDOR_SIGMA * x.std(axis=-2), axis=-1)


class ContainedSignal(NamedTuple):
    """A signal that stays in a room."""

    u: np.ndarray  # (N, n)
    margin_m: float  # least distance between the corridor and the walls, (1)
    replaced_fraction: float  # fraction of the chunks that were replaced
    eta: np.ndarray  # (L, N, 3) poses of the possible vehicles


def contain_in_room(
    u: np.ndarray,
    vehicle_file: VehicleFile,
    room: Room,
    *,
    cloud: VehicleCloud | None = None,
    seed: int = 0,
    backend: str = "auto",
) -> ContainedSignal:
    """Return `u` (N, n), one row per tick, in which every chunk that could leave `room` is replaced.  (4)

    `cloud` contains the possible vehicles; default: possible vehicles of `vehicle_file`, drawn with `seed`. Raise
    UsageError if `u` has another shape. Raise AnswerNo if these vehicles leave the room in spite of the replacements.

    >>> from baqueano.routes.room import vehicle_room
    >>> from baqueano.vehicle_file import load
    >>> small = load("small")
    >>> safe = contain_in_room(np.tile([1.0, 0.0, 0.0], (200, 1)), small, vehicle_room(small, "2x2"))  # 1 m ahead
    >>> print(safe.u.shape, f"{100 * safe.replaced_fraction:.0f} % replaced, {safe.margin_m > 0.0}")
    (200, 3) 50 % replaced, True
    """
    u = np.array(u, dtype=float)
    if u.ndim != 2 or u.shape[1] != vehicle_file.vehicle.commands or not len(u):
        raise UsageError.of("signal.shape", rows=u.shape, commands=vehicle_file.vehicle.commands)
    if cloud is None:
        vehicles = possible_vehicles(vehicle_file, vehicle_count=VEHICLES)
        cloud = VehicleCloud(vehicle_file, vehicles, seed, backend)
    state, rate_hz = cloud.state_at(room.start), vehicle_file.rate_hz
    chunk_ticks = max(1, round(CHUNK_S * rate_hz))
    limited_u, poses, change_count = np.empty_like(u), [], 0
    for begin in range(0, len(u), chunk_ticks):
        chunk_u = u[begin : begin + chunk_ticks]
        options = chunk_alternatives(chunk_u)
        index, state, path = _first_allowed_or_last(cloud, room, state, options, begin)
        limited_u[begin : begin + chunk_ticks] = options[index]
        poses.append(path)
        change_count += not np.array_equal(options[index], chunk_u)
    eta = np.concatenate(poses, axis=1)
    margin = float(wall_margin(room, eta))
    if margin < 0.0:
        width_m, height_m = room.width_m, room.height_m
        raise AnswerNo.of("room.too-small", width_m=width_m, height_m=height_m, excess_m=-margin)
    return ContainedSignal(limited_u, margin, change_count / len(poses), eta)


def chunk_alternatives(u: np.ndarray) -> np.ndarray:
    """Return (C, T, n): the chunk `u` (T, n) and then its alternatives in order. The last one is the zero command."""
    n = u.shape[1]
    first_sign = np.where(np.arange(n) == 0, -1.0, 1.0)
    signs = (np.ones(n), -np.ones(n), first_sign, -first_sign)
    variants = [size * sign * u for size in SIZE_FACTORS for sign in signs]
    return np.stack([*variants, np.zeros_like(u)])


def first_allowed_option(
    cloud: VehicleCloud, room: Room, state: VehicleState, options: Sequence[np.ndarray], tick: int
) -> tuple[int, VehicleState, np.ndarray] | None:  # fmt: skip
    """Return the index of the first allowed option (T, n), the vehicle states after it, and its poses (L, T, 3), or
    None. (4)"""
    stride = max(1, round(SAMPLE_S * cloud.rate_hz))
    rate_hz, ticks = cloud.rate_hz / stride, len(options[0])
    drives = cloud.drive_each([state] * len(options), options, tick)
    paths = [eta[:, ticks % stride :: stride] for _, eta in drives]
    allowed_indices = [k for k, eta in enumerate(paths) if wall_margin(room, eta) >= MIN_WALL_DISTANCE_M]
    coast_command = np.zeros((round(COAST_S * cloud.rate_hz), options[0].shape[1]))
    for offset in range(0, len(allowed_indices), SIMULATED_OPTIONS):
        indices = allowed_indices[offset : offset + SIMULATED_OPTIONS]
        coasts = cloud.drive_each(
            [drives[k][0] for k in indices], [coast_command] * len(indices), tick + ticks
        )
        for k, (_, eta) in zip(indices, coasts, strict=True):
            full_path = np.concatenate([paths[k], eta[:, ::stride]], axis=1)
            is_inside = wall_margin(room, full_path) >= MIN_WALL_DISTANCE_M
            if is_inside and respects_speed_limits(room, full_path, rate_hz):
                return k, *drives[k]
    return None


def _first_allowed_or_last(
    cloud: VehicleCloud, room: Room, state: VehicleState, options: np.ndarray, tick: int
) -> tuple[int, VehicleState, np.ndarray]:
    """Return the index of the first allowed option of (C, T, n), the vehicle states after it, and its poses (L, T, 3).
    If none is allowed, return the values of the last option."""
    for begin, end in ((0, 1), (1, len(options))):  # mostly the requested chunk is allowed
        allowed_option = first_allowed_option(cloud, room, state, list(options[begin:end]), tick)
        if allowed_option is not None:
            return begin + allowed_option[0], *allowed_option[1:]
    return len(options) - 1, *cloud.drive(state, options[-1], tick)
