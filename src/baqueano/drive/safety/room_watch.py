"""Stop the vehicle before it might leave the room.

  p̂ = p_start + R(ψ_start) R(ψ_0)ᵀ (p − p_0)                in the room, from the route's first pose η_0 (1)
  |p̂_i| + s(|v|) |v_i|/|v| + √(χ² Σ_ii) < free_i,   χ² = 5.99    the 95 % region, and the stopping distance  (2)
  s(v) = v (delay + lag) + ∫₀ᵛ w dw / a(w),   a(w) = min(−ν̇_x(w), ν̇_x(−w))         coasting without command  (3)

s(v) is at least STOPPING_S v. a is the smaller deceleration, of a forward and a backward motion. free is half the width
of the space in which the body's origin can be (routes/room.py). With only commands and an IMU, Σ grows from
lap to lap. The drive therefore ends when the vehicle might touch a wall, before it touches one.
"""

from collections.abc import Callable

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.values import JsonObject, Tree
from baqueano.diagnostics import Diagnostic, StopReason, stop
from baqueano.drive.observers import Observer
from baqueano.estimators.covariance import CHI_SQUARE_95
from baqueano.geometry import map_from_body
from baqueano.guides.route import Route
from baqueano.loop import Record
from baqueano.routes.room import Room

STOPPING_S = 0.3
MIN_DECELERATION_M_S2 = 0.01  # of a model without friction
SPEED_COUNT = 64
MIN_SPEED_M_S = 0.01


def stopping_distance(vehicle: Tree, max_speed_m_s: float) -> Callable[[float], float]:
    """Return the function s: speed, up to `max_speed_m_s` → stopping distance [m] of the vehicle.  (3)"""
    edges = np.linspace(0.0, max_speed_m_s, SPEED_COUNT + 1)
    middles, distances = 0.5 * (edges[1:] + edges[:-1]), np.zeros(SPEED_COUNT + 1)
    nu_dot, zero_command = optional.attribute(vehicle, "nu_dot"), np.zeros(vehicle.commands)
    if nu_dot is not None:  # otherwise the velocity follows the command at once
        speeds = np.array([middles, -middles])
        nu_dots = [[nu_dot(np.array([v, 0.0, 0.0]), zero_command, 0.0)[0] for v in row] for row in speeds]
        decelerations = np.min(-np.sign(speeds) * np.array(nu_dots, dtype=float), axis=0)
        decelerations = np.maximum(decelerations, MIN_DECELERATION_M_S2)
        distances[1:] = np.cumsum(middles / decelerations) * (edges[1] - edges[0])
    drivetrain = getattr(vehicle, "drivetrain", None)
    if drivetrain is not None:  # otherwise the command acts at once
        distances += edges * (float(drivetrain.delay_s) + float(np.max(drivetrain.lag_s)))
    distances = np.maximum(distances, STOPPING_S * edges)
    return lambda v: float(np.interp(v, edges, distances)) * max(1.0, v / max_speed_m_s)


class RoomWatch(Observer):
    """Observer of a drive along a route whose first pose is `origin` (3,) in the map and `room.start` in the room.

    `stopping_m` is the function s of (3).
    """

    def __init__(self, room: Room, origin: np.ndarray, stopping_m: Callable[[float], float]) -> None:
        self._stopping_m = stopping_m
        self._free_half_width_m, self._start = room.free_half_width_m, np.asarray(room.start)
        self._origin = origin
        self._turn = map_from_body(self._start[2] - origin[2])[:2, :2]
        self._reason: Diagnostic | None = None

    @classmethod
    def for_route(cls, route: Route, room: Room, vehicle: Tree) -> "RoomWatch":
        """Return the watch of a vehicle on this route, up to twice the largest speed of the route."""
        top_speed_m_s = max(float(np.max(np.abs(route.nu[:, 0]))), MIN_SPEED_M_S)
        return cls(room, route.eta[0], stopping_distance(vehicle, 2.0 * top_speed_m_s))

    def on_record(self, record: Record) -> None:
        """Test (2), and store the reason to stop if it fails."""
        eta, nu, cov = record.estimate.eta, record.estimate.nu, record.estimate.cov
        position = self._start[:2] + self._turn @ (eta[:2] - self._origin[:2])  # (1)
        v = self._turn @ map_from_body(eta[2])[:2, :2] @ nu[:2]
        std = np.sqrt(np.maximum(np.diag(self._turn @ cov[:2, :2] @ self._turn.T), 0.0))
        region = np.sqrt(CHI_SQUARE_95) * std
        speed = float(np.hypot(*v))
        stop_m = self._stopping_m(speed) * np.abs(v) / max(speed, 1e-9)
        excess = np.abs(position) + stop_m + region - self._free_half_width_m
        if np.max(excess) > 0.0 and self._reason is None:
            i = int(np.argmax(excess))
            wall_m = float(self._free_half_width_m[i] - abs(position[i]))
            values: JsonObject = {"wall_m": wall_m, "region_m": float(region[i]), "stop_m": float(stop_m[i])}
            self._reason = stop(StopReason.ROOM, axis="xy"[i], **values)

    def stop_reason(self, t_ns: int) -> Diagnostic | None:
        """Return the reason to stop the vehicle, or None to continue."""
        return self._reason
