"""Follow the parameters of a vehicle over many runs, and detect which of them changed, and when.

Each run is fitted separately, θ̂_k with its covariance Σ_k; the vehicle's parameters follow a random walk,

    θ_k = θ_{k−1} + w_k,  w_k ~ N(0, diag q²),   θ̂_k = θ_k + e_k,  e_k ~ N(0, Σ_k)                        (1)

(1) is filtered and smoothed (Rauch, Tung, Striebel 1965). q, with one entry per parameter, maximises its likelihood.
A parameter that a run did not determine keeps its value, with a growing error. Each parameter is tested for one step:

    z_k = (mean after k − mean before k) / its standard error,   z = max_k |z_k|                          (2)

The means are weighted by 1/(Σ_kk + s²). s is the scatter from run to run beyond the error bars, from differences of
neighbouring runs. A parameter changed if the p-value of z is below ALPHA, corrected for K − 1 places and p parameters
(Bonferroni). The change is a drift if a straight line explains the runs better than the step.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from baqueano.contracts.result import Result, shorten
from baqueano.contracts.values import TableRow
from baqueano.diagnostics import Diagnostic, Severity, Verdict, note
from baqueano.errors import UsageError
from baqueano.estimators.kalman import correct
from baqueano.identify.fit import identify
from baqueano.identify.options import FitOptions
from baqueano.identify.parameters.free import substitute
from baqueano.identify.result.fit_result import Fit
from baqueano.messages import text
from baqueano.messages.language import number, translate as _
from baqueano.messages.printable import baqueano_command
from baqueano.messages.text_table import text_table
from baqueano.numerics.statistics import QUANTILE_95
from baqueano.runs.run import Run
from baqueano.vehicle_file import VehicleFile

ALPHA = 0.01  # probability of reporting a change when nothing changed
MIN_RUNS = 3  # runs; a drift needs more, the scatter needs MIN_RUNS + 2
WALK_STDS = np.array([0.0, *np.geomspace(0.05, 50.0, 25)])  # q in typical standard errors
EPOCH_NS = 10**18  # timestamps above it are dates


class ParameterChange(NamedTuple):
    """A parameter that changed."""

    name: str
    unit: str
    pattern: str  # "step" or "drift"
    runs: tuple[str, str]  # runs: before and after the step, or the first and the last
    first_value: float
    first_std: float
    last_value: float
    last_std: float
    z: float

    @property
    def message(self) -> Diagnostic:
        """Return the change as a warning."""
        growth = self.last_value - self.first_value
        percent = 100.0 * growth / abs(self.first_value) if self.first_value else float("inf")
        details = {
            key: getattr(self, key) for key in ("first_value", "first_std", "last_value", "last_std", "unit")
        }
        details |= {"percent": percent, "z": abs(self.z), "first": self.runs[0], "second": self.runs[1]}
        code = "over-time.step" if self.pattern == "step" else "over-time.drift"
        return note(code, Severity.WARNING, subject=self.name, **details)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ParameterHistory(Result):
    """Parameters run by run: single fits, filtered and smoothed values, and changes."""

    names: tuple[str, ...]  # (p,)
    units: tuple[str, ...]
    runs: tuple[str, ...]  # (K,) in the order of time
    when: tuple[str, ...]  # (K,) dates, "" if the timestamps are not dates
    single: np.ndarray  # (K, p) fits of single runs; NaN if not identifiable, or if the fit was refused
    single_std: np.ndarray  # (K, p)
    filtered_values: np.ndarray  # (K, p) after run k, from the runs up to it
    filtered_std: np.ndarray  # (K, p)
    cov: np.ndarray  # (p, p) after the last run
    smoothed_values: np.ndarray  # (K, p) from all runs
    smoothed_std: np.ndarray  # (K, p)
    walk: np.ndarray  # (p,) q: standard deviation of a parameter's change from run to run
    changes: tuple[ParameterChange, ...]
    refused_runs: tuple[str, ...]  # runs whose fit was refused
    last: Fit  # of the last run that could be fitted

    @property
    def verdict(self) -> Verdict:
        """Return WARN if a parameter moved or a run was refused, else USABLE."""
        return Verdict.WARN if self.changes or self.refused_runs else Verdict.USABLE

    @property
    def vehicle_file(self) -> VehicleFile:
        """Return the file with the parameters after the last run."""
        value, std = self.filtered_values[-1], self.filtered_std[-1]
        is_measured = np.isfinite(value) & np.isfinite(std)
        paths = [name for name, k in zip(self.names, is_measured, strict=True) if k]
        blocks = substitute(self.last.blocks, paths, [float(x) for x in value[is_measured]])
        cov = np.where(np.outer(is_measured, is_measured), self.cov, np.nan)
        return replace(
            self.last,
            names=self.names,
            units=self.units,
            estimate=value,
            std=std,
            cov=cov,
            blocks=blocks,
            runs=self.runs,
        ).vehicle_file

    def rows(self) -> list[TableRow]:
        """Return one flat row per run and parameter."""
        rows = []
        for k, run in enumerate(self.runs):
            for i, name in enumerate(self.names):
                rows.append(
                    {
                        "run": run, "date": self.when[k] or None, "name": name, "unit": self.units[i],
                        "estimate": float(self.single[k, i]), "std": float(self.single_std[k, i]),
                        "filtered_value": float(self.filtered_values[k, i]),
                        "filtered_std": float(self.filtered_std[k, i]),
                        "smoothed_value": float(self.smoothed_values[k, i]),
                        "smoothed_std": float(self.smoothed_std[k, i]),
                    }
                )  # fmt: skip
        return rows

    def table(self) -> str:
        """Return a table as text: the first run, the last run, and the present estimate."""
        head = [_("parameter"), self.runs[0], self.runs[-1], _("now"), _("unit")]
        rows = (
            [
                name.removeprefix("model."),
                _estimate_text(self.single[0, i], self.single_std[0, i]),
                _estimate_text(self.single[-1, i], self.single_std[-1, i]),
                _estimate_text(self.filtered_values[-1, i], self.filtered_std[-1, i]),
                self.units[i],
            ]
            for i, name in enumerate(self.names)
        )
        lines = text_table("<>>><", head, *rows)
        return "\n".join([*lines, *self._sentences()])

    def __repr__(self) -> str:
        title = text(note("front.card-history", vehicle=self.last.file.name, runs=len(self.runs)))
        *changes, summary = self._sentences()
        return shorten([title], changes, [summary])

    def _sentences(self) -> list[str]:
        lines = [f"- {text(change.message)}" for change in self.changes]
        lines += [f"- {text(note('over-time.refused', subject=run))}" for run in self.refused_runs]
        constant = _("no parameter changed beyond its error bars over {runs} runs", runs=len(self.runs))
        summary = _("{moved} parameters changed", moved=len(self.changes)) if self.changes else constant
        return [*lines, f"{_(self.verdict)}: {summary}"]


@dataclass(frozen=True, slots=True, eq=False)
class Drift:
    """The parameters of a `ParameterHistory` that changed; `rows` contains only these."""

    history: ParameterHistory

    @property
    def verdict(self) -> Verdict:
        """Return the verdict of the whole history."""
        return self.history.verdict

    def rows(self) -> list[TableRow]:
        """Return one flat row per parameter that changed."""
        return [
            {name: x for name, x in change._asdict().items() if name != "runs"}
            | {"first_run": change.runs[0], "last_run": change.runs[1]}
            for change in self.history.changes
        ]

    def table(self) -> str:
        """Return the table as text."""
        return "\n".join(self.history._sentences())


def parameter_history(
    runs: Sequence["Run"],
    vehicle_file: VehicleFile,
    free: Sequence[str] | None = None,
    *,
    use: Sequence[str] | None = None,
    options: FitOptions = FitOptions(),  # noqa: B008  it is frozen
    progress: Callable[[str], object] | None = None,
) -> ParameterHistory:
    """Return the parameters of `vehicle_file` over `runs` in order of time. The runs are sorted by their timestamps if
    these are dates, else they remain in the given order. `free`, `use` and `options` are as in `identify`. Raise
    UsageError if fewer than two runs can be fitted."""
    if len(runs) < 2:
        raise UsageError.of("over-time.few-runs", count=len(runs))
    if all(len(run.t_ns) and run.t_ns[0] > EPOCH_NS for run in runs):
        runs = sorted(runs, key=lambda run: int(run.t_ns[0]))
    fits, refused_fits = [], []
    for run in runs:
        if progress is not None:
            progress(_("fitting {run}, {duration_s:.0f} s", run=run.name, duration_s=run.duration_s))
        fit = identify(run, vehicle_file, free, use=use, options=options)
        refused_fits += [run.name] if fit.verdict == Verdict.REFUSED else []
        fits.append(fit)
    accepted_fits = [fit for fit in fits if fit.verdict != Verdict.REFUSED]
    if len(accepted_fits) < 2:
        fix = baqueano_command("identify", refused_fits[0])
        raise UsageError.of("over-time.few-fits", fix, accepted_count=len(accepted_fits), count=len(fits))
    return track_parameters(fits, [_run_date(run) for run in runs])


def compare_fits(fits: Sequence[Fit], names: Sequence[str] = ()) -> ParameterHistory:
    """Return the parameters of two or more fits, and the ones that changed; `names` replace those of the runs.

    Raise UsageError unless two of the fits are accepted.
    """
    usable_count = sum(fit.verdict != Verdict.REFUSED for fit in fits)
    if usable_count < 2:
        raise UsageError.of(
            "compare.few-fits", "print(fit.table())", accepted_count=usable_count, count=len(fits)
        )
    return track_parameters(fits, labels=names)


def track_parameters(
    fits: Sequence[Fit], when: Sequence[str] = (), labels: Sequence[str] = ()
) -> ParameterHistory:
    """Return the history of the parameters from fits in order of time; `labels` name the fits.  (1), (2)"""
    units = {name: unit for fit in fits for name, unit in zip(fit.names, fit.units, strict=True)}
    names, labels = tuple(units), tuple(labels or _labels(fits))
    K, p = len(fits), len(units)
    single, single_std, covs = np.full((K, p), np.nan), np.full((K, p), np.nan), np.full((K, p, p), np.nan)
    is_refused = [fit.verdict == Verdict.REFUSED for fit in fits]
    for k, fit in enumerate(fits):
        if not is_refused[k]:
            columns = [names.index(name) for name in fit.names]
            single[k, columns], single_std[k, columns] = fit.estimate, fit.std
            covs[k][np.ix_(columns, columns)] = fit.cov
    walk = np.array([_most_likely_walk(single[:, i], single_std[:, i]) for i in range(p)])
    filtered_values, cov, smoothed_values = _smooth(single, covs, walk)
    estimates = zip(names, units.values(), single.T, single_std.T, strict=True)
    tests = [_change(name, unit, labels, x, std, p) for name, unit, x, std in estimates]
    changes = sorted((change for change in tests if change is not None), key=lambda change: -abs(change.z))
    accepted_fits = [fit for fit, skip in zip(fits, is_refused, strict=True) if not skip]
    refused_runs = tuple(label for label, skip in zip(labels, is_refused, strict=True) if skip)
    return ParameterHistory(
        names, tuple(units.values()), labels, tuple(when) or ("",) * K, single, single_std, *filtered_values, cov,
        *smoothed_values, walk, tuple(changes), refused_runs, accepted_fits[-1],
    )  # fmt: skip


def _labels(fits: Sequence[Fit]) -> list[str]:
    """Return the names of the runs of each fit, with its number if two fits have the same runs."""
    labels = [" + ".join(fit.runs) for fit in fits]
    return [f"{k}: {x}" if labels.count(x) > 1 else x for k, x in enumerate(labels, 1)]


def _smooth(
    single: np.ndarray, covs: np.ndarray, walk: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Return the filtered values of (1), their last covariance (p, p), and the smoothed values. Values and standard
    errors are (K, p) each, NaN before the first estimate of a parameter."""
    K, p = single.shape
    measured_std = [std[np.isfinite(std)] for std in np.sqrt(np.einsum("kii->ik", covs))]
    typical_std = np.array([np.median(std) if len(std) else 0.0 for std in measured_std])
    prior_std = 1e6 * np.where(typical_std > 0.0, typical_std, 1.0)
    x, P = np.zeros(p), np.diag(prior_std**2)
    Q = np.diag(np.where(np.isfinite(walk), walk, 0.0) ** 2)
    states = []
    for k in range(K):
        prior = x, P if k == 0 else P + Q
        x, P = prior
        measured_entries = np.flatnonzero(np.isfinite(single[k]) & np.isfinite(np.diagonal(covs[k])))
        if len(measured_entries):
            R = covs[k][np.ix_(measured_entries, measured_entries)]
            y = single[k, measured_entries] - x[measured_entries]
            correction = correct(P, y, np.eye(p)[measured_entries], R)
            x, P = x + correction.mean_change, correction.cov
        states.append((prior, (x, P)))
    smoothed_states = [states[-1][1]]
    for k in range(K - 2, -1, -1):
        (x_bar, P_bar), (x, P) = states[k + 1][0], states[k][1]
        G = np.linalg.solve(P_bar, P).T
        x_s, P_s = smoothed_states[0]
        smoothed_states.insert(0, (x + G @ (x_s - x_bar), P + G @ (P_s - P_bar) @ G.T))
    has_begun = np.maximum.accumulate(np.isfinite(single), axis=0)
    is_ever_measured = np.tile(np.isfinite(single).any(axis=0), (K, 1))
    filtered_values = _columns([s[1] for s in states], has_begun)
    return filtered_values, states[-1][1][1], _columns(smoothed_states, is_ever_measured)


def _columns(
    states: list[tuple[np.ndarray, np.ndarray]], is_known: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    x = np.array([state[0] for state in states])
    std = np.sqrt(np.maximum(np.array([np.diagonal(state[1]) for state in states]), 0.0))
    return np.where(is_known, x, np.nan), np.where(is_known, std, np.nan)


def _most_likely_walk(estimate: np.ndarray, std: np.ndarray) -> float:
    """Return q of one parameter under (1), from a grid of multiples of its median error; 0 if not significant."""
    is_measured = np.isfinite(estimate) & np.isfinite(std)
    y, s = estimate[is_measured], std[is_measured]
    if len(y) < 2:
        return 0.0
    typical_std = float(np.median(s))
    costs = []
    for ratio in WALK_STDS:
        x, P, cost = y[0], s[0] ** 2, 0.0
        for z, r in zip(y[1:], s[1:], strict=True):
            P += (ratio * typical_std) ** 2
            S = P + r**2
            cost += 0.5 * (np.log(S) + (z - x) ** 2 / S)
            x, P = x + P / S * (z - x), P * r**2 / S
        costs.append(cost)
    best_index = int(np.argmin(costs))
    return (
        float(WALK_STDS[best_index] * typical_std)
        if costs[0] - costs[best_index] > 0.5 * QUANTILE_95**2
        else 0.0
    )


def _change(
    name: str, unit: str, runs: tuple[str, ...], estimate: np.ndarray, std: np.ndarray, test_count: int
) -> ParameterChange | None:
    """Return the step or drift of one parameter, or None if it did not change.  (2)"""
    measured_runs = np.flatnonzero(np.isfinite(estimate) & np.isfinite(std))
    y, variance = estimate[measured_runs], std[measured_runs] ** 2
    if len(measured_runs) < 2:
        return None
    variance = variance + _scatter(y, variance) ** 2
    weight = 1.0 / variance
    steps = []
    for k in range(1, len(measured_runs)):
        first_mean, last_mean = (
            np.sum(weight[s] * y[s]) / np.sum(weight[s]) for s in (slice(k), slice(k, None))
        )
        first_variance, last_variance = 1.0 / weight[:k].sum(), 1.0 / weight[k:].sum()
        z = (last_mean - first_mean) / np.sqrt(first_variance + last_variance)
        residuals = np.concatenate([y[:k] - first_mean, y[k:] - last_mean])
        steps.append(
            (z, first_mean, first_variance, last_mean, last_variance, float(np.sum(weight * residuals**2)), k)
        )
    best_step = max(steps, key=lambda step: abs(step[0]))
    if not abs(best_step[0]) > NormalDist().inv_cdf(1.0 - 0.5 * ALPHA / (test_count * len(steps))):
        return None
    line, line_cost = _fit_line(np.arange(len(measured_runs), dtype=float), y, weight)
    if len(measured_runs) > MIN_RUNS and line_cost < best_step[5]:
        ends = (line[0], line[0] + line[1] * (len(measured_runs) - 1))
        z = float(line[1] / line[2])
        first, last = runs[measured_runs[0]], runs[measured_runs[-1]]
        first_std, last_std = float(np.sqrt(variance[0])), float(np.sqrt(variance[-1]))
        values = float(ends[0]), first_std, float(ends[1]), last_std
        return ParameterChange(name, unit, "drift", (first, last), *values, z)
    z, first_mean, first_variance, last_mean, last_variance, _, k = best_step
    run_pair = (runs[measured_runs[k - 1]], runs[measured_runs[k]])
    return ParameterChange(
        name, unit, "step", run_pair, float(first_mean), float(np.sqrt(first_variance)), float(last_mean),
        float(np.sqrt(last_variance)), float(z),
    )  # fmt: skip


def _fit_line(t: np.ndarray, y: np.ndarray, weight: np.ndarray) -> tuple[tuple[float, float, float], float]:
    """Return offset, slope and its standard error of a weighted straight line, and the weighted sum of squares."""
    mean = np.sum(weight * t) / weight.sum()
    moment = np.sum(weight * (t - mean) ** 2)
    slope = float(np.sum(weight * (t - mean) * y) / moment)
    level = float(np.sum(weight * y) / weight.sum())
    residuals = y - level - slope * (t - mean)
    return (level - slope * mean, slope, float(1.0 / np.sqrt(moment))), float(np.sum(weight * residuals**2))


def _scatter(y: np.ndarray, variance: np.ndarray) -> float:
    """Return s, the robust scatter of the differences of neighbours beyond their errors, or 0 with fewer than MIN_RUNS
    + 2 runs. A step affects only one of the differences, so it almost does not change s."""
    if len(y) < MIN_RUNS + 2:
        return 0.0
    excess = np.median(np.diff(y) ** 2 / 0.4549) - np.median(variance[1:] + variance[:-1])
    return float(np.sqrt(max(0.5 * excess, 0.0)))


def _run_date(run: "Run") -> str:
    if not len(run.t_ns) or run.t_ns[0] < EPOCH_NS:
        return ""
    return datetime.fromtimestamp(float(run.t_ns[0]) * 1e-9, UTC).strftime("%Y-%m-%d %H:%M")


def _estimate_text(value: float, std: float) -> str:
    return _("not identifiable") if not np.isfinite(value) else f"{number(value):.4g} ± {number(std):.1g}"
