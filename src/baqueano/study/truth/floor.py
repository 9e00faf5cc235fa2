"""Tags on a floor, read by n vehicles that pass over them: some are missed, read twice, or mistaken for another.

A reader is nearest to a tag when its distance stops decreasing. Within the radius it then reports its own position with
noise. If a tag is mistaken for another one, that position is shifted by the vector between the two tags.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

TWICE_S = 0.05  # after the first time


class TagFaults(NamedTuple):
    """Rates at which a passage over a tag is missed, doubled or mistaken."""

    missed: float = 0.0
    twice: float = 0.0
    mistaken: float = 0.0


class Floor:
    """Tags at `points_m` (m, 2) and the readers of vehicles at `xy` (n, 2), each with the noise of its seed."""

    def __init__(
        self, points_m: np.ndarray, radius_m: float, noise_m: float, seeds: Sequence[int], xy: np.ndarray,
        faults: TagFaults,
    ) -> None:  # fmt: skip
        self._points, self._radius_m, self._noise_m, self._faults = points_m, radius_m, noise_m, faults
        self._draw = [np.random.default_rng([seed, 22]) for seed in seeds]
        self._distance = self._to(xy)
        self._shrinks = np.zeros_like(self._distance, dtype=bool)
        self._late_readings: list[tuple[float, np.ndarray]] = []
        self.passed = np.zeros(len(xy), dtype=int)

    def read(self, t_s: float, xy: np.ndarray) -> np.ndarray:
        """Return the positions (n, 2) that are reported at `t_s`; NaN without a report."""
        distance, out = self._to(xy), np.full(xy.shape, np.nan)
        shrinks = distance < self._distance
        nearest = self._shrinks & ~shrinks & (self._distance <= self._radius_m)
        self._distance, self._shrinks = distance, shrinks
        for i in np.flatnonzero(nearest.any(axis=1)):
            draw, nearest_point = self._draw[i], int(np.argmax(nearest[i]))
            is_missed, twice, mistaken = draw.random(3) < self._faults
            reading = xy[i] + self._noise_m * draw.standard_normal((2, 2))
            self.passed[i] += 1
            if mistaken:
                wrong_points = [k for k in range(len(self._points)) if k != nearest_point]
                reading += self._points[draw.choice(wrong_points)] - self._points[nearest_point]
            if not is_missed:
                out[i] = reading[0]
                late = np.full(xy.shape, np.nan)
                late[i] = reading[1]
                self._late_readings += [(t_s + TWICE_S, late)] if twice else []
        for due_s, reading in self._late_readings:
            out = np.where(np.isnan(reading) | (due_s > t_s), out, reading)
        self._late_readings = [reading for reading in self._late_readings if reading[0] > t_s]
        return out

    def _to(self, xy: np.ndarray) -> np.ndarray:
        """Return the distances (n, m) from the readers to the tags."""
        return np.hypot(*np.moveaxis(xy[:, None, :] - self._points, -1, 0))
