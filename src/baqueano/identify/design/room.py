"""The room in which an experiment takes place, and whether a cloud of drives stays in it.

The origin of the map is the middle of the room, x along its width. With mean m(t) and standard deviation
s(t) of the position over the vehicles that the plan believes possible, and the radius ρ of the body,

    |m_x(t)| + k s_x(t) + ρ ≤ w/2,   |m_y(t)| + k s_y(t) + ρ ≤ h/2,   k = 3                               (1)
    m_v(t) + k s_v(t) ≤ fastest,     m_r(t) + k s_r(t) ≤ fastest turn,     m_vr(t) + k s_vr(t) ≤ sideways  (2)

The cloud is not linearised: once the heading is lost it is a ring, of which k = 3 standard deviations are
twice the radius. v, r and the acceleration v r towards the middle of a curve are read off neighbouring poses. No model
here knows where tyres slide: a vehicle that does goes straight on, into a wall. So v r stays below SIDEWAYS_M_S2.

Means and deviations know nothing of a tail: every single vehicle of the cloud is asked as well, and may go half as far
again from the mean, as one in ten thousand does of normal positions where a cloud of 128 holds 2.6 deviations:

    |m_x(t) + c (x_l(t) − m_x(t))| + ρ ≤ w/2,   y alike,   c = 1.5                                        (3)
"""

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from baqueano.diagnostics import fault
from baqueano.errors import UsageError

if TYPE_CHECKING:
    from baqueano.vehicle_file.file import VehicleFile

DEVIATIONS = 3.0  # k of (1): one normal position in 370 lies further out
TAIL = 1.5  # c of (3)
SIDEWAYS_M_S2 = 3.0  # half of what rubber holds on a smooth floor, 0.6 g: below it tyres hardly slip


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """Walls and limits, and where in it the drive begins."""

    width_m: float
    height_m: float
    radius_m: float = 0.0  # of the body about the origin of its frame
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)  # x, y [m], ψ [rad] from the middle of the room
    speed_m_s: float = float("inf")
    turn_rad_s: float = float("inf")
    sideways_m_s2: float = float("inf")

    def __post_init__(self) -> None:
        free = 0.5 * min(self.width_m, self.height_m) - self.radius_m
        if not (np.isfinite(self.width_m + self.height_m) and free > 0.0):
            raise UsageError(
                fault(
                    "room.small",
                    "--room 2x2",
                    width_m=self.width_m,
                    height_m=self.height_m,
                    radius_m=self.radius_m,
                    least_m=2.0 * self.radius_m,
                )
            )
        if np.any(np.abs(self.start[:2]) > self.free):
            raise UsageError(
                fault(
                    "room.start",
                    x_m=self.start[0],
                    y_m=self.start[1],
                    along_m=self.free[0],
                    across_m=self.free[1],
                )
            )

    @property
    def free(self) -> np.ndarray:
        """(2,) how far from the middle the origin of the body may come [m]."""
        return 0.5 * np.array([self.width_m, self.height_m]) - self.radius_m

    def margin(self, eta: np.ndarray) -> np.ndarray:
        """(…,) the least distance over time between a wall and the corridor, or the vehicle that goes furthest, of
        clouds (…, L, T, 3); below 0 some leave the room.  (1), (3)"""
        xy = eta[..., :2]
        mean, sd = xy.mean(axis=-3), xy.std(axis=-3)
        corridor = np.abs(mean) + DEVIATIONS * sd
        return np.min(
            self.free - np.maximum(corridor, reach(xy.min(axis=-3), mean, xy.max(axis=-3))), axis=(-2, -1)
        )

    def slow(self, eta: np.ndarray, rate_hz: float) -> np.ndarray:
        """(…,) bool: whether clouds (…, L, T, 3) keep to the limits of speed.  (2)"""
        if not np.isfinite(min(self.speed_m_s, self.turn_rad_s, self.sideways_m_s2)):
            return np.ones(eta.shape[:-3], bool)
        step = np.diff(eta, axis=-2) * rate_hz
        speed = np.hypot(step[..., 0], step[..., 1])
        half = np.pi * rate_hz
        turn = np.abs((step[..., 2] + half) % (2.0 * half) - half)
        slow = (_upper(speed) <= self.speed_m_s) & (_upper(turn) <= self.turn_rad_s)
        return slow & (_upper(speed * turn) <= self.sideways_m_s2)


def reach(low: np.ndarray, mean: np.ndarray, high: np.ndarray) -> np.ndarray:
    """How far from the middle a vehicle may come of a cloud whose positions have these extremes and mean, (…,) each.
    (3)"""
    return np.maximum(np.abs(mean + TAIL * (low - mean)), np.abs(mean + TAIL * (high - mean)))


def room_of(vehicle_file: "VehicleFile", size: str, **options: Any) -> Room:
    """The room "2x2.5", width and height in metres, for the vehicle of the file: its radius, the limits of its
    supervisor and SIDEWAYS_M_S2, unless `options`, fields of Room, say others. UsageError for what is no size, or a
    room too small.

    >>> from baqueano.vehicle_file import load
    >>> room = room_of(load("small"), "2x2.5", start=(0.5, 0.0, 0.0))
    >>> print(room.height_m, room.radius_m, room.free)
    2.5 0.07 [0.93 1.18]
    """
    found = re.fullmatch(r"\s*([\d.]+)\s*[x×]\s*([\d.]+)\s*m?\s*", size)
    try:
        sides = [float(side) for side in found.groups()] if found else []
    except ValueError:
        sides = []
    if len(sides) != 2:
        raise UsageError(fault("room.unreadable", "--room 2x2", size=size))
    supervisor = vehicle_file.supervisor()
    limits = {
        "radius_m": body_radius(vehicle_file),
        "speed_m_s": getattr(supervisor, "max_speed_m_s", float("inf")),
        "turn_rad_s": getattr(supervisor, "max_yaw_rate_rad_s", float("inf")),
        "sideways_m_s2": SIDEWAYS_M_S2,
    }
    return Room(sides[0], sides[1], **(limits | options))


def body_radius(vehicle_file: "VehicleFile") -> float:
    """Radius of the circle about the origin that holds the whole body [m]; 0 where the file has no size."""
    g = vehicle_file.geometry
    box = float(np.hypot(g.length_m or 0.0, g.width_m or 0.0)) / 2.0
    return max(g.radius_m or 0.0, box, (g.track_m or 0.0) / 2.0)


def _upper(x: np.ndarray) -> np.ndarray:
    """Max over time of mean + k sd over the cloud (…, L, T)."""
    return np.max(x.mean(axis=-2) + DEVIATIONS * x.std(axis=-2), axis=-1)
