"""The signal that each channel shows: a signed permutation of known signals, in one unit or another, by likelihood.

    z_i = s_i r_i g_i h_π(i) + e_i,   s_i = ±1,   low_i ≤ g_i ≤ high_i                                    (1)

z is measured, h is predicted from one of these: a truth, wheels, v̇ and v ω, a model. r is the ratio of two units,
g the scale that data sheets, skidding wheels or guessed files leave open. ρ is the correlation of z_i and h_j, and N
windows are as good as n independent ones; then the best slope gains over no relation at all

    log L = −n/2 log(1 − ρ²),   n = N (1 − a)/(1 + a),   a = a_e a_h                                      (2)

a_e, a_h are the autocorrelations, one window apart, of the residual and of h; s the sign of the slope; r the ratio that
is nearest to it. A relation counts from MARGIN in all and WORTH a window. Channels are swapped only if their own
predictions explain nothing of them: one that is nearly right may correlate less than a wrong one.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from baqueano.diagnostics import Diagnostic
from baqueano.runs.maps.units import UNITS, unit

MARGIN, WORTH = 5.0, 0.3  # of log L: a slope of three standard errors; 45 % of the variance
FEW = 20  # windows
NO_RELATION, NOTHING = 0.3, 0.05  # correlation, and what it gains a window
PERFECT = 1e-12  # part of the variance that rounding leaves


class Relation(NamedTuple):
    """The regression of a channel on a prediction, both without their means; zeros where one of them is constant."""

    slope: float = 0.0
    correlation: float = 0.0
    n: float = 1.0  # windows as good as independent ones

    @property
    def gain(self) -> float:
        """log L of a window over that of no relation.  (2)"""
        return -0.5 * float(np.log(max(1.0 - self.correlation**2, PERFECT)))

    def is_clear(self, worth: float = WORTH) -> bool:
        """Return True for more than chance and more than `worth` a window."""
        return self.n * self.gain > MARGIN and self.gain > worth


class MappedChannel(NamedTuple):
    """Scales that are believed of a channel, and what else it may be, by its ratio: a unit, or a line to write."""

    low: float = 0.0
    high: float = np.inf
    ratios: Mapping[float, "Diagnostic | str | None"] = MappingProxyType({})


class Hypothesis(NamedTuple):
    """A row of S = signed permutation × unit ratio, as the data of one channel prefer it."""

    code: str  # "" as it is, "swapped", "inverted", "unit", "scale" of no unit
    of: int  # the prediction that the channel shows
    relation: Relation
    is_clear: bool
    ratio: float = 1.0  # of units; NaN where none is near
    meaning: "Diagnostic | str | None" = None  # of that ratio


def ratios(measures: str, read_as: str) -> dict[float, str]:
    """Return the units that a column may have that was read as another, by the ratio of what was read to the truth."""
    unit_read = unit(read_as)
    si = unit_read.si if unit_read and unit_read.measures == measures else 1.0
    return {
        si / unit_.si: name for name, unit_ in UNITS.items() if unit_.measures == measures and unit_.si != si
    }


def relation(z: np.ndarray, h: np.ndarray) -> Relation:
    """Return the regression of z (N,) on h (N,), where both are finite; zeros for fewer than FEW windows."""
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
    """Of x (N,) one window later; 0 if its power is not more than `least`."""
    power = float(x @ x)
    return float(x[1:] @ x[:-1]) / power if power > least else 0.0


def signal_map(
    z: np.ndarray, h: np.ndarray, channels: Sequence[MappedChannel], worth: float = WORTH
) -> list[Hypothesis]:
    """Return what each channel of z (N, m) shows of the predictions h (N, k ≥ m): its own, the i-th, or another's."""
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
    """The share of a prediction in a channel."""
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
    """log L that i and j gain if each shows the other's prediction, where their own explain nothing; else 0."""
    pairs = [(of[a][a], of[a][b]) for a, b in _pairs(of, i, j)]
    gain = sum(candidate.n * (candidate.gain - own.gain) for own, candidate in pairs)
    clear = sum(candidate.gain - own.gain for own, candidate in pairs) > worth and gain > MARGIN
    return gain if clear and not any(own.is_clear(NOTHING) for own, _ in pairs) else 0.0


def _pairs(of: Sequence[Sequence[Relation]], i: int, j: int) -> list[tuple[int, int]]:
    """A swap of i and j; j may be a prediction that no channel has as its own."""
    return [(i, j), (j, i)] if j < len(of) else [(i, j)]
