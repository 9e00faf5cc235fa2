"""Validate a fit on held-out runs, simulated from the commands only.

    e = z − h(θ̂),   error = √ mean e²,   explained = 1 − Σ ẽ² / Σ (z − z̄)²,  ẽ = e clipped at 4 σ          (1)
    noise² = mean e_own² + max(0, w² − w_own²),   w² = ½ mean (e_{k+1} − e_k)²                            (2)
    g_b = log mean_{block b} e²,   ḡ − ḡ_own > t_{1−α} s √(1/B + 1/B_own)   and   error² > 2 noise²        (3)
    g_b − ḡ_own > t_{1−α/B} s_own √(1 + 1/B_own)   and   mean_{block b} e² > 2 noise²                      (4)
    error² − s² > χ²_{1,1−α} n² / (T / SHORT_BLOCK_S),   s² = mean (z − z̄)²,                              (5)
                  n² = min(noise², s²), or w² if the own runs have Σ e² > Σ (z − z̄)² too

Biases, clocks, the mount of a truth, and a start in motion are estimated on each run. (2) contains the residual on the
fitted runs, and the excess of this run's white noise (von Neumann's w). WARN: the model's part of e² is significantly
larger (3), one block fulfils (4), or the fit warns of signs, axes or timestamps. REFUSED: explained is significantly
below 0 (5). CANNOT TELL: too few segments of motion of a command that moved in the fit (objective_choice.py).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from baqueano.calibration.hand_measurements import HAND_SENSORS
from baqueano.calibration.rest import begins_at_rest
from baqueano.contracts.result import Result
from baqueano.contracts.values import JsonObject, TableRow
from baqueano.diagnostics import Diagnostic, Severity, Verdict, note
from baqueano.errors import UsageError
from baqueano.identify.data.added_channels import MOUNT_PREFIX
from baqueano.identify.diagnostics.file_consistency import GAIN_CODES
from baqueano.identify.fit import identify
from baqueano.identify.options import FitOptions
from baqueano.identify.parameters.theta import POSE_SEGMENT_S
from baqueano.identify.result.fit_result import ChannelFit, Fit, is_requested
from baqueano.messages import text, verdict_line
from baqueano.messages.language import number, percent_text, ratio_text, shown_unit, translate as _
from baqueano.messages.printable import baqueano_command
from baqueano.messages.text_table import text_table
from baqueano.numerics.statistics import prediction_limit, student_quantile
from baqueano.runs.run import Run
from baqueano.selection.cross_validation import (
    BLOCK_S,
    MIN_SIGNS as MIN_INDEPENDENT_MOTIONS,
    SHORT_BLOCK_S,
    independent_motion_count,
)
from baqueano.sensors.sampling import measures_pose
from baqueano.vehicle_file.units import channel_unit

MAX_SQUARE_RATIO = 2.0  # error² / noise²: above it more than half of the error is the model's
FALSE_ALARM_RATE = 0.01  # probability of a warning on one channel of one run, for a correct model
CLIP_RATIO = 10.0  # times the noise, at which an error is clipped: one spike is not an error of the model
MIN_BLOCK_READINGS = 10  # least number of readings in a block that is used
# Of 30 drives of SHORT_BLOCK_S * MIN_INDEPENDENT_MOTIONS, 7 had too few independent motions. Drives of this duration
# had enough.
ADVISED_S = 1.5 * SHORT_BLOCK_S * MIN_INDEPENDENT_MOTIONS
# codes, and beginnings of codes, of warnings on the data that a fit and its held-out runs share
DATA_FAULTS = (*GAIN_CODES, "axes.", "mount.", "time.", "gravity.", "gyro.", "accelerometer.")
MIN_BLOCKS = 6  # blocks on both sides; with fewer blocks of BLOCK_S, they have SHORT_BLOCK_S


class ChannelMetrics(NamedTuple):
    """Errors of one channel of one held-out run."""

    run: str
    channel: str
    error: float  # root mean square
    explained_fraction: float
    on_own_runs: float  # explained part on the runs of the fit
    unit: str = ""  # of error
    noise: float = float("nan")  # error that sensor noise and process noise explain, by (2)

    @property
    def times(self) -> float:
        """Return the ratio of the error to the noise, 1 for a perfect model."""
        return self.error / self.noise if self.noise > 0.0 else float("nan")


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Validation(Result):
    """Errors of a fit on runs that it did not use, with a verdict.

    Attributes
    ----------
    figures : tuple of ChannelMetrics
        Errors of each channel of each run, in the unit of the channel.
    channels : tuple of ChannelFit
        Residuals of each channel of each run, for the figure.
    messages : tuple of Diagnostic
        Evidence against the model, and reasons why a test is not possible.
    range_notes : tuple of Diagnostic
        Runs that leave the range of motion of the fit.
    basis : Diagnostic
        Horizon of the simulation [s], and the number of independent segments of motion.

    Examples
    --------
    >>> from baqueano.identify import identify, random_steps
    >>> small = bq.load("small")
    >>> runs = [bq.simulate(small, random_steps([1.0, 0.0, 1.0], 30.0, 100.0, k), k) for k in (1, 2)]
    >>> result = validate(identify(runs[0], small, ["model.mass_kg"]), runs[1])
    >>> [row["channel"] for row in result.rows()]
    ['imu[0]', 'imu[1]', 'imu[2]']
    """

    figures: tuple[ChannelMetrics, ...]
    channels: tuple[ChannelFit, ...]
    messages: tuple[Diagnostic, ...]
    range_notes: tuple[Diagnostic, ...]
    basis: Diagnostic

    @property
    def verdict(self) -> Verdict:
        """Return REFUSED if the model is worse than the mean, WARN for too large an error, CANNOT TELL, or USABLE."""
        return Verdict.of(self.messages)

    @property
    def reasons(self) -> tuple[Diagnostic, ...]:
        """Return the reasons for the verdict, the most severe first; () for USABLE."""
        order = (Severity.ERROR, Severity.WARNING, Severity.UNKNOWN)
        return tuple(sorted(self.messages, key=lambda message: order.index(message.severity)))

    @property
    def sentence(self) -> str:
        """Return the verdict, the reasons and the horizon as text."""
        code = "validation.checked" if self.messages else "validation.carries-over"
        return verdict_line(self.verdict, [*self.reasons, note(code, basis=self.basis)])

    def rows(self) -> list[TableRow]:
        """Return one flat row per run and channel."""
        return [metrics._asdict() | {"times": metrics.times} for metrics in self.figures]

    def table(self) -> str:
        """Return the table as text."""
        head = [_("held out"), _("channel"), _("error"), "", _("of noise"), _("explained"), _("own runs")]
        rows = (
            [f.run, f.channel, f"{number(f.error):.3g}", shown_unit(f.unit), ratio_text(f.times),
             percent_text(f.explained_fraction), percent_text(f.on_own_runs)]
            for f in self.figures
        )  # fmt: skip
        lines = text_table("<<><>>>", head, *rows)
        return "\n".join(
            [*lines, *(_("note: {note}", note=text(message)) for message in self.range_notes), self.sentence]
        )


class _ChannelError(NamedTuple):
    """Residuals of one channel, in blocks."""

    square: float  # mean e²
    white_square: float  # w² of (2)
    g: np.ndarray  # (B,) log of the mean square of each block
    t_s: np.ndarray  # (B,) beginning of each block
    block_s: float = BLOCK_S


def validate(fit: Fit, runs: Run | Sequence[Run]) -> Validation:
    """Return the errors of a fit on runs that it did not use.

    Parameters
    ----------
    fit : Fit
        A fit that was not refused.
    runs : Run or sequence of Run
        Runs of the same vehicle, with the sensors of the fit.

    Returns
    -------
    Validation
        REFUSED for a model that is worse than the mean of a channel, WARN for too large an error. CANNOT TELL if the
        runs contain too little independent motion, else USABLE.

    Raises
    ------
    UsageError
        If the fit was refused, or used one of these runs.

    Notes
    -----
    Each run is simulated in open loop from its own start, with the sensors' biases of the run. Equations of the module.

    Examples
    --------
    >>> from baqueano.identify import identify, random_steps
    >>> small = bq.load("small")
    >>> runs = [bq.simulate(small, random_steps([1.0, 0.0, 1.0], 40.0, 100.0, k), k) for k in (1, 2)]
    >>> print(validate(identify(runs[0], small, ["model.mass_kg"]), runs[1]).verdict)
    USABLE
    """
    runs = [runs] if isinstance(runs, Run) else list(runs)
    if fit.verdict == Verdict.REFUSED:
        raise UsageError.of("validation.refused-fit")
    fit_runs = [run.name for run in runs if fit.includes(run)]
    if fit_runs:
        raise UsageError.of("runs.fitted-to", "--held-out RUN", run=fit_runs[0])
    use = _used_channels(fit)
    sigma = {name: noise for name, noise in fit.sigma.items() if any(u.split("[")[0] == name for u in use)}
    run_parameters = [name for name in fit.run_entry_names if is_requested(name)]
    clocks = [name.removeprefix("clock.") for name in run_parameters if name.startswith("clock.")]
    per_run = [name for name in run_parameters if not name.startswith("clock.")]
    per_run += [name for name in fit.names if name.startswith(MOUNT_PREFIX)]
    options = FitOptions(per_run=per_run, clocks=clocks, sigma=sigma, diagnose=False, backend=fit.backend)
    vehicle_file, channels = fit.vehicle_file, list[ChannelFit]()
    at_rest = [begins_at_rest(run, fit.blocks.sensors) for run in runs]
    for run, is_at_rest in zip(runs, at_rest, strict=True):
        run_fit = identify(run, vehicle_file, (), use=use, options=replace(options, at_rest=is_at_rest))
        channels += run_fit.channels
    metrics, messages = [], [*_shared_faults(fit), *_too_few_reasons(fit, runs)]
    files = {run.name: run.path or run.name for run in runs}
    for c in channels:
        if np.isfinite(c.residuals).any() and np.isfinite(c.explained_fraction):
            own_channels = [
                channel for channel in fit.channels if (channel.sensor, channel.entry) == (c.sensor, c.entry)
            ]
            unit = channel_unit(vehicle_file, c.sensor, c.entry)
            channel_metrics, channel_findings = _channel_metrics(c, own_channels, unit, files[c.run])
            metrics.append(channel_metrics)
            messages += channel_findings
    flags = tuple(flag for run in runs for flag in fit.envelope.range_warnings(run))
    return Validation(tuple(metrics), tuple(channels), tuple(messages), flags, _basis(fit, runs, at_rest))


def _shared_faults(fit: Fit) -> list[Diagnostic]:
    """Return the warnings of the fit about signs, axes and timestamps, which runs of the same log cannot refute."""
    return [
        note("validation.shared-fault", Severity.WARNING, subject=reason.subject)
        for reason in fit.reasons
        if reason.severity == Severity.WARNING and reason.code.startswith(DATA_FAULTS)
    ]


def _too_few_reasons(fit: Fit, runs: Sequence[Run]) -> list[Diagnostic]:
    """Return the reasons why no test of the model is possible, for each command that moved in the fit."""
    reasons = []
    for k in fit.envelope.moved_commands:
        count, name = independent_motion_count(runs, k), fit.envelope.names[k]
        if not count:
            reasons.append(note("validation.no-variation", Severity.UNKNOWN, subject=name, min_s=ADVISED_S))
        elif count < MIN_INDEPENDENT_MOTIONS:
            details = {"pieces": count, "minimum": MIN_INDEPENDENT_MOTIONS, "min_s": ADVISED_S}
            reasons.append(note("validation.too-few", Severity.UNKNOWN, subject=name, **details))
    return reasons


def _basis(fit: Fit, runs: Sequence[Run], at_rest: Sequence[bool]) -> Diagnostic:
    """Return a note on the horizon, the start and the amount of motion of the test."""
    # then runs are split into segments
    has_pose = any(measures_pose(sensor) for sensor in fit.blocks.sensors)
    spans = [min(run.duration_s, POSE_SEGMENT_S) if has_pose else run.duration_s for run in runs]
    shortest_text, longest_text = f"{number(min(spans)):.3g}", f"{number(max(spans)):.3g}"
    if has_pose or not any(at_rest):
        start_note = note("validation.from-velocity")
    elif all(at_rest):
        start_note = note("validation.from-standstill")
    else:
        start_note = note("validation.some-from-velocity", count=at_rest.count(False), total=len(at_rest))
    count = min((independent_motion_count(runs, k) for k in fit.envelope.moved_commands), default=0.0)
    span = shortest_text if shortest_text == longest_text else f"{shortest_text} … {longest_text}"
    return note("validation.basis", span_s=span, start=start_note, pieces=count)


def _used_channels(fit: Fit) -> tuple[str, ...]:
    """Return the sensors of the fit, in the form of `use`, without hand measurements."""
    used_entries = dict.fromkeys(
        (c.sensor, c.entry) for c in fit.channels if np.isfinite(c.explained_fraction)
    )
    sensors = [name for name in fit.sigma if name not in HAND_SENSORS]
    whole_sensors = [
        name for name in sensors if all((name, k) in used_entries for k in range(len(fit.sigma[name])))
    ]
    return (
        *whole_sensors,
        *(f"{name}[{k}]" for name, k in used_entries if name in sensors and name not in whole_sensors),
    )


def _channel_metrics(
    c: ChannelFit, own_channels: Sequence[ChannelFit], unit: str, file: Path | str
) -> tuple[ChannelMetrics, list[Diagnostic]]:
    """Return the errors of one channel of a held-out run, compared with `own_channels`, the same channel in the runs of
    the fit. Also return the evidence against the model."""
    own_channels = [channel for channel in own_channels if np.isfinite(channel.explained_fraction)]
    error = float(np.sqrt(np.nanmean(c.residuals**2)))
    metrics = ChannelMetrics(c.run, c.label, error, c.explained_fraction, np.nan, unit)
    if not own_channels:
        return metrics, []
    errors, own_errors = _channel_errors(c, own_channels)
    samples = [np.isfinite(channel.measurements).sum() for channel in own_channels]
    signals = [np.nansum((c.measurements - np.nanmean(c.measurements)) ** 2) for c in own_channels]
    share = float(
        np.average([c.explained_fraction for c in own_channels], weights=np.maximum(signals, 1e-300))
    )
    square, white_square = (
        np.average([getattr(error, k) for error in own_errors], weights=samples)
        for k in _ChannelError._fields[:2]
    )
    noise = float(np.sqrt(square + max(0.0, errors.white_square - white_square)))
    metrics = metrics._replace(on_own_runs=share, noise=noise)
    is_explained = sum(np.nansum(own_channel.residuals**2) for own_channel in own_channels) < sum(signals)
    if worse_finding := _worse_than_mean(metrics, c, noise**2 if is_explained else errors.white_square):
        return metrics, [worse_finding]
    own_squares = np.concatenate([error.g for error in own_errors])
    return metrics, _misfit_evidence(metrics, errors, own_squares, file)


def _worse_than_mean(metrics: ChannelMetrics, c: ChannelFit, noise2: float) -> Diagnostic | None:
    """Return a finding on a channel whose error significantly exceeds its motion, or None.  (5)"""
    is_finite = np.isfinite(c.residuals)
    blocks = max(1.0, float(np.ptp(c.t_s[is_finite])) / SHORT_BLOCK_S)
    total = float(np.var(c.measurements[is_finite]))
    excess = metrics.error**2 - total
    chance = student_quantile(1.0 - 0.5 * FALSE_ALARM_RATE, np.inf) ** 2 * min(noise2, total) / blocks
    if not excess > chance:
        return None
    return _channel_finding(
        "validation.worse-than-mean",
        Severity.ERROR,
        metrics,
        variance_percent=-100.0 * excess / max(total, 1e-300),
    )


def _channel_finding(
    code: str, severity: Severity, metrics: ChannelMetrics, **figures: float | Diagnostic
) -> Diagnostic:
    """Return a finding on one channel of one held-out run."""
    details: JsonObject = {"run": metrics.run, "error": metrics.error, "unit": metrics.unit} | figures
    return note(code, severity, subject=metrics.channel, **details)


def _misfit_evidence(
    metrics: ChannelMetrics, errors: _ChannelError, own_squares: np.ndarray, file: Path | str
) -> list[Diagnostic]:
    """Return the evidence against the model in one channel of a run, at most one finding.  (3), (4)"""
    noise2, freedom, alpha = metrics.noise**2, len(errors.g) + len(own_squares) - 2, 0.5 * FALSE_ALARM_RATE
    details = {
        "ratio": metrics.times, "variance_percent": 100 * max(metrics.explained_fraction, 0.0),
        "fit_variance_percent": 100 * metrics.on_own_runs,
    }  # fmt: skip
    finding = _channel_finding("validation.error", Severity.WARNING, metrics, **details)
    if errors.square > MAX_SQUARE_RATIO * noise2 and (
        freedom < 1 or not min(len(errors.g), len(own_squares))
    ):
        return [_channel_finding("validation.error-possible", Severity.WARNING, metrics, finding=finding)]
    if errors.square > MAX_SQUARE_RATIO * noise2:
        s = np.sqrt((len(errors.g) * np.var(errors.g) + len(own_squares) * np.var(own_squares)) / freedom)
        chance = (
            student_quantile(1.0 - alpha, freedom) * s * np.sqrt(1.0 / len(errors.g) + 1.0 / len(own_squares))
        )
        if errors.g.mean() - own_squares.mean() > chance:
            return [finding]
    if len(errors.g) < 2 or len(own_squares) < 2:
        return []
    k = int(np.argmax(errors.g))
    limit = prediction_limit(own_squares, 1.0 - alpha / len(errors.g))
    if errors.g[k] > max(limit, own_squares.max(), np.log(MAX_SQUARE_RATIO * noise2)):
        rms_error, begin_s = float(np.exp(0.5 * errors.g[k])), float(errors.t_s[k])
        span = {"error": rms_error, "start_s": begin_s, "end_s": begin_s + errors.block_s}
        finding = _channel_finding("validation.error-in-part", Severity.WARNING, metrics, **span)
        return [replace(finding, fix=baqueano_command("runs", "cut", file, "--to", f"{begin_s:.0f}"))]
    return []


def _channel_errors(
    c: ChannelFit, own_channels: Sequence[ChannelFit]
) -> tuple[_ChannelError, list[_ChannelError]]:
    """Return the residuals of a channel and of its `own_channels` runs, in blocks of BLOCK_S. If there are fewer than
    MIN_BLOCKS blocks, use blocks of SHORT_BLOCK_S if this gives more blocks."""
    own_residuals = np.concatenate([channel.residuals for channel in own_channels])
    spread, trials = float(np.sqrt(np.nanmean(own_residuals**2))), []
    for block_s in (BLOCK_S, SHORT_BLOCK_S):
        errors, *own_errors = (_channel_error(channel, spread, block_s) for channel in (c, *own_channels))
        trials.append(
            (min(len(errors.g), sum(len(error.g) for error in own_errors), MIN_BLOCKS), errors, own_errors)
        )
    _, errors, own_errors = max(trials, key=lambda trial: trial[0])
    return errors, own_errors


def _channel_error(c: ChannelFit, spread: float, block_s: float) -> _ChannelError:
    """Return the residuals of a channel in blocks of `block_s`, clipped at CLIP_RATIO times `spread`."""
    e, is_finite = c.residuals, np.isfinite(c.residuals)
    e, t = np.clip(e[is_finite], -CLIP_RATIO * spread, CLIP_RATIO * spread), c.t_s[is_finite]
    block = ((t - t[0]) // block_s).astype(int) if len(t) else np.zeros(0, int)
    block_numbers, counts = np.unique(block, return_counts=True)
    blocks = [b for b, n in zip(block_numbers, counts, strict=True) if n >= MIN_BLOCK_READINGS]
    g = [float(np.log(max(np.mean(e[block == b] ** 2), 1e-300))) for b in blocks]
    white_square = 0.5 * float(np.mean(np.diff(e) ** 2)) if len(e) > 1 else 0.0
    begins = [float(t[0] + b * block_s) for b in blocks]
    return _ChannelError(
        float(np.mean(e**2)) if len(e) else 0.0, white_square, np.array(g), np.array(begins), block_s
    )
