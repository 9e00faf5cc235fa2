"""Calibrate scale and bias of a gyro from whole turns, made by hand between rests on a mark.

    G_k = Σ_{j<k} ∫ (z − b_j) dt = s θ_k,   θ_k = 2π N_k + a_k                                            (1)
    b_j: the bias between rests j and j + 1, the mean of z in both rests
    cov G = s² σ_a² I + L diag(q) Lᵀ,   q_j = T_j² (var b_j + (b_{j+1} − b_j)²/12)                        (2)

s and one constant are estimated by generalised least squares. a_k is the error of the hand on the mark. Its σ_a is
ANGLE_STD_RAD, or the scatter of the rests if that is significantly larger (p-value below 1/100). L computes the
cumulative sum, and T_j is the duration of a turn. A bias that changed from rest to rest has a uniform distribution
between the two. A rest is a time of MIN_REST_S or more in which the gyro scatters about as little as in its quietest
time. N_k is the nearest whole number, if a scale error of SCALE_TOLERANCE cannot change it; otherwise the user must
give the number of turns. A rest in the middle of a turn is off the mark and is not used.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from baqueano.calibration.against_truth import GAP_S, find_channel
from baqueano.calibration.result import CalibratedNumber, Calibration, sensor_axis_warnings
from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import fault
from baqueano.errors import UsageError
from baqueano.geometry import TAU
from baqueano.messages.language import mark as N_, translate as _
from baqueano.messages.printable import baqueano_command
from baqueano.numerics.statistics import QUANTILE_95, chi_square, student_quantile
from baqueano.runs.interpolation import TimeSeries
from baqueano.runs.run import Run
from baqueano.sensors.sampling import sensor_range
from baqueano.vehicle_file import VehicleFile

MIN_REST_S, WINDOW_S = 2.0, 0.5  # the shortest rest, and the windows that are tested for rest
# quantile of the windows' scatter; up to the second value times this scatter is a rest
QUIET_QUANTILE, MAX_SCATTER_RATIO = 0.05, 3.0
MIN_TURN_RAD_S = 0.02  # rad/s: a mean that differs by more from the mean of the first rest is a turn
SCALE_TOLERANCE = 0.06  # of a scale: twice the tolerance of a data sheet
ANGLE_STD_RAD = float(np.radians(2.0))  # accuracy of a line of chalk
MARK_SIGMA = 4.0  # standard errors of placing the vehicle by hand


class Rest(NamedTuple):
    """A time in which the vehicle was at rest."""

    begin_s: float
    end_s: float
    mean: float  # of the gyro [rad/s]
    std: float  # of the mean

    @property
    def middle_s(self) -> float:
        """Return the middle of the rest [s]."""
        return 0.5 * (self.begin_s + self.end_s)


def calibrate_by_hand_turns(run: Run, vehicle_file: VehicleFile, turns: float | None = None) -> Calibration:
    """Return the calibration of the gyro of `run`, in which the vehicle was turned by hand between rests on a mark.
    `turns` is the number of whole turns between two rests, in either direction; None: the nearest whole number. Raise
    UsageError if the run lacks a gyro, two rests or whole turns, or if the gyro has a gap or was saturated."""
    channel = find_channel(run, vehicle_file, "gyro_scale", -1)
    if channel is None:
        raise UsageError.of("turns.no-gyro", "--vehicle FILE", run=run.name, vehicle=vehicle_file.name)
    name, gyro = channel
    block = getattr(vehicle_file.sensors, name)
    rests = _rests(gyro)
    if len(rests) < 2:
        raise UsageError.of("turns.few-rests", run=run.name, rests=len(rests), rest_s=MIN_REST_S)
    _check_complete_record(run.name, gyro, sensor_range(block))
    angle, variance = _angles(gyro, rests)
    whole_turns, used_rests = _whole_turns(run.name, rests, angle / float(block.gyro_scale), turns)
    scale, std, freedom = _regression(angle[used_rests], whole_turns, _covariance(used_rests, variance))
    half_width = std * (QUANTILE_95 if freedom is None else student_quantile(0.975, freedom))
    sentence = _(
        "{turns:g} turns by hand, between {rests} rests on a mark",
        turns=float(np.abs(np.diff(whole_turns)).sum()),
        rests=len(used_rests),
    )
    path, window_means = f"sensors.{name}.gyro", np.array([rest.mean for rest in rests])
    spread = float(np.ptp(window_means)) / np.sqrt(12.0)
    bias_std = float(np.hypot(np.sqrt(np.mean([rest.std**2 for rest in rests]) / len(rests)), spread))
    return Calibration(
        run.name,
        (
            CalibratedNumber(f"{path}_scale", scale, std, half_width, "1", float(block.gyro_scale), sentence),
            CalibratedNumber(f"{path}_bias", float(window_means.mean()), bias_std, QUANTILE_95 * bias_std, "rad/s",
                  float(block.gyro_bias), _("at rest, {times} times", times=len(rests))),
        ),
        {"heading_rad": float(np.std(angle[used_rests] / scale - TAU * whole_turns))},
        N_("the turns determine everything"),
        sensor_axis_warnings(run),
    )  # fmt: skip


def _check_complete_record(name: str, gyro: TimeSeries, limit: np.ndarray | None) -> None:
    """Raise UsageError if the record of a turn has a gap or is saturated."""
    steps_s = np.diff(gyro.t_s)
    if steps_s.max() > GAP_S:
        gap_time_s = float(gyro.t_s[np.argmax(steps_s)])
        fix = baqueano_command("runs", "cut", name, "--to", f"{gap_time_s:.1f}")
        raise UsageError.of("turns.silent", fix, run=name, gap_s=steps_s.max(), t_s=gap_time_s)
    if limit is not None and np.any(np.abs(gyro.x) >= limit[-1]):
        gap_time_s = gyro.t_s[np.argmax(np.abs(gyro.x))]
        raise UsageError.of("turns.end-of-range", run=name, limit_rad_s=limit[-1], t_s=gap_time_s)


def is_turned_by_hand(run: Run) -> bool:
    """Return True if all commands are 0 and a pose was not measured: only a hand can have turned the vehicle."""
    lacks_truth = run.truth is None or not np.isfinite(run.truth.eta).any()
    return lacks_truth and not np.any(np.nan_to_num(run.applied_commands))


def _rests(gyro: TimeSeries) -> list[Rest]:
    """Return the rests: joined windows with a scatter close to the scatter of the quietest windows."""
    t_s, z = gyro.t_s, gyro.x
    window_number = ((t_s - t_s[0]) // WINDOW_S).astype(int)
    ends = np.flatnonzero(np.diff(window_number, append=window_number[-1] + 1)) + 1
    windows = [slice(a, b) for a, b in zip([0, *ends[:-1]], ends, strict=True) if b - a >= 3]
    if not windows:
        return []
    scatter = np.array([np.std(z[window], ddof=1) for window in windows])
    changes = np.abs(np.diff(z))
    step = float(np.min(changes[changes > 0.0])) if np.any(changes > 0.0) else 0.0  # of the converter
    is_quiet = scatter <= max(MAX_SCATTER_RATIO * float(np.quantile(scatter, QUIET_QUANTILE)), step)
    mean = np.array([np.mean(z[window]) for window in windows])
    if not is_quiet.any():
        return []
    is_quiet &= np.abs(mean - mean[np.argmax(is_quiet)]) < MIN_TURN_RAD_S
    rests, edges = [], np.flatnonzero(np.diff(np.concatenate([[False], is_quiet, [False]]).astype(int)))
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        rows = slice(windows[a].start, windows[b - 1].stop)
        begin_s, end_s = float(t_s[rows][0]), float(t_s[rows][-1])
        if end_s - begin_s >= 0.9 * MIN_REST_S:
            std = float(np.std(mean[a:b], ddof=1) / np.sqrt(b - a))
            rests.append(Rest(begin_s, end_s, float(np.mean(z[rows])), std))
    return rests


def _angles(gyro: TimeSeries, rests: list[Rest]) -> tuple[np.ndarray, np.ndarray]:
    """Return G (K,) of (1) from middle to middle of the rests, the first 0, and q (K − 1,) of (2)."""
    middles_s, rates = np.array([rest.middle_s for rest in rests]), np.array([rest.mean for rest in rests])
    T = np.diff(middles_s)
    interval_turns = np.diff(gyro.integral_until(middles_s)) - 0.5 * (rates[1:] + rates[:-1]) * T
    var = 0.25 * np.array([x.std**2 + y.std**2 for x, y in pairwise(rests)])
    return np.concatenate([[0.0], np.cumsum(interval_turns)]), T**2 * (var + np.diff(rates) ** 2 / 12.0)


def _whole_turns(
    name: str, rests: list[Rest], angle: np.ndarray, turns: float | None
) -> tuple[np.ndarray, list[int]]:
    """Return the whole turns N of the rests on the mark, from the first on, and the indices of these rests. Raise
    UsageError without a whole turn, or if the number of turns is ambiguous."""
    marked_turns, used_rests, problem = [0.0], [0], fault("turns.not-turned", run=name)
    mark_turns = MARK_SIGMA * np.sqrt(2.0) * ANGLE_STD_RAD / TAU
    for k in range(1, len(rests)):
        turn_count = (angle[k] - angle[used_rests[-1]]) / TAU
        n = float(np.round(turn_count))
        if turns is not None and abs(turn_count) >= 0.5:
            n = float(np.copysign(abs(turns), turn_count))
        tolerance = SCALE_TOLERANCE * max(abs(turn_count), abs(n)) + mark_turns
        start_s, end_s = (rests[i].middle_s for i in (used_rests[-1], k))
        details: JsonObject = {"run": name, "start_s": start_s, "end_s": end_s}
        if turns is None and abs(turn_count) > 0.5 and tolerance > 0.5:
            raise UsageError.of("turns.ambiguous", f"--turns {abs(n):.0f}", turns=turn_count, **details)
        if abs(turn_count - n) < tolerance:
            marked_turns.append(marked_turns[-1] + n)
            used_rests.append(k)
        else:
            problem = fault("turns.not-whole", turns=turn_count, expected=abs(n), **details)
    if not np.ptp(marked_turns) > 0.0:
        raise UsageError(problem)
    return np.array(marked_turns), used_rests


def _covariance(used_rests: list[int], variance: np.ndarray) -> np.ndarray:
    """Return the covariance (K, K) that the bias adds to G at `used_rests`.  (2)"""
    L = np.tril(np.ones((len(variance) + 1, len(variance))), -1)[used_rests]
    return (L * variance) @ L.T


def _regression(
    angle: np.ndarray, whole_turns: np.ndarray, bias_cov: np.ndarray
) -> tuple[float, float, int | None]:
    """Return the scale, its standard error, and the degrees of freedom if the error comes from the scatter of the
    rests, else None.  (1), (2)"""
    X = np.column_stack([np.ones(len(whole_turns)), TAU * whole_turns])
    scale, freedom = float(np.polyfit(TAU * whole_turns, angle, 1)[0]), len(whole_turns) - 2
    cov = (scale * ANGLE_STD_RAD) ** 2 * np.eye(len(whole_turns)) + bias_cov
    weights = np.linalg.solve(cov, X)
    x = np.linalg.solve(X.T @ weights, weights.T @ angle)
    residuals = angle - X @ x
    std = float(np.sqrt(np.linalg.inv(X.T @ weights)[1, 1]))
    chi2 = float(residuals @ np.linalg.solve(cov, residuals))
    if freedom > 0 and chi2 > chi_square(freedom, 2.3263):
        return float(x[1]), std * (chi2 / freedom) ** 0.5, freedom
    return float(x[1]), std, None
