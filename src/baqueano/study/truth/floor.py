"""Marks on a floor, read by n vehicles that pass over them. Some are missed, read twice, or mistaken for another mark.

A reader is nearest to a mark when the distance stops decreasing. If the mark is then within the radius, the reader
reports with noise: over a tag the position of the vehicle, in a gate the pose. A line is reported when it is crossed,
with the distance beyond it. If a tag or gate is mistaken for another one, the report is shifted by the vector between
the two. If a line is mistaken for another line, the report names the other line.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

SECOND_READING_S = 0.05  # after the first time

Measure = Callable[[np.random.Generator, bool], np.ndarray]


class PassingFaults(NamedTuple):
    """Rates at which a passage over a mark is missed, doubled or mistaken."""

    missed_rate: float = 0.0
    double_rate: float = 0.0
    mistaken_rate: float = 0.0


class Reader(Protocol):
    """The readers of n vehicles on the same floor."""

    def read(self, t_s: float, eta: np.ndarray) -> np.ndarray:
        """Return the reports (n, m) at `t_s` of vehicles at the poses (n, 3); NaN without a report."""
        ...


class TagReaders:
    """Tags at `points_m` (m, 2) and the readers of vehicles at `xy` (n, 2), each with the noise of its seed."""

    def __init__(
        self, points_m: np.ndarray, radius_m: float, noise_m: float, seeds: Sequence[int], xy: np.ndarray,
        faults: PassingFaults,
    ) -> None:  # fmt: skip
        self._points, self._noise_m = points_m, noise_m
        self._detector = _PassageDetector(points_m, radius_m, xy)
        self._reports = _Reports((len(xy), 2), seeds, faults)

    def read(self, t_s: float, eta: np.ndarray) -> np.ndarray:
        """Return the reported positions (n, 2) [m] at `t_s`; NaN without a report."""
        return self._reports.readings_at(
            t_s, [(i, self._tag_measure(k, eta[i])) for i, k in self._detector.passages(eta[:, :2])]
        )

    def _tag_measure(self, k: int, eta: np.ndarray) -> Measure:
        def measure(draw: np.random.Generator, is_mistaken: bool) -> np.ndarray:
            z = eta[:2] + self._noise_m * draw.standard_normal((2, 2))
            if is_mistaken:
                z += self._points[draw.choice(_other_indices(len(self._points), k))] - self._points[k]
            return z

        return measure


class Gate:
    """A gate at `poses` [0] that measures the pose. A mistaken gate is taken for one of the other `poses` (m, 3)."""

    def __init__(
        self, poses: np.ndarray, radius_m: float, noise: np.ndarray, seeds: Sequence[int], xy: np.ndarray,
        faults: PassingFaults,
    ) -> None:  # fmt: skip
        self._poses, self._noise = poses, noise
        self._detector = _PassageDetector(poses[:1, :2], radius_m, xy)
        self._reports = _Reports((len(xy), 3), seeds, faults)

    def read(self, t_s: float, eta: np.ndarray) -> np.ndarray:
        """Return the reported poses (n, 3) [m, m, rad] at `t_s`; NaN without a report."""
        return self._reports.readings_at(
            t_s, [(i, self._pose_measure(eta[i])) for i, _ in self._detector.passages(eta[:, :2])]
        )

    def _pose_measure(self, eta: np.ndarray) -> Measure:
        def measure(draw: np.random.Generator, is_mistaken: bool) -> np.ndarray:
            z = eta + self._noise * draw.standard_normal((2, 3))
            if is_mistaken:
                z += self._poses[draw.choice(_other_indices(len(self._poses), 0))] - self._poses[0]
            z[:, 2] = np.arctan2(np.sin(z[:, 2]), np.cos(z[:, 2]))
            return z

        return measure


class FloorLines:
    """Lines through `poses` (m, 3) [m, m, rad], crossed along their heading; each extends `half_width_m` to a side."""

    def __init__(
        self, poses: np.ndarray, half_width_m: float, noise_m: float, seeds: Sequence[int], xy: np.ndarray,
        faults: PassingFaults,
    ) -> None:  # fmt: skip
        self._poses, self._half_width_m, self._noise_m = poses, half_width_m, noise_m
        self._reports = _Reports((len(xy), len(poses)), seeds, faults)
        self._past_line_m, _ = self._line_distances(xy)

    def read(self, t_s: float, eta: np.ndarray) -> np.ndarray:
        """Return the reported distances (n, m) beyond each line [m] at `t_s`; NaN without a report."""
        previous_past_line_m, (self._past_line_m, lateral_m) = (
            self._past_line_m,
            self._line_distances(eta[:, :2]),
        )
        is_passage = (
            (previous_past_line_m < 0.0)
            & (self._past_line_m >= 0.0)
            & (np.abs(lateral_m) <= self._half_width_m)
        )
        passages = np.argwhere(is_passage).tolist()
        return self._reports.readings_at(
            t_s, [(i, self._line_measure(k, self._past_line_m[i, k])) for i, k in passages]
        )

    def _line_measure(self, k: int, past_line_m: float) -> Measure:
        def measure(draw: np.random.Generator, is_mistaken: bool) -> np.ndarray:
            z, n = np.full((2, len(self._poses)), np.nan), len(self._poses)
            z[:, draw.choice(_other_indices(n, k)) if is_mistaken else k] = past_line_m
            return z + self._noise_m * draw.standard_normal((2, 1))

        return measure

    def _line_distances(self, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the distances (n, m) [m] of vehicles at `xy` (n, 2), beyond the lines and to the left of
        their points."""
        offset = xy[:, None, :] - self._poses[:, :2]
        c, s = np.cos(self._poses[:, 2]), np.sin(self._poses[:, 2])
        return offset[..., 0] * c + offset[..., 1] * s, offset[..., 1] * c - offset[..., 0] * s


class _PassageDetector:
    """Detector of the moments at which vehicles are nearest to points (m, 2), within a radius."""

    def __init__(self, points_m: np.ndarray, radius_m: float, xy: np.ndarray) -> None:
        self._points, self._radius_m = points_m, radius_m
        self._distance = self._point_distances(xy)
        self._shrinks = np.zeros_like(self._distance, dtype=bool)

    def passages(self, xy: np.ndarray) -> list[tuple[int, int]]:
        """Return the pairs (vehicle, point) nearest at this call, within the radius: at most one point per vehicle."""
        distance = self._point_distances(xy)
        shrinks = distance < self._distance
        is_nearest = self._shrinks & ~shrinks & (self._distance <= self._radius_m)
        self._distance, self._shrinks = distance, shrinks
        return [(int(i), int(np.argmax(is_nearest[i]))) for i in np.flatnonzero(is_nearest.any(axis=1))]

    def _point_distances(self, xy: np.ndarray) -> np.ndarray:
        """Return the distances (n, m) [m] from vehicles at `xy` (n, 2) to the points."""
        return np.hypot(*np.moveaxis(xy[:, None, :] - self._points, -1, 0))


class _Reports:
    """Reports of vehicles that pass a mark, with the faults of their readers; `shape` is (n, m)."""

    def __init__(self, shape: tuple[int, int], seeds: Sequence[int], faults: PassingFaults) -> None:
        self._shape, self._faults = shape, faults
        self._draw = [np.random.default_rng([seed, 22]) for seed in seeds]
        self._second_readings: list[tuple[float, np.ndarray]] = []

    def readings_at(self, t_s: float, passages: Iterable[tuple[int, Measure]]) -> np.ndarray:
        """Return the reports (n, m) at `t_s`; NaN without a report. `passages` contains the index of each
        passing vehicle, and the function that draws its report."""
        reports = np.full(self._shape, np.nan)
        for i, measure in passages:
            draw = self._draw[i]
            is_missed, is_repeated, is_mistaken = draw.random(3) < self._faults
            first, second = measure(draw, bool(is_mistaken))
            if not is_missed:
                reports[i], late_reports = first, np.full(self._shape, np.nan)
                late_reports[i] = second
                self._second_readings += [(t_s + SECOND_READING_S, late_reports)] if is_repeated else []
        for due_s, late_reports in self._second_readings:
            reports = np.where(np.isnan(late_reports) | (due_s > t_s), reports, late_reports)
        self._second_readings = [
            (due_s, late_reports) for due_s, late_reports in self._second_readings if due_s > t_s
        ]
        return reports


def _other_indices(n: int, k: int) -> list[int]:
    return [i for i in range(n) if i != k]
