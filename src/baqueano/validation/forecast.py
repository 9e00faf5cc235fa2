"""Forecast the error of an open-loop drive that follows from the errors of a fit.

    ∂η_k/∂θ along the drive, from the equations of the model                                              (1)
    Σ_η = (∂η/∂θ) P (∂η/∂θ)ᵀ,   position √(Σ_xx + Σ_yy),   heading √Σ_ψψ                                  (2)
    η: the pose after HORIZON_S relative to its start, once per second of the runs of the fit               (3)
    + max(0, mean d₁ᵀ d₂ + tr Σ_η) over windows of the runs,   d_i: (3) of ν + H⁺ r_i, minus (3) of ν        (4)
    + (2) of S C Sᵀ,   S = ∂θ̂/∂κ,   C of the parameters κ that were not fitted: information.py               (5)

P is the covariance of the fit without the shifts by effects that the model lacks. Along the runs these effects and
shifts cancel; what remains is in the residuals r. H = ∂h/∂ν of wheels, gyro, odometer. r₁, r₂ are every second
residual, so their white noise cancels. A fit reduces the errors of its own runs by Σ_η (Akaike 1970), so (4) adds it
(docs/derivations/robust_covariance.md). The residuals do not show (5). Above MAX_HEADING_STD_RAD the position is lost.
Process noise and another voltage add to the forecast. The model drives the lap with the recommended controller and a
known pose, at the mean voltage of the runs. Then it repeats the commands in open loop.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from baqueano.contracts.result import Result
from baqueano.contracts.values import TableRow, Tree
from baqueano.diagnostics import Diagnostic, Verdict, note
from baqueano.errors import BaqueanoError, UsageError
from baqueano.estimators.readings.sensor_numbers import measurement_jacobian
from baqueano.geometry import map_from_body, wrap
from baqueano.guides.route import Route
from baqueano.guides.shapes import sinuous_circle
from baqueano.identify.data.added_channels import VOLTAGE_KEY, with_voltage
from baqueano.identify.data.record import FitRecord, make_record
from baqueano.identify.parameters.free import free_parameter, value
from baqueano.identify.residuals.motion import motion_rows, open_loop
from baqueano.identify.result.fit_result import ChannelFit, Fit
from baqueano.messages import text, texts, with_full_stop
from baqueano.messages.language import number, translate as _
from baqueano.messages.printable import baqueano_command
from baqueano.runs.diagnostics.timestamps import check_timestamps
from baqueano.runs.run import Run
from baqueano.sensors.sampling import is_imu
from baqueano.signals import NANOSECONDS, seconds
from baqueano.simulate.closed_loop import closed_loop, drive_tick_count, loop_system, start_pose
from baqueano.simulate.open_loop import tick_times
from baqueano.simulate.system import Input, begin

NU = slice(3, 6)  # of (η, ν, ν̇)
MIN_SINGULAR = 1e-3  # singular value of H: below it a direction of ν is not measured; its error counts as 0
GYRO_WEIGHT = 100.0  # wheels also slip, so the gyro determines the error of the yaw rate
HORIZON_S = 10.0
STEP_S = 1.0  # between the beginnings of windows
MIN_DRIVEN_SHARE = 0.5  # least part of the ticks of a window with a command
MAX_HEADING_STD_RAD = 0.5  # standard deviation of the heading above which (2) is not valid for the position
LAP_RATE = 0.25  # 1/s: speed over radius of the default lap
MAX_LAP_ERROR = 0.1  # fraction of the size of a lap: with a larger rms error the vehicle leaves the lap


class DriveForecast(NamedTuple):
    """One drive, and the standard deviations of the pose at its end."""

    drive: Diagnostic
    duration_s: float
    distance_m: float
    position_m: float
    heading_rad: float

    @property
    def message(self) -> Diagnostic:
        """Return the drive and its errors as a message."""
        code = "forecast.lost" if self.heading_rad > MAX_HEADING_STD_RAD else "forecast.error"
        details = {"drive": self.drive, "duration_s": self.duration_s, "distance_m": self.distance_m}
        degrees = float(np.degrees(self.heading_rad))
        heading = f"{number(degrees):.2g}" if degrees < 10.0 else f"{number(degrees):.0f}"
        return note(code, **details, position=_length(self.position_m), heading_deg=heading)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Forecast(Result):
    """Open-loop errors that follow from the errors of a fit, drive by drive.

    Parameters
    ----------
    drives : tuple of DriveForecast
        Each drive, and the standard deviations of the pose at its end [m, rad].
    notes : tuple of Diagnostic or str
        Errors that the forecast does not contain.

    Examples
    --------
    >>> drive = DriveForecast(note("forecast.as-the-runs"), 10.0, 1.9, 0.02, 0.05)
    >>> Forecast((drive,), ()).rows()[0]["position_m"]
    0.02
    """

    drives: tuple[DriveForecast, ...]
    notes: tuple[Diagnostic | str, ...]

    def rows(self) -> list[TableRow]:
        """Return one flat row per drive, in SI units."""
        return [
            drive._asdict() | {"drive": text(drive.drive), "text": text(drive.message)}
            for drive in self.drives
        ]

    @property
    def sentences(self) -> tuple[str, ...]:
        """Return a sentence per drive, then the errors that the forecast does not contain."""
        return (*texts(drive.message for drive in self.drives), *map(with_full_stop, texts(self.notes)))

    def table(self) -> str:
        """Return the sentences as text."""
        return "\n".join(self.sentences)


class _ModelDrive(NamedTuple):
    """Motion of the model along a drive, and its derivatives."""

    t_s: np.ndarray  # (N,)
    eta: np.ndarray  # (N, 3)
    derivatives: np.ndarray  # (N, 3, p)
    u: np.ndarray  # (N, n)
    measured: tuple[np.ndarray, ...] = ()  # two paths (N, 3) with the velocity that the residuals show  (4)


def forecast(fit: "Fit", runs: Run | Sequence[Run], route: Route | None = None, name: str = "") -> Forecast:
    """Return the open-loop errors that follow from the errors of a fit, over HORIZON_S of its runs and over one lap.

    Parameters
    ----------
    fit : Fit
        A usable fit.
    runs : Run or sequence of Run
        The runs of the fit.
    route : Route, optional
        The lap; default: a sinuous circle at the speed of the runs.
    name : str
        Name of the route.

    Returns
    -------
    Forecast
        Two drives, or one if the model cannot drive the lap.

    Raises
    ------
    UsageError
        If the fit is refused, if none of its parameters of the model has a finite error, or if it diverges along a
        drive.

    Examples
    --------
    >>> from baqueano.identify import identify, random_steps
    >>> small = bq.load("small")
    >>> run = bq.simulate(small, random_steps(small.command.limit, 30.0, small.rate_hz, 1))
    >>> prediction = forecast(identify(run, small, ["model.actuator_matrix[0,0]", "model.friction.linear[0]"]), run)
    >>> len(prediction.drives), prediction.drives[0].position_m < 0.1
    (2, True)
    """
    runs = [runs] if isinstance(runs, Run) else list(runs)
    if fit.verdict == Verdict.REFUSED:
        raise UsageError.of("forecast.refused")
    entries = [k for k, n in enumerate(fit.names) if n.startswith("model.") and np.isfinite(fit.std[k])]
    if not entries:
        raise UsageError.of("forecast.no-errors")
    fixed_paths = [path for path in fit.fixed.paths if path.startswith("model.")]
    paths = (*(fit.names[k] for k in entries), *fixed_paths)
    covs = _covariances(fit, entries, fixed_paths)
    segments = [segment for run in runs for segment in check_timestamps(run, fit.file.rate_hz)[0]]
    records = [
        with_voltage([make_record(segment, {})], [segment], fit.blocks, is_needed=False)[0]
        for segment in segments
    ]
    volts = [record.sensors[VOLTAGE_KEY].z for record in records if VOLTAGE_KEY in record.sensors]
    kernel, theta = open_loop(
        fit.blocks.model, paths, lambda motion: motion.eta, fit.backend, bool(volts)
    )  # (1)
    drives = []
    for segment, record in zip(segments, records, strict=True):
        drive, channels = _drive(kernel, theta, motion_rows(record), record.u), fit.channels_of(segment)
        drives.append(drive._replace(measured=_measured_paths(fit, channels, record, drive.eta)))
    forecasts: list[DriveForecast] = [_forecast_windows(drives, covs)[0]]
    notes: list[Diagnostic | str] = _fixed_notes(fit, drives, covs, forecasts[0])
    if not volts:
        notes += _battery_notes(fit, drives[0], motion_rows(records[0]))
    lap, reason = _lap(fit, paths, theta, _forecast_route(drives) if route is None else route)
    if lap is None:
        notes.append(reason)
    else:
        title = note("forecast.lap") if route else note("forecast.lap-of-circle")
        title = note("forecast.lap-of", name=name) if name else title
        mean_volts = [np.full((len(lap[0]), 1), np.mean(np.concatenate(volts)))] if volts else []
        lap_drive = _drive(kernel, theta, np.column_stack([*lap, *mean_volts]), lap[1])
        _, misfit = _forecast_windows(drives, covs, float(lap_drive.t_s[-1]))
        forecasts.append(_forecast_drive(title, lap_drive, _variances(lap_drive, 0, -1, covs)[0] + misfit))
        notes += _outside_envelope(fit, lap[1])
    if not np.isfinite([forecasts[1:] for forecasts in forecasts]).all():
        raise UsageError.of("forecast.diverged")
    if fit.unobservable:
        notes.append(note("forecast.unidentifiable-exact"))
    notes.append(note("forecast.more-errors"))
    return Forecast(tuple(forecasts), tuple(message for message in notes if message))


def _covariances(fit: "Fit", entries: list[int], fixed_paths: list[str]) -> np.ndarray:
    """Return covariances (1 + K, p, p) of the fitted parameters `entries` and of `fixed_paths`: by the errors of the
    fit, and by each of the K fixed parameters.  (5)"""
    paths, C = fit.fixed.paths, fit.fixed.cov
    direct = np.array([[path == x for x in fixed_paths] for path in paths]).reshape(
        len(paths), len(fixed_paths)
    )
    S = np.hstack([fit.fixed.shifts[:, entries], direct])
    covs = np.zeros((1 + len(paths), S.shape[1], S.shape[1]))
    data_cov = fit.cov - fit.unmodelled_cov - fit.fixed.estimate_cov
    covs[0, : len(entries), : len(entries)] = data_cov[np.ix_(entries, entries)]
    cross = S[:, :, None] * (C @ S)[:, None, :]
    covs[1:] = 0.5 * (cross + cross.transpose(0, 2, 1))
    return covs


def _fixed_notes(
    fit: "Fit", drives: Sequence["_ModelDrive"], covs: np.ndarray, total: DriveForecast
) -> list[Diagnostic | str]:
    """Return a note if the parameters that were not fitted cause most of the variance of the position."""
    if not _forecast_windows(drives, covs[:1])[0].position_m ** 2 < 0.5 * total.position_m**2:
        return []
    others = [
        _forecast_windows(drives, np.delete(covs, 1 + k, axis=0))[0] for k in range(len(fit.fixed.paths))
    ]
    k = int(np.argmin([other.position_m for other in others]))
    path, std = fit.fixed.paths[k], float(np.sqrt(fit.fixed.cov[k, k]))
    parameter, x = free_parameter(fit.blocks, path, {}), value(fit.blocks, path)
    if parameter.definition.role == "scale" and (subject := path.split(".")[1]) in _imus(fit):
        fix = baqueano_command("runs", "calibrate", "last", "--update")
        return [note("forecast.scales", fix=fix, subject=subject, percent=100.0 * std / abs(x))]
    return [note("forecast.fixed", subject=path, value=x, std=std, unit=parameter.unit)]


def _battery_notes(fit: "Fit", drive: "_ModelDrive", rows: np.ndarray) -> list[Diagnostic | str]:
    """Return a note on the speed of a drive at the least voltage of the battery, if the file states one."""
    low_v, drivetrain = fit.file.robot.least_battery_v, getattr(fit.blocks.model, "drivetrain", None)
    full_v = float(getattr(drivetrain, "battery_v", 0.0))
    if not 0.0 < low_v < full_v:
        return []
    kernel, _ = open_loop(fit.blocks.model, ("model.drivetrain.battery_v",), lambda m: m.eta, fit.backend)
    weak = np.asarray(kernel.run(np.ascontiguousarray(rows), np.array([low_v]))[1])
    distances_m = [float(np.sum(np.hypot(*np.diff(eta[:, :2], axis=0).T))) for eta in (drive.eta, weak)]
    percent = 100.0 * (1.0 - distances_m[1] / max(distances_m[0], 1e-9))
    return [note("forecast.battery", low_v=low_v, full_v=full_v, percent=percent)]


def _imus(fit: "Fit") -> list[str]:
    return [name for name, sensor in fit.file.sensors._asdict().items() if is_imu(sensor)]


def _drive(kernel: Any, theta: np.ndarray, rows: np.ndarray, u: np.ndarray) -> _ModelDrive:
    eta, slopes = kernel.sensitivities(np.ascontiguousarray(rows), theta)
    return _ModelDrive(np.cumsum(rows[:, 0]), np.asarray(eta), np.asarray(slopes), u)


def _measured_paths(
    fit: "Fit", channels: Sequence[ChannelFit], record: FitRecord, eta: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Return the path `eta` (N, 3) with the velocity errors that every second residual shows, and that the others
    show; () if the residuals are white, or if no channel measures a velocity.  (4)"""
    H, residuals, weights = [], [], []
    for c in channels:
        sensor = getattr(fit.blocks.sensors, c.sensor)
        weight = GYRO_WEIGHT if is_imu(sensor) else 1.0
        row = weight / c.sigma * measurement_jacobian(sensor)[c.entry]
        finite_indices = np.flatnonzero(np.isfinite(c.residuals))
        if np.any(row[NU]) and not np.any(np.delete(row, NU)) and len(finite_indices) > 1:
            halves = (finite_indices[half::2] for half in (0, 1))
            scaled_residuals = weight / c.sigma * c.residuals
            residuals.append([np.interp(record.t_s, c.t_s[k], scaled_residuals[k]) for k in halves])
            H.append(row[NU])
            weights.append(weight)
    if not (fit.autocorrelated and H):
        return ()
    inverse = np.linalg.pinv(np.array(H), rcond=MIN_SINGULAR / max(weights))
    errors = np.einsum("ic,chk->hki", inverse, np.array(residuals)) * record.dt_s[:, None]
    heading, xy = np.unwrap(eta[:, 2]), eta[:, 0] + 1j * eta[:, 1]
    step = np.diff(xy, prepend=xy[:1]) * np.exp(-1j * heading) + errors[..., 0] + 1j * errors[..., 1]
    headings = heading + np.cumsum(errors[..., 2], axis=1)
    paths = np.cumsum(np.exp(1j * headings) * step, axis=1)
    return tuple(np.stack([np.real(paths), np.imag(paths), headings], axis=2))


def _forecast_windows(
    drives: Sequence[_ModelDrive], covs: np.ndarray, horizon_s: float = HORIZON_S
) -> tuple[DriveForecast, np.ndarray]:
    """Return the root mean square of the errors over the windows of the runs (3), and the variances (2,) of (4)."""
    longest_s = max(float(drive.t_s[-1] - drive.t_s[0]) for drive in drives)
    ahead_s = min(horizon_s, 0.999 * longest_s)
    variances, distances_m = [], []
    for drive in drives:
        a = np.unique(np.searchsorted(drive.t_s, np.arange(drive.t_s[0], drive.t_s[-1] - ahead_s, STEP_S)))
        b = np.minimum(np.searchsorted(drive.t_s, drive.t_s[a] + ahead_s), len(drive.t_s) - 1)
        moving_ticks = np.concatenate([[0], np.cumsum(np.any(drive.u != 0.0, axis=1))])
        distance_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(drive.eta[:, :2], axis=0).T))])
        for i, j in zip(a, b, strict=True):
            if moving_ticks[j] - moving_ticks[i] >= MIN_DRIVEN_SHARE * (j - i):
                variances.append(_variances(drive, i, j, covs))
                distances_m.append(distance_m[j] - distance_m[i])
    longest_drive = max(drives, key=lambda drive: len(drive.u))
    fit_variance, misfit = np.mean(variances or [_variances(longest_drive, 0, -1, covs)], axis=0)
    misfit = np.maximum(misfit, 0.0)
    if not variances:  # almost without commands: use the whole longest run
        return _forecast_drive(note("forecast.repeat-longest"), longest_drive, fit_variance + misfit), misfit
    position_m, heading_rad = np.sqrt(np.maximum(fit_variance + misfit, 0.0)).tolist()
    title, distance = note("forecast.as-the-runs"), float(np.mean(distances_m))
    return DriveForecast(title, ahead_s, distance, position_m, heading_rad), misfit


def _forecast_drive(title: Diagnostic, drive: _ModelDrive, variances: np.ndarray) -> DriveForecast:
    position_m, heading_rad = np.sqrt(np.maximum(variances, 0.0)).tolist()
    distance_m = float(np.sum(np.hypot(*np.diff(drive.eta[:, :2], axis=0).T)))
    return DriveForecast(title, float(drive.t_s[-1]), distance_m, position_m, heading_rad)


def _variances(drive: _ModelDrive, i: int, j: int, covs: np.ndarray) -> np.ndarray:
    """Return variances (2, 2) of position and heading of the pose at row j, relative to the pose at row i: by the
    errors of the parameters (2), (5), and by the misfit (4). `covs` (c, p, p) are P, and the covariance of (5)."""
    J = map_from_body(drive.eta[i, 2])
    derivative_change = drive.derivatives[j] - drive.derivatives[i]
    displacement = drive.eta[j] - drive.eta[i]
    # ∂(Jᵀ way)/∂ψ_i, in the map
    rotation = np.outer(np.array([displacement[1], -displacement[0], 0.0]), drive.derivatives[i, 2])
    jacobian = J.T @ (derivative_change + rotation)
    x, y, psi = np.einsum("ip,cpq,iq->ic", jacobian, covs, jacobian)
    error_variances = np.array([x + y, psi])
    fit_variance, total = error_variances[:, 0], error_variances.sum(axis=1)
    if not drive.measured:
        return np.array([total, 0.0 * fit_variance])
    errors = [
        map_from_body(path[i, 2]).T @ (path[j] - path[i]) - J.T @ displacement for path in drive.measured
    ]
    x, y, psi = np.prod([[*error[:2], wrap(error[2])] for error in errors], axis=0)
    return np.array([total, fit_variance + np.array([x + y, psi])])


def _forecast_route(drives: Sequence[_ModelDrive]) -> Any:
    """Return a lap at the median speed of the runs while they move."""
    steps = [(np.hypot(*np.diff(drive.eta[:, :2], axis=0).T), np.diff(drive.t_s)) for drive in drives]
    speeds_m_s = np.concatenate([step_m / np.maximum(step_s, 1e-9) for step_m, step_s in steps])
    lap_speed_m_s = LAP_RATE
    if np.any(speeds_m_s > 0.0):
        lap_speed_m_s = float(np.median(speeds_m_s[speeds_m_s > 0.1 * np.quantile(speeds_m_s, 0.95)]))
    lap_speed_m_s = float(f"{lap_speed_m_s:.1g}")
    size_m = lap_speed_m_s / LAP_RATE
    return sinuous_circle(size_m, 0.1 * size_m, 6, lap_speed_m_s)


def _lap(
    fit: Fit, paths: tuple[str, ...], theta: np.ndarray, route: Route
) -> tuple[tuple[np.ndarray, np.ndarray] | None, Diagnostic | str]:
    """Return steps (N,) and commands (N, n) of a lap that the model drives, or None and the reason."""
    vehicle_file = fit.vehicle_file
    gain_paths = (f"controller.vehicle.{path.removeprefix('model.')}" for path in paths)
    try:
        system = loop_system(
            vehicle_file, route, perfect=True, controller=vehicle_file.controller("pd_feedforward")
        )
        kernel = closed_loop(
            system, vehicle_file.rate_hz, noise=False, backend=fit.backend, output=_command_and_pose,
            paths=(*paths, *gain_paths),
        )  # fmt: skip
        t_ns = tick_times(drive_tick_count(system, vehicle_file.rate_hz), vehicle_file.rate_hz)
        start = begin(system, start_pose(system))
    except (BaqueanoError, ValueError, AttributeError, TypeError) as error:  # a custom vehicle
        return None, note("forecast.no-controller", error=str(error))
    _, (u, eta, reference) = kernel.run(Input(t_ns, None), np.tile(theta, 2), carry=start)
    size_m = 0.5 * float(np.max(np.ptp(np.asarray(route.eta)[:, :2], axis=0)))
    rms_error_m = float(np.sqrt(np.mean(np.sum((eta[:, :2] - reference[:, :2]) ** 2, axis=1))))
    if not rms_error_m < MAX_LAP_ERROR * size_m:
        return None, note("forecast.strays", distance=_length(rms_error_m))
    return (seconds(np.diff(t_ns, prepend=0)), np.asarray(u)), ""


def _command_and_pose(outputs: Tree) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return outputs.record.tick.u, outputs.truth.eta, outputs.record.reference.eta


def _outside_envelope(fit: "Fit", u: np.ndarray) -> tuple[Diagnostic, ...]:
    """Return a message if the lap contains commands outside the range of the fit, else an empty tuple."""
    t_ns = np.arange(1, len(u) + 1) * NANOSECONDS
    flags = fit.envelope.range_warnings(Run(_("The lap"), None, t_ns, u))
    return flags[:1]


def _length(length_m: float) -> str:
    """Return a length as text, "3.2 cm" or "1.4 m"."""
    if not np.isfinite(length_m):
        return "∞ m"
    return f"{number(100.0 * length_m):.2g} cm" if length_m < 0.995 else f"{number(length_m):.2g} m"
