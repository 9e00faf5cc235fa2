"""Measure how often `lap_closure` refuses a taught lap of an independent robot that ends away from its mark.

    from baqueano.study.corridor.vehicles import identify_vehicles, vehicles
    from benchmarks.lap_returns import lap_ends, refused_share

    seeds = range(10, 60)
    ends = lap_ends(seeds, identify_vehicles(vehicles(seeds), seeds, "auto"), "rectangle")
    refused_share(ends, distance_m=0.1)

The estimated end is moved, so one lap of a robot gives all distances.
"""

from collections.abc import Sequence

import numpy as np

from baqueano.drive.closure import LapEnd, end_closure, lap_end
from baqueano.errors import AnswerNo
from baqueano.study.corridor.vehicles import vehicles
from baqueano.study.laps.team import MARK_M, simulate_taught_laps
from baqueano.vehicle_file import VehicleFile

DIRECTIONS = 24


def lap_ends(
    seeds: Sequence[int], files: Sequence[VehicleFile | None], shape: str
) -> list[tuple[LapEnd, VehicleFile]]:
    """Return the end of a lap of each robot, with its file. A robot without a file does not drive."""
    usable = {seed: file for seed, file in zip(seeds, files, strict=True) if file is not None}
    laps = simulate_taught_laps(vehicles([*usable]), [*usable], [*usable.values()], shape)
    return [(lap_end(lap, file, MARK_M), file) for lap, file in zip(laps, usable.values(), strict=True)]


def refused_share(
    ends: Sequence[tuple[LapEnd, VehicleFile]], distance_m: float = 0.0, turn_rad: float = 0.0
) -> float:
    """Return the share of the laps that are refused if they end away from the mark, in any direction."""
    angles = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    sides = np.where(angles < np.pi, turn_rad, -turn_rad)
    offsets = np.column_stack([distance_m * np.cos(angles), distance_m * np.sin(angles), sides])
    return float(
        np.mean([_is_refused(end._replace(e=end.e + d), file) for end, file in ends for d in offsets])
    )


def _is_refused(end: LapEnd, vehicle_file: VehicleFile) -> bool:
    try:
        end_closure(end, vehicle_file, "lap")
    except AnswerNo:
        return True
    return False
