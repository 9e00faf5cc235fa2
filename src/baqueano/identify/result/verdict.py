"""Derive the verdict USABLE, WARN or REFUSED, with reasons.

REFUSED   The search did not converge. The model explains nothing, or is far from a channel in use. Most parameters
          are not identifiable, or have a large error. A diagnostic found impossible data.
WARN      A parameter is at its bound, poorly identified or not identifiable. Residuals are autocorrelated and large, or
          far above the sensors' noise in the file. Outliers are many, or to one side. A diagnostic found an effect that
          may have moved a parameter.
USABLE    None of these. Parameters that the vehicle can never show do not count. Notes report repairs to the data.

Runs are compared by mean squares of residuals and of motion. ḡ and s are mean and standard deviation of g_r = log mean
e² over the other runs. One of R runs differs from the others if
    g_r − ḡ > t_{1−α/R} s √(1 + 1/(R − 1)),                                                               (1)
and if it is further from the model than from its mean, and moved by more than the model's error in other runs.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, Severity, Verdict, note
from baqueano.identify.covariance.information import WHITE_LIMIT
from baqueano.identify.covariance.quantiles import student_quantile
from baqueano.identify.estimation.search import LACKING
from baqueano.vehicle_file.units import CHANNEL_UNITS

if TYPE_CHECKING:
    from baqueano.identify.result.fit_result import ChannelFit

EXPLAINS = 0.5  # least explained part of the variance of the best channel
UNSEEN = 0.5  # largest part of the parameters that may be unidentifiable
ABOVE_NOISE = 3.0  # times the noise of the file that residuals may have
OUTLIER, OUTLIERS = 4.0, 0.2  # standard deviations, and part of the samples that may lie beyond; the Huber
# cost tolerates them if they are equally frequent on both sides
# part of the samples; fewer outliers, even to one side, move a fit by less than its error
OUTLIER_CHANCE = 0.01
WARNING, ERROR = Severity.WARNING, Severity.ERROR
LEAN = 5.0  # standard deviations of a fair coin by which outliers may prefer a side
FAR = 2.0  # times the square about its own mean: a channel with larger residuals does not follow the model
CLIPPED = 4.0  # standard deviations, beyond which an error is clipped
NAMED = 3  # runs
CHANCE = 0.01  # α, the probability that a normal run is reported as unlike the others


class Evidence(NamedTuple):
    """Evidence for a verdict."""

    names: tuple[str, ...]  # (p,)
    estimate: np.ndarray  # (p,)
    bound: np.ndarray  # (p,)
    weak: np.ndarray  # (p,)
    frozen: int  # parameters whose command never moved
    unobservable: tuple[Diagnostic, ...]
    channels: Any  # ChannelFit, run by run, the channels in one order
    converged: bool
    autocorrelation: np.ndarray  # (m,)
    prior_sigma: np.ndarray | None  # (m,) noise in the file, 0 without one; None: σ was given
    messages: tuple[Diagnostic, ...] = ()  # by the detectors
    weakly: tuple[Diagnostic, ...] = ()  # reasons for the weak parameters
    moving: str = ""  # the parameter that a search without convergence would still move most
    # (m,) True for channels with one mean over all runs; None: each run has a separate mean
    one_mean: np.ndarray | None = None


def verdict_of(e: Evidence) -> tuple[Verdict, tuple[Diagnostic, ...]]:
    """Return the verdict and its reasons."""
    reasons = _refusals(e) or _warnings(e) or [note("fit.converged")]
    return Verdict.of(reasons), tuple(reasons)


def remarks(e: Evidence) -> list[Diagnostic]:
    """Return notes that are not a reason to doubt. `e.bound` marks parameters that may be at a bound by chance."""
    out = _of(e, Severity.INFO)
    out += unlike(by_channel(e.channels, e.one_mean), hardly=True)
    out += [_at_bound(e, int(k), "by-chance", Severity.INFO) for k in np.flatnonzero(e.bound)]
    for label, (n, above, below) in zip(_labels(e), _beyond(e), strict=True):
        far = (above + below) / max(n, 1)
        if OUTLIER_CHANCE < far <= OUTLIERS and not _lean(above, below):
            out.append(note("outliers.both-sides", subject=label, percent=100.0 * far, beyond=OUTLIER))
    return out


def _of(e: Evidence, severity: Severity) -> list[Diagnostic]:
    """Return the findings of the detectors with this severity."""
    return [message for message in e.messages if message.severity == severity]


def _at_bound(e: Evidence, k: int, kind: str, severity: Severity) -> Diagnostic:
    side = "low" if e.bound[k] < 0 else "high"
    return note(f"bound.{side}-{kind}", severity, subject=e.names[k], bound=float(e.estimate[k]))


def _refusals(e: Evidence) -> list[Diagnostic]:
    out = _of(e, ERROR)
    if not e.converged and e.moving:
        out.append(note("fit.not-converged-moving", ERROR, f"--fix {e.moving}", e.moving, key=e.moving))
    elif not e.converged:
        out.append(note("fit.not-converged", ERROR, "--fix KEY"))
    shares = [c.explained for c in e.channels if np.isfinite(c.explained)]
    over_all = {label: whole(runs) for label, runs in by_channel(e.channels, e.one_mean).items()}
    best = max([0.0, *shares, *(channel.explained_variance for channel in over_all.values())])
    far = {
        label: np.sqrt(channel.squares / max(channel.moved, 1e-300))
        for label, channel in over_all.items()
        if channel.unlike
    }
    if not best > EXPLAINS:
        out.append(note("fit.explains-nothing", ERROR, percent=100.0 * max(best, 0.0)))
    if far and best > EXPLAINS:
        out += [
            note("fit.far-channel", ERROR, "--use SENSOR", label, times=float(times))
            for label, times in far.items()
        ]
        out += _of(e, WARNING)  # one of them may be the reason
    return out + _identifiability(e)


def _identifiability(e: Evidence) -> list[Diagnostic]:
    """Return a finding if too few of the parameters are identified."""
    free, weak = len(e.names) - e.frozen, int(np.sum(e.weak))
    missing = free - int(np.sum(np.isfinite(e.estimate)))
    if free and missing == free:
        return [note("fit.nothing-seen", ERROR, asked=free)]
    if missing > UNSEEN * free:
        return [note("fit.most-unseen", ERROR, unseen=missing, asked=free)]
    if missing + weak > UNSEEN * free:
        code = "fit.most-unseen-or-weak" if missing else "fit.most-weak"
        return [note(code, ERROR, asked=free, unseen=missing, weak=weak)]
    return []


def _warnings(e: Evidence) -> list[Diagnostic]:
    out = _of(e, WARNING)
    out += [_at_bound(e, int(k), "held", WARNING) for k in np.flatnonzero(e.bound)]
    if e.weak.any():
        names = ", ".join(short(e.names[k]) for k in np.flatnonzero(e.weak))
        out.append(note("fit.weak", WARNING, names=names))
        out += e.weakly
    out += unlike(by_channel(e.channels, e.one_mean), hardly=False)
    if e.unobservable:
        out.append(note("fit.unseen", WARNING, count=len(e.unobservable)))
    subjects = {message.subject for message in e.messages if message.code == "residual.autocorrelated"}
    for label, c, channel in zip(_labels(e), e.autocorrelation, e.channels, strict=False):
        if abs(c) > WHITE_LIMIT and channel.explained < 1.0 - LACKING**2 and label not in subjects:
            out.append(note("residual.lacking", WARNING, subject=label))
    return out + _loud(e)


def _loud(e: Evidence) -> list[Diagnostic]:
    """Return findings on residuals far above the noise of the file, and on outliers."""
    out, labels = [], _labels(e)
    prior = np.zeros(len(labels)) if e.prior_sigma is None else e.prior_sigma
    for label, c, prior_sigma in zip(labels, e.channels, prior, strict=False):
        if prior_sigma > 0.0 and c.sigma > ABOVE_NOISE * prior_sigma:
            times = float(c.sigma / prior_sigma)
            out.append(note("residual.loud", WARNING, subject=label, sigma=c.sigma, times=times))
    for label, (n, above, below) in zip(labels, _beyond(e), strict=True):
        far = (above + below) / max(n, 1)
        details: JsonObject = {"subject": label, "percent": 100.0 * far, "beyond": OUTLIER}
        if far > OUTLIERS and n == 1:
            out.append(_one_far(e, label))
        elif far > OUTLIERS:
            out.append(note("outliers.many", WARNING, **details))
        elif _lean(above, below) and far > OUTLIER_CHANCE:
            out.append(note("outliers.one-side", WARNING, **details, above=above, below=below))
    return out


def _lean(above: int, below: int) -> bool:
    """Return True if significantly more outliers are on one side."""
    return bool(abs(above - below) > LEAN * np.sqrt(above + below))


def _one_far(e: Evidence, label: str) -> Diagnostic:
    """Return the finding on a channel with one outlying reading, such as a hand measurement. It states measurement
    and prediction in place of 100 % outliers."""
    same = [c for c in e.channels if f"{c.sensor}[{c.entry}]" == label]
    z, h, sigma = next(
        (float(c.measured[k]), float(c.predicted[k]), c.sigma)
        for c in same
        for k in np.flatnonzero(np.isfinite(c.measured - c.predicted))
    )
    units = CHANNEL_UNITS.get(same[0].sensor, ())
    unit = units[same[0].entry] if same[0].entry < len(units) else ""
    difference = abs(z - h) / sigma
    return note("residual.one-far", WARNING, subject=label, measured=z, model=h, unit=unit, apart=difference)


def _beyond(e: Evidence) -> list[tuple[int, int, int]]:
    """Return for each channel over all runs the numbers of samples, of samples above OUTLIER, and of samples below
    −OUTLIER."""
    m = len(e.autocorrelation)
    counts = np.zeros((m, 3), int)
    for k, c in enumerate(e.channels):
        residuals = (c.measured - c.predicted) / c.sigma
        counts[k % m] += [
            np.sum(np.isfinite(residuals)),
            np.sum(residuals > OUTLIER),
            np.sum(residuals < -OUTLIER),
        ]
    return [(int(n), int(above), int(below)) for n, above, below in counts]


def _labels(e: Evidence) -> list[str]:
    return [f"{c.sensor}[{c.entry}]" for c in e.channels[: len(e.autocorrelation)]]


def short(name: str) -> str:
    """Return the path of a parameter in its short form for people."""
    return name.removeprefix("model.")


class ChannelOfRun(NamedTuple):
    """One channel in one run, in units of its noise."""

    run: str
    squares: float  # sum of the squared residuals, outliers clipped
    moved: float  # sum of the squared measurements about their mean
    samples: int

    @property
    def unlike(self) -> bool:
        """Return True if the square about the model exceeds FAR times the square about the mean of the channel."""
        return self.squares > FAR * self.moved

    @property
    def explained_variance(self) -> float:
        """Return the part of the channel's motion that the model explains."""
        return 1.0 - self.squares / self.moved if self.moved > 0.0 else 0.0


def by_channel(
    channels: "Sequence[ChannelFit]", one_mean: np.ndarray | None
) -> dict[str, list[ChannelOfRun]]:
    """Return for each channel its runs. `one_mean` (m,), in the order of the first run, marks channels with one
    mean over all runs."""
    out: dict[str, list[ChannelOfRun]] = {}
    labels = list(dict.fromkeys(f"{c.sensor}[{c.entry}]" for c in channels))
    means = np.zeros(len(labels)) if one_mean is None else one_mean
    for label, mean_of_runs in zip(labels, means, strict=True):
        fewest = 1 if mean_of_runs else 2
        same = [c for c in channels if f"{c.sensor}[{c.entry}]" == label]
        same = [c for c in same if np.isfinite(c.measured).sum() >= fewest]
        finite = [np.isfinite(c.measured) for c in same]
        z = [c.measured[finite_rows] for c, finite_rows in zip(same, finite, strict=True)]
        mean = float(np.mean(np.concatenate(z))) if mean_of_runs and z else None
        for c, finite_rows, measured in zip(same, finite, z, strict=True):
            most = CLIPPED * max(c.sigma, float(np.std(measured)))
            residuals = np.clip(measured - c.predicted[finite_rows], -most, most)
            signal = c.predicted[finite_rows] + residuals
            signal = signal - (np.mean(signal) if mean is None else mean)
            left2, moved2 = (float(x @ x) / c.sigma**2 for x in (residuals, signal))
            out.setdefault(label, []).append(ChannelOfRun(c.run, left2, moved2, len(measured)))
    return out


def whole(runs: Sequence[ChannelOfRun]) -> ChannelOfRun:
    """Return the sums over all runs of a channel."""
    squares, moved2, samples = (
        sum(getattr(channel, name) for channel in runs) for name in ("squares", "moved", "samples")
    )
    return ChannelOfRun("", squares, moved2, samples)


def unlike(channels: dict[str, list[ChannelOfRun]], hardly: bool) -> list[Diagnostic]:
    """Return findings on runs that are unlike the model in a channel that other runs support.

    If `hardly`, these are runs that moved by less than the model's error in the other runs. Else they are runs that
    moved more and differ significantly.
    """
    out = []
    for label, runs in channels.items():
        rest = [channel for channel in runs if not channel.unlike]
        if not rest:
            continue
        errs = whole(rest).squares / max(whole(rest).samples, 1)
        small = [channel.moved <= errs * channel.samples for channel in runs]
        outliers = [
            channel.run
            for channel, quiet in zip(runs, small, strict=True)
            if channel.unlike
            and (quiet if hardly else not quiet and _beyond_chance(channel, rest, len(runs)))
        ]
        if outliers:
            code, grave = (
                ("runs.hardly-moved", Severity.INFO) if hardly else ("runs.unlike-others", Severity.WARNING)
            )
            run_names = ", ".join(outliers[:NAMED]) + ", …" * (len(outliers) > NAMED)
            out.append(note(code, grave, subject=label, count=len(outliers), of=len(runs), runs=run_names))
    return out


def _beyond_chance(channel: ChannelOfRun, rest: list[ChannelOfRun], count: int) -> bool:
    """Return True if the residuals of a run are significantly larger than in the `rest`, one of `count` runs.  (1)
    Return True also if `rest` contains fewer than two runs, because their scatter is then unknown."""
    g = np.log([max(r.squares / r.samples, 1e-300) for r in (channel, *rest)])
    if len(rest) < 2:
        return True
    far = (
        student_quantile(1.0 - CHANCE / count, len(rest) - 1)
        * np.std(g[1:], ddof=1)
        * np.sqrt(1.0 + 1.0 / len(rest))
    )
    return bool(g[0] > np.mean(g[1:]) + far)
