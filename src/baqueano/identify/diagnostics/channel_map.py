"""Test if channels, units and mounts of the sensors are those of the vehicle file.

The test of a channel is the signal map (runs/diagnostics/signal_map.py) of measurements and predictions, of any scale.
If a channel does not follow the prediction with the values of the file, the search is repeated for other mounts: axes
swapped, turned by a quarter or a half turn, or one axis inverted. The gains adapt, so they are compared with the file
(gains.py):

    gain = Σ_c n_c log σ_c(unchanged) − Σ_c n_c log σ_c(other mount),   n_c readings of the IMU              (1)
    ω_z = r ω_h   of the gyro and the values in the file, r of runs/diagnostics/physical_units.py             (2)

A turned mount cannot be detected if the vehicle can have any force along x and y; a mirrored one can, because ν_x ω
points to the left in a left turn. If mounts have the same residuals, the signs of the gains decide. A gyro
that agrees with the wheels or with the model is confirmed.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.optional import has_field
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.identify.data.record import FitRecord, FittedBlocks
from baqueano.identify.diagnostics.gains import gain_findings
from baqueano.identify.estimation.search import Search, Task, search
from baqueano.identify.options import FitOptions
from baqueano.identify.parameters.free import FreeParameter, value
from baqueano.identify.parameters.theta import start_theta
from baqueano.identify.residuals.simulation import Residuals
from baqueano.runs.diagnostics.physical_units import MAX_UNIT_RATIO, compare_gyro
from baqueano.runs.diagnostics.signal_map import (
    MappedChannel,
    channel_regressions,
    clip,
    is_clear,
    signal_map,
)

if TYPE_CHECKING:
    from baqueano.identify.identifiability import FinishedFit

MAX_SAMPLES = 2000  # samples that are tested, evenly spaced
DIVERGED_PREDICTION = 1e6  # SI units: a model with a larger prediction is treated as diverged
MAX_ROWS = 3000  # rows of each run
SIMILAR_GAIN_FRACTION = 0.5  # of the largest gain: the data cannot separate mounts whose gain is above it
AXIS_CODES = ("axes.swapped", "axes.inverted", "file.swapped", "file.inverted")


def check_channels(problem: Residuals, theta: np.ndarray) -> list[Diagnostic]:
    """Return an error message for each inverted channel and for each pair of swapped channels."""
    out = []
    for name, size in zip(problem.names, problem.sizes, strict=True):
        hypotheses = signal_map(*sensor_samples(problem, theta, name), [MappedChannel()] * size)
        for i, hypothesis in enumerate(hypotheses):
            rho, channel = hypothesis.regression.correlation, f"{name}[{i}]"
            if hypothesis.code == "inverted":
                out.append(note("axes.inverted", Severity.ERROR, subject=channel, correlation=rho))
            elif hypothesis.code == "swapped" and (j := hypothesis.prediction_index) < i:
                correlations = {
                    "other": channel,
                    "first": hypotheses[j].regression.correlation,
                    "second": rho,
                }
                out.append(note("axes.swapped", Severity.ERROR, subject=f"{name}[{j}]", **correlations))
    return out


def sensor_samples(problem: Residuals, theta: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the measurements (n, m) of the channels of a sensor and their predictions (n, m), thinned and clipped."""
    k = problem.names.index(name)
    span = slice(sum(problem.sizes[:k]), sum(problem.sizes[: k + 1]))
    z, h = measurements(problem)[:, span], predictions(problem, theta)[:, span]
    rows = np.flatnonzero(np.isfinite(z).any(axis=1))
    rows = rows[:: max(1, len(rows) // MAX_SAMPLES)]
    return clip(z[rows]), clip(h[rows])


def measurements(problem: Residuals) -> np.ndarray:
    """Return the measurements of all segments (N, m), NaN for a missing measurement."""
    return np.where(np.concatenate(problem.has) > 0.0, np.concatenate(problem.z), np.nan)


def predictions(problem: Residuals, theta: np.ndarray) -> np.ndarray:
    """Return the predictions of all segments (N, m), NaN where the model diverged."""
    h = np.concatenate(problem.predictions(theta))
    return np.where(np.abs(h) < DIVERGED_PREDICTION, h, np.nan)


def check_gyro_against_model(end: "FinishedFit") -> tuple[list[Diagnostic], bool]:
    """Return messages on gyros in another unit than the predictions with the file, and True if all gyros are confirmed.
    A gyro is confirmed if it agrees with the file, with the wheels, or with a converged fit whose gains agree with the
    file. The start of the search is not evidence, so it is not used. (2)"""
    problem, sensors = end.task.problem, end.blocks.sensors._asdict()
    unbounded_parameters = [
        end.requested_parameters[k]._replace(low=-np.inf, high=np.inf) for k in end.in_theta
    ]
    by_file = start_theta(end.blocks, unbounded_parameters, problem.shape, problem.records, FitOptions())[0]
    first_channel = dict(zip(problem.names, np.cumsum([0, *problem.sizes[:-1]]), strict=True))
    z, h = measurements(problem), predictions(problem, by_file)
    wheels = [(k, sensors[name]) for name, k in first_channel.items() if has_field(sensors[name], "track_m")]
    wheel_rates = [(z[:, k + 1] - z[:, k]) / block.track_m for k, block in wheels]
    fitted_thetas = [end.search.solution.theta] if _keeps_turning_gains(end) else []
    fitted_predictions = [predictions(problem, theta) for theta in fitted_thetas]
    messages, is_cleared, source = [], True, note("gyro.as-commands")
    for name in (name for name in first_channel if has_field(sensors[name], "gyro_scale")):
        i = first_channel[name] + 2
        turn_rates = h[:, i], *wheel_rates, *(fit[:, i] for fit in fitted_predictions)
        comparisons = [compare_gyro(name, z[:, i], omega, source) for omega in turn_rates]
        if not any(comparison.is_near for comparison in comparisons):
            messages, is_cleared = [*messages, comparisons[0].message], False
    return [message for message in messages if message is not None], is_cleared


def _keeps_turning_gains(end: "FinishedFit") -> bool:
    """Return True if the fit converged, and its turning gains and known measures stayed near their values in the file.
    Return False if the file contains such values, but none of them is identifiable."""
    theta, mask = end.search.solution.theta, end.identifiability.mask
    turning = [(k, value(end.blocks, free.path)) for k, free in enumerate(end.free) if _affects_turning(free)]
    ratios = [theta[k] / x_0 for k, x_0 in turning if x_0 and mask[k]]
    identifiable = bool(ratios) or not any(x_0 for _, x_0 in turning)
    return (
        end.search.solution.converged
        and identifiable
        and all(1.0 / MAX_UNIT_RATIO < abs(ratio) < MAX_UNIT_RATIO for ratio in ratios)
    )


def _affects_turning(parameter: FreeParameter) -> bool:
    """Return True for a gain or a measure of the vehicle on which its turning depends."""
    is_gain = parameter.definition.role in ("gain", "known") and parameter.path.startswith("model.")
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
        if (
            has_field(block, "gyro_scale")
            and _has_wrong_axes(task, name)
            and (mount := _better_mount(end, name))
        ):
            code = "axes.swapped" if mount[0].order[0] else "axes.inverted"
            other_messages = [
                message for message in messages if message.code not in AXIS_CODES or message.code == code
            ]
            return [mount[1], *other_messages]
    return messages


def _has_wrong_axes(task: Task, name: str) -> bool:
    """Return True if a channel of the IMU does not follow its prediction, or follows the prediction of another
    channel more closely."""
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
    first_channel = sum(task.problem.sizes[: task.problem.names.index(name)])
    channels = slice(first_channel, first_channel + 3)
    n = np.sum([r.sensors[name].has.sum(axis=0) for r in records], axis=0)
    theta = end.search.solution.theta
    starts = task.start, np.where(np.isfinite(theta), theta, task.start)
    as_in_file = min(
        (_search_from(task, blocks, records, start) for start in starts),
        key=lambda result: _log_sigma(result, channels, n),
    )
    trials = []
    for mount in MOUNTS:
        turned_records = [_with_remounted_imu(record, name, mount) for record in records]
        result = _search_from(task, blocks, turned_records, task.start)
        gain = _log_sigma(as_in_file, channels, n) - _log_sigma(result, channels, n[list(mount.order)])
        trials.append((gain, mount, result))
    max_gain = max(gain for gain, _, _ in trials)
    for gain, mount, result in trials if is_clear(max_gain, max_gain / n.sum()) else ():
        if gain > SIMILAR_GAIN_FRACTION * max_gain and _agrees_with_file(task, blocks, result):
            sigma = result.sigma[channels][np.argsort(mount.order)]  # in the column order of the run
            pairs = zip(as_in_file.sigma[channels], sigma, strict=True)
            less = [note("residual.from-to", before=a, after=b) for a, b in pairs]
            return mount, note(mount.code, Severity.ERROR, subject=name, less=less)
    return None


def _search_from(task: Task, blocks: FittedBlocks, records: list[FitRecord], theta: np.ndarray) -> Search:
    problem = Residuals(blocks, task.problem.shape, records, task.problem.scan.backend)
    return search(task._replace(problem=problem, progress=None), theta, rough=True)


def _with_remounted_imu(record: FitRecord, name: str, hypothesis: MountHypothesis) -> FitRecord:
    order, readings = list(hypothesis.order), record.sensors[name]
    z, has = readings.z[:, order] * np.array(hypothesis.sign), readings.has[:, order]
    return record._replace(sensors={**record.sensors, name: readings._replace(z=z, has=has)})


def _log_sigma(end: Search, channels: slice, n: np.ndarray) -> float:
    """Return Σ n log σ over the channels of the IMU with n (3,) readings, or infinity if the search diverged.  (1)"""
    log_sigma = float(n @ np.log(end.sigma[channels]))
    return log_sigma if np.isfinite(log_sigma) and np.isfinite(end.solution.evaluation.cost) else np.inf


def _agrees_with_file(task: Task, blocks: FittedBlocks, end: Search) -> bool:
    names = task.problem.shape.shared_paths
    messages = gain_findings(blocks, names, end.solution.theta[: len(names)], np.zeros(len(names)))
    return not any(message.code in AXIS_CODES for message in messages)
