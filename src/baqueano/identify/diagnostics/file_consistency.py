"""Test if channels, units, mounts and gains are those of the vehicle file.

    gain = Σ_c n_c log σ_c(unchanged) − Σ_c n_c log σ_c(other mount),   n_c readings of the IMU              (1)
    ω_z = r ω_h   of the gyro and the values in the file, r of runs/diagnostics/physical_units.py             (2)
    G = diag(1/m, 1/m, 1/I) T            accelerations of a command (V itself for a kinematic model)         (3)
    G_y = l_x G_ψ,   G_x = −l_y G_ψ      effect of an IMU at (l_x, l_y) if the command turns the vehicle     (4)

The test of a channel is the signal map (runs/diagnostics/signal_map.py) of measurements and predictions, of any scale.
If a channel does not follow the prediction with the values of the file, the search is repeated for other mounts (1).
A turned mount cannot be detected if the vehicle can have any force along x and y; a mirrored one can, because ν_x ω
points to the left in a left turn. If mounts have the same residuals, the signs of the gains decide. The gains adapt
to a wrong channel, so they are compared with the file. The file can be wrong. But if a command of the fit pushes
backward, sideways or five times as hard, a wrong log is more probable.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.optional import has_field
from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.identify.data.record import FitRecord, FittedBlocks
from baqueano.identify.estimation.search import Search, Task, search
from baqueano.identify.options import FitOptions
from baqueano.identify.parameters.free import FreeParameter, entries, value
from baqueano.identify.parameters.theta import start_theta
from baqueano.identify.residuals.gyro_aided import GYRO_CHANNEL
from baqueano.identify.residuals.simulation import Residuals
from baqueano.parameter import all_parameters
from baqueano.runs.diagnostics.physical_units import MAX_UNIT_RATIO, compare_gyro
from baqueano.runs.diagnostics.signal_map import (
    MappedChannel,
    channel_regressions,
    clip,
    is_clear,
    nearest_ratio,
    signal_map,
)
from baqueano.sensors.sampling import is_imu
from baqueano.symbolic import value_at_path

if TYPE_CHECKING:
    from baqueano.identify.identifiability import FinishedFit

MAX_SAMPLES = 2000  # samples that are tested, evenly spaced
DIVERGED_PREDICTION = 1e6  # SI units: a model with a larger prediction is treated as diverged
MAX_ROWS = 3000  # rows of each run
SIMILAR_GAIN_FRACTION = 0.5  # share of the largest gain: the data cannot separate mounts with a gain above it
GAIN_CODES = ("file.swapped", "file.inverted", "file.mirrored")
CHANNEL_CODES = ("axes.swapped", "axes.inverted", *GAIN_CODES)
MAX_GAIN_RATIO = 2.0  # of the file's value: tolerances of data sheet and scale, or a guess of half or double
MODEL_TOLERANCE = 0.1  # relative change of a gain by an imperfect model, in addition to its standard error
IMPLAUSIBLE_RATIO = 20.0  # times the value in the file: larger than for any wrong guess of a vehicle
SIGNIFICANT_SIGMA = 5.0  # standard errors
QUIET_RATIO, SILENT_RATIO = 0.2, 1e-4  # of the file's noise; a smaller one than the second is simulated
UNITS = {
    57.29578: "guess.degrees", 9.80665: "guess.g", 255.0: "guess.pwm", 100.0: "guess.percent", 1000.0: "guess.milli",
}  # fmt: skip
AXIS_CODES, TURNING_AXIS = ("axis.forward", "axis.sideways", "axis.turning"), 2


def check_channels(problem: Residuals, theta: np.ndarray) -> list[Diagnostic]:
    """Return an error message for each inverted channel and for each pair of swapped channels."""
    messages = []
    for name, size in zip(problem.names, problem.sizes, strict=True):
        hypotheses = signal_map(*sensor_samples(problem, theta, name), [MappedChannel()] * size)
        for i, hypothesis in enumerate(hypotheses):
            rho, channel = hypothesis.regression.correlation, f"{name}[{i}]"
            if hypothesis.code == "inverted":
                messages.append(note("axes.inverted", Severity.ERROR, subject=channel, correlation=rho))
            elif hypothesis.code == "swapped" and (j := hypothesis.prediction_index) < i:
                figures = {"channel": channel, "first": hypotheses[j].regression.correlation, "second": rho}
                messages.append(note("axes.swapped", Severity.ERROR, subject=f"{name}[{j}]", **figures))
    return messages


def sensor_samples(problem: Residuals, theta: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the measurements (n, m) of the channels of a sensor and their predictions (n, m), thinned and clipped."""
    span = problem.spans[name]
    z, h = measurements(problem)[:, span], predictions(problem, theta)[:, span]
    rows = np.flatnonzero(np.isfinite(z).any(axis=1))
    rows = rows[:: max(1, len(rows) // MAX_SAMPLES)]
    return clip(z[rows]), clip(h[rows])


def measurements(problem: Residuals) -> np.ndarray:
    """Return the measurements of all segments (N, m), NaN for a missing measurement."""
    return np.where(np.concatenate(problem.masks) > 0.0, np.concatenate(problem.z), np.nan)


def predictions(problem: Residuals, theta: np.ndarray) -> np.ndarray:
    """Return the predictions of all segments (N, m); a diverged prediction is NaN."""
    h = np.concatenate(problem.predictions(theta))
    return np.where(np.abs(h) < DIVERGED_PREDICTION, h, np.nan)


def check_gyro_against_model(end: "FinishedFit") -> tuple[list[Diagnostic], bool]:
    """Return messages on gyros in another unit than the predictions with the file, and True if all gyros are confirmed.
    A gyro is confirmed if it agrees with the file, with the wheels, or with a converged fit whose gains agree with the
    file. The start of the search is not evidence, so it is not used. (2)"""
    problem, sensors = end.task.problem, end.blocks.sensors._asdict()
    unbounded_parameters = [free._replace(low=-np.inf, high=np.inf) for free in end.parameters.free]
    theta = start_theta(end.blocks, unbounded_parameters, problem.shape, problem.records, FitOptions())[0]
    z, h = measurements(problem), predictions(problem, theta)
    wheel_rates = [
        np.diff(z[:, span])[:, 0] / sensors[name].track_m
        for name, span in problem.spans.items()
        if has_field(sensors[name], "track_m")
    ]
    fitted_thetas = [end.search.solution.theta] if _keeps_turning_gains(end) else []
    fitted_predictions = [predictions(problem, fitted_theta) for fitted_theta in fitted_thetas]
    messages, is_cleared, source = [], True, note("gyro.as-commands")
    for name in (name for name in problem.names if is_imu(sensors[name])):
        i = problem.spans[name].start + GYRO_CHANNEL
        other_rates = *wheel_rates, *(fit[:, i] for fit in fitted_predictions)
        by_file = compare_gyro(name, z[:, i], h[:, i], source)
        comparisons = (compare_gyro(name, z[:, i], omega, source) for omega in other_rates)
        if not (by_file.is_near or any(comparison.is_near for comparison in comparisons)):
            messages, is_cleared = [*messages, by_file.message], False
    return [message for message in messages if message is not None], is_cleared


def _keeps_turning_gains(end: "FinishedFit") -> bool:
    """Return True if the fit converged, and its turning gains and known measures stayed near their values in the file.
    Return False if the file contains such values, but none of them is identifiable."""
    theta, mask = end.search.solution.theta, end.identifiability.mask
    turning = [
        (k, value(end.blocks, free.path))
        for k, free in enumerate(end.parameters.free)
        if _affects_turning(free)
    ]
    ratios = [theta[k] / x_0 for k, x_0 in turning if x_0 and mask[k]]
    identifiable = bool(ratios) or not any(x_0 for _, x_0 in turning)
    return (
        end.search.solution.converged
        and identifiable
        and all(1.0 / MAX_UNIT_RATIO < abs(ratio) < MAX_UNIT_RATIO for ratio in ratios)
    )


def _affects_turning(parameter: FreeParameter) -> bool:
    """Return True for a gain or a measure of the vehicle on which its turning depends."""
    is_gain = parameter.definition.role in ("gain", "fixed") and parameter.path.startswith("model.")
    return is_gain and parameter.axis in (None, 2) and not parameter.unit.startswith("m/s")


class MountHypothesis(NamedTuple):
    """A mount of the IMU. The corrected readings are the columns `order` of the readings, times `sign`."""

    order: tuple[int, int, int]
    sign: tuple[float, float, float]
    code: str


MOUNTS = (
    MountHypothesis((1, 0, 2), (1.0, 1.0, 1.0), "mount.swapped"),
    MountHypothesis((0, 1, 2), (-1.0, 1.0, 1.0), "mount.first-inverted"),
    MountHypothesis((0, 1, 2), (1.0, -1.0, 1.0), "mount.second-inverted"),
    MountHypothesis((0, 1, 2), (1.0, 1.0, -1.0), "mount.third-inverted"),
    MountHypothesis((0, 1, 2), (-1.0, -1.0, 1.0), "mount.half-turn"),
    MountHypothesis((1, 0, 2), (1.0, -1.0, 1.0), "mount.quarter-turn-second"),
    MountHypothesis((1, 0, 2), (-1.0, 1.0, 1.0), "mount.quarter-turn-first"),
)  # fmt: skip


def with_mount_findings(end: "FinishedFit", messages: list[Diagnostic]) -> list[Diagnostic]:
    """Return the `messages` on a finished search. If another mount of an IMU explains the data better, the first
    message names this mount. It replaces the other messages about axes and signs."""
    task, blocks = end.task, end.blocks
    if type(task.problem) is not Residuals or all(message.severity == Severity.INFO for message in messages):
        return messages
    for name, block in blocks.sensors._asdict().items():
        if is_imu(block) and _has_wrong_axes(task, name) and (mount := _better_mount(end, name)):
            code = "axes.swapped" if mount[0].order[0] else "axes.inverted"
            other_messages = [
                message for message in messages if message.code not in CHANNEL_CODES or message.code == code
            ]
            return [mount[1], *other_messages]
    return messages


def _has_wrong_axes(task: Task, name: str) -> bool:
    """Return True if a channel of the IMU follows the prediction of another channel more closely, or none."""
    table = channel_regressions(*sensor_samples(task.problem, task.start, name))
    is_related = any(r.is_clear() for row in table for r in row)
    return is_related and not all(
        row[i].is_clear() and row[i].slope > 0.0 and row[i].gain == max(r.gain for r in row)
        for i, row in enumerate(table)
    )


def _better_mount(end: "FinishedFit", name: str) -> tuple[MountHypothesis, Diagnostic] | None:
    """Return a mount with clearly smaller residuals whose gains agree with the file, and its diagnostic, or None."""
    task, blocks = end.task, end.blocks
    records = [record.part(slice(MAX_ROWS)) for record in task.problem.records]
    channels = task.problem.spans[name]
    n = np.sum([r.sensors[name].mask.sum(axis=0) for r in records], axis=0)
    theta = end.search.solution.theta
    starts = task.start, np.where(np.isfinite(theta), theta, task.start)
    file_solution = min(
        (_search_from(task, blocks, records, start) for start in starts),
        key=lambda result: result.log_sigma_sum(n, channels),
    )
    trials, is_silent = [], n == 0.0
    for mount in (mount for mount in MOUNTS if not np.any(is_silent & (mount.order != np.arange(3)))):
        turned_records = [_with_remounted_imu(record, name, mount) for record in records]
        result = _search_from(task, blocks, turned_records, task.start)
        log_sigma = result.log_sigma_sum(n[list(mount.order)], channels)  # (1)
        gain = file_solution.log_sigma_sum(n, channels) - log_sigma
        trials.append((gain, mount, result))
    max_gain = max(gain for gain, _, _ in trials)
    for gain, mount, result in trials if is_clear(max_gain, max_gain / n.sum()) else ():
        if gain > SIMILAR_GAIN_FRACTION * max_gain and _agrees_with_file(task, blocks, result):
            # another minimum, not the mount, can explain a gain: the same start must not help the unchanged readings
            file_solution = min(
                (file_solution, _search_from(task, blocks, records, result.solution.theta)),
                key=lambda end: end.log_sigma_sum(n, channels),
            )
            log_sigma = result.log_sigma_sum(n[list(mount.order)], channels)
            gain = file_solution.log_sigma_sum(n, channels) - log_sigma
            if not is_clear(gain, gain / n.sum()):
                continue
            sigma = result.sigma[channels][np.argsort(mount.order)]  # in the column order of the run
            pairs = zip(file_solution.sigma[channels], sigma, strict=True)
            reductions = [note("residual.from-to", first_value=a, last_value=b) for a, b in pairs]
            return mount, note(mount.code, Severity.ERROR, subject=name, change=reductions)
    return None


def _search_from(task: Task, blocks: FittedBlocks, records: list[FitRecord], theta: np.ndarray) -> Search:
    problem = Residuals(blocks, task.problem.shape, records, task.problem.scan.backend)
    return search(task._replace(problem=problem, progress=None), theta, rough=True)


def _with_remounted_imu(record: FitRecord, name: str, hypothesis: MountHypothesis) -> FitRecord:
    order, readings = list(hypothesis.order), record.sensors[name]
    z, mask = readings.z[:, order] * np.array(hypothesis.sign), readings.mask[:, order]
    return record._replace(sensors={**record.sensors, name: readings._replace(z=z, mask=mask)})


def _agrees_with_file(task: Task, blocks: FittedBlocks, end: Search) -> bool:
    names = task.problem.shape.shared_paths
    messages = gain_findings(blocks, names, end.solution.theta[: len(names)], np.zeros(len(names)))
    return not any(message.code in CHANNEL_CODES for message in messages)


def gain_findings(
    blocks: FittedBlocks, names: Sequence[str], estimate: np.ndarray, std: np.ndarray
) -> list[Diagnostic]:
    """Return findings on fitted gains that disagree with the gains in `blocks`."""
    estimates = {
        n: (float(e), float(s)) for n, e, s in zip(names, estimate, std, strict=True) if np.isfinite(e)
    }
    return _scalar_gain_findings(blocks, estimates) + _matrix_findings(blocks, estimates)


def noise_findings(file_sigma: np.ndarray, sigma: np.ndarray, labels: Sequence[str]) -> list[Diagnostic]:
    """Return findings on channels whose noise `sigma` (m,) is much less than `file_sigma` (m,), that of the file."""
    findings = []
    for label, file_std, fit_std in zip(labels, file_sigma, sigma, strict=True):
        if file_std > 0.0 and SILENT_RATIO < (ratio := float(fit_std / file_std)) < QUIET_RATIO:
            figures: JsonObject = {"guess": _unit(1.0 / ratio), "sigma": float(fit_std), "ratio": ratio}
            findings.append(note("file.quiet", Severity.WARNING, "", label, **figures))
    return findings


def _scalar_gain_findings(
    blocks: FittedBlocks, estimates: dict[str, tuple[float, float]]
) -> list[Diagnostic]:
    findings = []
    for path, p in all_parameters(blocks.model, "model"):
        is_matrix = np.ndim(value_at_path(blocks, path)) == 2
        for entry in entries(blocks, path) if p.role == "gain" and not is_matrix else ():
            if entry in estimates and value(blocks, entry) != 0.0:
                findings += _comparison(entry, value(blocks, entry), *estimates[entry])
    return findings


def _comparison(path: str, file_value: float, estimate: float, std: float) -> list[Diagnostic]:
    """Return findings on one gain compared with its value in the file."""
    if not abs(estimate - file_value) > SIGNIFICANT_SIGMA * std:
        return []
    ratio = estimate / file_value
    if ratio < 0.0:
        return [note("file.inverted", Severity.WARNING, subject=path, value=estimate, file_value=file_value)]
    factor = max(ratio, 1.0 / max(ratio, 1e-12))
    if factor * (1.0 - max(SIGNIFICANT_SIGMA * std / abs(estimate), MODEL_TOLERANCE)) < MAX_GAIN_RATIO:
        return []
    if factor > IMPLAUSIBLE_RATIO:
        return [note("file.far-gain", Severity.ERROR, subject=path, ratio=ratio, guess=_unit(factor))]
    return [note("file.gain", Severity.WARNING, subject=path, ratio=ratio, guess=_unit(factor))]


def _unit(ratio: float) -> Diagnostic | str:
    code = UNITS.get(nearest_ratio(ratio, 0.8, 1.25, UNITS))
    return note(code) if code else ""


def _matrix_findings(blocks: FittedBlocks, estimates: dict[str, tuple[float, float]]) -> list[Diagnostic]:
    """Return findings on each column of the gain matrix: the largest entry in the file must stay the largest, and its
    value must agree with the file. If a turning command moves the vehicle more along another axis, a lever arm is
    suggested. (3), (4)"""
    model = blocks.model
    gains = [path for path, p in all_parameters(model, "model") if p.role == "gain" and p.shape == (3, 3)]
    path = next(iter(gains), None)
    if path is None:
        return []
    file_gains, scale, findings = np.asarray(value_at_path(blocks, path), float), np.ones(3), []
    if has_field(model, "mass_kg"):
        scale = np.array([model.mass_kg, model.mass_kg, model.inertia_kg_m2])
    for j in range(file_gains.shape[1]):
        paths = [f"{path}[{i},{j}]" for i in range(3)]
        main_axis = int(np.argmax(np.abs(file_gains[:, j]) / scale))
        if file_gains[main_axis, j] == 0.0 or paths[main_axis] not in estimates:
            continue
        fitted_gains = np.array([estimates.get(p, (file_gains[i, j], 0.0))[0] for i, p in enumerate(paths)])
        sizes, file_sizes = (
            _comparable_magnitudes(gains / scale, file_gains, scale)
            for gains in (fitted_gains, file_gains[:, j])
        )
        second_axis = int(np.argmax(np.where(np.arange(3) == main_axis, 0.0, sizes)))
        is_second_larger = sizes[second_axis] > sizes[main_axis]
        if is_second_larger and MAX_GAIN_RATIO * sizes[main_axis] < file_sizes[main_axis]:
            axes = {k: note(AXIS_CODES[i]) for k, i in (("expected", main_axis), ("value", second_axis))}
            findings.append(note("file.swapped", Severity.WARNING, "", f"u[{j}]", **axes))
            continue
        offset = _offset_path(blocks)
        if is_second_larger and main_axis == TURNING_AXIS and offset:
            axis, fix = note(AXIS_CODES[second_axis]), f"--free +{offset}"
            findings.append(note("file.lever-arm", Severity.WARNING, fix, f"u[{j}]", axis=axis))
        notes = _comparison(paths[main_axis], file_gains[main_axis, j], *estimates[paths[main_axis]])
        imus = [name for name, block in blocks.sensors._asdict().items() if is_imu(block)]
        if main_axis == TURNING_AXIS and imus:
            notes = [
                replace(finding, code="file.mirrored", figures={**finding.figures, "imu": imus[0]})
                if finding.code == "file.inverted"
                else finding
                for finding in notes
            ]
        findings += notes
    return findings


def _offset_path(blocks: FittedBlocks) -> str:
    """Return the path of the lever arm of a sensor, else of the centre of mass, else ""."""
    for name, sensor in blocks.sensors._asdict().items():
        if has_field(sensor, "lever_arm_m"):
            return f"sensors.{name}.lever_arm_m"
    return "model.centre_of_mass_x_m" if has_field(blocks.model, "centre_of_mass_x_m") else ""


def _comparable_magnitudes(estimate: np.ndarray, file_gains: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return the comparable magnitudes (3,) of the accelerations `estimate` (3,) of a command. The turning entry is
    multiplied by the ratio of linear to turning gain in the file."""
    gains = np.max(np.abs(file_gains) / scale[:, None], axis=1)
    linear_gain = max(gains[0], gains[1])
    ratio = linear_gain / gains[2] if gains[2] > 0.0 and linear_gain > 0.0 else 1.0
    return np.abs(estimate) * np.array([1.0, 1.0, ratio])
