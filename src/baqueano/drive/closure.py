"""Estimate the scales of the sensors from a return to a mark: between t₁ and t₂ the vehicle has made whole turns.

  s_ω = ∫ (z_ω − b) dt / (c · 2π k),   k = round(∫ (z_ω − b) dt / (s₀ c · 2π)) ≠ 0                       (1)
  σ(s_ω) = √(σ_mark² + (σ_b T)² + σ_w² T³/3 + σ_z² T δ) / (c · 2π |k|)                                   (2)
  ∮ R(ψ) s_v ν dt = s_v ∮ R(ψ) ν dt = 0      for each s_v: no closure shows the scale of the speed       (3)
  s_v = s₀ ∫ z_v / s₀ dt / L                 L measured along the path, driven forward                   (4)
  κ̂ = −σ̂² Jᵀ V⁻¹ e,  σ̂⁻² = Jᵀ V⁻¹ J,  V = P + M;  s_ω = s₀ e^κ,  κ = κ̂ σ₀² / (σ₀² + σ̂²)                   (5)
  χ² = ‖e + J κ̂‖² in V⁻¹ ≤ 13.82,  κ̂² ≤ 10.83 (σ₀² + σ̂²)     the 99.9 % of two degrees of freedom, of one  (6, 7)

z_ω is the reading of the gyro, and s₀ its scale in the vehicle file. c is the cosine of its tilt, b its zero at rest
in the same run. σ_w is the random walk of b, σ_z the noise of a sample, δ the sampling interval, σ_mark = 2°
[assumed]. If the vehicle returns to the same place too, e is the pose that its estimator finds at t₂ relative to t₁, P
its covariance for a known scale, M that of the mark, J = ∂e/∂κ, σ₀ the deviation of s₀ in the file (0: κ = κ̂). (5)
holds for k = 0 too, as on an eight; (1) does not. Derivation: docs/derivations/repeat_and_drift.md.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from baqueano.contracts.blocks import Sensor
from baqueano.contracts.optional import has_field
from baqueano.contracts.result import Result
from baqueano.contracts.values import TableRow, Tree, Value
from baqueano.drive.replay import replay
from baqueano.drive.session import mark_times_ns
from baqueano.errors import AnswerNo, Invalid
from baqueano.geometry import wrap
from baqueano.messages.language import translate as _
from baqueano.messages.printable import baqueano_command
from baqueano.runs import Channel, Run
from baqueano.sensors.sampling import is_imu
from baqueano.signals import NANOSECONDS, Motion, seconds
from baqueano.vehicle_file.file import VehicleFile

MARK_STD_RAD = np.radians(2.0)
SCALE_STEP = 0.005  # of κ, for J; the second step of (5) uses the same J
MAX_TURN_ERROR = 0.1
MAX_SCALE_ERROR = 0.1  # of κ̂ and of σ̂
MAX_RESIDUAL_CHI2 = 13.816  # (6): −2 ln 0.001
MAX_SIGMAS = 3.2905  # (7)
MAX_TURNS = 4  # maximum number of turns between two marks
REST_S, MIN_REST_S = 1.0, 1.0  # at rest after this time without a command; least duration of rest


@dataclass(frozen=True, repr=False)
class Closure(Result):
    """The motion of a run between its first and its last mark, and the scales of the sensors that follow from it."""

    gyro: str  # name of the IMU
    turns: int
    turned_rad: float  # measured by the gyro with the scale in the vehicle file
    scale: float  # of the gyro
    std: float  # (2) or (5)
    values: dict[str, object]  # of the vehicle file: path → value
    distances_m: dict[str, float]  # speed sensor → metres with its scale in the vehicle file
    length_m: float | None
    # of (5): distance between the estimated poses at both marks, with the file's scale
    gap_m: float | None = None

    def rows(self) -> list[TableRow]:
        """Return one flat row per scale."""
        rows: list[TableRow] = [
            {"name": f"sensors.{self.gyro}.gyro_scale", "value": self.scale, "std": self.std}
        ]
        other_values = {path: value for path, value in self.values.items() if not path.endswith("gyro_scale")}
        return rows + [
            {"name": path, "value": str(value), "std": float("nan")} for path, value in other_values.items()
        ]

    def table(self) -> str:
        """Return the results as sentences, with the options to type."""
        degrees = np.degrees(self.turned_rad)
        figures = {"gyro": self.gyro, "degrees": degrees, "scale": self.scale, "std": self.std}
        lines = [
            _(
                "marks: turned {turns:+d} times between the first and the last; {gyro} measured {degrees:+.1f} deg: "
                "gyro_scale {scale:.4f} +- {std:.4f}",
                turns=self.turns,
                **figures,
            )
            if self.gap_m is None
            else _(
                "the lap returned to its start; with the old scale its end was {gap_m:.2f} m away, and {gyro} "
                "measured {degrees:+.1f} deg: gyro_scale {scale:.4f} +- {std:.4f}",
                gap_m=self.gap_m,
                **figures,
            )
        ]
        lines += [
            "       "
            + _(
                "{sensor} measured {metres:.3f} m of {length_m:g} m",
                sensor=name,
                metres=metres,
                length_m=self.length_m,
            )
            for name, metres in self.distances_m.items()
        ]
        lines += [
            "       "
            + _("type: {fix}, or write it into the vehicle file", fix=f"--set {path}={_compact_text(value)}")
            for path, value in self.values.items()
        ]
        return "\n".join(lines)


class LapEnd(NamedTuple):
    """The estimated end of a lap relative to its start: e + J κ with the scale s₀ e^κ, and its covariance V."""

    gyro: str
    e: np.ndarray  # (3,)
    J: np.ndarray  # (3,)
    V: np.ndarray  # (3, 3)
    turn_rad: float  # of the lap, with the scale s₀
    file_e: np.ndarray  # (3,), computed with the scale s₀

    @property
    def std(self) -> float:
        """Return σ̂, infinity if the lap does not determine a scale."""
        information = float(self.J @ np.linalg.solve(self.V, self.J))
        return information**-0.5 if information > 0.0 else np.inf

    @property
    def kappa(self) -> float:
        """Return κ̂."""
        return -(self.std**2) * float(self.J @ np.linalg.solve(self.V, self.e))


def closure(run: Run, vehicle_file: VehicleFile, length_m: float | None = None) -> Closure:
    """Return the sensor scales that follow from the marks of `run`, for the vehicle of `vehicle_file`.

    The scales of speed sensors need `length_m`, the length of the path between the first and the last mark. Raise
    AnswerNo if a mark, the IMU or a rest is missing, or if the turns between the marks are not whole or cancel.
    """
    marks = mark_times_ns(run)
    if len(marks) < 2:
        raise AnswerNo.of("marks.too-few", name=run.name, marks=len(marks))
    name = _gyro_name(run, vehicle_file)
    sensor, channel = getattr(vehicle_file.sensors, name), run.sensors[name]
    bias, bias_std = _rest_bias(run, channel)
    cosine = _gain(sensor) / sensor.gyro_scale
    raw_turns = [_integral(channel, -1, bias, a, b) / cosine for a, b in pairwise(marks)]
    turns = sum(_turn_count(x / sensor.gyro_scale, run.name) for x in raw_turns)
    if turns == 0:
        raise AnswerNo.of("marks.no-turn", name=run.name)
    scale = sum(raw_turns) / (2.0 * np.pi * turns)  # (1)
    # (2)
    std = _turn_std(sensor, bias_std, seconds(marks[-1], marks[0])) / (2.0 * np.pi * cosine * abs(turns))
    values = _gyro_values(vehicle_file, name, scale, std)
    distances = _distances(run, vehicle_file, marks[0], marks[-1]) if length_m else {}
    for wheels, metres in distances.items():
        path, old_scale = _speed_scale(wheels, getattr(vehicle_file.sensors, wheels))
        new_scale = np.asarray(old_scale) * metres / (length_m or metres)  # (4)
        values[path] = (
            _round_to_five_digits(float(new_scale))
            if new_scale.ndim == 0
            else [_round_to_five_digits(x) for x in new_scale.tolist()]
        )
    turn_rad = sum(raw_turns) / sensor.gyro_scale
    return Closure(name, turns, float(turn_rad), float(scale), std, values, distances, length_m)


def lap_closure(run: Run, vehicle_file: VehicleFile, place_std_m: float = 0.01) -> Closure:
    """Return the gyro scale that follows from a lap which returned to its start: same place, same heading.

    The estimator of `vehicle_file` computes the end of the lap, so the model must be identified.  (5)

    The end has three components and the scale is one unknown, so (6) and (7) test the lap. They cannot notice an error
    of the end along J, because a scale explains it. So the driver must look at the vehicle: a lap that is closed in its
    estimate has e = 0 for any true scale, and confirms the scale of the file.

    Parameters
    ----------
    run : Run
        The lap, between its first and its last mark, or from its first to its last tick.
    vehicle_file : VehicleFile
        The vehicle with its identified model and its estimator.
    place_std_m : float
        Standard deviation [m] with which the driver returned to the place. For the heading it is 2°.

    Returns
    -------
    Closure
        The gyro scale, its standard deviation, and both as values of the vehicle file.

    Raises
    ------
    AnswerNo
        If the run or the file lacks a gyro, or the estimate is not finite. If the lap does not determine the scale
        within MAX_SCALE_ERROR. If no scale explains the end of the lap (6), or the scale contradicts the file (7).
    Invalid
        If `place_std_m` is not positive.
    FileError
        If the file lacks the noise of its estimator: `identify` finds it.
    """
    return end_closure(lap_end(run, vehicle_file, place_std_m), vehicle_file, run.name)


def lap_end(run: Run, vehicle_file: VehicleFile, place_std_m: float = 0.01) -> LapEnd:
    """Return the estimated end of a lap, near its best scale; parameters and errors as for `lap_closure`."""
    if not (0.0 < place_std_m < np.inf):
        raise Invalid.of("marks.place-std", value=place_std_m)
    name = _gyro_name(run, vehicle_file)
    sensor = getattr(vehicle_file.sensors, name)
    lap, from_ns, start = _marked_lap(run)

    def end(kappa: float) -> tuple[np.ndarray, np.ndarray, float]:
        """Return e (3,), P (3, 3), and the turn of the lap [rad], with the scale s₀ e^κ."""
        path, scale = f"sensors.{name}.gyro_scale", sensor.gyro_scale * float(np.exp(kappa))
        rescaled_file = vehicle_file.with_values({path: scale, f"{path}_std": 0.0})
        log = replay(lap, rescaled_file, backend="python", **start).estimate
        assert log is not None
        eta, P = log.eta[np.searchsorted(log.t_ns, from_ns) :], log.cov[-1, :3, :3]
        if not (np.isfinite(eta).all() and np.isfinite(P).all()):
            kind = vehicle_file.kind("estimator").__name__
            raise AnswerNo.of("marks.no-covariance", name=run.name, kind=kind)
        e, turn_rad = eta[-1] - eta[0], np.sum(wrap(np.diff(eta[:, 2])))
        return np.array([e[0], e[1], wrap(e[2])]), P, float(turn_rad)

    e, P, turn_rad = end(0.0)
    change = end(SCALE_STEP)[0] - e
    J = np.array([change[0], change[1], wrap(change[2])]) / SCALE_STEP
    lap_end = LapEnd(
        name, e, J, P + np.diag(np.square([place_std_m, place_std_m, MARK_STD_RAD])), turn_rad, e
    )
    if not lap_end.std <= MAX_SCALE_ERROR:
        figures = {"gyro": name, "tolerance_percent": 100.0 * MAX_SCALE_ERROR}
        raise AnswerNo.of("marks.lap-no-scale", name=run.name, **figures)
    kappa = float(np.clip(lap_end.kappa, -MAX_SCALE_ERROR, MAX_SCALE_ERROR))
    return lap_end._replace(e=end(kappa)[0] - J * kappa)


def end_closure(end: LapEnd, vehicle_file: VehicleFile, run_name: str) -> Closure:
    """Return the gyro scale that the end of a lap determines. Raise AnswerNo by (6) or (7)."""
    sensor = getattr(vehicle_file.sensors, end.gyro)
    kappa, std, file_std = end.kappa, end.std, sensor.gyro_scale_std
    _require_return(run_name, end.gyro, end.e + end.J * kappa, end.V)
    _require_agreement(run_name, end.gyro, sensor, kappa, std)
    share = file_std**2 / (file_std**2 + std**2) if file_std > 0.0 else 1.0
    scale = sensor.gyro_scale * float(np.exp(share * kappa))
    scale_std, turns = scale * float(np.sqrt(share)) * std, round(end.turn_rad / (2.0 * np.pi))
    values, gap_m = _gyro_values(vehicle_file, end.gyro, scale, scale_std), float(np.hypot(*end.file_e[:2]))
    return Closure(end.gyro, turns, end.turn_rad, scale, scale_std, values, {}, None, gap_m)


def _require_return(run_name: str, gyro: str, residual: np.ndarray, V: np.ndarray) -> None:
    """Raise AnswerNo if `residual` (3,), the end of a lap with its best scale, is improbable for `V`.  (6)"""
    chi2 = float(residual @ np.linalg.solve(V, residual))
    if not chi2 <= MAX_RESIDUAL_CHI2:
        gaps = {"gap_m": float(np.hypot(*residual[:2])), "turn_deg": np.degrees(wrap(residual[2]))}
        figures = {"name": run_name, "gyro": gyro, "chi2": chi2, "maximum": MAX_RESIDUAL_CHI2}
        fix = baqueano_command("teach", "lab", "--driver", "keys", "--closed", "--update")
        raise AnswerNo.of("marks.lap-open", fix, **gaps, **figures)


def _require_agreement(run_name: str, gyro: str, sensor: Tree, kappa: float, std: float) -> None:
    """Raise AnswerNo if the scale by the lap alone, s₀ e^κ ± `std`, contradicts its prior in the file.  (7)"""
    limit = MAX_SCALE_ERROR
    if sensor.gyro_scale_std > 0.0:
        limit = min(limit, MAX_SIGMAS * float(np.hypot(sensor.gyro_scale_std, std)))
    if not abs(kappa) <= limit:
        figures = {"gyro": gyro, "value": sensor.gyro_scale * np.exp(kappa), "file": sensor.gyro_scale}
        percent = {"percent": 100.0 * kappa, "max_percent": 100.0 * limit}
        fix = baqueano_command("drive", "--update")
        raise AnswerNo.of("marks.lap-other-scale", fix, "", name=run_name, **figures, **percent)


def _marked_lap(run: Run) -> tuple[Run, int, dict[str, Any]]:
    """Return the run until its last mark, the time of its first mark [ns], and the first pose as a keyword of `replay`.

    The run begins at rest on the first mark, so that the covariance at its end contains only the motion since this
    mark. Raise AnswerNo for fewer than two ticks between the marks.
    """
    marks = mark_times_ns(run)
    from_ns, to_ns = (marks[0], marks[-1]) if len(marks) > 1 else (run.t_ns[:1], run.t_ns[-1:])
    ticks = np.count_nonzero((run.t_ns >= from_ns) & (run.t_ns <= to_ns)) if len(run.t_ns) else 0
    if ticks < 2:
        raise AnswerNo.of("marks.no-lap", name=run.name, ticks=ticks)
    from_ns, to_ns = int(np.squeeze(from_ns)), int(np.squeeze(to_ns))
    motions_ns = run.t_ns[np.any(run.applied_commands != 0.0, axis=1) & (run.t_ns <= from_ns)]
    if not len(motions_ns):
        return run.cut(0.0, float(seconds(to_ns + 1, run.t_ns[0]))), from_ns, {}
    rest_ns = min(int(motions_ns[-1]) + round(REST_S * NANOSECONDS), from_ns)
    lap = run.cut(*(float(seconds(t_ns, run.t_ns[0])) for t_ns in (rest_ns, to_ns + 1)))
    return lap, from_ns, {"eta": np.zeros(3)}


def _gyro_name(run: Run, vehicle_file: VehicleFile) -> str:
    """Return the name of the sensor with a gyro. Raise AnswerNo if the file or the run does not have one."""
    sensors = vehicle_file.sensors._asdict().items()
    name = next((n for n, s in sensors if is_imu(s) and n in run.sensors), None)
    if name is None:
        raise AnswerNo.of("marks.no-gyro", name=run.name)
    return name


def _gyro_values(vehicle_file: VehicleFile, name: str, scale: float, std: float) -> dict[str, object]:
    """Return the values of the vehicle file for a gyro scale. The model's speed keeps the error of the old scale."""
    path, estimator = f"sensors.{name}.gyro_scale", vehicle_file.estimator()
    values = {path: _round_to_five_digits(scale), f"{path}_std": float(f"{std / scale:.2g}")}
    if not has_field(estimator, "speed_per_gyro_scale") or estimator.speed_per_gyro_scale == 0.0:
        return {**values}
    old_std, (offset, slope) = getattr(vehicle_file.sensors, name).gyro_scale_std, estimator.speed_error_std
    speed = [float(offset), float(f"{np.hypot(slope, estimator.speed_per_gyro_scale * old_std):.3g}")]
    return {**values, "estimator.speed_error_std": speed, "estimator.speed_per_gyro_scale": 0.0}


def _turn_std(sensor: Tree, bias_std: float, t_s: float) -> float:
    """Return the standard deviation [rad] of the turn after `t_s` seconds, the root of (2)."""
    walk, noise = sensor.gyro_bias_walk**2 * t_s**3 / 3.0, sensor.gyro_noise_std**2 * t_s / sensor.rate_hz
    return float(np.sqrt(MARK_STD_RAD**2 + (bias_std * t_s) ** 2 + walk + noise))


def _turn_count(turned_rad: float, name: str) -> int:
    """Return the number k of turns between two marks. Raise AnswerNo if the turn is not whole, or over MAX_TURNS."""
    turns = round(turned_rad / (2.0 * np.pi))
    residual_rad = abs(turned_rad - 2.0 * np.pi * turns)
    if abs(turns) > MAX_TURNS or residual_rad > max(
        2.0 * np.pi * MAX_TURN_ERROR * abs(turns), 3.0 * MARK_STD_RAD
    ):
        figures = {
            "turn_deg": np.degrees(turned_rad),
            "tolerance_percent": 100 * MAX_TURN_ERROR,
            "maximum": MAX_TURNS,
        }
        raise AnswerNo.of("marks.no-whole-turn", subject=name, **figures)
    return turns


def _rest_bias(run: Run, channel: Channel) -> tuple[float, float]:
    """Return the gyro's zero while the vehicle was at rest, and its standard deviation [rad/s].

    Raise AnswerNo if the rest was too short.
    """
    is_moving = np.any(run.applied_commands != 0.0, axis=1)  # an unknown command (NaN) is treated as motion
    last_motion_ns = np.maximum.accumulate(np.where(is_moving, run.t_ns, run.t_ns[0] - round(REST_S * 1e9)))
    tick = np.clip(np.searchsorted(run.t_ns, channel.t_ns), 0, len(run.t_ns) - 1)
    at_rest = (
        ~is_moving[tick]
        & (seconds(channel.t_ns, last_motion_ns[tick]) >= REST_S)
        & np.isfinite(channel.z[:, -1])
    )
    z = channel.z[at_rest, -1]
    period_s = float(np.median(seconds(np.diff(channel.t_ns)))) if len(channel.t_ns) > 1 else 1.0
    if len(z) * period_s < MIN_REST_S:
        raise AnswerNo.of("marks.stood-too-short", name=run.name, rest_s=len(z) * period_s)
    return float(np.mean(z)), float(np.std(z) / np.sqrt(len(z)))


def _integral(channel: Channel, column: int, bias: float, from_ns: int, to_ns: int) -> float:
    """Return ∫ (z − b) dt of a column of `channel` between two times [ns], by the trapezoidal rule."""
    is_finite = np.isfinite(channel.z[:, column])
    t_s = seconds(channel.t_ns[is_finite], channel.t_ns[0])
    end_times_s = [seconds(t, channel.t_ns[0]) for t in (from_ns, to_ns)]
    z = channel.z[is_finite, column] - bias
    is_inner = (t_s > end_times_s[0]) & (t_s < end_times_s[1])
    t = np.concatenate([end_times_s[:1], t_s[is_inner], end_times_s[1:]])
    heights = np.interp(t, t_s, z)
    return float(np.sum(0.5 * (heights[1:] + heights[:-1]) * np.diff(t)))


def _gain(sensor: Sensor) -> float:
    """Return the gyro's reading for a yaw rate of 1 rad/s, by the sensor model of the vehicle file."""
    unit_turn, none = (
        Motion(np.zeros(3), np.array([0.0, 0.0, w]), np.zeros(3), np.zeros(2)) for w in (1.0, 0.0)
    )
    return float(sensor.h(unit_turn)[-1] - sensor.h(none)[-1])


def _speed_scale(name: str, sensor: Sensor) -> tuple[str, Value]:
    """Return (path in the vehicle file, value) of the scale of a speed sensor."""
    field = "radius_scale" if has_field(sensor, "radius_scale") else "scale"
    return f"sensors.{name}.{field}", getattr(sensor, field)


def _distances(run: Run, vehicle_file: VehicleFile, from_ns: int, to_ns: int) -> dict[str, float]:
    """Return the distance [m] that each speed sensor measured between two times [ns], with its scale in the file."""
    distances = {}
    for name, sensor in vehicle_file.sensors._asdict().items():
        if name in run.sensors and (has_field(sensor, "radius_scale") or has_field(sensor, "scale")):
            scales = np.atleast_1d(_speed_scale(name, sensor)[1])
            channel_distances = [
                _integral(run.sensors[name], k, 0.0, from_ns, to_ns) / s for k, s in enumerate(scales)
            ]
            distances[name] = float(np.mean(channel_distances))
    return distances


def _round_to_five_digits(value: float) -> float:
    return float(f"{value:.5g}")


def _compact_text(value: object) -> str:
    return str(value).replace(" ", "")
