"""Corridor along a path: the 95 % regions of position and heading, by the covariance P of the filter.

    position   (p − p̂)ᵀ P_p⁻¹ (p − p̂) ≤ χ²₂,  an ellipse of the area π χ²₂ √det P_p                       (1)
    across     ± 1.96 √(nᵀ P_p n),  n to the left of the heading;   heading   ± 1.96 σ_ψ                   (2)

χ²₂ and 1.96 are the 95 % quantiles. If σ_ψ exceeds MAX_HEADING_STD_RAD, the heading is unusable and the vehicle
is lost. From then on the ellipse does not bound a region, so the corridor ends.
"""

from typing import NamedTuple

import numpy as np

from baqueano.diagnostics import Diagnostic, note
from baqueano.estimators.covariance import CHI_SQUARE_95
from baqueano.geometry import wrap
from baqueano.messages import text
from baqueano.runs.run import Run
from baqueano.signals import seconds

MAX_HEADING_STD_RAD = 0.5
QUANTILE_95 = 1.960
RETURN_DISTANCE_M, RETURN_ANGLE_RAD = 0.03, 0.15  # from its first pose: a reference has returned to it


class Corridor(NamedTuple):
    """The 95 % regions along a path at M ticks, until the vehicle is lost."""

    t_s: np.ndarray  # (M,) since the first tick
    eta: np.ndarray  # (M, 3) poses in the middle of the corridor
    across_m: np.ndarray  # (M,) half-width to the left and right of the heading
    area_m2: np.ndarray  # (M,) area of the ellipse of the position
    heading_rad: np.ndarray  # (M,) half-width
    loss_s: float  # time from which the vehicle is lost; NaN: never
    lap_s: float  # NaN: no lap was closed

    @property
    def sentence(self) -> str:
        """Return a sentence with the half-widths at the end, or with the time from which the vehicle is lost."""
        return text(self.message)

    @property
    def message(self) -> Diagnostic:
        """Return the message that `sentence` expresses."""
        if np.isfinite(self.loss_s):
            if not np.isfinite(self.lap_s):
                return note("corridor.lost", t_s=self.loss_s)
            return note("corridor.lost-in-lap", t_s=self.loss_s, lap=int(self.loss_s / self.lap_s) + 1)
        laps = round(float(self.t_s[-1]) / self.lap_s) if np.isfinite(self.lap_s) else 0
        bound = self._width_message(len(self.t_s) - 1)
        if laps:
            return note("corridor.after-laps" if laps > 1 else "corridor.after-lap", laps=laps, bound=bound)
        return note("corridor.after-time", t_s=float(self.t_s[-1]), bound=bound)

    def region_text(self, k: int) -> str:
        """Return the half-widths at one tick, such as "± 8 cm across, ± 4°"."""
        return text(self._width_message(k))

    def _width_message(self, k: int) -> Diagnostic:
        across_m, heading_deg = float(self.across_m[k]), float(np.degrees(self.heading_rad[k]))
        if across_m < 0.995:
            return note("corridor.cm", across_cm=100.0 * across_m, heading_deg=heading_deg)
        return note("corridor.m", across_m=across_m, heading_deg=heading_deg)


def corridor(t_s: np.ndarray, eta: np.ndarray, cov: np.ndarray, lap_s: float = float("nan")) -> Corridor:
    """Return the corridor of poses (N, 3) at times (N,), until the vehicle is lost.  (1), (2)
    The covariances (N, k, k) begin with the pose.
    """
    std = np.sqrt(np.maximum(cov[:, 2, 2], 0.0))
    is_lost = ~(std <= MAX_HEADING_STD_RAD)  # NaN also means lost
    m = int(np.argmax(is_lost)) if is_lost.any() else len(t_s)
    P, psi = cov[:m, :2, :2], eta[:m, 2]
    left_directions = np.stack([-np.sin(psi), np.cos(psi)], axis=1)
    across_std = np.sqrt(np.maximum(np.einsum("ki,kij,kj->k", left_directions, P, left_directions), 0.0))
    area = np.pi * CHI_SQUARE_95 * np.sqrt(np.maximum(np.linalg.det(P), 0.0))
    loss_s = float(t_s[m]) if m < len(t_s) else float("nan")
    return Corridor(t_s[:m], eta[:m], QUANTILE_95 * across_std, area, QUANTILE_95 * std[:m], loss_s, lap_s)


def run_corridor(run: Run) -> Corridor | None:
    """Return the corridor of a run; None if its filter does not report a covariance of the pose."""
    log = run.estimate
    if log is None or not len(log.t_ns) or not np.any(log.cov[:, :3, :3]):
        return None
    return corridor(seconds(log.t_ns, run.start_ns), log.eta, log.cov, _lap_s(run))


def corridor_row(corridor: Corridor | None) -> dict[str, float]:
    """Return the half-widths at the end as a flat row (SI); NaN without a corridor, or if the vehicle is lost."""
    names = ("corridor_across_m", "corridor_area_m2", "corridor_heading_rad")
    if corridor is None:
        return dict.fromkeys((*names, "loss_s"), float("nan"))
    is_bounded = len(corridor.t_s) > 0 and not np.isfinite(corridor.loss_s)
    last = [
        x[-1] if is_bounded else np.nan for x in (corridor.across_m, corridor.area_m2, corridor.heading_rad)
    ]
    return dict(zip(names, map(float, last), strict=True)) | {"loss_s": corridor.loss_s}


def _lap_s(run: Run) -> float:
    """Return the mean duration of the laps of the reference [s]; NaN if it did not return to its first pose."""
    ref = run.guide_reference
    if ref is None or len(ref.t_ns) < 2:
        return float("nan")
    offsets = ref.eta - ref.eta[0]
    is_outside = (np.hypot(offsets[:, 0], offsets[:, 1]) > RETURN_DISTANCE_M) | (
        np.abs(wrap(offsets[:, 2])) > RETURN_ANGLE_RAD
    )
    return_indices = np.flatnonzero(is_outside[:-1] & ~is_outside[1:])
    if not len(return_indices):
        return float("nan")
    begin = return_indices[-1] + 1
    near_count = int(np.argmax(np.append(is_outside[begin:], True)))
    k = begin + int(np.argmin(np.hypot(*offsets[begin : begin + near_count, :2].T)))
    return float(seconds(ref.t_ns[k], ref.t_ns[0])) / len(return_indices)
