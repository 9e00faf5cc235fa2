"""Measure sensors at rest: bias, scatter, Allan deviation, and change with temperature.

The longest time without a command is used, from REST_S after the last command. The error of the bias is the Allan
deviation of an average of that length, not σ/√N: the bias of a cheap sensor drifts.

    z = b + s (T − T̄),   sd of both from block means                                                      (1)

(1) is used if the run contains a temperature. Samples whose timestamps come in bursts (a host that reads a full
buffer) are treated as sampled evenly, at the mean rate.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.optional import has_field
from baqueano.contracts.result import Result
from baqueano.diagnostics import Diagnostic, Severity, Verdict, fault, note
from baqueano.errors import UsageError
from baqueano.identify.data.rest import REST_S
from baqueano.identify.noise.allan import AllanDeviation, Coefficients, allan_deviation, coefficients
from baqueano.messages import texts
from baqueano.messages.language import number
from baqueano.messages.language import translate as _
from baqueano.runs.run import Channel, Run
from baqueano.signals import seconds

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject, TableRow
    from baqueano.vehicle_file import VehicleFile

MIN_SAMPLES = 200  # samples
TEMPERATURE_BLOCKS = 12  # means from which the slope over temperature is estimated
MIN_TEMPERATURE_CHANGE = 0.5  # °C of change, below which no slope is estimated
BURST_STEPS = 0.5  # of the mean step: timestamps whose steps scatter by more come in bursts
TEMPERATURE = "temperature"


class ChannelAtRest(NamedTuple):
    """One channel of one sensor at rest, in the sensor's unit."""

    sensor: str
    entry: int
    samples: int
    rate_hz: float
    mean: float
    mean_std: float
    sd: float
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
    channels: tuple[ChannelAtRest, ...]
    findings: tuple[Diagnostic, ...]

    @property
    def verdict(self) -> Verdict:
        """Return WARN if `findings` contains a message, else USABLE."""
        return Verdict.WARN if self.findings else Verdict.USABLE

    def rows(self) -> list["TableRow"]:
        """Return one flat row per channel, in SI units."""
        out = []
        for c in self.channels:
            row: TableRow = {"name": f"{c.sensor}[{c.entry}]", "samples": c.samples, "rate_hz": c.rate_hz}
            row |= {"mean": c.mean, "mean_sd": c.mean_std, "sd": c.sd, "step": c.step}
            for name, value, sd, measurable in zip(
                ("white_noise", "bias_instability", "bias_walk"),
                *c.coefficients,
                c.coefficients.is_measurable,
                strict=True,
            ):
                row |= {
                    name: float(value) if measurable else None,
                    f"{name}_sd": float(sd) if measurable else None,
                }
            row["allan_1s"] = c.allan_1s
            out.append(row | {"temperature_slope": c.slope, "temperature_slope_sd": c.slope_std})
        return out

    def table(self) -> str:
        """Return the table as text."""
        head = f"{'':16}{_('mean'):>12} {_('± sd'):>9} {_('scatter'):>10} {_('white'):>10} "
        head += f"{_('instab.'):>10} {_('walk'):>10}"
        lines = [
            _("{run} at rest for {duration_s:.1f} s", run=self.run, duration_s=self.duration_s),
            head + f" {_('per °C'):>20}",
        ]
        for c in self.channels:
            pairs = zip(c.coefficients.value, c.coefficients.is_measurable, strict=True)
            parts = " ".join(
                f"{number(value):>10.3g}" if measurable else f"{'-':>10}" for value, measurable in pairs
            )
            warm = "" if c.slope is None else f"{number(c.slope):.2g} ± {number(c.slope_std):.1g}"
            lines.append(
                f"{c.sensor}[{c.entry}]".ljust(16)
                + f"{number(c.mean):>12.5g} {number(c.mean_std):>9.1g} {number(c.sd):>10.3g} {parts} {warm:>20}"
            )
        lines.append(_("white: per √Hz; walk: per s √s; SI; '-': not visible in a run of this length"))
        return "\n".join([*lines, *(f"- {finding}" for finding in texts(self.findings)), _(self.verdict)])

    def updated_file(self, vehicle_file: "VehicleFile") -> "VehicleFile":
        """Return the file with noise, bias and walk of its IMUs as measured at rest. Raise UsageError if no IMU of
        the file was measured."""
        from baqueano.vehicle_file import Provenance
        from baqueano.vehicle_file.file import today

        values: JsonObject = {}
        for name, block in vehicle_file.sensors._asdict().items():
            channels = {c.entry: c for c in self.channels if c.sensor == name}
            if has_field(block, "gyro_noise_std") and set(channels) == {0, 1, 2}:
                values |= _imu_values(f"sensors.{name}", channels)
        if not values:
            raise UsageError(fault("at-rest.no-imu", run=self.run, vehicle=vehicle_file.name))
        return vehicle_file.with_values(
            values, dict.fromkeys(values, Provenance(self.run, today(), None, self.verdict))
        )


def measure_at_rest(run: "Run", from_s: float = 0.0, to_s: float = float("inf")) -> RestMeasurement:
    """Return the sensors of `run` at rest, between two times [s] from its first tick.

    Raise UsageError if the run is never at rest, or if no sensor has MIN_SAMPLES samples then.

    >>> from baqueano.simulate import simulate
    >>> from baqueano.vehicle_file import load
    >>> gyro = measure_at_rest(simulate(load("small"), np.zeros((6000, 3)))).channels[2]
    >>> print(f"bias {gyro.mean:.4f} ± {gyro.mean_std:.4f} rad/s, noise {gyro.sd:.4f} rad/s")
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
                findings.append(
                    note("at-rest.dead", Severity.WARNING, subject=f"{name}[{entry}]", value=z[0, entry])
                )
    if not channels:
        raise UsageError(fault("at-rest.few-samples", run=run.name, least=MIN_SAMPLES))
    return RestMeasurement(run.name, float(seconds(last_ns, first_ns)), tuple(channels), tuple(findings))


def _rest_span(run: "Run") -> tuple[int, int]:
    """Return begin and end [ns] of the longest time without a command, from REST_S after the last command. Raise
    UsageError without a tick or a rest."""
    if not len(run.t_ns):
        raise UsageError(fault("at-rest.no-tick", run=run.name))
    driven_ticks = np.any(run.applied != 0.0, axis=1)  # NaN counts as driven
    edges = np.flatnonzero(np.diff(np.concatenate([[True], driven_ticks, [True]]).astype(int)))
    begins, ends = edges[::2], edges[1::2] - 1
    if not len(begins):
        raise UsageError(fault("at-rest.driven", run=run.name))
    wait_ns = np.where(begins > 0, round(REST_S * 1e9), 0)
    spans_ns = run.t_ns[ends] - run.t_ns[begins] - wait_ns
    k = int(np.argmax(spans_ns))
    return int(run.t_ns[begins[k]] + wait_ns[k]), int(run.t_ns[ends[k]])


def _rest_channel(
    name: str, entry: int, t_ns: np.ndarray, y: np.ndarray, rate_hz: float, temperature: "Channel | None"
) -> ChannelAtRest:
    curve = allan_deviation(y, rate_hz)
    changes = np.abs(np.diff(np.unique(y)))
    slope, slope_sd = _over_temperature(t_ns, y, temperature)
    ticks_per_s = max(1, round(rate_hz))
    over_1s = (
        float(allan_deviation(y, rate_hz, np.array([ticks_per_s])).deviation[0])
        if 2 * ticks_per_s <= len(y)
        else None
    )
    return ChannelAtRest(
        name, entry, len(y), rate_hz, float(np.mean(y)), float(curve.deviation[-1]), float(np.std(y, ddof=1)),
        float(changes.min()) if len(changes) else 0.0, curve, coefficients(curve), over_1s,
        slope, slope_sd,
    )  # fmt: skip


def _over_temperature(
    t_ns: np.ndarray, y: np.ndarray, temperature: "Channel | None"
) -> tuple[float | None, float | None]:
    """Return the slope per °C and its standard error, from block means.

    Return (None, None) without a change of temperature.  (1)
    """
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
    out = []
    steps = np.diff(t_ns) * 1e-9
    if (
        np.mean(steps <= 0.0) > 0.0
        or np.median(steps) < BURST_STEPS / rate_hz
        or np.std(steps) > BURST_STEPS / rate_hz
    ):
        spans = {
            "median_ms": 1e3 * np.median(steps),
            "mean_ms": 1e3 / rate_hz,
            "longest_ms": 1e3 * steps.max(),
        }
        out.append(note("at-rest.bursts", Severity.WARNING, subject=name, **spans, rate_hz=rate_hz))
    repeated_share = np.mean(np.all(z[1:] == z[:-1], axis=1))
    if z.shape[1] >= 3 and repeated_share > 0.01:
        out.append(note("at-rest.repeats", Severity.WARNING, subject=name, percent=100.0 * repeated_share))
    median = np.median(z, axis=0)
    spread = 1.4826 * np.median(np.abs(z - median), axis=0)
    outlier_share = np.mean(np.abs(z - median) > 8.0 * np.maximum(spread, 1e-300), axis=0)
    for entry in np.flatnonzero((outlier_share > 0.002) & (spread > 0.0)):
        percent = 100.0 * outlier_share[entry]
        out.append(note("at-rest.touched", Severity.WARNING, subject=f"{name}[{entry}]", percent=percent))
    return out


def _imu_values(path: str, channels: dict[int, ChannelAtRest]) -> "JsonObject":
    """Return the values of an IMU from its three channels: standard deviation of one sample, bias, and bias random
    walk. The walk is 0 if it cannot be measured. Both accelerometers get the larger one.
    """
    walk = [
        float(channels[k].coefficients.value[2]) if channels[k].coefficients.is_measurable[2] else 0.0
        for k in range(3)
    ]
    return {
        f"{path}.accel_noise_std": [channels[0].sd, channels[1].sd],
        f"{path}.gyro_noise_std": channels[2].sd,
        f"{path}.accel_bias": [channels[0].mean, channels[1].mean],
        f"{path}.gyro_bias": channels[2].mean,
        f"{path}.accel_bias_walk": max(walk[:2]),
        f"{path}.gyro_bias_walk": walk[2],
    }
