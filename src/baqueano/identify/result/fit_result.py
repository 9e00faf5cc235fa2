"""Result of a fit: estimates with error bars, unobservable parameters, residuals, and a verdict."""

from dataclasses import dataclass, field
from datetime import date
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baqueano.contracts.calls import checked_call
from baqueano.contracts.result import Result, shorten, wrap_sentences
from baqueano.diagnostics import Diagnostic, Verdict, fault, most_severe_first, nearest, note
from baqueano.errors import UsageError
from baqueano.identify.covariance.information import FixedParameters
from baqueano.identify.data.record import contains_readings
from baqueano.identify.parameters.free import entries, free_parameter
from baqueano.messages import group_sentences, text
from baqueano.messages.language import mark as N_, number, percent_text, shown_unit, translate as _
from baqueano.messages.text_table import text_table, with_remark
from baqueano.numerics.statistics import QUANTILE_95
from baqueano.vehicle_file.units import channel_unit

if TYPE_CHECKING:
    from baqueano.contracts.values import TableRow
    from baqueano.identify.data.record import FittedBlocks
    from baqueano.runs.run import Run
    from baqueano.vehicle_file import VehicleFile
    from baqueano.vehicle_file.envelope import Envelope

MAX_LISTED_RUNS = 8  # runs, above which a table summarises them
MAX_REASONS, MAX_UNOBSERVABLE, MAX_NOTES = 5, 3, 4  # lines: with the verdict and the line on the others 14
BOUNDS = {"low": N_("at its lower bound"), "high": N_("at its upper bound")}
VERDICT_MEANINGS = {Verdict.REFUSED: note("verdict.refused"), Verdict.WARN: note("verdict.warn")}


class ChannelFit(NamedTuple):
    """One channel of one sensor in one run."""

    run: str
    sensor: str
    entry: int
    t_s: np.ndarray  # (N,)
    measurements: np.ndarray  # (N,) NaN without a measurement
    predictions: np.ndarray  # (N,)
    sigma: float  # of its noise
    explained_fraction: float  # part of the measurements' variance that the model explains, outliers clipped
    autocorrelation: float  # sum of the autocorrelation of the residuals, 0 for white noise

    @property
    def label(self) -> str:
        """Return the name of the channel, such as "imu[2]"."""
        return f"{self.sensor}[{self.entry}]"

    @property
    def residuals(self) -> np.ndarray:
        """Return z − h (N,), NaN without a measurement."""
        return self.measurements - self.predictions


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Fit(Result):
    """Parameters of a vehicle with their error bars, and a verdict. NaN marks parameters that the data do not
    determine.

    Parameters
    ----------
    names, units : tuple of str (p,)
        Dotted paths of the vehicle file, with entries, in the order of `free`; their units.
    start : ndarray (p,)
        Start of the search [unit of each].
    estimate, std : ndarray (p,)
        Estimates, and their standard errors [unit of each]; NaN if the parameter was not identifiable.
    bound : ndarray (p,)
        −1 at the low bound, 1 at the high one, 0 inside [no unit].
    poorly_identified : ndarray of bool (p,)
        Poorly identified.
    cov : ndarray (p, p)
        Covariance of the estimates [products of their units]; NaN if not identifiable.
    unmodelled_cov : ndarray (p, p)
        Part of `cov` by effects that the model lacks [products of units]; NaN if not identifiable.
    unmodelled_shifts : ndarray (n, p)
        Change of the estimates by each of these effects [unit of each], if its effect on the speed is known;
        divided by √3 for a difference between parts of the run.
    unmodelled_speeds : ndarray (n, 2, 3)
        Change of |ν_x| by the effect itself, forward and backward: part of it [1], constant [m/s], per yaw rate [m].
    fixed : FixedParameters
        Uncertain parameters that were not fitted: their paths (K,), the mean square `cov` (K, K) of their errors,
        and `shifts` (K, p), the change of the estimates per change of each.
    run_entry_names : tuple of str (q,)
        Names of the entries that each run has separately: biases, clocks, starts.
    run_entries, run_entry_std : ndarray (runs, q)
        Estimates of these entries, and their standard errors [unit of each].
    unobservable : tuple of Diagnostic
        Parameters that a better run would show.
    always_unobservable : tuple of Diagnostic
        Parameters that this vehicle can never show.
    verdict : Verdict
        USABLE, WARN or REFUSED.
    reasons, notes : tuple of Diagnostic
        Reasons of the verdict; changes to the data, and advice.
    channels : tuple of ChannelFit
        Measurement and prediction of each channel in each run.
    sigma : dict of str to ndarray (m,)
        Sensor → standard deviation of its noise [unit of each channel].
    autocorrelated : bool
        True if the residuals are autocorrelated; then the standard errors were widened.
    converged : bool
        True if the search ended at a minimum.
    cost : float
        Huber cost at the end [no unit].
    evaluations : int
        Number of evaluations of the cost.
    runs : tuple of str
        Names of the runs.
    backend : str
        Backend of the kernels.
    file : VehicleFile
        The file that was fitted.
    blocks : FittedBlocks
        Vehicle and sensors with the estimates.
    envelope : Envelope
        The motion in the runs.

    Examples
    --------
    >>> small, u = bq.load("small"), bq.excitation("prbs", [1.0, 0.0, 1.0], 10.0, 100.0)
    >>> fit = bq.identify(bq.simulate(small, u), small, ["model.mass_kg"], options=bq.FitOptions(diagnose=False))
    >>> bool(fit.interval[0, 0] < small.vehicle.mass_kg < fit.interval[0, 1])
    True
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    start: np.ndarray
    estimate: np.ndarray
    std: np.ndarray
    bound: np.ndarray
    poorly_identified: np.ndarray
    cov: np.ndarray
    unmodelled_cov: np.ndarray
    unmodelled_shifts: np.ndarray
    unmodelled_speeds: np.ndarray
    fixed: FixedParameters
    run_entry_names: tuple[str, ...]
    run_entries: np.ndarray
    run_entry_std: np.ndarray
    unobservable: tuple[Diagnostic, ...]
    always_unobservable: tuple[Diagnostic, ...]
    verdict: Verdict
    reasons: tuple[Diagnostic, ...]
    notes: tuple[Diagnostic, ...]
    channels: tuple[ChannelFit, ...] = field(repr=False)
    sigma: dict[str, np.ndarray]
    autocorrelated: bool
    converged: bool
    cost: float
    evaluations: int
    runs: tuple[str, ...]
    backend: str
    file: "VehicleFile" = field(repr=False)
    blocks: "FittedBlocks" = field(repr=False)
    envelope: "Envelope" = field(repr=False)

    @property
    def findings(self) -> tuple[Diagnostic, ...]:
        """Return all diagnostics: the reasons of the verdict, unobservable parameters, and notes."""
        return (*self.reasons, *self.unobservable, *self.always_unobservable, *self.notes)

    @property
    def correlation(self) -> np.ndarray:
        """Return the correlation of the estimates (p, p)."""
        return self.cov / np.outer(self.std, self.std)

    @property
    def interval(self) -> np.ndarray:
        """Return the 95 % interval of each parameter (p, 2)."""
        half_width = QUANTILE_95 * self.std
        return np.stack([self.estimate - half_width, self.estimate + half_width], axis=1)

    @property
    def channels_by_run(self) -> list[tuple[ChannelFit, ...]]:
        """Return the channels of each run. Several runs can have the same name."""
        count = len(self.channels) // len(self.runs)
        return [self.channels[k * count : (k + 1) * count] for k in range(len(self.runs))]

    def includes(self, run: "Run") -> bool:
        """Return True if the fit used this run: a run with its name and with its readings."""
        return bool(self.channels_of(run))

    def channels_of(self, run: "Run") -> tuple[ChannelFit, ...]:
        """Return the channels of a run with the name and readings of `run`; () if the fit did not use it."""
        for name, channels in zip(self.runs, self.channels_by_run, strict=True):
            is_alike = (contains_readings(run, c.sensor, c.entry, c.measurements) for c in channels)
            if name == run.name and all(is_alike):
                return channels
        return ()

    def value(self, name: str) -> float:
        """Return the estimate of one parameter by its path, NaN if it was not identifiable; as in the table, "model."
        can be omitted. Raise UsageError if it was not fitted."""
        path = f"model.{name}" if f"model.{name}" in self.names else name
        if path not in self.names:
            raise UsageError(self._missing_parameter(name))
        return float(self.estimate[self.names.index(path)])

    def _missing_parameter(self, name: str) -> Diagnostic:
        """Return the message for a name that was not fitted: the option that frees it, or a similar name."""
        try:
            entry_paths = [free_parameter(self.blocks, path, {}).path for path in entries(self.blocks, name)]
        except UsageError:
            entry_paths = []
        fitted_paths = [path for path in entry_paths if path in self.names]
        if entry_paths and not fitted_paths:
            return fault("fit.not-free", f"--free +{name}", path=name, valid=self.names)
        return fault("fit.not-fitted", path=name, suggestion=nearest(name, fitted_paths[:1] or self.names))

    @property
    def vehicle_file(self) -> "VehicleFile":
        """Return the file with the estimates and their origin. After a REFUSED fit the file is unchanged."""
        return self.updated_file()

    @checked_call("fit.updated_file()")
    def updated_file(self, on: date | None = None) -> "VehicleFile":
        """Return the file with the estimates, dated `on`, by default today."""
        if self.verdict == Verdict.REFUSED:
            return self.file
        from baqueano.identify.result.to_vehicle_file import fit_file

        return fit_file(self, on)

    def rows(self) -> list["TableRow"]:
        """Return one flat row per parameter, with None for unknown values."""
        rows = []
        for k, name in enumerate(self.names):
            is_identified = bool(np.isfinite(self.estimate[k]))
            state = "poorly" if self.poorly_identified[k] else "yes"
            rows.append({
                "name": name, "estimate": float(self.estimate[k]) if is_identified else None,
                "std": float(self.std[k]) if is_identified and np.isfinite(self.std[k]) else None,
                "unit": self.units[k], "start": float(self.start[k]),
                "bound": {-1: "low", 1: "high"}.get(int(self.bound[k])) if is_identified else None,
                "identifiable": state if is_identified else "no",
            })  # fmt: skip
        return rows

    def __repr__(self) -> str:
        identified_count, table_rows = int(np.isfinite(self.estimate).sum()), self.rows()
        runs = self.runs[0] if len(self.runs) == 1 else _("{runs} runs", runs=len(self.runs))
        numbers = {"runs": runs, "count": identified_count, "parameters": len(table_rows)}
        head = text(note("front.fit", vehicle=self.file.name, **numbers))
        names = [row["name"].removeprefix("model.") for row in table_rows]
        width, rows = max(map(len, names)), []
        for name, row in zip(names, table_rows, strict=True):
            if row["estimate"] is None:
                continue
            value = round_to_error(row["estimate"], row["std"])
            error = f"± {number(np.nan if row['std'] is None else row['std']):<8.2g}"
            rows.append(f"{name:{width}}  {number(value):>10.5g} {error} {shown_unit(row['unit'])}")
        return shorten([head], rows, verdict_lines(self)[:3])

    def table(self, reported: bool = False) -> str:
        """Return the table as text, with the most severe diagnostics below it. `reported` is True if a report with
        all diagnostics is written."""
        cells, remarks = [], [""]
        for row in self.rows():
            remarks.append(row_remarks(row))
            name = row["name"].removeprefix("model.")
            if row["estimate"] is None:
                cells.append([name, "–", "", ""])
                continue
            std = f"± {number(row['std']):.2g}" if row["std"] is not None else "± ?"
            value = f"{number(round_to_error(row['estimate'], row['std'])):.5g}"
            cells.append([name, value, std, shown_unit(row["unit"])])
        table = text_table("<>><", [_("parameter"), _("estimate"), _("std. error"), _("unit")], *cells)
        lines = [
            *(part for row in zip(table, remarks, strict=True) for part in with_remark(*row)),
            "",
            *self._per_run_lines(),
            *self._channel_lines(),
            "",
            *wrap_sentences(verdict_lines(self, reported)),
        ]
        return "\n".join(lines)

    def run_by_run(self) -> list["TableRow"]:
        """Return one flat row per run and entry of the run; std is None if the run does not determine the entry."""
        rows: list[TableRow] = []
        for k, name in enumerate(self.run_entry_names):
            for run, x, std in zip(self.runs, self.run_entries[:, k], self.run_entry_std[:, k], strict=False):
                std = float(std) if np.isfinite(std) else None
                rows.append({"run": run, "name": name, "estimate": float(x), "std": std})
        return rows

    def _per_run_lines(self) -> list[str]:
        """Return lines on the entries of each run that the user requested; biases and starts are excluded."""
        rows = [row for row in self.run_by_run() if is_requested(row["name"])]
        if len(self.runs) > MAX_LISTED_RUNS:
            return self._per_run_summary(rows)
        lines = []
        for row in rows:
            std = _("not identifiable") if row["std"] is None else f"± {number(row['std']):.2g}"
            unit = _(" s, to be added to its timestamps") if row["name"].startswith("clock.") else ""
            lines.append(_("{name} of {run}: {estimate:.5g} {std}{unit}", **row | {"std": std, "unit": unit}))
        return [*lines, ""] if lines else []

    def _per_run_summary(self, rows: list["TableRow"]) -> list[str]:
        """Return one line per entry, a summary of all runs."""
        lines = []
        for name in dict.fromkeys(row["name"] for row in rows):
            x = [row["estimate"] for row in rows if row["name"] == name]
            unit = _(" s, to be added to its timestamps") if name.startswith("clock.") else ""
            figures: TableRow = {"runs": len(x), "median": float(np.median(x)), "low": min(x), "high": max(x)}
            figures |= {"name": name, "unit": unit}
            lines.append(_("{name} of {runs} runs: {median:.5g}, {low:.5g} to {high:.5g}{unit}", **figures))
        return [*lines, ""] if lines else []

    def _channel_lines(self) -> list[str]:
        lines = []
        if len(self.runs) > MAX_LISTED_RUNS:
            return self._channels_together()
        for c in self.channels:
            if not np.isfinite(c.explained_fraction):
                continue  # it was not fitted
            label = _("{channel} of {run}", channel=c.label, run=c.run) if len(self.runs) > 1 else c.label
            unit = channel_unit(self.file, c.sensor, c.entry)
            noise = f"{number(c.sigma):.3g} {unit}".rstrip()
            details = {"channel": label, "noise": noise, "part": percent_text(c.explained_fraction)}
            if c.explained_fraction >= 0.0:
                lines.append(_("{channel}: noise {noise}, the model explains {part}", **details))
                continue
            template = N_("{channel}: noise {noise}, larger than the signal: the model explains nothing")
            lines.append(_(template, **details))
        return lines

    def _channels_together(self) -> list[str]:
        """Return one line per channel on all runs: the median run, and the run with the least explained part."""
        lines, finite_channels = [], [c for c in self.channels if np.isfinite(c.explained_fraction)]
        for label in dict.fromkeys(c.label for c in finite_channels):
            channel_fits = [c for c in finite_channels if c.label == label]
            sorted_fits = sorted(channel_fits, key=lambda c: c.explained_fraction)
            median, lowest = sorted_fits[len(sorted_fits) // 2], sorted_fits[0]
            unit = channel_unit(self.file, median.sensor, median.entry)
            noise = f"{number(median.sigma):.3g} {unit}".rstrip()
            middle_text, low_text = (percent_text(c.explained_fraction) for c in (median, lowest))
            text_ = _(
                "{channel} of {runs} runs: noise {noise}; the model explains {middle} of the median "
                "run and {least} of {run}",
                channel=label, runs=len(sorted_fits), noise=noise, middle=middle_text, least=low_text, run=lowest.run,
            )  # fmt: skip
            lines.append(text_)
        return lines


def is_requested(name: str) -> bool:
    """Return True if the user requested this entry of a run, which excludes biases and starts."""
    return not name.startswith("start.") and "_bias" not in name


def round_to_error(value: float, std: float | None) -> float:
    """Return a value rounded to three digits beyond the first digit of its standard error: 9e-8 ± 0.05 is 0."""
    if std is None or not std > 0.0:
        return value
    return round(value, 3 - int(np.floor(np.log10(std))))


def row_remarks(row: dict[str, Any]) -> str:
    """Return the remarks on a row of `Fit.rows()`, or "" without remarks."""
    value, std = row["estimate"], row["std"]
    if value is None:
        return _("not identifiable, fixed at {start:.4g}", start=row["start"])
    row_texts = [_(BOUNDS[row["bound"]])] if row["bound"] else []
    row_texts += [_("poorly identified")] if row["identifiable"] == "poorly" else []
    if std is None:
        row_texts.append(_("its error is unknown"))
    elif abs(value) < QUANTILE_95 * std:
        row_texts.append(_("may be 0"))
    elif abs(value) < 2.0 * QUANTILE_95 * std:
        row_texts.append(_("roughly, ± {percent:.0f} %", percent=100.0 * QUANTILE_95 * std / abs(value)))
    return ", ".join(row_texts)


def verdict_lines(fit: Any, reported: bool = False) -> list[str]:
    """Return the verdict with the most severe reasons, unobservable parameters and notes, as lines of text. The last
    line counts the omitted messages. If `reported`, it states that a report contains them."""
    lists = (fit.reasons, fit.unobservable, fit.always_unobservable + fit.notes)
    reasons, unobservable, notes = (group_sentences(most_severe_first(messages)) for messages in lists)
    main_text = reasons.pop() if len(reasons) == 1 else text(VERDICT_MEANINGS.get(fit.verdict))
    lines = [f"{_(fit.verdict)}: {main_text}", *(f"- {line}" for line in reasons[:MAX_REASONS])]
    lines += [f"- {line}" for line in (*unobservable[:MAX_UNOBSERVABLE], *notes[:MAX_NOTES])]
    limits = (reasons, MAX_REASONS), (unobservable, MAX_UNOBSERVABLE), (notes, MAX_NOTES)
    omitted_count = sum(max(0, len(sentences) - n) for sentences, n in limits)
    if not omitted_count:
        return lines
    return [*lines, text(note("verdict.more-in-report" if reported else "verdict.more", count=omitted_count))]
