"""Match each channel with a known signal by likelihood: signed permutation, unit ratio and scale.

    z_i = s_i r_i g_i h_π(i) + e_i,   s_i = ±1,   low_i ≤ g_i ≤ high_i                                    (1)

z is measured. h is predicted from one of these: a truth, wheels, v̇ and v ω, a model. r is the ratio of two units. g is
the scale that data sheets, skidding wheels or guessed files do not determine. ρ is the correlation of z_i and h_j, and
N windows contain as much information as n independent windows. Compared with a slope of 0, the best slope has the gain

    log L = −n/2 log(1 − ρ²),   n = N (1 − a)/(1 + a),   a = a_e a_h                                      (2)

a_e, a_h are the autocorrelations, one window apart, of the residual and of h. s is the sign of the slope, and r the
ratio nearest to it. A relation counts if log L rises by MARGIN in total and by WORTH per window. Channels are swapped
only if no channel fits its own prediction at all: a nearly right prediction may correlate less than a wrong one.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from baqueano.diagnostics import Diagnostic
from baqueano.runs.maps.units import UNITS, unit

MARGIN, WORTH = 5.0, 0.3  # of log L: a slope of three standard errors; 45 % of the variance
FEW = 20  # windows
NO_RELATION, NOTHING = 0.3, 0.05  # correlation, and its gain per window
PERFECT = 1e-12  # part of the variance that rounding leaves


class Relation(NamedTuple):
    """The regression of a channel on a prediction, both minus their means; zeros if one of the two is constant."""

    slope: float = 0.0
    correlation: float = 0.0
    n: float = 1.0  # windows as good as independent ones

    @property
    def gain(self) -> float:
        """Return the gain of log L per window, compared with a slope of 0.  (2)"""
        return -0.5 * float(np.log(max(1.0 - self.correlation**2, PERFECT)))

    def is_clear(self, worth: float = WORTH) -> bool:
        """Return True if the total gain exceeds MARGIN and the gain per window exceeds `worth`."""
        return self.n * self.gain > MARGIN and self.gain > worth


class MappedChannel(NamedTuple):
    """The plausible scales of a channel, and the unit or the line to write for each other ratio."""

    low: float = 0.0
    high: float = np.inf
    ratios: Mapping[float, "Diagnostic | str | None"] = MappingProxyType({})


class Hypothesis(NamedTuple):
    """Prediction, sign and unit ratio that best explain one channel: a row of S = signed permutation × ratio."""

    code: str  # "": as the map reads it, "swapped", "inverted", "unit", "scale" (of no known unit)
    of: int  # index of the prediction that the channel shows
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
    """Return the regression of z (N,) on h (N,) over the rows that are finite in both; zeros for fewer than
    FEW rows."""
    good = np.isfinite(z) & np.isfinite(h)
    if np.count_nonzero(good) < FEW:
        return Relation()
    z, h = z[good], h[good]
    z, h = z - np.mean(z), h - np.mean(h)
    zz, hh, zh = float(z @ z), float(h @ h), float(z @ h)
    if not 0.0 < zz * hh < np.inf:
        return Relation()
    a = max(0.0, _autocorrelation(z - zh / hh * h, PERFECT * zz) * _autocorrelation(h))
    return Relation(zh / hh, zh / np.sqrt(zz * hh), len(z) * (1.0 - a) / (1.0 + a))


def relations(z: np.ndarray, h: np.ndarray) -> list[list[Relation]]:
    """Return the regressions of each channel of z (N, m) on each prediction of h (N, k)."""
    return [[relation(column, prediction) for prediction in h.T] for column in z.T]


def _autocorrelation(x: np.ndarray, least: float = 0.0) -> float:
    """Return the lag-1 autocorrelation of x (N,); 0 if the power of x is at most `least`."""
    power = float(x @ x)
    return float(x[1:] @ x[:-1]) / power if power > least else 0.0


def signal_map(
    z: np.ndarray, h: np.ndarray, channels: Sequence[MappedChannel], worth: float = WORTH
) -> list[Hypothesis]:
    """Return for each channel of z (N, m) the prediction of h (N, k ≥ m) that it shows.
    Channel i should show prediction i; the code "swapped" marks another one.
    """
    of = relations(z, h)
    hypotheses = [_hypothesis(i, of[i][i], channel, worth) for i, channel in enumerate(channels)]
    swaps = {(i, j): _swap(of, i, j, worth) for i in range(len(of)) for j in range(i + 1, h.shape[1])}
    for i, j in sorted((pair for pair in swaps if swaps[pair] > 0.0), key=lambda pair: -swaps[pair]):
        pairs = _pairs(of, i, j)
        swap_hypotheses = {a: _hypothesis(b, of[a][b], channels[a], worth) for a, b in pairs}
        if all(
            hypotheses[a].code != "swapped" and np.isfinite(hypothesis.ratio)
            for a, hypothesis in swap_hypotheses.items()
        ):
            for a, hypothesis in swap_hypotheses.items():
                hypotheses[a] = hypothesis._replace(code="swapped")
    return hypotheses


def _hypothesis(of: int, r: Relation, channel: MappedChannel, worth: float) -> Hypothesis:
    """Return the hypothesis for a channel that shows prediction `of` with the regression `r`."""
    clear, size = r.is_clear(worth), abs(r.slope)
    if not clear or channel.low <= r.slope <= channel.high:
        return Hypothesis("", of, r, clear)
    low, high, meanings = channel.low, channel.high, {1.0: None} | dict(channel.ratios)
    near = [ratio for ratio in meanings if ratio * low <= size <= ratio * high]
    middle = np.sqrt(low * high) if len(near) > 1 else 1.0
    nearest = min(near, key=lambda ratio: abs(np.log(size / ratio / middle)), default=np.nan)
    code = "inverted" if r.slope < 0.0 else "unit" if near else "scale"
    return Hypothesis(code, of, r, clear, nearest, meanings.get(nearest))


def _swap(of: Sequence[Sequence[Relation]], i: int, j: int, worth: float) -> float:
    """Return the gain of log L if the channels i and j swap their predictions. Return 0 if the gain is small, or if one
    of the two channels fits its own prediction.
    """
    pairs = [(of[a][a], of[a][b]) for a, b in _pairs(of, i, j)]
    gain = sum(candidate.n * (candidate.gain - own.gain) for own, candidate in pairs)
    clear = sum(candidate.gain - own.gain for own, candidate in pairs) > worth and gain > MARGIN
    return gain if clear and not any(own.is_clear(NOTHING) for own, _ in pairs) else 0.0


def _pairs(of: Sequence[Sequence[Relation]], i: int, j: int) -> list[tuple[int, int]]:
    """Return the (channel, prediction) pairs of a swap of i and j; j may be a prediction without a channel."""
    return [(i, j), (j, i)] if j < len(of) else [(i, j)]
