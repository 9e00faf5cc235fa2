"""Match each channel with a known signal by likelihood: signed permutation, unit ratio and scale.

    z_i = s_i r_i g_i h_π(i) + e_i,   s_i = ±1,   low_i ≤ g_i ≤ high_i                                    (1)
    log L = −n/2 log(1 − ρ²),   n = N (1 − a)/(1 + a),   a = a_e a_h                                      (2)
    gain of log L > MIN_TOTAL_GAIN in total,   > MIN_GAIN per measurement                                 (3)

z is measured. h is predicted from a truth, wheels, v̇ and v ω, or a model. r is a ratio of two units, and g a scale
that data sheets, skidding wheels or guessed files do not determine. (2) compares the best slope of z_i on h_j with a
slope of 0; s is its sign, and r the nearest ratio. a_e, a_h are the autocorrelations, one window apart, of the residual
and of h. Import and fit accept another hypothesis π, s, r only by (3). Channels are swapped only if neither channel
fits its own prediction: a nearly right prediction can correlate less than a wrong one. A scale without a known unit is
not such a hypothesis. It needs MIN_SCALE_GAIN, as vibration also correlates. A slope that noise of h can explain also
needs it.
"""

from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from baqueano.diagnostics import Diagnostic
from baqueano.numerics.parallel import dot
from baqueano.numerics.statistics import MAD
from baqueano.runs.maps.units import UNITS, unit

MIN_TOTAL_GAIN, MIN_GAIN = 5.0, 0.1  # (3): a slope of three standard errors; 18 % of the variance
MIN_SCALE_GAIN = 0.3  # per measurement: 45 % of the variance
MIN_WINDOWS = 20  # windows
CLIP_SIGMA = 4.0  # of a sample, in robust standard deviations
ROUNDING_VARIANCE = 1e-12  # part of the variance that rounding leaves


class ChannelRegression(NamedTuple):
    """The regression of a channel on a prediction, both minus their means; zeros if one of the two is constant."""

    slope: float = 0.0
    correlation: float = 0.0
    n: float = 1.0  # equivalent number of independent windows

    @property
    def gain(self) -> float:
        """Return the gain of log L per window, compared with a slope of 0.  (2)"""
        return -0.5 * float(np.log(max(1.0 - self.correlation**2, ROUNDING_VARIANCE)))

    def is_clear(self, min_gain: float = MIN_GAIN) -> bool:
        """Return True if the gain is large enough."""
        return is_clear(self.n * self.gain, self.gain, min_gain)


def is_clear(total_gain: float, gain: float, min_gain: float = MIN_GAIN) -> bool:
    """Return True if log L rises enough, in total and by `gain` per measurement.  (3)

    >>> is_clear(40.0, 0.2), is_clear(4.0, 0.2), is_clear(40.0, 0.02)
    (True, False, False)
    """
    return total_gain > MIN_TOTAL_GAIN and gain > min_gain


class MappedChannel(NamedTuple):
    """The plausible scales of a channel, and the unit or the line to write for each other ratio."""

    low: float = 0.0
    high: float = np.inf
    ratios: Mapping[float, "Diagnostic | str | None"] = MappingProxyType({})


class Hypothesis(NamedTuple):
    """Prediction, sign and unit ratio that best explain one channel: a row of S = signed permutation × ratio."""

    code: str  # "": as the map reads it, "swapped", "inverted", "unit", "scale" (without a known unit)
    prediction_index: int  # index of the prediction that the channel shows
    regression: ChannelRegression
    is_clear: bool
    ratio: float = 1.0  # of units; NaN if none is near
    meaning: "Diagnostic | str | None" = None  # of that ratio


def unit_ratios(measures: str, unit_name: str) -> dict[float, str]:
    """Return ratio → unit for all units of a column other than `unit_name`; the ratio is read value / true value."""
    assumed_unit = unit(unit_name)
    si = assumed_unit.si_factor if assumed_unit and assumed_unit.measures == measures else 1.0
    return {
        si / unit_.si_factor: name
        for name, unit_ in UNITS.items()
        if unit_.measures == measures and unit_.si_factor != si
    }


def channel_regression(z: np.ndarray, h: np.ndarray) -> ChannelRegression:
    """Return the regression of z (N,) on h (N,) over the rows that are finite in both.
    Its slope and correlation are 0 for fewer than MIN_WINDOWS rows, or if z or h is constant."""
    is_known = np.isfinite(z) & np.isfinite(h)
    if np.count_nonzero(is_known) < MIN_WINDOWS:
        return ChannelRegression()
    z, h = z[is_known], h[is_known]
    z, h = z - np.mean(z), h - np.mean(h)
    zz, hh, zh = dot(z, z), dot(h, h), dot(z, h)
    if not 0.0 < zz * hh < np.inf:
        return ChannelRegression()
    a = max(0.0, _autocorrelation(z - zh / hh * h, ROUNDING_VARIANCE * zz) * _autocorrelation(h))
    return ChannelRegression(zh / hh, zh / np.sqrt(zz * hh), len(z) * (1.0 - a) / (1.0 + a))


def channel_regressions(z: np.ndarray, h: np.ndarray) -> list[list[ChannelRegression]]:
    """Return the regressions of each channel of z (N, m) on each prediction of h (N, k)."""
    return [[channel_regression(column, prediction) for prediction in h.T] for column in z.T]


def _autocorrelation(x: np.ndarray, min_lag_share: float = 0.0) -> float:
    """Return the lag-1 autocorrelation of x (N,); 0 if the power xᵀx is at most `min_lag_share`."""
    power = dot(x, x)
    return dot(x[1:], x[:-1]) / power if power > min_lag_share else 0.0


def signal_map(z: np.ndarray, h: np.ndarray, channels: Sequence[MappedChannel]) -> list[Hypothesis]:
    """Return, for each channel of z (N, m), the prediction of h (N, k ≥ m) that it shows.
    Channel i should show prediction i; the code "swapped" marks another prediction.
    """
    table = channel_regressions(z, h)
    hypotheses = [_hypothesis(i, table[i][i], channel) for i, channel in enumerate(channels)]
    swaps = [(_swap_gain(table, i, j), i, j) for i in range(len(table)) for j in range(i + 1, h.shape[1])]
    for gain, i, j in sorted(swaps, reverse=True):
        swap = {a: _hypothesis(b, table[a][b], channels[a]) for a, b in _pairs(table, i, j)}
        is_free = all(hypotheses[a].code != "swapped" and np.isfinite(swap[a].ratio) for a in swap)
        for a in swap if gain > 0.0 and is_free else ():
            hypotheses[a] = swap[a]._replace(code="swapped")
    return hypotheses


def nearest_ratio(magnitude: float, low: float, high: float, ratios: Collection[float]) -> float:
    """Return the known ratio r with low r ≤ magnitude ≤ high r. Return NaN without such a ratio.

    >>> nearest_ratio(50.0, 0.5, 2.0, [1.0, 57.3])
    57.3
    """
    close_ratios = [r for r in ratios if r * low <= magnitude <= r * high]
    typical_ratio = np.sqrt(low * high) if len(close_ratios) > 1 else 1.0
    return min(close_ratios, key=lambda r: abs(np.log(magnitude / r / typical_ratio)), default=np.nan)


def _hypothesis(prediction_index: int, r: ChannelRegression, channel: MappedChannel) -> Hypothesis:
    """Return the hypothesis for a channel that shows prediction `prediction_index` with the regression `r`."""
    low, high, meanings = channel.low, channel.high, {1.0: None} | dict(channel.ratios)
    gyro_column = Hypothesis("", prediction_index, r, r.is_clear())
    if not gyro_column.is_clear or low <= r.slope <= high:
        return gyro_column
    ratio = nearest_ratio(abs(r.slope), low, high, meanings)
    is_attenuated = abs(r.slope) < low <= abs(r.slope) / r.correlation**2  # possible if h has all the noise
    if (np.isnan(ratio) or is_attenuated) and not r.is_clear(MIN_SCALE_GAIN):
        return gyro_column._replace(is_clear=False)
    code = "inverted" if r.slope < 0.0 else "scale" if np.isnan(ratio) else "unit"
    return Hypothesis(code, prediction_index, r, is_clear=True, ratio=ratio, meaning=meanings.get(ratio))


def _swap_gain(table: Sequence[Sequence[ChannelRegression]], i: int, j: int) -> float:
    """Return the gain of log L if the channels i and j swap their predictions. Return 0 if the gain is small, if one of
    the two channels fits its own prediction, or if one is silent: its readings cannot confirm the swap.
    """
    pairs = [(table[a][a], table[a][b]) for a, b in _pairs(table, i, j)]
    total_gain = sum(candidate.n * (candidate.gain - current.gain) for current, candidate in pairs)
    gain = sum(candidate.gain - current.gain for current, candidate in pairs) / len(pairs)
    is_possible = all(candidate.gain > 0.0 and not current.is_clear() for current, candidate in pairs)
    return total_gain if is_possible and is_clear(total_gain, gain) else 0.0


def _pairs(table: Sequence[Sequence[ChannelRegression]], i: int, j: int) -> list[tuple[int, int]]:
    """Return the (channel, prediction) pairs of a swap of i and j; j can be a prediction without a channel."""
    return [(i, j), (j, i)] if j < len(table) else [(i, j)]


def clip(x: np.ndarray) -> np.ndarray:
    """Return the columns of x (n, m), clipped at CLIP_SIGMA robust standard deviations about the median."""
    x = x.copy()
    for column in x.T:
        if len(finite_values := column[np.isfinite(column)]):
            median = float(np.median(finite_values))
            limit = CLIP_SIGMA * max(
                MAD * float(np.median(np.abs(finite_values - median))), 0.1 * float(np.std(finite_values))
            )
            np.clip(column, median - limit, median + limit, out=column)
    return x
