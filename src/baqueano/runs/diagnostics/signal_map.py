"""Match each channel with a known signal by likelihood: signed permutation, unit ratio and scale.

    z_i = s_i r_i g_i h_π(i) + e_i,   s_i = ±1,   low_i ≤ g_i ≤ high_i                                    (1)

z is measured. h is predicted from one of these: a truth, wheels, v̇ and v ω, a model. r is the ratio of two units. g is
the scale that data sheets, skidding wheels or guessed files do not determine. ρ is the correlation of z_i and h_j, and
N windows contain as much information as n independent windows. Compared with a slope of 0, the best slope has the gain

    log L = −n/2 log(1 − ρ²),   n = N (1 − a)/(1 + a),   a = a_e a_h                                      (2)

a_e, a_h are the autocorrelations, one window apart, of the residual and of h. s is the sign of the slope, and r the
ratio nearest to it. A relation is clear if log L rises by MIN_GAIN_MARGIN in total and by MIN_GAIN per window. Channels
are swapped only if neither channel fits its own prediction: a nearly right prediction can correlate less than a wrong
one.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from baqueano.diagnostics import Diagnostic
from baqueano.runs.maps.units import UNITS, unit

MIN_GAIN_MARGIN, MIN_GAIN = 5.0, 0.3  # of log L: a slope of three standard errors; 45 % of the variance
MIN_WINDOWS = 20  # windows
MAX_CHANCE_CORRELATION, MAX_CHANCE_GAIN = 0.3, 0.05  # correlation, and its gain per window
ROUNDING_VARIANCE = 1e-12  # part of the variance that rounding leaves


class Relation(NamedTuple):
    """The regression of a channel on a prediction, both minus their means; zeros if one of the two is constant."""

    slope: float = 0.0
    correlation: float = 0.0
    n: float = 1.0  # equivalent number of independent windows

    @property
    def gain(self) -> float:
        """Return the gain of log L per window, compared with a slope of 0.  (2)"""
        return -0.5 * float(np.log(max(1.0 - self.correlation**2, ROUNDING_VARIANCE)))

    def is_clear(self, min_gain: float = MIN_GAIN) -> bool:
        """Return True if the total gain exceeds MIN_GAIN_MARGIN and the gain per window exceeds `min_gain`."""
        return self.n * self.gain > MIN_GAIN_MARGIN and self.gain > min_gain


class MappedChannel(NamedTuple):
    """The plausible scales of a channel, and the unit or the line to write for each other ratio."""

    low: float = 0.0
    high: float = np.inf
    ratios: Mapping[float, "Diagnostic | str | None"] = MappingProxyType({})


class Hypothesis(NamedTuple):
    """Prediction, sign and unit ratio that best explain one channel: a row of S = signed permutation × ratio."""

    code: str  # "": as the map reads it, "swapped", "inverted", "unit", "scale" (of no known unit)
    prediction_index: int  # index of the prediction that the channel shows
    relation: Relation
    is_clear: bool
    ratio: float = 1.0  # of units; NaN if none is near
    meaning: "Diagnostic | str | None" = None  # of that ratio


def ratios(measures: str, read_as: str) -> dict[float, str]:
    """Return ratio → unit for all units of a column other than `read_as`; the ratio is read value / true value."""
    unit_read = unit(read_as)
    si = unit_read.si if unit_read and unit_read.measures == measures else 1.0
    return {
        si / unit_.si: name for name, unit_ in UNITS.items() if unit_.measures == measures and unit_.si != si
    }


def relation(z: np.ndarray, h: np.ndarray) -> Relation:
    """Return the regression of z (N,) on h (N,) over the rows that are finite in both.
    Its slope and correlation are 0 for fewer than MIN_WINDOWS rows, or if z or h is constant."""
    is_known = np.isfinite(z) & np.isfinite(h)
    if np.count_nonzero(is_known) < MIN_WINDOWS:
        return Relation()
    z, h = z[is_known], h[is_known]
    z, h = z - np.mean(z), h - np.mean(h)
    zz, hh, zh = float(z @ z), float(h @ h), float(z @ h)
    if not 0.0 < zz * hh < np.inf:
        return Relation()
    a = max(0.0, _autocorrelation(z - zh / hh * h, ROUNDING_VARIANCE * zz) * _autocorrelation(h))
    return Relation(zh / hh, zh / np.sqrt(zz * hh), len(z) * (1.0 - a) / (1.0 + a))


def relations(z: np.ndarray, h: np.ndarray) -> list[list[Relation]]:
    """Return the regressions of each channel of z (N, m) on each prediction of h (N, k)."""
    return [[relation(column, prediction) for prediction in h.T] for column in z.T]


def _autocorrelation(x: np.ndarray, min_lag_share: float = 0.0) -> float:
    """Return the lag-1 autocorrelation of x (N,); 0 if the power xᵀx is at most `min_lag_share`."""
    power = float(x @ x)
    return float(x[1:] @ x[:-1]) / power if power > min_lag_share else 0.0


def signal_map(
    z: np.ndarray, h: np.ndarray, channels: Sequence[MappedChannel], min_gain: float = MIN_GAIN
) -> list[Hypothesis]:
    """Return, for each channel of z (N, m), the prediction of h (N, k ≥ m) that it shows.
    Channel i should show prediction i; the code "swapped" marks another prediction.
    """
    table = relations(z, h)
    hypotheses = [_hypothesis(i, table[i][i], channel, min_gain) for i, channel in enumerate(channels)]
    swaps = {
        (i, j): _swap(table, i, j, min_gain) for i in range(len(table)) for j in range(i + 1, h.shape[1])
    }
    for i, j in sorted((pair for pair in swaps if swaps[pair] > 0.0), key=lambda pair: -swaps[pair]):
        pairs = _pairs(table, i, j)
        swap_hypotheses = {a: _hypothesis(b, table[a][b], channels[a], min_gain) for a, b in pairs}
        if all(
            hypotheses[a].code != "swapped" and np.isfinite(hypothesis.ratio)
            for a, hypothesis in swap_hypotheses.items()
        ):
            for a, hypothesis in swap_hypotheses.items():
                hypotheses[a] = hypothesis._replace(code="swapped")
    return hypotheses


def _hypothesis(prediction_index: int, r: Relation, channel: MappedChannel, min_gain: float) -> Hypothesis:
    """Return the hypothesis for a channel that shows prediction `prediction_index` with the regression `r`."""
    is_clear, magnitude = r.is_clear(min_gain), abs(r.slope)
    if not is_clear or channel.low <= r.slope <= channel.high:
        return Hypothesis("", prediction_index, r, is_clear)
    low, high, meanings = channel.low, channel.high, {1.0: None} | dict(channel.ratios)
    close_ratios = [ratio for ratio in meanings if ratio * low <= magnitude <= ratio * high]
    typical = np.sqrt(low * high) if len(close_ratios) > 1 else 1.0
    nearest_ratio = min(
        close_ratios, key=lambda ratio: abs(np.log(magnitude / ratio / typical)), default=np.nan
    )
    code = "inverted" if r.slope < 0.0 else "unit" if close_ratios else "scale"
    return Hypothesis(code, prediction_index, r, is_clear, nearest_ratio, meanings.get(nearest_ratio))


def _swap(table: Sequence[Sequence[Relation]], i: int, j: int, min_gain: float) -> float:
    """Return the gain of log L if the channels i and j swap their predictions. Return 0 if the gain is small, or if one
    of the two channels fits its own prediction.
    """
    pairs = [(table[a][a], table[a][b]) for a, b in _pairs(table, i, j)]
    gain = sum(candidate.n * (candidate.gain - present.gain) for present, candidate in pairs)
    is_clear = (
        sum(candidate.gain - present.gain for present, candidate in pairs) > min_gain
        and gain > MIN_GAIN_MARGIN
    )
    return gain if is_clear and not any(present.is_clear(MAX_CHANCE_GAIN) for present, _ in pairs) else 0.0


def _pairs(table: Sequence[Sequence[Relation]], i: int, j: int) -> list[tuple[int, int]]:
    """Return the (channel, prediction) pairs of a swap of i and j; j can be a prediction without a channel."""
    return [(i, j), (j, i)] if j < len(table) else [(i, j)]
