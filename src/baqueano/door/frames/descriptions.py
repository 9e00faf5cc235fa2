"""Describe the vehicle, its route and its mission in messages of the door."""

import math
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING

import numpy as np

from baqueano.blocks import resolve
from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic
from baqueano.door.states import DoorState
from baqueano.drive.health import degraded_note
from baqueano.errors import BaqueanoError
from baqueano.geometry import map_from_body
from baqueano.guides.route import Route
from baqueano.loop import Record
from baqueano.signals import seconds
from baqueano.vehicle_file.file import VehicleFile

if TYPE_CHECKING:
    from baqueano.drive.mission import Mission

ROLES = ("estimator", "guide", "controller")


def vehicle_description(
    vehicle_file: VehicleFile, world: str, seed: int | None = None, blocks: dict[str, str] | None = None
) -> JsonObject:
    """Return the description of a vehicle that a page needs before the first frame.

    `world` is "simulated" or "real". `blocks` maps the roles to the kinds that replace the file's blocks in a mission.
    """
    block_kinds = blocks or {}
    kinds = {
        role: resolve(role, block_kinds[role], vehicle_file.folder)
        if role in block_kinds
        else vehicle_file.kind(role)
        for role in ROLES
    }
    command, shape = vehicle_file.command, vehicle_file.geometry
    round_m = None if shape.radius_m is None else 2.0 * shape.radius_m
    names, limits = command.names, command.limit.tolist()
    return {
        "name": vehicle_file.name, "world": world, "rate_hz": vehicle_file.rate_hz, "seed": seed,
        "footprint": {
            "kind": "car" if round_m is None else "round",
            "length_m": round_m or shape.length_m, "width_m": round_m or shape.width_m,
        },
        "command": [
            {"name": n, "low": -limit, "high": limit, "unit": command.unit}
            for n, limit in zip(names, limits, strict=True)
        ],
        "blocks": {"model": type(vehicle_file.vehicle).__name__} | {role: k.__name__ for role, k in kinds.items()},
        "sensors": [
            {
                "name": name, "kind": str(vehicle_file.data.get("sensors", {}).get(name, {}).get("kind", name)),
                "channels": int(sensor.size), "rate_hz": float(sensor.rate_hz),
            }
            for name, sensor in vehicle_file.sensors._asdict().items()
        ],
        "gains": scalar_gains(vehicle_file, block_kinds.get("controller")),
    }  # fmt: skip


def scalar_gains(vehicle_file: VehicleFile, kind: str | None = None) -> dict[str, float]:
    """Return path → value of the scalar gains, such as "controller.k_x"; {} if the controller cannot be built."""
    try:
        controller = vehicle_file.controller(kind)
    except BaqueanoError:
        return {}
    values = {name: np.asarray(getattr(controller, name)) for name in adjustable_names(controller)}
    return {
        f"controller.{name}": float(value)
        for name, value in values.items()
        if value.ndim == 0 and math.isfinite(float(value))
    }


def adjustable_names(block: object) -> list[str]:
    """Return the names of the numeric parameters of a block, except `rate_hz`, which belongs to the vehicle."""
    names = [field.name for field in fields(block)] if is_dataclass(block) else []
    return [n for n in names if n != "rate_hz" and np.asarray(getattr(block, n)).dtype.kind in "fi"]


def route_description(
    route: Route | None, name: str = "", laps: int = 1, room: JsonObject | None = None
) -> JsonObject:
    """Return the message of a drive's route; its lists of points are empty if `route` is None.

    `room` comes from the precautions: the message contains the closed line that the vehicle's centre does not cross.
    """
    if route is None:
        return {"type": "route", "x": [], "y": []}
    x, y = route.eta[:, 0], route.eta[:, 1]
    limit = {} if room is None else {"room": _limit(room["free"], room["start"], route.eta[0])}
    return {
        "type": "route", "name": name, "closed": bool(route.closed), "laps": laps, "seconds": float(route.t_s[-1]),
        "length_m": float(np.sum(np.hypot(np.diff(x), np.diff(y)))),
        "x": np.round(x, 4).tolist(), "y": np.round(y, 4).tolist(), **limit,
    }  # fmt: skip


def _limit(free_m: Sequence[float], start: Sequence[float], origin: np.ndarray) -> JsonObject:
    """Return the corners of the area ± `free_m` in the map, as a closed line: `start` in the room is at `origin`."""
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) * np.asarray(free_m)
    points = origin[:2] + (corners - start[:2]) @ map_from_body(float(origin[2] - start[2]))[:2, :2].T
    return {"x": points[:, 0].tolist(), "y": points[:, 1].tolist()}


def state_description(
    world: str, state: DoorState, reason: Diagnostic | None, run: str | None, mission: "Mission | None",
    record: Record | None,
) -> JsonObject:  # fmt: skip
    """Return the state message: the state and its reason, the run, the mission and its last tick; None if unknown.

    The mission is one of `with_durations`. The figures of the hardware are those of a simulation.
    """
    t_s = 0.0 if record is None else float(seconds(record.tick.t_ns))
    return {
        "type": "state", "state": str(state), "reason": reason, "run": run, "world": world,
        "battery_v": None, "tilt_rad": None, "temperature_c": None, "uno_trip_ms": None, "lost_telemetry": 0,
        "resets": 0, **_mission_description(mission, t_s), **_motion_description(record),
    }  # fmt: skip


def _mission_description(mission: "Mission | None", t_s: float) -> JsonObject:
    if mission is None:
        return {"mission": None, "laps": None, "t_s": None, "left_s": None}
    whole_s, rest_s = mission.duration_s, mission.rest_s or 0.0
    remaining_s = None if whole_s is None else round(max(0.0, whole_s - t_s), 2)
    laps = mission.laps if mission.kind == "repeat" else None
    rest = {"rest_s": rest_s} if t_s < rest_s else {}
    return {"mission": mission.kind, "laps": laps, "t_s": round(t_s, 3), "left_s": remaining_s, **rest}


def _motion_description(record: Record | None) -> JsonObject:
    """Return command, request, speed, yaw rate and degraded sensors of a tick, {} without a tick."""
    if record is None:
        return {}
    nu = record.estimate.nu.tolist()
    return {
        "u": record.tick.u.tolist(), "requested": record.requested_command.u.tolist(), "speed_m_s": nu[0],
        "yaw_rate_rad_s": nu[2], "degraded": degraded_note(record.sensor_findings),
    }  # fmt: skip
