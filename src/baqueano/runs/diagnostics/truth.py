"""Compare the course, from two positions, with the heading of the truth.

    θ = mean of exp 2i (course ∓ heading),  − for the axes as read, + if one of the axes is mirrored       (1)

Angles are doubled, so that forward and backward motion are equivalent. Half the angle of θ is the heading's offset.
"""

from collections.abc import Iterator

import numpy as np

from baqueano.diagnostics import note
from baqueano.geometry import wrap
from baqueano.runs.diagnostics.finding import ImportFinding
from baqueano.runs.diagnostics.physical_limits import MAX_SPEED_M_S, MAX_YAW_RATE_RAD_S, MIN_WINDOWS
from baqueano.runs.run import TruthLog
from baqueano.signals import NANOSECONDS

MIN_AGREEMENT, STEP_M, MAX_OFFSET_RAD = 0.7, 0.05, 0.35


def truth_findings(truth: TruthLog) -> Iterator[ImportFinding]:
    """Yield the findings about units, axes and heading of a truth."""
    if len(truth.t_ns) < 2:
        return
    dt, d = np.diff(truth.t_ns) / NANOSECONDS, np.diff(truth.eta, axis=0)
    speed, rate = (np.quantile(x / dt, 0.9) for x in (np.hypot(d[:, 0], d[:, 1]), np.abs(wrap(d[:, 2]))))
    if speed > MAX_SPEED_M_S:
        reason = note("recording.truth-fast", speed_m_s=speed)
        yield ImportFinding("unit", "error", reason, note("recording.possible-line", line='unit = "mm"'))
    elif rate > MAX_YAW_RATE_RAD_S:
        reason = note("recording.truth-turns", rate_rad_s=rate)
        yield ImportFinding("unit", "error", reason, note("recording.possible-line", line='unit = "deg"'))
    else:
        yield from _axis_findings(truth.eta)


def _axis_findings(eta: np.ndarray) -> Iterator[ImportFinding]:
    """Yield a finding if the axes are mirrored or the heading has an offset.  (1)"""
    distances = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(eta[:, :2], axis=0).T))])
    steps = np.floor(distances / STEP_M)
    rows = np.flatnonzero(np.diff(steps, prepend=-1.0) > 0.0)  # one pose in every STEP_M
    d = np.diff(eta[rows, :2], axis=0)
    if len(d) < MIN_WINDOWS:
        return
    course = np.arctan2(d[:, 1], d[:, 0])
    heading = eta[rows[:-1], 2] + 0.5 * wrap(np.diff(eta[rows, 2]))
    same_mean, mirror_mean = (np.mean(np.exp(2j * (course + sign * heading))) for sign in (-1.0, 1.0))
    offset = 0.5 * float(np.angle(same_mean))
    if abs(mirror_mean) > MIN_AGREEMENT and abs(same_mean) < 0.5:
        reason = note("recording.mirrored", agreement=abs(same_mean), mirrored_agreement=abs(mirror_mean))
        yield ImportFinding("mirrored", "error", reason, note("recording.write-mirrored"))
    elif abs(same_mean) > MIN_AGREEMENT and abs(offset) > MAX_OFFSET_RAD:
        reason = note(
            "recording.camera-turned", offset_deg=np.degrees(offset), opposite_deg=np.degrees(offset) + 180.0
        )
        line = note(
            "recording.write-offset", offset=f"{offset:.3f}", backward_offset=f"{wrap(offset + np.pi):.3f}"
        )
        yield ImportFinding("heading offset", "error", reason, line)
