"""Sensors that measure the position of a vehicle on its lap: none, two tags, three lines, or a pose gate.

    tags    at 1/4 and 3/4 of a lap from the start: x and y of each passage
    lines   perpendicular to the path at three places: distance beyond the line
    gate    at 1/4 of a lap from the start: x, y and heading, by a camera over a marker

Three lines with normals nᵢ at places pᵢ relative to the middle of the route determine the pose by

    H = [nᵢᵀ, pᵢ × nᵢ],   at these places its smallest singular value is at least 0.7 on each route        (1)

A mistaken gate can be anywhere on the route. The filter is not informed of the places of mistaken gates.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import tomlkit

from baqueano.guides.route import Route
from baqueano.messages.language import mark as N_
from baqueano.study.truth import FloorLines, Gate, PassingFaults, Reader, TagReaders
from baqueano.vehicle_file import VehicleFile, parse

TWO_FRACTIONS, THREE_FRACTIONS, ONE_FRACTION = (0.25, 0.75), (0.2, 0.4, 0.7), (0.25,)  # of a lap
RADIUS_M, NOISE_M, NOISE_RAD = 0.15, 0.01, 0.02
MISTAKEN_POSE_COUNT = 40  # places of mistaken gates on the route

MakeReader = Callable[[Route, Sequence[int], np.ndarray, PassingFaults], Reader]


class Fix(NamedTuple):
    """The sensors of one kind of fix."""

    sizes: dict[str, int]  # number of values that each sensor reports
    tables: Callable[[Route], str]  # of the vehicle file
    reader: MakeReader  # of route, seeds, initial positions (n, 2), faults


def lap_poses(route: Route, lap_fractions: Sequence[float]) -> np.ndarray:
    """Return the poses (m, 3) of a route after the fractions `lap_fractions` of its lap."""
    return route.eta[
        [int(np.searchsorted(route.t_s, fraction * route.t_s[-1])) for fraction in lap_fractions]
    ]


def with_fix(vehicle_file: VehicleFile, fix: str, route: Route) -> VehicleFile:
    """Return the file with the sensors of a fix on a route, instead of other fixes; its estimator uses them."""
    sizes, tables, _ = FIXES[fix]
    document = tomlkit.parse(vehicle_file.with_values({"estimator.use": ["imu"]}).text)
    for name in [name for sensors in FIXES.values() for name in sensors.sizes]:
        document["sensors"].pop(name, None)
        for key in [key for key in document.get("provenance", {}) if key.startswith(f"sensors.{name}.")]:
            del document["provenance"][key]
    return parse(f"{tomlkit.dumps(document)}\n{tables(route)}", vehicle_file.name).with_values(
        {"estimator.use": ["imu", *sizes]}
    )


def _tag_tables(route: Route) -> str:
    points = lap_poses(route, TWO_FRACTIONS)[:, :2].tolist()
    return (
        f'[sensors.tags]\nkind = "tags"\npoints_m = {points}\nradius_m = {RADIUS_M}\nnoise_std = {NOISE_M}\n'
    )


def _line_tables(route: Route) -> str:
    return "\n".join(
        f'[sensors.{name}]\nkind = "mark"\npoint_m = [{x}, {y}]\nheading_rad = {heading}\n'
        f"half_width_m = {RADIUS_M}\nnoise_std = {NOISE_M}\n"
        for name, (x, y, heading) in zip(LINES, lap_poses(route, THREE_FRACTIONS).tolist(), strict=True)
    )


def _gate_tables(route: Route) -> str:
    return f'[sensors.pose]\nkind = "pose"\nnoise_std = [{NOISE_M}, {NOISE_M}, {NOISE_RAD}]\n'


def _tags(route: Route, seeds: Sequence[int], xy: np.ndarray, faults: PassingFaults) -> Reader:
    return TagReaders(lap_poses(route, TWO_FRACTIONS)[:, :2], RADIUS_M, NOISE_M, seeds, xy, faults)


def _lines(route: Route, seeds: Sequence[int], xy: np.ndarray, faults: PassingFaults) -> Reader:
    return FloorLines(lap_poses(route, THREE_FRACTIONS), RADIUS_M, NOISE_M, seeds, xy, faults)


def _gate(route: Route, seeds: Sequence[int], xy: np.ndarray, faults: PassingFaults) -> Reader:
    poses = lap_poses(route, (*ONE_FRACTION, *np.linspace(0.0, 1.0, MISTAKEN_POSE_COUNT)))
    return Gate(poses, RADIUS_M, np.array([NOISE_M, NOISE_M, NOISE_RAD]), seeds, xy, faults)


class _NoMarkReader:
    """Reader of a floor without marks."""

    def read(self, t_s: float, eta: np.ndarray) -> np.ndarray:
        """Return an empty report (n, 0)."""
        return np.zeros((len(eta), 0))


LINES = ("line_1", "line_2", "line_3")
FIXES = {
    N_("none"): Fix({}, lambda route: "", lambda route, seeds, xy, faults: _NoMarkReader()),
    N_("tags"): Fix({"tags": 2}, _tag_tables, _tags),
    N_("lines"): Fix(dict.fromkeys(LINES, 1), _line_tables, _lines),
    N_("gate"): Fix({"pose": 3}, _gate_tables, _gate),
}
