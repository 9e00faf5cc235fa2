"""Measure sensors at rest: bias, scatter, Allan deviation with its coefficients, and change with temperature.

The longest time without a command is used, from REST_S after the last command. With x the integral of the signal, N
samples τ₀ apart, τ = n τ₀ and the temperature T:

    σ²(τ) = Σ_{k=1}^{N+1−2n} (x_{k+2n} − 2 x_{k+n} + x_k)² / (2 τ² (N + 1 − 2n))                           (1)
    σ²(τ) = W²/τ + (2 ln 2/π) B² + K² τ/3      W white noise, B instability and K walk of the bias          (2)
    ν = (3 N / (2 n) − 2 (N − 1)/(N + 1)) · 4 n² / (4 n² + 5),   95 % interval: σ² ν / χ²                  (3)
    z = b + s (T − T̄),   std of both from block means                                                      (4)

The error of the bias is (1) of an average of that length, not σ/√N: the bias of a low-cost sensor drifts. (2) is fitted
to (1) at octaves of τ, weighted by ν, at most MAX_FREEDOM. A coefficient below twice its error is not measurable.
Timestamps in bursts are treated as even. Sources: IEEE Std 952-1997, annex C for (2); Riley, NIST SP 1065 (2008).
"""

from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np

from baqueano.calibration.rest import REST_S
from baqueano.contracts.calls import checked_call
from baqueano.contracts.optional import has_field
from baqueano.contracts.result import Result
from baqueano.contracts.values import JsonObject, TableRow
from baqueano.diagnostics import Diagnostic, Severity, Verdict, note
from baqueano.errors import UsageError
from baqueano.messages import texts
from baqueano.messages.language import number, translate as _
from baqueano.messages.text_table import text_table
from baqueano.numerics.statistics import MAD, QUANTILE_95, chi_square
from baqueano.runs.run import Channel, Run
from baqueano.signals import seconds
from baqueano.vehicle_file import Provenance, VehicleFile
from baqueano.vehicle_file.file import today

MIN_SAMPLES = 200  # samples of a sensor at rest
MIN_ALLAN_SAMPLES = 16  # samples of (1)
TEMPERATURE_BLOCKS = 12  # means from which the slope over temperature is estimated
MIN_TEMPERATURE_CHANGE = 0.5  # °C of change, below which no slope is estimated
BURST_STEPS = 0.5  # of the mean step: timestamps whose steps scatter by more come in bursts
TEMPERATURE = "temperature"
MIN_FREEDOM = 1.0  # degrees of freedom, below which an average is not shown
MAX_FREEDOM = 200.0  # of (1) in the fit of (2): 7 % of σ
ROUNDS = 20  # of the weights of (2)
NOISE_COLUMNS = "white_noise", "bias_instability", "bias_walk"
FLICKER = 2.0 * np.log(2.0) / np.pi


class AllanDeviation(NamedTuple):
    """Averaging times, the Allan deviation, and its 95 % interval."""

    tau_s: np.ndarray  # (K,)
    deviation: np.ndarray  # (K,) in the unit of the signal
    low: np.ndarray  # (K,)
    high: np.ndarray  # (K,)
    degrees_of_freedom: np.ndarray  # (K,) degrees of freedom


class Coefficients(NamedTuple):
    """Coefficients W, B, K with their standard errors; 0 for a coefficient that the data do not show."""

    value: np.ndarray  # (3,) per √Hz, in the unit of the signal, per s^1.5 times √Hz·s
    std: np.ndarray  # (3,)

    @property
    def is_measurable(self) -> np.ndarray:
        """Return a mask (3,) of the coefficients above twice their error."""
        return self.value > 2.0 * self.std


def averaging_counts(sample_count: int) -> np.ndarray:
    """Return the numbers of samples n of (1): octaves with at least one degree of freedom."""
    n = 2 ** np.arange(int(np.log2(max(2, sample_count))) + 1)
    return n[(2 * n <= sample_count) & (degrees_of_freedom(sample_count, n) >= MIN_FREEDOM)]


def degrees_of_freedom(sample_count: int, n: np.ndarray) -> np.ndarray:
    """Return the degrees of freedom ν (K,) of averages over n samples.  (3)"""
    n = np.asarray(n, dtype=float)
    N = sample_count + 1.0  # points of the integral
    return (3.0 * (N - 1.0) / (2.0 * n) - 2.0 * (N - 2.0) / N) * 4.0 * n**2 / (4.0 * n**2 + 5.0)


def allan_deviation(y: np.ndarray, rate_hz: float, n: np.ndarray | None = None) -> AllanDeviation:
    """Return the Allan deviation of a signal y (N,), sampled `rate_hz` times per second.

    Averages are over `n` (K,) samples, by default octaves.  (1) Raise UsageError for fewer than MIN_ALLAN_SAMPLES
    samples, a sample that is not finite, or a rate of 0 or below. Raise it also for averages over more than half.

    >>> white = np.random.default_rng(0).normal(0.0, 0.1, 10_000)  # 0.1 at 100 Hz: 0.01 per √Hz
    >>> coefficients(allan_deviation(white, 100.0)).value.round(3)
    array([0.01, 0.  , 0.  ])
    """
    y = np.asarray(y, dtype=float)
    if y.ndim != 1 or len(y) < MIN_ALLAN_SAMPLES or not np.all(np.isfinite(y)):
        raise UsageError.of("allan.numbers", minimum=MIN_ALLAN_SAMPLES, value=y.size)
    if not rate_hz > 0.0:
        raise UsageError.of("allan.rate", rate_hz=rate_hz)
    n = averaging_counts(len(y)) if n is None else np.atleast_1d(n).astype(int)
    if np.any(n < 1) or np.any(2 * n > len(y)):
        raise UsageError.of("allan.averages", samples=len(y), maximum=len(y) // 2, value=n.tolist())
    x = np.concatenate([[0.0], np.cumsum(y - y.mean())]) / rate_hz
    variance = np.empty(len(n))
    for k, count in enumerate(n.tolist()):
        differences = x[2 * count :] - 2.0 * x[count:-count] + x[: -2 * count]
        variance[k] = np.mean(differences**2) / (2.0 * (count / rate_hz) ** 2)
    nu = np.maximum(degrees_of_freedom(len(y), n), MIN_FREEDOM)
    high = variance * nu / chi_square(nu, -QUANTILE_95)
    low = variance * nu / chi_square(nu, QUANTILE_95)
    return AllanDeviation(n / rate_hz, np.sqrt(variance), np.sqrt(low), np.sqrt(high), nu)


def coefficients(curve: AllanDeviation) -> Coefficients:
    """Return W, B, K of (2), none below 0, for the combination of coefficients that fits best."""
    tau, variance = curve.tau_s, np.maximum(curve.deviation**2, 1e-300)
    terms = np.stack([1.0 / tau, np.full_like(tau, FLICKER), tau / 3.0], axis=1)
    best_fit, min_cost = (np.zeros(3), np.full(3, np.nan)), np.inf
    for term_count in (1, 2, 3):
        for members in combinations(range(3), term_count):
            nu = np.minimum(curve.degrees_of_freedom, MAX_FREEDOM)
            squares, stds, cost = _fit_terms(terms[:, members], variance, nu)
            penalty = 2.0 * (term_count > 1)  # for another coefficient
            if np.all(squares > 0.0) and cost < min_cost - penalty:
                min_cost, all_squares, all_stds = cost, np.zeros(3), np.full(3, np.nan)
                all_squares[list(members)], all_stds[list(members)] = squares, stds
                best_fit = (all_squares, all_stds)
    squares, stds = best_fit
    value = np.sqrt(squares)
    return Coefficients(value, np.where(value > 0.0, stds / (2.0 * np.maximum(value, 1e-300)), np.nan))


def _fit_terms(
    terms: np.ndarray, variance: np.ndarray, nu: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the squares (c,) of the coefficients, their standard errors (c,), and −2 log of the likelihood of (1)."""
    model, squares, cov = variance, np.zeros(terms.shape[1]), np.eye(terms.shape[1])
    for _round in range(ROUNDS):
        weight = np.sqrt(0.5 * nu) / model  # the variance of σ² is 2 σ⁴/ν
        A, b = terms * weight[:, None], variance * weight
        scale = np.linalg.norm(A, axis=0)
        cov = np.linalg.pinv((A / scale).T @ (A / scale)) / np.outer(scale, scale)
        squares = cov @ (A.T @ b)
        model = np.maximum(terms @ squares, 1e-3 * variance)
    cost = float(np.sum(nu * (np.log(model) + variance / model)))
    return squares, np.sqrt(np.diagonal(cov)), cost


class RestChannel(NamedTuple):
    """One channel of one sensor at rest, in the sensor's unit."""

    sensor: str
    entry: int
    samples: int
    rate_hz: float
    mean: float
    mean_std: float
    std: float
    step: float  # smallest change: the step of the converter
    curve: AllanDeviation
    coefficients: Coefficients
    allan_1s: float | None  # deviation of averages over 1 s; None if the run is too short
    slope: float | None  # per °C
    slope_std: float | None


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RestMeasurement(Result):
    """All channels of a run at rest."""

    run: str
    duration_s: float
    channels: tuple[RestChannel, ...]
    findings: tuple[Diagnostic, ...]

    @property
    def verdict(self) -> Verdict:
        """Return WARN if `findings` contains a message, else USABLE."""
        return Verdict.WARN if self.findings else Verdict.USABLE

    def rows(self) -> list[TableRow]:
        """Return one flat row per channel, in SI units."""
        rows = []
        for c in self.channels:
            row: TableRow = {"name": f"{c.sensor}[{c.entry}]", "samples": c.samples, "rate_hz": c.rate_hz}
            row |= {"mean": c.mean, "mean_std": c.mean_std, "std": c.std, "step": c.step}
            columns = NOISE_COLUMNS, *c.coefficients, c.coefficients.is_measurable
            for name, value, std, is_measurable in zip(*columns, strict=True):
                pair = (float(value), float(std)) if is_measurable else (None, None)
                row |= dict(zip((name, f"{name}_std"), pair, strict=True))
            row["allan_1s"] = c.allan_1s
            rows.append(row | {"temperature_slope": c.slope, "temperature_slope_std": c.slope_std})
        return rows

    def table(self) -> str:
        """Return the table as text."""
        head = [
            "",
            _("mean"),
            _("std. error"),
            _("scatter"),
            _("white"),
            _("instab."),
            _("walk"),
            _("per °C"),
        ]
        rows = []
        for c in self.channels:
            pairs = zip(c.coefficients.value, c.coefficients.is_measurable, strict=True)
            parts = [f"{number(value):.3g}" if is_measurable else "-" for value, is_measurable in pairs]
            warm = "" if c.slope is None else f"{number(c.slope):.2g} ± {number(c.slope_std):.1g}"
            values = f"{number(c.mean):.5g}", f"{number(c.mean_std):.1g}", f"{number(c.std):.3g}"
            rows.append([f"{c.sensor}[{c.entry}]", *values, *parts, warm])
        lines = [
            _("{run} at rest for {duration_s:.1f} s", run=self.run, duration_s=self.duration_s),
            *text_table("<>>>>>>>", head, *rows),
        ]
        lines.append(_("white: per √Hz; walk: per s √s; SI; '-': not visible in a run of this length"))
        return "\n".join([*lines, *(f"- {finding}" for finding in texts(self.findings)), _(self.verdict)])

    @checked_call("at_rest.updated_file(robot)")
    def updated_file(self, vehicle_file: VehicleFile) -> VehicleFile:
        """Return the file with noise, bias and walk of its IMUs as measured at rest. Raise UsageError if no IMU of
        the file was measured."""
        values: JsonObject = {}
        for name, block in vehicle_file.sensors._asdict().items():
            channels = {c.entry: c for c in self.channels if c.sensor == name}
            if has_field(block, "gyro_noise_std") and set(channels) == {0, 1, 2}:
                values |= _imu_values(f"sensors.{name}", channels)
        if not values:
            raise UsageError.of("at-rest.no-imu", run=self.run, vehicle=vehicle_file.name)
        origin = Provenance(self.run, today(), None, self.verdict)
        return vehicle_file.with_values(values, dict.fromkeys(values, origin))


def measure_at_rest(run: "Run", from_s: float = 0.0, to_s: float = float("inf")) -> RestMeasurement:
    """Return the sensors of `run` at rest, between two times [s] from its first tick.

    Raise UsageError if the run is never at rest, or if no sensor has MIN_SAMPLES samples then.

    >>> from baqueano.simulate import simulate
    >>> from baqueano.vehicle_file import load
    >>> gyro = measure_at_rest(simulate(load("small"), np.zeros((6000, 3)))).channels[2]
    >>> print(f"bias {gyro.mean:.4f} ± {gyro.mean_std:.4f} rad/s, noise {gyro.std:.4f} rad/s")
    bias 0.0150 ± 0.0002 rad/s, noise 0.0042 rad/s
    """
    first_ns, last_ns = _rest_span(run.cut(from_s, to_s))
    findings: list[Diagnostic] = []
    temperature = run.sensors.get(TEMPERATURE)
    channels = []
    for name, channel in run.sensors.items():
        is_used = (channel.t_ns >= first_ns) & (channel.t_ns <= last_ns) & np.isfinite(channel.z).all(axis=1)
        if name == TEMPERATURE or is_used.sum() < MIN_SAMPLES:
            continue
        t_ns, z = channel.t_ns[is_used], channel.z[is_used]
        rate_hz = (len(t_ns) - 1) / float(seconds(t_ns[-1], t_ns[0]))
        findings += _findings(name, t_ns, z, rate_hz)
        for entry in range(z.shape[1]):
            if np.ptp(z[:, entry]) > 0.0:
                channels.append(_rest_channel(name, entry, t_ns, z[:, entry], rate_hz, temperature))
            else:
                label = f"{name}[{entry}]"
                findings.append(note("at-rest.dead", Severity.WARNING, subject=label, value=z[0, entry]))
    if not channels:
        raise UsageError.of("at-rest.few-samples", run=run.name, minimum=MIN_SAMPLES)
    return RestMeasurement(run.name, float(seconds(last_ns, first_ns)), tuple(channels), tuple(findings))


def _rest_span(run: "Run") -> tuple[int, int]:
    """Return begin and end [ns] of the longest time without a command, from REST_S after the last command. Raise
    UsageError without a tick or a rest."""
    if not len(run.t_ns):
        raise UsageError.of("at-rest.no-tick", run=run.name)
    driven_ticks = np.any(run.applied_commands != 0.0, axis=1)  # NaN counts as driven
    edges = np.flatnonzero(np.diff(np.concatenate([[True], driven_ticks, [True]]).astype(int)))
    begins, ends = edges[::2], edges[1::2] - 1
    if not len(begins):
        raise UsageError.of("at-rest.driven", run=run.name)
    wait_ns = np.where(begins > 0, round(REST_S * 1e9), 0)
    spans_ns = run.t_ns[ends] - run.t_ns[begins] - wait_ns
    k = int(np.argmax(spans_ns))
    return int(run.t_ns[begins[k]] + wait_ns[k]), int(run.t_ns[ends[k]])


def _rest_channel(
    name: str, entry: int, t_ns: np.ndarray, y: np.ndarray, rate_hz: float, temperature: "Channel | None"
) -> RestChannel:
    curve = allan_deviation(y, rate_hz)
    changes = np.abs(np.diff(np.unique(y)))
    slope, slope_std = _temperature_slope(t_ns, y, temperature)
    ticks_per_s = max(1, round(rate_hz))
    allan_1s = None
    if 2 * ticks_per_s <= len(y):
        allan_1s = float(allan_deviation(y, rate_hz, np.array([ticks_per_s])).deviation[0])
    return RestChannel(
        name, entry, len(y), rate_hz, float(np.mean(y)), float(curve.deviation[-1]), float(np.std(y, ddof=1)),
        float(changes.min()) if len(changes) else 0.0, curve, coefficients(curve), allan_1s,
        slope, slope_std,
    )  # fmt: skip


def _temperature_slope(
    t_ns: np.ndarray, y: np.ndarray, temperature: "Channel | None"
) -> tuple[float | None, float | None]:
    """Return the slope per °C and its standard error, from block means. Return (None, None) without a change of
    temperature. (4)"""
    if temperature is None or len(y) < TEMPERATURE_BLOCKS:
        return None, None
    T = np.interp(t_ns, temperature.t_ns, temperature.z[:, 0])
    y_mean = np.array([part.mean() for part in np.array_split(y, TEMPERATURE_BLOCKS)])
    T_mean = np.array([part.mean() for part in np.array_split(T, TEMPERATURE_BLOCKS)])
    if np.ptp(T_mean) < MIN_TEMPERATURE_CHANGE:
        return None, None
    deviations = T_mean - T_mean.mean()
    slope = float(deviations @ y_mean / (deviations @ deviations))
    residuals = y_mean - y_mean.mean() - slope * deviations
    return slope, float(np.sqrt(residuals @ residuals / (TEMPERATURE_BLOCKS - 2) / (deviations @ deviations)))


def _findings(name: str, t_ns: np.ndarray, z: np.ndarray, rate_hz: float) -> list[Diagnostic]:
    findings = []
    steps = np.diff(t_ns) * 1e-9
    limit_s = BURST_STEPS / rate_hz
    if np.any(steps <= 0.0) or np.median(steps) < limit_s or np.std(steps) > limit_s:
        spans_s = {"median_ms": np.median(steps), "mean_ms": 1.0 / rate_hz, "longest_ms": steps.max()}
        spans = {key: 1e3 * span_s for key, span_s in spans_s.items()}
        findings.append(note("at-rest.bursts", Severity.WARNING, subject=name, **spans, rate_hz=rate_hz))
    repeated_share = np.mean(np.all(z[1:] == z[:-1], axis=1))
    if z.shape[1] >= 3 and repeated_share > 0.01:
        findings.append(
            note("at-rest.repeats", Severity.WARNING, subject=name, percent=100.0 * repeated_share)
        )
    median = np.median(z, axis=0)
    spread = MAD * np.median(np.abs(z - median), axis=0)
    outlier_share = np.mean(np.abs(z - median) > 8.0 * np.maximum(spread, 1e-300), axis=0)
    for entry in np.flatnonzero((outlier_share > 0.002) & (spread > 0.0)):
        percent = 100.0 * outlier_share[entry]
        findings.append(
            note("at-rest.touched", Severity.WARNING, subject=f"{name}[{entry}]", percent=percent)
        )
    return findings


def _imu_values(path: str, channels: dict[int, RestChannel]) -> JsonObject:
    """Return the values of an IMU from its three channels: standard deviation of one sample, bias, and bias random
    walk. The walk is 0 if it cannot be measured. Both accelerometers use the larger one."""
    random_walks = [channels[k].coefficients for k in range(3)]
    walk = [float(c.value[2]) if c.is_measurable[2] else 0.0 for c in random_walks]
    return {
        f"{path}.accel_noise_std": [channels[0].std, channels[1].std],
        f"{path}.gyro_noise_std": channels[2].std,
        f"{path}.accel_bias": [channels[0].mean, channels[1].mean],
        f"{path}.gyro_bias": channels[2].mean,
        f"{path}.accel_bias_walk": max(walk[:2]),
        f"{path}.gyro_bias_walk": walk[2],
    }
