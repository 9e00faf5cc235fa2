"""The course, from two positions, against the heading of the truth.

    θ = mean of exp 2i (course ∓ heading),  − as it is, + if one of the axes is mirrored                   (1)

Angles are doubled: forward and backward count alike. Half the angle of θ is the offset of the heading.
"""

from collections.abc import Iterator

import numpy as np

from baqueano.geometry import wrap
from baqueano.runs.diagnostics.doubt import Doubt
from baqueano.runs.diagnostics.plausible import ENOUGH, FASTEST_M_S, FASTEST_RAD_S
from baqueano.runs.run import TruthLog
from baqueano.signals import NANOSECONDS

CLEAR, STEP_M, OFFSET_RAD = 0.7, 0.05, 0.35


def course_and_heading(truth: TruthLog) -> Iterator[Doubt]:
    """Doubts about units, axes and heading of a truth."""
    dt, d = np.diff(truth.t_ns) / NANOSECONDS, np.diff(truth.eta, axis=0)
    speed, rate = (np.quantile(x / dt, 0.9) for x in (np.hypot(d[:, 0], d[:, 1]), np.abs(wrap(d[:, 2]))))
    if speed > FASTEST_M_S:
        said = f"[truth] eta: positions change by {speed:.3g} m/s"
        yield Doubt("unit", "error", None, said, 'perhaps unit = "mm"')
    elif rate > FASTEST_RAD_S:
        said = f"[truth] eta[2]: the heading changes by {rate:.3g} rad/s"
        yield Doubt("unit", "error", None, said, 'perhaps unit = "deg"')
    else:
        yield from _agreement(truth.eta)


def _agreement(eta: np.ndarray) -> Iterator[Doubt]:
    """(1)"""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(eta[:, :2], axis=0).T))])
    steps = np.floor(way / STEP_M)
    far = np.flatnonzero(np.diff(steps, prepend=-1.0) > 0.0)  # one pose in every STEP_M
    d = np.diff(eta[far, :2], axis=0)
    if len(d) < ENOUGH:
        return
    course = np.arctan2(d[:, 1], d[:, 0])
    heading = eta[far[:-1], 2] + 0.5 * wrap(np.diff(eta[far, 2]))
    same, mirrored = (np.mean(np.exp(2j * (course + sign * heading))) for sign in (-1.0, 1.0))
    off = 0.5 * float(np.angle(same))
    if abs(mirrored) > CLEAR and abs(same) < 0.5:
        seen = f"agreement {abs(same):.2f}, mirrored {abs(mirrored):.2f}"
        said = f"[truth] eta: course and heading turn opposite ways ({seen})"
        cure = "x and y are swapped, or one of y and yaw needs scale = -1.0"
        yield Doubt("mirrored", "error", None, said, cure)
    elif abs(same) > CLEAR and abs(off) > OFFSET_RAD:
        degrees = f"{np.degrees(off):.0f}° (or {np.degrees(off) + 180:.0f}°)"
        said = f"[truth] eta[2]: the vehicle moves {degrees} beside its heading"
        cure = f"write offset = {off:.3f} for the yaw, or {wrap(off + np.pi):.3f} if it drove backward"
        yield Doubt("heading offset", "error", None, said, cure)
