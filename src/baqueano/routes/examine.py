"""Check a route against its vehicle and its room before the drive.

    r_has(v): the largest steady yaw rate of the identified vehicle at the speed v                        (1)
    share = max |u| / limit of the command that the model needs for ν and ν̇ of the route                   (2)
    free = half a side of the room − radius of the body − the largest |x| or |y| of the route             (3)

u is the command, ν the velocity. The route's acceleration is averaged over MEAN_WINDOW_S, because the yaw rate jumps at
a corner of a drawn route. A vehicle with too little acceleration is behind its reference for a moment: a warning. A
vehicle with too little speed remains behind, and the verdict on the route is REFUSED.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from baqueano.contracts.result import Result
from baqueano.diagnostics import Diagnostic, Severity, Verdict, fault, note
from baqueano.guides.route import Route, from_start, move_route
from baqueano.messages import verdict_line
from baqueano.messages.language import number
from baqueano.messages.language import translate as _
from baqueano.messages.printable import baqueano_command, in_lines
from baqueano.routes.capability import MAX_SPEED_M_S, Capability
from baqueano.routes.gaps import route_gaps
from baqueano.routes.path import NAME_PLACEHOLDER, distances_along

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject, TableRow
    from baqueano.vehicle_file import VehicleFile

MEAN_WINDOW_S = 0.3  # time over which an acceleration is averaged
MAX_POSES = 600  # largest number of poses of a route that are evaluated
MAX_SHARE = 1.05  # share of the command up to which a route passes
MIN_LACK_S = 0.3  # the controller compensates a shorter lack of command


class Walls(Protocol):
    """Protocol of a room: the free space around its middle, and the pose at which a route starts."""

    @property
    def free_half_width_m(self) -> np.ndarray:
        """Return the largest distance (2,) [m] of the body's origin from the middle of the room, along x and y."""
        ...

    @property
    def start(self) -> tuple[float, float, float]:
        """Return the pose at the start of the route, relative to the middle of the room: x, y [m], ψ [rad]."""
        ...


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RouteReport(Result):
    """Length, speeds and demands of a route, and the reasons against driving it.

    Attributes
    ----------
    route : Route
        The route.
    length_m, duration_s : float
        Length and duration of one lap.
    fastest_m_s, fastest_rad_s, sideways_m_s2 : float
        Largest speed, yaw rate, and acceleration to the side.
    radius_m : float [m]
        Smallest radius of a curve; 0 for a turn on the spot.
    share : float
        Largest part of the command that the route needs; NaN without a vehicle.
    free_m : float [m]
        Least distance between the body and a wall; NaN without a room.
    findings : tuple of Diagnostic
        Codes, values and commands to type.

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
    fastest_m_s: float
    fastest_rad_s: float
    sideways_m_s2: float
    radius_m: float
    share: float
    free_m: float
    findings: tuple[Diagnostic, ...]

    @property
    def verdict(self) -> Verdict:
        """Return USABLE, or REFUSED if a finding is an error."""
        has_error = any(finding.severity == Severity.ERROR for finding in self.findings)
        return Verdict.REFUSED if has_error else Verdict.USABLE

    def rows(self) -> list["TableRow"]:
        """Return a list with one flat dict of all values."""
        names = (
            "length_m",
            "duration_s",
            "fastest_m_s",
            "fastest_rad_s",
            "sideways_m_s2",
            "radius_m",
            "share",
        )
        figures = {name: getattr(self, name) for name in (*names, "free_m")}
        return [{"poses": len(self.route.t_s), "closed": self.route.closed, **figures}]

    def table(self) -> str:
        """Return a text with the values and the findings."""
        lines = [
            _("length {m:.2f} m, {s:.1f} s a lap", m=self.length_m, s=self.duration_s) if self.route.closed
            else _("length {m:.2f} m, {s:.1f} s", m=self.length_m, s=self.duration_s),
            _("speed up to {v:.2f} m/s, yaw rate up to {r:.2f} rad/s", v=self.fastest_m_s, r=self.fastest_rad_s),
            _("tightest curve {m:.2f} m, up to {a:.2f} m/s² to the side", m=self.radius_m, a=self.sideways_m_s2),
        ]  # fmt: skip
        if np.isfinite(self.share):
            lines.append(_("needs up to {share} of the command", share=number(f"{100.0 * self.share:.0f} %")))
        if np.isfinite(self.free_m):
            lines.append(_("stays {m:.2f} m from the walls", m=self.free_m))
        return in_lines([*lines, verdict_line(self.verdict, self.findings)])


def examine(
    route: Route,
    vehicle_file: "VehicleFile | None" = None,
    room: Walls | None = None,
    *,
    backend: str = "auto",
) -> RouteReport:
    """Check a route: its geometry and speeds, its demands on an identified vehicle, and its distance to walls.

    Parameters
    ----------
    route : Route
        The route.
    vehicle_file : VehicleFile, optional
        The vehicle that will drive the route.
    room : Room, optional
        Walls, as `identify.design.room.room_of` returns them; the route begins at the start of the room.
    backend : str
        "auto", "c", "python", or "numpy".

    Returns
    -------
    RouteReport
        REFUSED if a value is not finite, a pose jumps or samples are missing. Also REFUSED if the vehicle is too slow,
        or hits a wall.

    Notes
    -----
    Equations (1)-(3) of the module.

    Examples
    --------
    >>> print(examine(bq.guides.shapes.eight(0.6, 0.2), bq.load("small")).verdict)
    USABLE
    """
    s = distances_along(route.eta[:, :2])
    speed, turn = np.abs(route.nu[:, 0]), np.abs(route.nu[:, 2])
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.where(turn > 1e-9, speed / turn, np.inf)
    findings, share = route_gaps(route, s), float("nan")
    if vehicle_file is not None and not findings:
        share, share_findings = _share_findings(route, s, Capability(vehicle_file, backend))
        findings = share_findings
    free_m = float("nan")
    if room is not None and np.isfinite(s[-1]):
        xy = move_route(route._replace(eta=from_start(route.eta)), np.array(room.start)).eta[:, :2]
        distances = np.min(room.free_half_width_m - np.abs(xy), axis=1)
        free_m, index = float(np.min(distances)), int(np.argmin(distances))
        if free_m < 0.0:
            findings = [
                *findings,
                fault(
                    "route.through-wall",
                    baqueano_command("route", "scale", NAME_PLACEHOLDER, "0.8"),
                    at_m=float(s[index]),
                    beyond_m=-free_m,
                ),
            ]
    return RouteReport(
        route, float(s[-1]), float(route.t_s[-1]), float(np.max(speed)), float(np.max(turn)),
        float(np.max(speed * turn)), float(np.min(radius)), share, free_m, tuple(findings),
    )  # fmt: skip


def _share_findings(route: Route, s: np.ndarray, capability: Capability) -> tuple[float, list[Diagnostic]]:
    """Return the largest share of the command, and a list with a finding if the vehicle cannot follow.  (1), (2)"""
    t_s = np.linspace(0.0, route.t_s[-1], min(MAX_POSES, max(len(route.t_s), 2)))
    v, r = (_moving_mean(t_s, np.interp(t_s, route.t_s, route.nu[:, k])) for k in (0, 2))
    steady_share = capability.share(v, r)
    lasting_share = _least_over(capability.share(v, r, np.gradient(v, t_s), np.gradient(r, t_s)), t_s)
    share, advice = float(np.max(lasting_share)), baqueano_command("route", "faster", NAME_PLACEHOLDER)
    is_too_fast = bool(np.any(_least_over(steady_share, t_s) > MAX_SHARE))
    if not is_too_fast and share <= MAX_SHARE:
        return share, []
    k = int(np.argmax(steady_share if is_too_fast else lasting_share))
    figures: JsonObject = {"at_m": float(np.interp(t_s[k], route.t_s, s)), "share": share}
    if not is_too_fast:
        return share, [note("route.accelerates-too-fast", Severity.WARNING, advice, **figures)]
    max_speed = float(capability.fastest_speed(np.zeros(1), np.full(1, MAX_SPEED_M_S))[0])
    if abs(v[k]) > max_speed:
        limits: JsonObject = {"needs_m_s": float(abs(v[k])), "has_m_s": max_speed}
        return share, [fault("route.speed-too-high", advice, **limits, **figures)]
    max_turn = float(capability.fastest_turn(v[k : k + 1])[0])
    limits = {"needs_rad_s": float(abs(r[k])), "has_rad_s": max_turn, "speed_m_s": float(v[k])}
    return share, [fault("route.turns-too-fast", advice, **limits, **figures)]


def _moving_mean(t_s: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the moving mean (m,) of x (m,) over MEAN_WINDOW_S; the times `t_s` (m,) are evenly spaced."""
    n = max(1, round(MEAN_WINDOW_S / max(t_s[1] - t_s[0], 1e-9)))
    return np.convolve(np.pad(x, (n // 2, n - 1 - n // 2), mode="edge"), np.ones(n) / n, mode="valid")


def _least_over(share: np.ndarray, t_s: np.ndarray) -> np.ndarray:
    """Return the least share (m,) in the MIN_LACK_S after each time: the share that is required for this long."""
    n = max(1, round(MIN_LACK_S / max(t_s[1] - t_s[0], 1e-9)))
    padded_share = np.pad(share, (0, n - 1), mode="edge")
    return np.min(np.lib.stride_tricks.sliding_window_view(padded_share, n), axis=1)
