"""Describe the room of a drive: the walls, the body between them, and the pose at the start.

The origin of the room is its middle, and x points along its width. The origin of the body stays within

    |x| ≤ w/2 − ρ,   |y| ≤ h/2 − ρ,   with the radius ρ of the body                                       (1)
"""

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from baqueano.errors import UsageError
from baqueano.vehicle_file.file import VehicleFile

# half of the grip of rubber on a smooth floor, 0.6 g: below it tyres almost do not slip
MAX_LATERAL_M_S2 = 3.0
SIDES = re.compile(r"\s*(\d+\.?\d*|\.\d+)\s*[x×]\s*(\d+\.?\d*|\.\d+)\s*m?\s*")  # "2x2.5"


@dataclass(frozen=True, slots=True)
class Room:
    """Walls and limits of a room, and the pose at which the drive begins."""

    width_m: float
    height_m: float
    radius_m: float = 0.0  # of the body about the origin of its frame
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)  # x, y [m], ψ [rad] from the middle of the room
    speed_m_s: float = float("inf")
    turn_rad_s: float = float("inf")
    lateral_m_s2: float = float("inf")

    def __post_init__(self) -> None:
        free_m = 0.5 * min(self.width_m, self.height_m) - self.radius_m
        if not (np.isfinite(self.width_m + self.height_m) and free_m > 0.0):
            w, h, r = self.width_m, self.height_m, self.radius_m
            raise UsageError.of("room.small", "--room 2x2", width_m=w, height_m=h, radius_m=r, min_m=2.0 * r)
        if np.any(np.abs(self.start[:2]) > self.free_half_width_m):
            (x_m, y_m, _), (along_m, across_m) = self.start, self.free_half_width_m
            raise UsageError.of("room.start", x_m=x_m, y_m=y_m, max_x_m=along_m, max_y_m=across_m)

    @property
    def free_half_width_m(self) -> np.ndarray:
        """Return the largest distance (2,) [m] from the middle that is allowed for the origin of the body."""
        return 0.5 * np.array([self.width_m, self.height_m]) - self.radius_m


def vehicle_room(vehicle_file: VehicleFile | None, room: Room | str, **options: Any) -> Room:
    """Return the room "2x2.5", width and height in metres, for the vehicle of the file.

    The room has the radius of the vehicle, the limits of its supervisor, and MAX_LATERAL_M_S2; without a file, neither
    a radius nor limits. `options` replaces these or sets other fields of Room. A Room is returned unchanged.

    Parameters
    ----------
    vehicle_file : VehicleFile or None
        The vehicle.
    room : str or Room
        Width and height, such as "2x2.5" [m].
    **options : object
        Fields of Room, such as `start`.

    Returns
    -------
    Room
        The room.

    Raises
    ------
    UsageError
        For an invalid size, or a room that is too small.

    Examples
    --------
    >>> room = vehicle_room(bq.load("small"), "2x2.5", start=(0.5, 0.0, 0.0))
    >>> print(room.height_m, room.radius_m, room.free_half_width_m)
    2.5 0.07 [0.93 1.18]
    """
    if isinstance(room, Room):
        return room
    if not isinstance(room, str):
        raise UsageError.of("room.kind", "--room 2x2", value=repr(room))
    if not (match := SIDES.fullmatch(room)):
        room_text = room.replace(",", ".")
        remedy = room_text if SIDES.fullmatch(room_text) else "2x2"
        raise UsageError.of("room.unreadable", f"--room {remedy}", size=room)
    sides = [float(side) for side in match.groups()]
    if vehicle_file is None:
        return Room(sides[0], sides[1], **options)
    supervisor = vehicle_file.supervisor()
    limits = {
        "radius_m": body_radius(vehicle_file),
        "speed_m_s": getattr(supervisor, "max_speed_m_s", float("inf")),
        "turn_rad_s": getattr(supervisor, "max_yaw_rate_rad_s", float("inf")),
        "lateral_m_s2": MAX_LATERAL_M_S2,
    }
    return Room(sides[0], sides[1], **(limits | options))


def body_radius(vehicle_file: VehicleFile) -> float:
    """Return the radius [m] of the circle about the origin that contains the body, or 0 without a size in the file."""
    g = vehicle_file.geometry
    half_diagonal_m = float(np.hypot(g.length_m or 0.0, g.width_m or 0.0)) / 2.0
    return max(g.radius_m or 0.0, half_diagonal_m, (g.track_m or 0.0) / 2.0)
