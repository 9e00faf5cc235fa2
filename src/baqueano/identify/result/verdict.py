"""Derive the verdict USABLE, WARN or REFUSED, with reasons.

REFUSED   The search did not converge. The model explains nothing, or is far from a channel in use. Most parameters
          are not identifiable, or have a large error. A diagnostic found impossible data.
WARN      A parameter is at its bound, poorly identified or not identifiable. A speed is unknown. Residuals are
          autocorrelated and large, or far above the sensors' noise in the file. Outliers are frequent, or on one side.
          A diagnostic found an effect that might have changed a parameter.
USABLE    None of these. Parameters that the vehicle can never show do not count. Notes report repairs to the data.

Runs are compared by mean squares of residuals and of motion. ḡ and s are mean and standard deviation of g_r = log mean
e² over the other runs. One of R runs differs from the others if
    g_r − ḡ > t_{1−α/R} s √(1 + 1/(R − 1)),                                                               (1)
and if it is further from the model than from its mean, and moved by more than the model's error in other runs.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, Severity, Verdict, note
from baqueano.identify.estimation.search import MAX_RESIDUAL_SHARE
from baqueano.identify.identifiability import larger_bound
from baqueano.numerics.autocorrelation import WHITE_LIMIT
from baqueano.numerics.parallel import dot
from baqueano.numerics.statistics import CLIP_SIGMA, prediction_limit
from baqueano.vehicle_file.units import CHANNEL_UNITS

if TYPE_CHECKING:
    from baqueano.identify.result.fit_result import ChannelFit


MIN_EXPLAINED = 0.5  # least explained part of the variance of the best channel
MAX_UNOBSERVABLE_SHARE = 0.5  # largest allowed part of unidentifiable parameters
MAX_NOISE_RATIO = 3.0  # largest allowed ratio of the residuals to the noise in the file
# standard deviations, and part of the samples that may lie beyond on both sides, because the cost is Huber's
OUTLIER_SIGMA, MAX_OUTLIER_SHARE = 4.0, 0.2
OUTLIER_CHANCE = 0.01  # of the samples; fewer outliers, even to one side, move a fit by less than its error
WARNING, ERROR = Severity.WARNING, Severity.ERROR
ONE_SIDED_SIGMA = 5.0  # standard deviations of a binomial with p = ½ by which outliers may be on one side
MAX_SQUARE_RATIO = 2.0  # times the square about its own mean: above it, a channel does not follow the model
MAX_NAMED_RUNS = 3  # runs
FALSE_ALARM_RATE = 0.01  # α, the probability that a normal run is reported as unlike the others


class Evidence(NamedTuple):
    """Evidence for a verdict."""

    names: tuple[str, ...]  # (p,)
    estimate: np.ndarray  # (p,)
    bound: np.ndarray  # (p,)
    poorly_identified: np.ndarray  # (p,)
    fixed_count: int  # parameters whose command never moved
    unobservable: tuple[Diagnostic, ...]
    channels: "tuple[ChannelFit, ...]"  # run by run, the channels in one order
    channel_runs: "dict[str, list[RunChannel]]"  # see group_channels
    converged: bool
    autocorrelation: np.ndarray  # (m,)
    prior_sigma: np.ndarray | None  # (m,) noise in the file, 0 without one; None: σ was given
    messages: tuple[Diagnostic, ...] = ()  # by the detectors
    weak_reasons: tuple[Diagnostic, ...] = ()  # reasons for the weak parameters
    most_moving: str = ""  # the parameter that a search without convergence would still move most
    speed_warnings: tuple[Diagnostic, ...] = ()  # on frictions without which a speed is unknown


def fit_verdict(e: Evidence) -> tuple[Verdict, tuple[Diagnostic, ...]]:
    """Return the verdict and its reasons."""
    reasons = [*(_refusals(e) or _warnings(e)), *e.speed_warnings] or [note("fit.converged")]
    return Verdict.of(reasons), tuple(reasons)


def remarks(e: Evidence) -> list[Diagnostic]:
    """Return notes that do not change the verdict. `e.bound` marks parameters that can be at a bound by chance."""
    notes = _select_findings(e, Severity.INFO)
    notes += contradicting_runs(e.channel_runs, is_slow=True)
    notes += [_bound_note(e, k, "by-chance", Severity.INFO) for k in np.flatnonzero(e.bound).tolist()]
    for label, (n, highs, lows) in zip(_labels(e), _outlier_counts(e), strict=True):
        outlier_share = (highs + lows) / max(n, 1)
        if OUTLIER_CHANCE < outlier_share <= MAX_OUTLIER_SHARE and not _is_one_sided(highs, lows):
            notes.append(
                note("outliers.both-sides", subject=label, percent=100.0 * outlier_share, limit=OUTLIER_SIGMA)
            )
    return notes


def _select_findings(e: Evidence, severity: Severity) -> list[Diagnostic]:
    """Return the findings of the detectors with this severity."""
    return [message for message in e.messages if message.severity == severity]


def _bound_note(e: Evidence, k: int, kind: str, severity: Severity) -> Diagnostic:
    return active_bound(e.names[k], float(e.estimate[k]), e.bound[k] < 0, kind, severity)


def active_bound(
    path: str, estimate: float, is_low: bool, kind: str = "held", severity: Severity = Severity.INFO
) -> Diagnostic:
    """Return the finding on a parameter at its lower or upper bound, with the option for a larger upper bound."""
    fix = "" if is_low else larger_bound(path, estimate)
    code = "bound.high-default" if fix else f"bound.{'low' if is_low else 'high'}-{kind}"
    return note(code, severity, fix, path, bound=estimate)


def _refusals(e: Evidence) -> list[Diagnostic]:
    refusals = _select_findings(e, ERROR)
    if not e.converged and (key := e.most_moving):
        refusals.append(note("fit.not-converged-moving", ERROR, f"--fix {key}", key, key=key))
    elif not e.converged:
        refusals.append(note("fit.not-converged", ERROR, "--fix KEY"))
    shares = [c.explained_fraction for c in e.channels if np.isfinite(c.explained_fraction)]
    over_all = {label: pooled_channel(runs) for label, runs in e.channel_runs.items()}
    max_explained = max([0.0, *shares, *(channel.explained_variance for channel in over_all.values())])
    error_ratios = {
        label: np.sqrt(channel.squares / max(channel.signal_squares, 1e-300))
        for label, channel in over_all.items()
        if channel.contradicts_model
    }
    if not max_explained > MIN_EXPLAINED:
        refusals.append(note("fit.explains-nothing", ERROR, percent=100.0 * max(max_explained, 0.0)))
    if error_ratios and max_explained > MIN_EXPLAINED:
        refusals += [
            note("fit.channel-far-from-model", ERROR, "--use SENSOR", label, ratio=float(times))
            for label, times in error_ratios.items()
        ]
        refusals += _select_findings(e, WARNING)  # one of them can be the reason
    return refusals + _identifiability(e)


def _identifiability(e: Evidence) -> list[Diagnostic]:
    """Return a finding if too few of the parameters are identified."""
    free_count, weak_count = len(e.names) - e.fixed_count, int(np.sum(e.poorly_identified))
    missing_count = free_count - int(np.sum(np.isfinite(e.estimate)))
    if free_count and missing_count == free_count:
        return [note("fit.nothing-identifiable", ERROR, total=free_count)]
    if missing_count > MAX_UNOBSERVABLE_SHARE * free_count:
        return [note("fit.most-unidentifiable", ERROR, missing_count=missing_count, total=free_count)]
    if missing_count + weak_count > MAX_UNOBSERVABLE_SHARE * free_count:
        code = "fit.most-not-identified" if missing_count else "fit.most-poor"
        counts: JsonObject = {"total": free_count, "missing_count": missing_count, "weak_count": weak_count}
        return [note(code, ERROR, **counts, reason=_wide_error_cause(e))]
    return []


def _wide_error_cause(e: Evidence) -> Diagnostic:
    """Return the model as the cause if large residuals are autocorrelated, else too little motion."""
    channels = _lacking_channels(e)
    if channels:
        return note("fit.incomplete-model", ERROR, "--choose", ", ".join(channels))
    return note("fit.little-motion")


def _lacking_channels(e: Evidence) -> list[str]:
    """Return the channels with autocorrelated residuals that are a large part of their motion."""
    parts = zip(_labels(e), e.autocorrelation, e.channels, strict=False)
    return [
        label
        for label, c, channel in parts
        if abs(c) > WHITE_LIMIT and channel.explained_fraction < 1.0 - MAX_RESIDUAL_SHARE**2
    ]


def _warnings(e: Evidence) -> list[Diagnostic]:
    warnings = _select_findings(e, WARNING)
    warnings += [_bound_note(e, k, "held", WARNING) for k in np.flatnonzero(e.bound).tolist()]
    if e.poorly_identified.any():
        names = ", ".join(e.names[k].removeprefix("model.") for k in np.flatnonzero(e.poorly_identified))
        warnings.append(note("fit.poor", WARNING, names=names))
        warnings += e.weak_reasons
    warnings += contradicting_runs(e.channel_runs, is_slow=False)
    if e.unobservable:
        warnings.append(note("fit.unidentifiable", WARNING, count=len(e.unobservable)))
    subjects = {message.subject for message in e.messages if message.code == "residual.autocorrelated"}
    warnings += [
        note("residual.incomplete-model", WARNING, subject=label)
        for label in _lacking_channels(e)
        if label not in subjects
    ]
    return warnings + _noise_warnings(e)


def _noise_warnings(e: Evidence) -> list[Diagnostic]:
    """Return findings on residuals far above the noise of the file, and on outliers."""
    warnings, labels = [], _labels(e)
    prior = np.zeros(len(labels)) if e.prior_sigma is None else e.prior_sigma
    for label, c, prior_sigma in zip(labels, e.channels, prior, strict=False):
        if prior_sigma > 0.0 and c.sigma > MAX_NOISE_RATIO * prior_sigma:
            times = float(c.sigma / prior_sigma)
            warnings.append(note("residual.large", WARNING, subject=label, sigma=c.sigma, ratio=times))
    for label, (n, highs, lows) in zip(labels, _outlier_counts(e), strict=True):
        outlier_share = (highs + lows) / max(n, 1)
        details: JsonObject = {"subject": label, "percent": 100.0 * outlier_share, "limit": OUTLIER_SIGMA}
        if outlier_share > MAX_OUTLIER_SHARE and n == 1:
            warnings.append(_single_outlier(e, label))
        elif outlier_share > MAX_OUTLIER_SHARE:
            warnings.append(note("outliers.many", WARNING, **details))
        elif _is_one_sided(highs, lows) and outlier_share > OUTLIER_CHANCE:
            warnings.append(note("outliers.one-side", WARNING, **details, positives=highs, negatives=lows))
    return warnings


def _is_one_sided(highs: int, lows: int) -> bool:
    """Return True if significantly more outliers are on one side."""
    return bool(abs(highs - lows) > ONE_SIDED_SIGMA * np.sqrt(highs + lows))


def _single_outlier(e: Evidence, label: str) -> Diagnostic:
    """Return the finding on a channel with one outlying reading, such as a hand measurement. It states measurement
    and prediction instead of 100 % outliers."""
    channel_fits = [c for c in e.channels if c.label == label]
    z, h, sigma = next(
        (float(c.measurements[k]), float(c.predictions[k]), c.sigma)
        for c in channel_fits
        for k in np.flatnonzero(np.isfinite(c.residuals))
    )
    units = CHANNEL_UNITS.get(channel_fits[0].sensor, ())
    unit = units[channel_fits[0].entry] if channel_fits[0].entry < len(units) else ""
    difference = abs(z - h) / sigma
    return note("residual.outlier", WARNING, subject=label, measurement=z, model=h, unit=unit, z=difference)


def _outlier_counts(e: Evidence) -> list[tuple[int, int, int]]:
    """Return for each channel over all runs the numbers of samples, of outliers above the model, and of outliers below
    it."""
    m = len(e.autocorrelation)
    counts = np.zeros((m, 3), int)
    for k, c in enumerate(e.channels):
        residuals = c.residuals / c.sigma
        is_in_group = np.isfinite(residuals), residuals > OUTLIER_SIGMA, residuals < -OUTLIER_SIGMA
        counts[k % m] += [np.count_nonzero(x) for x in is_in_group]
    return [(int(n), int(highs), int(lows)) for n, highs, lows in counts]


def _labels(e: Evidence) -> list[str]:
    return [c.label for c in e.channels[: len(e.autocorrelation)]]


class RunChannel(NamedTuple):
    """One channel in one run, in units of its noise."""

    run: str
    squares: float  # sum of the squared residuals, outliers clipped
    signal_squares: float  # sum of the squared measurements about their mean
    samples: int

    @property
    def contradicts_model(self) -> bool:
        """Return True if the square about the model exceeds MAX_SQUARE_RATIO times the square about the mean of the
        channel."""
        return self.squares > MAX_SQUARE_RATIO * self.signal_squares

    @property
    def explained_variance(self) -> float:
        """Return the part of the channel's motion that the model explains."""
        return 1.0 - self.squares / self.signal_squares if self.signal_squares > 0.0 else 0.0


def group_channels(
    channels: "Sequence[ChannelFit]", one_mean: np.ndarray | None
) -> dict[str, list[RunChannel]]:
    """Return for each channel its runs. `one_mean` (m,), in the order of the first run, marks channels with one
    mean over all runs."""
    channel_runs: dict[str, list[RunChannel]] = {}
    labels = list(dict.fromkeys(c.label for c in channels))
    means = np.zeros(len(labels)) if one_mean is None else one_mean
    for label, is_mean in zip(labels, means, strict=True):
        min_count = 1 if is_mean else 2
        fits = [(c, np.isfinite(c.measurements)) for c in channels if c.label == label]
        fits = [(c, is_finite) for c, is_finite in fits if np.count_nonzero(is_finite) >= min_count]
        z = [c.measurements[is_finite] for c, is_finite in fits]
        mean = float(np.mean(np.concatenate(z))) if is_mean and z else None
        for (c, is_finite), measurements in zip(fits, z, strict=True):
            limit = CLIP_SIGMA * max(c.sigma, float(np.std(measurements)))
            residuals = np.clip(measurements - c.predictions[is_finite], -limit, limit)
            signal = c.predictions[is_finite] + residuals
            signal = signal - (np.mean(signal) if mean is None else mean)
            squares, signal_squares = (dot(x, x) / c.sigma**2 for x in (residuals, signal))
            run_channel = RunChannel(c.run, squares, signal_squares, len(measurements))
            channel_runs.setdefault(label, []).append(run_channel)
    return channel_runs


def pooled_channel(runs: Sequence[RunChannel]) -> RunChannel:
    """Return the sums over all runs of a channel."""
    squares, signal_squares, samples = (
        sum(getattr(channel, name) for channel in runs) for name in ("squares", "signal_squares", "samples")
    )
    return RunChannel("", squares, signal_squares, samples)


def contradicting_runs(channels: dict[str, list[RunChannel]], is_slow: bool) -> list[Diagnostic]:
    """Return findings on runs that are unlike the model in a channel that other runs support. If `is_slow`, these are
    runs that moved by less than the model's error in the other runs. Otherwise they are runs that moved more and
    differ significantly."""
    findings = []
    for label, runs in channels.items():
        like_runs = [channel for channel in runs if not channel.contradicts_model]
        if not like_runs:
            continue
        total, outliers = pooled_channel(like_runs), []
        for channel in (channel for channel in runs if channel.contradicts_model):
            is_quiet = channel.signal_squares * total.samples <= total.squares * channel.samples
            if is_quiet == is_slow and (is_slow or _is_significantly_larger(channel, like_runs, len(runs))):
                outliers.append(channel.run)
        if outliers:
            code, severity = (
                ("runs.little-motion", Severity.INFO) if is_slow else ("runs.unlike-model", Severity.WARNING)
            )
            run_names = ", ".join(outliers[:MAX_NAMED_RUNS]) + ", …" * (len(outliers) > MAX_NAMED_RUNS)
            findings.append(
                note(code, severity, subject=label, count=len(outliers), total=len(runs), runs=run_names)
            )
    return findings


def _is_significantly_larger(channel: RunChannel, like_runs: list[RunChannel], count: int) -> bool:
    """Return True if the residuals of a run are significantly larger than in the `like_runs`, one of `count` runs. (1)
    Also return True if `like_runs` contains fewer than two runs, because their scatter is then unknown."""
    g = np.log([max(r.squares / r.samples, 1e-300) for r in (channel, *like_runs)])
    return len(like_runs) < 2 or bool(g[0] > prediction_limit(g[1:], 1.0 - FALSE_ALARM_RATE / count))
