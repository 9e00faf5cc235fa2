"""Take precautions for a repetition: checks, a path to its route, and the observers that slow and stop it."""

from dataclasses import asdict, dataclass, fields
from inspect import signature

import numpy as np

from baqueano.contracts.blocks import Estimator, Guide
from baqueano.contracts.values import JsonObject
from baqueano.controllers.following.response import SMOOTHING_S
from baqueano.drive.observers import Observer
from baqueano.drive.safety.caution import Caution
from baqueano.drive.safety.final_pose import FinalPose
from baqueano.drive.safety.patience import Patience, TimeLimit
from baqueano.drive.safety.room_watch import RoomWatch
from baqueano.errors import UsageError
from baqueano.geometry import wrap
from baqueano.guides import DriveTo, GuideSequence
from baqueano.guides.drive_to import MAX_GOAL_ANGLE_RAD, MAX_GOAL_DISTANCE_M
from baqueano.guides.route import Route
from baqueano.routes.capability import Capability
from baqueano.routes.room import Room, vehicle_room
from baqueano.symbolic import TraceError
from baqueano.vehicle_file import VehicleFile

MIN_SPEED_M_S = 0.01  # a slower sample is treated as rest
MIN_RADIUS_M, MAX_RADIUS_M = 0.15, 20.0  # limits of the radius of a path to the route
RADIUS_MARGIN = 1.3  # margin of the radius, for the controller
MAX_RAMP_S = 2.0
MIN_RAMP_S = 3.0 * SMOOTHING_S  # the controllers follow a ramp of their reference with this lag
PATIENCE_S = 20.0
TIMES = ("patience_s", "time_limit_s")


@dataclass(frozen=True, slots=True)
class Precautions:
    """Options of `repeat` for the safety of the vehicle.

    `check`: examine the route before the vehicle moves. `force`: drive even a route that is too fast or has gaps.
    `room`: stop before the vehicle might leave this room. `lead_in`: if the vehicle is not at the start of its route,
    drive there first. `way_back`: drive back to the start afterwards. `caution`: slow down and stop if the estimate is
    doubtful. `patience_s`: end the drive of a vehicle that is stuck for this time. `time_limit_s`: end a drive that
    takes longer; None: `TimeLimit.for_duration` its planned time.
    """

    check: bool = True
    force: bool = False
    room: Room | None = None
    lead_in: bool = True
    way_back: bool = False
    caution: bool = True
    patience_s: float = PATIENCE_S
    time_limit_s: float | None = None

    @classmethod
    def split_options(
        cls, options: JsonObject, vehicle_file: VehicleFile
    ) -> "tuple[Precautions, JsonObject]":
        """Split `options` into precautions and other options, and return both. Raise UsageError for an invalid room.

        A room as text, such as "2x2.5", becomes the room of the vehicle.
        """
        if options.get("room") is not None:
            options = options | {"room": vehicle_room(vehicle_file, options["room"])}
        field_names = {field.name for field in fields(cls)}
        own_options = {name: value for name, value in options.items() if name in field_names}
        return cls(**own_options), {name: value for name, value in options.items() if name not in field_names}

    def to_json(self) -> JsonObject:
        """Return the values that differ from the defaults, as data for JSON."""
        defaults = Precautions()
        row = {f.name: getattr(self, f.name) for f in fields(self)}
        row = {name: value for name, value in row.items() if value != getattr(defaults, name)}
        row = {name: None if value == float("inf") else value for name, value in row.items()}  # not in JSON
        if self.room is not None:
            half_widths = tuple(float(x) for x in self.room.free_half_width_m)
            row["room"] = {"free": list(half_widths), "start": list(self.room.start)}
        return row

    @classmethod
    def from_json(cls, document: JsonObject) -> "Precautions":
        """Return the precautions in this JSON, the inverse of `to_json`. Raise UsageError for other data."""
        try:
            defaults, row = asdict(cls()), dict(document)
            room = row.pop("room", None)
            if room is not None:
                half_widths, start_pose = (tuple(map(float, room[name])) for name in ("free", "start"))
                start = (start_pose[0], start_pose[1], start_pose[2])
                room = Room(2.0 * half_widths[0], 2.0 * half_widths[1], start=start)
            row |= {name: float("inf") for name in TIMES if name in row and row[name] is None}
            for name, value in row.items():
                is_valid = isinstance(value, int | float) if name in TIMES else isinstance(value, bool)
                if name not in defaults or not is_valid:
                    raise ValueError(f"{name} = {value!r:.80}")
            return cls(room=room, **row)
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise UsageError.of("mission.damaged", kind=type(error).__name__, error=error) from error

    def wrap_guide(
        self, guide: Guide, route: Route, vehicle_file: VehicleFile, start: np.ndarray, estimator: Estimator,
    ) -> Guide:  # fmt: skip
        """Return the guide with a path to the start of the route (`lead_in`) and a path back to it (`way_back`).

        The path to the start is added only if the vehicle is not there. An estimator without a start pose begins at the
        pose that its sensors measure; with such an estimator the path is always added.
        """
        offset = start[:3] - route.eta[0]
        is_away = (
            np.hypot(offset[0], offset[1]) > MAX_GOAL_DISTANCE_M or abs(wrap(offset[2])) > MAX_GOAL_ANGLE_RAD
        )
        has_lead_in = self.lead_in and (is_away or not signature(estimator.init).parameters)
        if not (has_lead_in or self.way_back):
            return guide
        limits = approach_limits(route, vehicle_file)
        if has_lead_in:
            guide = GuideSequence.with_lead_in(guide, route, **limits)
        return GuideSequence.with_way_back(guide, route, **limits) if self.way_back else guide

    def observers(self, vehicle_file: VehicleFile, route: Route, planned_s: float) -> tuple[Observer, ...]:
        """Return the observers that slow down and stop the drive of `planned_s`, and examine its end."""
        max_std_m = getattr(vehicle_file.supervisor(), "max_position_std_m", float("inf"))
        lead_in = DriveTo.to_route(route, **approach_limits(route, vehicle_file)) if self.lead_in else None
        watch: list[Observer] = [Caution(max_std_m, self.caution, lead_in), FinalPose()]
        limit_s = self.time_limit_s
        watch.append(TimeLimit.for_duration(planned_s) if limit_s is None else TimeLimit(limit_s))
        if np.isfinite(self.patience_s):
            watch.append(Patience(self.patience_s))
        if self.room is not None:
            watch.append(RoomWatch.for_route(route, self.room, vehicle_file.vehicle))
        return tuple(watch)


def approach_limits(route: Route, vehicle_file: VehicleFile) -> dict[str, float]:
    """Return the median speed of a route [m/s], a turning radius [m], and the length [m] on which such a turn begins.

    The radius and the length are for this speed, with a margin.
    """
    speed = np.abs(route.nu[:, 0])
    moving_speeds = speed[speed > MIN_SPEED_M_S]
    v = float(np.median(moving_speeds)) if moving_speeds.size else 0.2
    radius_m, ramp_s = 2.0 * MIN_RADIUS_M, MIN_RAMP_S
    try:
        capability, speeds = Capability(vehicle_file), np.array([v])
        turn = float(capability.fastest_turn(speeds)[0])
        if turn > 0.0:
            radius_m = float(np.clip(RADIUS_MARGIN * v / turn, MIN_RADIUS_M, MAX_RADIUS_M))
        ramp_s = float(np.clip(_ramp_s(capability, v, v / radius_m), MIN_RAMP_S, MAX_RAMP_S))
    except TraceError:  # a user's vehicle that cannot be compiled
        pass
    return {"speed_m_s": v, "radius_m": radius_m, "ramp_m": v * ramp_s}


def _ramp_s(capability: Capability, v: float, r: float) -> float:
    """Return the time [s] in which the yaw rate at the speed `v` rises from 0 to `r` with full command.

    ṙ decreases exponentially from its first to its last value, as with the lag of a servo, of tyres or of a motor.
    """
    first, last = map(float, capability.fastest_turn_change(np.array([v, v]), np.array([0.0, r])))
    if last <= 0.0:
        return MAX_RAMP_S
    ratio = first / last
    return r / last * (np.log(ratio) / (ratio - 1.0) if abs(ratio - 1.0) > 1e-6 else 1.0)
