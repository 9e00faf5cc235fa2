"""Estimate Q and R of a filter: the noise of sensors and model.

Q is the measurement noise, R the process noise of (ν, ν̇) per tick (Thrun's letters, and the paper's).

    Q = cov(z − h), in motion and at rest                     Grotz et al., `equ:covarianza`              (1)
    R = cov(μ_t − g(u_t, μ_{t−1})),  μ = (ν, ν̇) the truth of a simulation                                 (2)
    R = arg min Σ_t ½ (log |S_t| + ρ(y_tᵀ S_t⁻¹ y_t)),  R diagonal, without a truth                       (3)

z − h are the residuals of the fit, clipped at 4 σ. If they are autocorrelated, Q is half the covariance of the
differences of neighbours, which removes a drift. g is the prediction of the estimator, in its mode; (3) is the
likelihood of its innovations y with covariance S (process_noise.py). Both are symmetric positive definite: standard
deviations are at least MIN_RELATIVE_STD of the signal's size, eigenvalues of the correlation at least
`MIN_EIGENVALUE`. `notes` lists the raised values. Errata 5: the paper's printed Q and R are not positive definite.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

from baqueano.calibration.hand_measurements import HAND_SENSORS
from baqueano.calibration.rest import is_at_rest
from baqueano.contracts.calls import checked_call
from baqueano.contracts.optional import check_noise_fields, is_dynamic
from baqueano.contracts.result import Result
from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, Severity, Verdict, note
from baqueano.errors import UsageError
from baqueano.estimators import AugmentedEkf
from baqueano.estimators.augmented.state import layout
from baqueano.identify.noise.filter_noise import FIELDS, filter_noise, simulated_noise
from baqueano.identify.noise.held_out import Acceptance, SpeedChannels, speed_channels, validate_noise
from baqueano.identify.noise.process_noise import MIN_RELATIVE_STD, process_covariance, process_errors
from baqueano.identify.result.fit_result import Fit
from baqueano.messages import texts
from baqueano.messages.language import number, shown_unit, translate as _
from baqueano.messages.text_table import text_table
from baqueano.numerics.autocorrelation import WHITE_LIMIT
from baqueano.numerics.statistics import row_cov
from baqueano.parameter import parameters
from baqueano.runs.run import Run
from baqueano.signals import NANOSECONDS
from baqueano.vehicle_file.units import channel_units

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject, TableRow
    from baqueano.vehicle_file import VehicleFile

MIN_EIGENVALUE = 1e-6  # least eigenvalue of a correlation matrix
MIN_STD = 1e-9  # least standard deviation, in its unit
CLIP_SIGMA = 4.0  # standard deviations
MIN_SAMPLES = 30  # samples for a variance or covariance
CODES = "noise.of-its-rest", "noise.of-its-readings", "noise.without-readings"
STATES = ("nu_x", "nu_y", "nu_psi", "nu_dot_x", "nu_dot_y", "nu_dot_psi")
STATE_UNITS = ("m/s", "m/s", "rad/s", "m/s²", "m/s²", "rad/s²")


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Noise(Result):
    """Noise covariances of sensors and model.

    Parameters
    ----------
    in_motion : dict of str to ndarray (m, m)
        Sensor → Q [products of the units of its channels].
    at_rest : dict of str to ndarray (m, m) or None
        Sensor → Q [as above]; None with too few samples at rest, absent for a sensor that the fit did not use.
    process : ndarray (6, 6)
        R of (ν, ν̇) per tick [products of m/s, rad/s, m/s², rad/s²]; shape (0, 0) for a filter without R.
    rate_hz : float
        Ticks per second of R.
    source : str
        Source of R: "truth" or "innovations".
    notes : tuple of Diagnostic
        Changes that make Q and R positive definite.
    units : dict of str to str
        Unit of each channel, such as "imu[0]", and of a field that differs from its definition.
    fields : dict of str to ndarray (k,)
        Noise of the recommended filter [unit of each key].
    speed : SpeedChannels, optional
        Accelerometers that correct the speed in the recommended filter.
    acceptance : Acceptance, optional
        Verdict of held-out runs on the recommended filter.
    sideways_is_shown : bool
        False if no sensor in use shows the sideways velocity; its walk then comes from the file.

    Examples
    --------
    >>> noise = Noise({"imu": np.diag([0.04, 0.01])}, {"imu": None}, np.zeros((0, 0)), 100.0, "innovations", ())
    >>> noise.rows()[0]["std"]
    0.2
    """

    in_motion: dict[str, np.ndarray]
    at_rest: dict[str, np.ndarray | None]
    process: np.ndarray
    rate_hz: float
    source: str
    notes: tuple[Diagnostic, ...]
    units: dict[str, str] = field(default_factory=dict)
    fields: dict[str, np.ndarray] = field(default_factory=dict)
    speed: SpeedChannels | None = None
    acceptance: Acceptance | None = None
    sideways_is_shown: bool = True

    @property
    def verdict(self) -> Verdict:
        """Return USABLE, or WARN if a value was raised to its lower limit or held-out runs disagree."""
        is_inconsistent = self.acceptance and self.acceptance.is_inconsistent
        return Verdict.WARN if self.notes or is_inconsistent else Verdict.USABLE

    def rows(self) -> list["TableRow"]:
        """Return one flat row per entry of a diagonal, with its standard deviation."""
        rows = []
        for name, q in self.in_motion.items():
            rest = self.at_rest.get(name)
            for i in range(len(q)):
                std_at_rest = None if rest is None else float(np.sqrt(rest[i, i]))
                std, unit = float(np.sqrt(q[i, i])), self.units.get(f"{name}[{i}]", "")
                rows.append({"name": f"{name}[{i}]", "std": std, "std_at_rest": std_at_rest, "unit": unit})
        filter_fields = dict(parameters(AugmentedEkf))
        for name, values in self.fields.items():
            units = filter_fields[name].unit.partition(" (")[0].split(", ")
            for i, value in enumerate(np.atleast_1d(values)):
                label = f"{name}[{i}]" if np.ndim(values) else name
                row = {"name": label, "std": float(value), "std_at_rest": None}
                rows.append(row | {"unit": self.units.get(label, units[i % len(units)])})
        for i, state in enumerate(STATES[: len(self.process)]):
            std = float(np.sqrt(self.process[i, i]))
            rows.append({"name": state, "std": std, "std_at_rest": None, "unit": STATE_UNITS[i]})
        return rows

    def table(self) -> str:
        """Return the table as text."""
        lines = text_table(
            "<>><",
            [_("noise"), _("in motion"), _("at rest"), _("unit")],
            *(
                [row["name"], f"{number(row['std']):.3g}",
                 "-" if row["std_at_rest"] is None else f"{number(row['std_at_rest']):.3g}", shown_unit(row["unit"])]
                for row in self.rows()
            ),
        )  # fmt: skip
        if len(self.process):
            source = _("R of (ν, ν̇) per tick at {rate_hz:g} Hz, from the {source}",
                       rate_hz=self.rate_hz, source=_(self.source))  # fmt: skip
            lines.append(source)
        lines += texts([] if self.sideways_is_shown else [note("noise.sideways-of-the-file")])
        lines += texts(message.message for message in (self.speed, self.acceptance) if message)
        return "\n".join([*lines, *(f"- {message}" for message in texts(self.notes))])

    @checked_call("noise.updated_file(fit.vehicle_file)")
    def updated_file(self, vehicle_file: "VehicleFile", run: str = "") -> "VehicleFile":
        """Return the file with Q of each sensor (in motion), and with R, the other noise values and `speed_from` of
        the estimator. A sensor without noise in the file also gets white noise, for simulations."""
        from baqueano.vehicle_file import Provenance
        from baqueano.vehicle_file.file import today

        values: JsonObject = {
            f"sensors.{name}.measurement_noise_cov": q.tolist()
            for name, q in self.in_motion.items()
            if name in vehicle_file.sensors._fields
        }
        values |= simulated_noise(vehicle_file.sensors, self.in_motion)
        if len(self.process):
            values["estimator.process_noise_cov"] = self.process.tolist()
        values |= {f"estimator.{name}": value.tolist() for name, value in self.fields.items()}
        if self.speed and self.speed.is_from_held_out:
            values["estimator.speed_from"] = list(self.speed.names)
        origin = Provenance(run, today(), None, self.verdict)
        return vehicle_file.with_values(values, dict.fromkeys(values, origin))


@checked_call("bq.measure_noise(fit, run)")
def measure_noise(
    fit: "Fit",
    runs: Run | Sequence[Run],
    *,
    source: str = "auto",
    held_out: Sequence[Run] = (),
    backend: str = "auto",
) -> Noise:
    """Return the noise of sensors and model, from a fit and its runs.

    Parameters
    ----------
    fit : Fit
        The fit of the runs.
    runs : Run or sequence of Run
        The runs of the fit.
    source : str
        Source of R: "truth" of a simulation, "innovations", or "auto": the truth if a run has one.
    held_out : sequence of Run
        Runs that were not used in the fit. They decide which accelerometers are used to correct the speed,
        and if the noise is correct.
    backend : str
        "auto", "c", "python" or "numpy".

    Returns
    -------
    Noise
        Q in motion and at rest, and R; `.updated_file(fit.vehicle_file)` returns the vehicle file with them.

    Raises
    ------
    UsageError
        For an unknown source, or for "truth" if no run contains a truth.

    Notes
    -----
    Equations (1), (2) or (3) of the module.

    Examples
    --------
    >>> small, u = bq.load("small"), bq.excitation("random_steps", [1.0, 0.0, 1.0], 10.0, 100.0)
    >>> run = bq.simulate(small, u)
    >>> noise = measure_noise(bq.identify(run, small, ["model.mass_kg"]), run)
    >>> sorted(noise.fields)[:2], np.sqrt(np.diag(noise.in_motion["imu"])).round(3)
    (['course_std', 'disturbance_fade_s'], array([0.104, 0.1  , 0.004]))
    """
    runs = [runs] if isinstance(runs, Run) else list(runs)
    if source not in ("auto", "truth", "innovations"):
        raise UsageError.of("noise.unknown-source", value=source)
    check_noise_fields(fit.file.sensors)
    notes: list[Diagnostic] = []
    in_motion, at_rest = _measurement(fit, runs, notes)
    units = channel_units(fit.file) | channel_units(fit.file, fit.blocks.sensors)
    if not is_dynamic(fit.blocks.model):
        units |= {"disturbance_std[0]": "m/s", "disturbance_std[1]": "rad/s"}
    if fit.file.kind("estimator") is AugmentedEkf:
        estimator, covariances = fit.file.estimator(), dict(in_motion)
        filters = cache(lambda names: filter_noise(fit, runs, covariances, at_rest, backend, names))
        speed = speed_channels(filters, estimator.speed_from, held_out, backend)
        names, check = speed.names if speed else estimator.speed_from, None
        ekf = filters(names)
        if held_out:
            make_filter = partial(filter_noise, fit, [*runs, *held_out], covariances, at_rest, backend, names)
            ekf, check = validate_noise(ekf, make_filter, held_out, backend)
        in_motion |= {name: getattr(ekf.sensors, name).cov for name in layout(ekf).names}
        fields = {name: np.array(getattr(ekf, name), dtype=float) for name in FIELDS}
        metadata = np.zeros((0, 0)), fit.file.rate_hz, "innovations", tuple(notes), units
        return Noise(
            in_motion, at_rest, *metadata, fields, speed, check, bool(layout(ekf).measures_sideways.any())
        )
    truths = [(r, r.truth) for r in runs if r.truth is not None and len(r.truth.t_ns)]
    runs_with_truth = [r for r, truth in truths if np.isfinite(truth.nu_dot).all()]
    if source == "truth" and not runs_with_truth:
        raise UsageError.of("noise.no-truth")
    if runs_with_truth and source != "innovations":
        errors, size = process_errors(fit, runs_with_truth, backend)
        R, source = np.cov(errors.T), "truth"
    else:
        file_covariances = {name: q for name, q in in_motion.items() if name in fit.file.sensors._fields}
        (R, size), source = process_covariance(fit, runs, file_covariances, backend), "innovations"
    R = positive_definite(R, (MIN_RELATIVE_STD * size) ** 2, "R", notes)
    return Noise(in_motion, at_rest, R, fit.file.rate_hz, source, tuple(notes), units)


def positive_definite(
    matrix: np.ndarray, floor: np.ndarray, name: str, notes: list[Diagnostic]
) -> np.ndarray:
    """Return a symmetric positive definite matrix (n, n) with variances of at least `floor` (n,) and MIN_STD². MIN_STD
    is for a vehicle on a rail, which never moves sideways. Changes of the matrix are added to `notes`."""
    matrix = np.atleast_2d(np.asarray(matrix, dtype=float))
    matrix = np.where(np.isfinite(matrix), matrix, 0.0)
    variance, floor = np.diagonal(matrix), np.maximum(floor, MIN_STD**2)
    is_low = variance < floor
    if is_low.any():
        count = int(is_low.sum())
        notes.append(note("noise.raised", Severity.WARNING, subject=name, count=count, total=len(is_low)))
    d = np.sqrt(np.maximum(variance, floor))
    C = np.clip(0.5 * (matrix + matrix.T) / np.outer(d, d), -1.0, 1.0)
    C = np.where(is_low[:, None] | is_low[None, :], 0.0, C)
    np.fill_diagonal(C, 1.0)
    values, vectors = np.linalg.eigh(C)
    if values[0] < MIN_EIGENVALUE:
        notes.append(note("noise.correlations-reduced", Severity.WARNING, subject=name))
        C = (vectors * np.maximum(values, 2.0 * MIN_EIGENVALUE)) @ vectors.T
        C = C / np.sqrt(np.outer(np.diagonal(C), np.diagonal(C)))
    upper = np.triu(C) * np.outer(d, d)
    return upper + np.triu(upper, 1).T


def _measurement(
    fit: Fit, runs: Sequence[Run], notes: list[Diagnostic]
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray | None]]:
    """Return Q of each sensor, in motion and at rest: (1), or `unfitted_covariance` if a channel was not fitted."""
    in_motion: dict[str, np.ndarray] = {}
    at_rest: dict[str, np.ndarray | None] = {}
    for name, block in {**fit.file.sensors._asdict(), **fit.blocks.sensors._asdict()}.items():
        if name in HAND_SENSORS:
            continue  # the error of a hand measurement is given by the user
        channels = [c for c in fit.channels if c.sensor == name]
        columns = sorted({c.entry for c in channels if np.isfinite(c.measurements).any()})
        r, q, floor = _residuals(fit, runs, name, columns)
        residuals = r if len(r) >= MIN_SAMPLES else np.concatenate([r, q])
        if len(residuals) >= MIN_SAMPLES and len(columns) == block.size:
            in_motion[name] = positive_definite(row_cov(residuals), floor, _("Q of {name}", name=name), notes)
            at_rest[name] = None
            if len(q) >= MIN_SAMPLES:
                at_rest[name] = positive_definite(
                    row_cov(q), floor, _("Q of {name} at rest", name=name), notes
                )
        elif name not in fit.file.sensors._fields:
            continue  # the file does not contain the noise of a truth
        elif name in fit.sigma or not np.all(np.diagonal(block.cov) > 0.0):
            variances = np.zeros(block.size)
            if len(residuals) >= MIN_SAMPLES:
                variances[columns] = np.maximum(np.diagonal(row_cov(residuals)), floor)
            file_q = unfitted_covariance(name, block, variances, runs, notes)
            if file_q is not None:
                in_motion[name], at_rest[name] = file_q, None
    return in_motion, at_rest


def _residuals(
    fit: "Fit", runs: Sequence[Run], name: str, columns: list[int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rows (K, m) of the residuals of `columns`, in motion and at rest, and their least variances."""
    if not columns:
        return np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0)
    is_drifting = bool(np.any([c.autocorrelation > WHITE_LIMIT for c in fit.channels if c.sensor == name]))
    sigma, in_motion, at_rest, size = fit.sigma[name][columns], [], [], np.zeros(len(columns))
    for run_channels, run in zip(fit.channels_by_run, runs, strict=True):
        by_entry = {c.entry: c for c in run_channels if c.sensor == name}
        channels = [by_entry[i] for i in columns]
        r = np.stack([c.residuals for c in channels], axis=1)
        h = np.stack([c.predictions for c in channels], axis=1)
        is_complete = np.isfinite(r).all(axis=1)
        at_standstill = _is_at_rest(run, channels[0].t_s, h, sigma)
        r = np.clip(r, -CLIP_SIGMA * sigma, CLIP_SIGMA * sigma)
        in_motion.append(_white_residuals(r, is_complete & ~at_standstill, is_drifting))
        at_rest.append(_white_residuals(r, is_complete & at_standstill, is_drifting))
        size = np.maximum(size, np.sqrt(np.mean(h**2, axis=0)))
    return np.concatenate(in_motion), np.concatenate(at_rest), (MIN_RELATIVE_STD * size) ** 2


def _white_residuals(r: np.ndarray, rows: np.ndarray, is_drifting: bool) -> np.ndarray:
    """Return the residuals (K, m) at `rows` (N,) or, if `is_drifting`, the differences of neighbours divided by √2."""
    if not is_drifting:
        return r[rows]
    steps = np.diff(np.flatnonzero(rows))
    is_neighbour = steps <= np.median(steps) if len(steps) else steps > 0
    return np.diff(r[rows], axis=0)[is_neighbour] / np.sqrt(2.0)


def _is_at_rest(run: Run, t_s: np.ndarray, h: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Return a mask (N,) of the rows without a command for REST_S in which the model is at rest."""
    is_candidate = is_at_rest(run, run.t_ns[0] + np.rint(t_s * NANOSECONDS).astype(np.int64))
    if not is_candidate.any():
        return is_candidate
    median = np.median(h[is_candidate], axis=0)
    return is_candidate & np.all(np.abs(h - median) <= sigma, axis=1)


def unfitted_covariance(
    name: str, block: Tree, fitted_variance: np.ndarray, runs: Sequence[Run], notes: list[Diagnostic]
) -> np.ndarray | None:
    """Return Q (m, m) of a sensor with channels that were not fitted, or None if it is unknown. Q of the file counts if
    it has every channel. Otherwise a channel has the value of the file, of its residuals (`fitted_variance` (m,)), of
    its readings at rest, or 1: with 0 a filter would follow only this sensor."""
    file_variance = np.diagonal(block.cov)
    if np.all(file_variance > 0.0):
        notes.append(note("noise.of-the-file", Severity.WARNING, subject=name))
        return block.cov
    channels = [run.sensors.get(name) for run in runs]
    if any(channel is None or channel.z.shape[1] != block.size for channel in channels):
        return None
    variance = np.where(file_variance > 0.0, file_variance, fitted_variance)
    for i in np.flatnonzero(variance <= 0.0):
        candidates = zip(CODES, (*_variance_candidates(name, int(i), runs), 1.0), strict=True)
        code, variance[i] = next(x for x in candidates if x[1] > 0.0)
        sigma = float(np.sqrt(variance[i]))
        notes.append(note(code, Severity.WARNING, subject=f"{name}[{i}]", sigma=sigma))
    return np.diag(variance)


def _variance_candidates(name: str, i: int, runs: Sequence[Run]) -> Iterator[float]:
    """Yield the variance of channel i at rest, about the mean of each run, then the white part of all its readings."""
    deviations_at_rest, steps = [np.zeros(0)], [np.zeros(0)]
    for run in runs:
        channel = run.sensors[name]
        z, is_finite = channel.z[:, i], np.isfinite(channel.z[:, i])
        at_rest = z[is_finite & is_at_rest(run, channel.t_ns)]
        deviations_at_rest.append(at_rest - at_rest.mean() if len(at_rest) else at_rest)
        steps.append(np.diff(z[is_finite]))
    for x, factor in ((np.concatenate(deviations_at_rest), 1.0), (np.concatenate(steps), 0.5)):
        yield factor * float(np.mean(x**2)) if len(x) >= MIN_SAMPLES else 0.0
