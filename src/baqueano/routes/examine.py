"""Check a route against its vehicle and its room before the drive.

    r_has(v): the largest steady yaw rate of the identified vehicle at the speed v                        (1)
    share = max |u| / limit of the command that the model needs for ν and ν̇ of the route                   (2)
    free = half a side of the room − radius of the body − the largest |x| or |y| of the route             (3)
    |ν_y| ≤ R |r| + |ν_x| + MIN_SIDEWAYS_M_S                                                              (4)
    σ ≤ MAX_NOISE_M, the noise of the positions (noise.py)                                                (5)

u is the command, ν the velocity. The route's acceleration is averaged over MEAN_WINDOW_S, because at a corner of a
drawn route the yaw rate jumps. A vehicle with too little acceleration is behind its reference for a moment: a warning.
A vehicle with too little speed remains behind: the route is refused. (4) is for a vehicle that no command moves
sideways: it rolls on an axle within the radius R of its body, or slips by less than 45°. The guides use poses and
velocities of a route. So along the heading, the velocity must agree with the change of the poses, within a half.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.contracts.calls import checked_call
from baqueano.contracts.result import Result
from baqueano.contracts.values import JsonObject, TableRow
from baqueano.diagnostics import Diagnostic, Severity, Verdict, fault, note
from baqueano.errors import UsageError
from baqueano.geometry import wrap
from baqueano.guides.route import Route, move_route, relative_poses
from baqueano.messages import verdict_line
from baqueano.messages.language import number, translate as _
from baqueano.messages.printable import baqueano_command, join_rows
from baqueano.routes.capability import MAX_SPEED_M_S, MAX_YAW_RATE_RAD_S, Capability
from baqueano.routes.gaps import route_gaps
from baqueano.routes.noise import position_noise
from baqueano.routes.path import NAME_PLACEHOLDER, distances_along
from baqueano.routes.room import Room, vehicle_room
from baqueano.vehicle_file import VehicleFile
from baqueano.vehicle_file.head import reach_m

MEAN_WINDOW_S = 0.3  # time over which an acceleration is averaged
MIN_SCALE = 0.1  # a smaller route is of no use: its start is too near to the wall
MIN_POSES, MAX_POSES = 600, 100_000  # number of poses of a route that are judged, if it has so many
MAX_STEP_S = 0.1  # largest time between two of them, up to MAX_POSES: a third of MIN_DEFICIT_S
MAX_SHARE = 1.05  # share of the command up to which a route passes
MIN_DEFICIT_S = 0.3  # the controller compensates a shorter lack of command
MIN_SPEED_M_S = 1e-3  # below it a curvature is not defined
# a slower or shorter motion to the side may be an error, or a correction, of the recorded estimate
MIN_SIDEWAYS_M_S, MIN_SIDEWAYS_S = 0.05, 1.0
MAX_NOISE_M = 0.002  # most controllers leave a route without noise by this distance, or less
MAX_REACH_M = 1.0  # R of a vehicle without dimensions


class Demand(NamedTuple):
    """Motion of a route at the distances `s_m` (m,), and the part of the command that it needs.

    The parts are NaN without a vehicle.
    """

    s_m: np.ndarray
    speed_m_s: np.ndarray
    yaw_rate_rad_s: np.ndarray
    steady: np.ndarray  # part of the command for the velocity
    share: np.ndarray  # part for velocity and acceleration: the least in MIN_DEFICIT_S


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RouteReport(Result):
    """Figures of a route, and the reasons against driving it.

    Attributes
    ----------
    route : Route
        The route.
    length_m, duration_s : float
        Length and duration of one lap.
    max_speed_m_s, max_yaw_rate_rad_s, lateral_m_s2 : float
        Largest speed, yaw rate, and acceleration to the side.
    min_radius_m : float [m]
        Smallest radius of a curve; 0 for a turn on the spot, infinite for a straight line.
    command_share : float
        Largest part of the command that the route needs [no unit]; NaN without a vehicle.
    clearance_m : float [m]
        Least distance between the body and a wall; NaN without a room.
    findings : tuple of Diagnostic
        Codes, figures and commands to type.
    capability : Capability, optional
        Limits of the vehicle, for the figure; None without a vehicle, or if samples are missing.
    room : Room, optional
        The room, for the figure.

    Examples
    --------
    >>> from baqueano.routes import examine
    >>> report = examine(bq.guides.shapes.circle(0.3, 2.0), bq.load("small"))
    >>> print(report.verdict, [one.code for one in report.findings])
    REFUSED ['route.speed-too-high']
    """

    route: Route
    length_m: float
    duration_s: float
    max_speed_m_s: float
    max_yaw_rate_rad_s: float
    lateral_m_s2: float
    min_radius_m: float
    command_share: float
    clearance_m: float
    findings: tuple[Diagnostic, ...]
    capability: Capability | None = None
    room: Room | None = None

    @property
    def placed_route(self) -> Route:
        """Return the route, moved to the start in the room; without a room it stays at its place in the map."""
        return self.route if self.room is None else _place_route(self.route, self.room)

    @property
    def verdict(self) -> Verdict:
        """Return USABLE, or REFUSED if a finding is an error."""
        has_error = any(finding.severity == Severity.ERROR for finding in self.findings)
        return Verdict.REFUSED if has_error else Verdict.USABLE

    def rows(self) -> list[TableRow]:
        """Return one flat dict with all figures."""
        names = (
            "length_m",
            "duration_s",
            "max_speed_m_s",
            "max_yaw_rate_rad_s",
            "lateral_m_s2",
            "min_radius_m",
            "command_share",
        )
        figures = {name: getattr(self, name) for name in (*names, "clearance_m")}
        return [{"poses": len(self.route.t_s), "closed": self.route.closed, **figures}]

    def table(self) -> str:
        """Return a text with the figures and the findings."""
        lines = [
            _("length {m:.2f} m, {s:.1f} s a lap", m=self.length_m, s=self.duration_s) if self.route.closed
            else _("length {m:.2f} m, {s:.1f} s", m=self.length_m, s=self.duration_s),
            _("speed up to {v:.2f} m/s, yaw rate up to {r:.2f} rad/s", v=self.max_speed_m_s, r=self.max_yaw_rate_rad_s),
        ]  # fmt: skip
        if np.isfinite(self.min_radius_m):
            lines.append(
                _(
                    "tightest curve {m:.2f} m, up to {a:.2f} m/s² to the side",
                    m=self.min_radius_m,
                    a=self.lateral_m_s2,
                )
            )
        if np.isfinite(self.command_share):
            lines.append(
                _("needs up to {share} of the command", share=number(f"{100.0 * self.command_share:.0f} %"))
            )
        if self.clearance_m >= 0.0:  # beyond a wall, a finding states the place
            lines.append(_("stays {m:.2f} m from the walls", m=self.clearance_m))
        return join_rows([*lines, verdict_line(self.verdict, self.findings)])

    def demand(self) -> Demand:
        """Return the motion along the route, and the part of the command that it needs."""
        return _demand(self.route, distances_along(self.route.eta[:, :2]), self.capability)

    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the largest steady speed (m,) [m/s] and yaw rate (m,) [rad/s] at the distances of `demand`.

        NaN without a vehicle, without a limit, and for the speed of a turn on the spot.
        """
        motion = self.demand()
        unknown = np.full(len(motion.s_m), np.nan)
        if self.capability is None:
            return unknown, unknown
        moves = motion.speed_m_s > MIN_SPEED_M_S
        curvature = motion.yaw_rate_rad_s / np.where(moves, motion.speed_m_s, 1.0)
        speed = self.capability.fastest_speed(curvature, np.full(len(moves), MAX_SPEED_M_S))
        turn = self.capability.fastest_turn(motion.speed_m_s)
        return (
            np.where(moves & (speed < MAX_SPEED_M_S), speed, np.nan),
            np.where(turn < MAX_YAW_RATE_RAD_S, turn, np.nan),
        )


@checked_call('bq.routes.examine(route, robot, "2x3")')
def examine(
    route: Route,
    vehicle_file: VehicleFile | None = None,
    room: Room | str | None = None,
    *,
    backend: str = "auto",
) -> RouteReport:
    """Check a route: its figures alone, for an identified vehicle, and in a room.

    Parameters
    ----------
    route : Route
        The route.
    vehicle_file : VehicleFile, optional
        The vehicle that will drive it.
    room : str or Room, optional
        Width and height, such as "2x2.5" [m], or the result of `vehicle_room`; the route begins at its start.
    backend : str
        "auto", "c", "python", or "numpy".

    Returns
    -------
    RouteReport
        REFUSED if a number is not finite, a pose jumps or samples are missing. Also REFUSED if the vehicle is too slow,
        or hits a wall.

    Raises
    ------
    UsageError
        For a route with fewer than two poses, or an invalid room.

    Notes
    -----
    Equations (1)-(3) of the module.

    Examples
    --------
    >>> print(examine(bq.guides.shapes.eight(0.6, 0.2), bq.load("small")).verdict)
    USABLE
    """
    if len(route.t_s) < 2:
        shapes = {name: str(np.shape(getattr(route, name))) for name in ("t_s", "eta", "nu")}
        raise UsageError.of("route.shapes", **shapes)
    walls = None if room is None else vehicle_room(vehicle_file, room)
    s = distances_along(route.eta[:, :2])
    speed, turn = np.abs(route.nu[:, 0]), np.abs(route.nu[:, 2])
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.where(turn > 1e-9, speed / turn, np.inf)
    findings, share, capability = route_gaps(route, s), float("nan"), None
    if vehicle_file is not None and not findings:
        capability = Capability(vehicle_file, backend)
        share, findings = _share_findings(route, s, capability)
        if not capability.moves_sideways:
            reach = reach_m(vehicle_file.geometry) or MAX_REACH_M
            findings = [*_motion_findings(route, s, reach), *findings]
    findings = [*findings, *_noise_findings(route)]
    clearance_m = float("nan")
    if walls is not None and np.isfinite(s[-1]):
        xy = _place_route(route, walls).eta[:, :2]
        distances = np.min(walls.free_half_width_m - np.abs(xy), axis=1)
        clearance_m, index = float(np.min(distances)), int(np.argmin(distances))
        if clearance_m < 0.0:
            findings = [
                *findings,
                fault(
                    "route.through-wall",
                    baqueano_command("route", "scale", NAME_PLACEHOLDER, f"{_room_scale(xy, walls):.2f}"),
                    position_m=float(s[index]),
                    excess_m=-clearance_m,
                ),
            ]
    return RouteReport(
        route, float(s[-1]), float(route.t_s[-1]), float(np.max(speed)), float(np.max(turn)),
        float(np.max(speed * turn)), float(np.min(radius)), share, clearance_m, tuple(findings), capability,
        walls,
    )  # fmt: skip


def _room_scale(xy: np.ndarray, room: Room) -> float:
    """Return the largest factor of hundredths, at least MIN_SCALE, with which the path (m, 2) stays in the room."""
    offset = xy - xy[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        factors = (room.free_half_width_m - np.sign(offset) * xy[0]) / np.abs(offset)
    return max(float(np.floor(100.0 * np.nanmin(factors) - 1e-6)) / 100.0, MIN_SCALE)


def _place_route(route: Route, room: Room) -> Route:
    return move_route(route._replace(eta=relative_poses(route.eta)), np.array(room.start))


def _share_findings(route: Route, s: np.ndarray, capability: Capability) -> tuple[float, list[Diagnostic]]:
    """Return the largest share of the command, and a finding if the vehicle cannot follow the route.  (1), (2)"""
    place_m, v, r, steady_share, lasting_share = _demand(route, s, capability)
    t_s = _times(route)
    share, advice = float(np.max(lasting_share)), baqueano_command("route", "faster", NAME_PLACEHOLDER)
    is_too_fast = bool(np.any(_sliding_minimum(steady_share, t_s) > MAX_SHARE))
    if not is_too_fast and share <= MAX_SHARE:
        return share, []
    k = int(np.argmax(steady_share if is_too_fast else lasting_share))
    figures: JsonObject = {"position_m": float(place_m[k]), "share": share}
    if not is_too_fast:
        return share, [note("route.accelerates-too-fast", Severity.WARNING, advice, **figures)]
    max_speed = float(capability.fastest_speed(np.zeros(1), np.full(1, MAX_SPEED_M_S))[0])
    if abs(v[k]) > max_speed:
        limits: JsonObject = {"demand_m_s": float(abs(v[k])), "max_m_s": max_speed}
        return share, [fault("route.speed-too-high", advice, **limits, **figures)]
    kappa = abs(r[k] / v[k]) if abs(v[k]) > MIN_SPEED_M_S else 0.0
    max_kappa = float(capability.largest_curvature(np.full(1, kappa))[0])
    if max_kappa > 0.0 and MAX_SHARE * max_kappa < kappa:  # else it cannot turn
        advice = baqueano_command("route", "smooth", NAME_PLACEHOLDER, "--max", "0.1")
        limits = {"radius_m": 1.0 / kappa, "min_radius_m": 1.0 / max_kappa}
        return share, [fault("route.curve-too-tight", advice, **limits, **figures)]
    max_turn = float(capability.fastest_turn(v[k : k + 1])[0])
    limits = {"demand_rad_s": float(abs(r[k])), "max_rad_s": max_turn, "speed_m_s": float(v[k])}
    return share, [fault("route.turns-too-fast", advice, **limits, **figures)]


def _noise_findings(route: Route) -> list[Diagnostic]:
    """Return a list with a finding if the positions are noisy, and with the tolerance that removes the noise.  (5)"""
    noise_m = position_noise(route)
    if noise_m <= MAX_NOISE_M:
        return []
    rms_mm = np.ceil(1e3 * np.sqrt(2.0) * noise_m)  # the distance contains x and y
    advice = baqueano_command("route", "smooth", NAME_PLACEHOLDER, "--rms", str(float(rms_mm / 1e3)))
    return [note("route.noisy", Severity.WARNING, advice, noise_mm=1e3 * noise_m)]


def _motion_findings(route: Route, s: np.ndarray, reach: float) -> list[Diagnostic]:
    """Return a list with a finding if the route moves sideways, or else than its velocities; `reach` is R [m].  (4)"""
    t_s, dt_s, middle_s = _times(route), np.diff(route.t_s), 0.5 * (route.t_s[1:] + route.t_s[:-1])
    step, turn = np.diff(route.eta[:, :2], axis=0), wrap(np.diff(route.eta[:, 2]))
    psi = route.eta[:-1, 2] + 0.5 * turn
    forward_m, lateral_m = np.cos(psi) * step.T + np.sin(psi) * np.array([step[:, 1], -step[:, 0]])
    nu_x, nu_y, r = (
        _moving_mean(t_s, np.interp(t_s, middle_s, change / dt_s)) for change in (forward_m, lateral_m, turn)
    )
    sideways = np.abs(nu_y) - reach * np.abs(r) - np.abs(nu_x)
    file, name = f"routes/{NAME_PLACEHOLDER}.csv", f"{NAME_PLACEHOLDER}-turned"
    v = _moving_mean(t_s, np.interp(t_s, route.t_s, route.nu[:, 0]))
    speed_excess = np.abs(nu_x - v) - 0.5 * np.maximum(np.abs(nu_x), np.abs(v))
    usual_speed = str(round(max(float(np.median(np.abs(nu_x))), MIN_SIDEWAYS_M_S), 2))
    for code, excess, speed, advice in (
        ("route.sideways", sideways, nu_y, ("import", file, name)),
        ("route.otherwise", speed_excess, nu_x, ("faster", NAME_PLACEHOLDER, "--speed", usual_speed)),
    ):
        min_excess = _sliding_minimum(excess, t_s, MIN_SIDEWAYS_S)
        k = int(np.argmax(min_excess))
        if min_excess[k] > MIN_SIDEWAYS_M_S:
            place_m, fix = float(np.interp(t_s[k], route.t_s, s)), baqueano_command("route", *advice)
            return [fault(code, fix, position_m=place_m, speed_m_s=float(speed[k]), velocity_m_s=float(v[k]))]
    return []


def _demand(route: Route, s: np.ndarray, capability: Capability | None) -> Demand:
    """Return motion and share of the command at the distances s (n,) of the route, at most MAX_POSES.  (2)"""
    t_s = _times(route)
    v, r = (_moving_mean(t_s, np.interp(t_s, route.t_s, route.nu[:, k])) for k in (0, 2))
    steady_share = lasting_share = np.full(len(t_s), np.nan)
    if capability is not None:
        steady_share = capability.share(v, r)
        lasting_share = _sliding_minimum(
            capability.share(v, r, np.gradient(v, t_s), np.gradient(r, t_s)), t_s
        )
    return Demand(np.interp(t_s, route.t_s, s), v, r, steady_share, lasting_share)


def _times(route: Route) -> np.ndarray:
    duration_s = max(1e-9, float(route.t_s[-1]))  # above 0, because _demand divides by its steps
    count = max(2, min(MIN_POSES, len(route.t_s)), int(min(MAX_POSES - 1.0, duration_s / MAX_STEP_S)) + 1)
    return np.linspace(0.0, duration_s, count)


def _moving_mean(t_s: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the moving mean (m,) of x (m,) over MEAN_WINDOW_S."""
    n = _span_count(MEAN_WINDOW_S, t_s)
    return np.convolve(np.pad(x, (n // 2, n - 1 - n // 2), mode="edge"), np.ones(n) / n, mode="valid")


def _sliding_minimum(x: np.ndarray, t_s: np.ndarray, span_s: float = MIN_DEFICIT_S) -> np.ndarray:
    """Return the least x (m,) in the `span_s` after each time: the value that lasts at least `span_s`."""
    n = _span_count(span_s, t_s)
    padded_x = np.pad(x, (0, n - 1), mode="edge")
    return np.min(np.lib.stride_tricks.sliding_window_view(padded_x, n), axis=1)


def _span_count(span_s: float, t_s: np.ndarray) -> int:
    """Return the number of the equidistant times (m,) in a span, from 1 to m."""
    return max(1, round(min(span_s / (t_s[1] - t_s[0]), len(t_s))))
