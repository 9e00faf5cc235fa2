"""End the drive of a vehicle that is stuck, and of a guide that does not end.

  stuck while |p − p_0| < STILL_M, |ψ − ψ_0| < STILL_RAD and |p_r − p| > NEAR_M                         (1)
  stop  once (1) has been true for patience_s

p_0, ψ_0 is the pose at the last motion, p_r the reference. During a stop in the route the vehicle is not stuck, because
it is at its reference. During a pause it is not stuck either, even if a person moved it.

  stop  once ∫ pace dt ≥ limit_s                                                                        (2)

A drive of N laps is planned for T_N. Without another limit, limit_s = TIME_RATIO T_N + TIME_MARGIN_S. A pause does not
count in (2).
"""

from math import dist, nan

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, StopReason, stop
from baqueano.drive.observers import Observer
from baqueano.geometry import wrap
from baqueano.loop import Blocks, Record
from baqueano.signals import NANOSECONDS, seconds

STILL_M, STILL_RAD, NEAR_M = 0.02, 0.1, 0.05
TIME_RATIO = 10.0  # a guide that waits is slower than its plan
TIME_MARGIN_S = 60.0  # for the ways to and from a route


class PausedObserver(Observer):
    """Observer of a drive that can be paused: its guide has a pace."""

    _guide: Tree = None

    def begin(self, blocks: Blocks) -> Blocks:
        """Return the blocks unchanged. Their guide has a pace."""
        self._guide = blocks.guide
        return blocks


class Patience(PausedObserver):
    """Observer that ends a drive after `patience_s` without progress, without the pauses."""

    def __init__(self, patience_s: float) -> None:
        self._patience_s = patience_s
        self._origin = [nan, nan, nan]
        self._rest_start_ns, self._distance_m = 0, 0.0

    def on_record(self, record: Record) -> None:
        """Restart the waiting time if the vehicle has moved, is at its reference, or has to wait."""
        pose, reference = (np.asarray(x.eta).tolist() for x in (record.estimate, record.reference))
        self._distance_m = dist(pose[:2], reference[:2])
        if self._guide.pace == 0.0 or self._distance_m <= NEAR_M or self._has_moved(pose):
            self._origin, self._rest_start_ns = pose, record.tick.t_ns

    def _has_moved(self, pose: list[float]) -> bool:
        is_near = dist(pose[:2], self._origin[:2]) < STILL_M
        return not (is_near and abs(wrap(pose[2] - self._origin[2])) < STILL_RAD)

    def stop_reason(self, t_ns: int) -> Diagnostic | None:
        """Return the reason to end the drive, or None to continue.  (1)"""
        rest_s = seconds(t_ns, self._rest_start_ns)
        if rest_s < self._patience_s:
            return None
        return stop(StopReason.STUCK, rest_s=rest_s, distance_m=self._distance_m)


class TimeLimit(PausedObserver):
    """Observer that ends a drive whose guide has not ended it after `limit_s`, without the pauses."""

    def __init__(self, limit_s: float) -> None:
        self._limit_s, self._driven_ns = limit_s, 0.0
        self._last_ns: int | None = None

    @classmethod
    def for_duration(cls, planned_s: float) -> "TimeLimit":
        """Return the limit of a drive that is planned for `planned_s`."""
        return cls(TIME_RATIO * planned_s + TIME_MARGIN_S)

    def stop_reason(self, t_ns: int) -> Diagnostic | None:
        """Add the time since the last tick. Return the reason to end the drive, or None to continue.  (2)"""
        if self._last_ns is not None:
            self._driven_ns += self._guide.pace * (t_ns - self._last_ns)
        self._last_ns = t_ns
        if self._driven_ns < self._limit_s * NANOSECONDS:
            return None
        return stop(StopReason.TIME_LIMIT, limit_s=self._limit_s)
