"""The gate of the sensors that measure the pose: it tests a reading as a whole, and the filter by two readings.

    d² = yᵀ S⁻¹ y,   w = 1/(1 + (d²/χ²)⁴)         y: all m channels of a sensor, χ²: their limit (gate.py)      (1)
    d²ᵢ = (y + Δᵢ)ᵀ S⁻¹ (y + Δᵢ),   p = 1/(1 + MISTAKEN e^(½ (d² − min d²ᵢ))),   w ← p w                       (2)
    P ← D P D,   D = d/√m for η, κ, β, b; ψ, κ, β, b grow at most to their deviation at the start              (3)
    (y − y₋)ᵀ (2 S)⁻¹ (y − y₋) ≤ χ²                                                                          (4)

y is the innovation with covariance S, w the weight. Δᵢ is the vector from the tag that was read to tag i. p is the
probability that no tag was mistaken for another (Bar-Shalom and Tse 1975). One refused reading is an outlier. Two of
them, at least AGAIN_S apart, mean that a person moved the vehicle or that the filter is overconfident: P grows (3). If
the second reading agrees with the first, y₋, it is accepted at once (4); else the next reading decides. Readings that a
mistaken tag explains count for this only after OVERLOOKED such readings in a row. A refused reading counts only if the
previous counted reading is at least AGAIN_S old.
"""

from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.estimators.readings.gate import gate

AGAIN_S = 1.0
MISTAKEN = 0.05  # share of mistaken readings; a guess, the distances between tags matter more
OVERLOOKED = 2.0  # mistakes in a row
LONG_AGO_S = 1e9  # no reading was refused
LIKELY = 50.0  # largest exponent, to avoid an overflow
SMALL = 1e-12  # m²: a smaller squared distance is that of a tag from itself
TURN_STD = np.pi / np.sqrt(3.0)  # rad, of an unknown heading: uniform between ±π


class PlaceNumbers(NamedTuple):
    """The channels of the pose sensors in a tick, compared with their prediction."""

    y: np.ndarray  # (m,) innovations; 0 for a channel without a measurement
    S: np.ndarray  # (m, m) their covariance; only the noise for a channel without a measurement
    has: np.ndarray  # (m,) 1 for a channel with a measurement, else 0
    ways: list[np.ndarray]  # of each channel (k,): Δ of (2), zeros for the tag that the sensor reported


class Past(NamedTuple):
    """Results of the gate for earlier readings of each sensor; each array is (sensors,)."""

    since_s: np.ndarray  # time since a refused reading; LONG_AGO_S if the last one was accepted
    witness: np.ndarray  # 1 if an informative reading was refused since the last accepted one
    mistakes: np.ndarray  # readings in a row that a mistaken tag explains


class PlaceDoubt(NamedTuple):
    """Memory of the refused readings, for each sensor that measures the pose."""

    y: np.ndarray  # (m,) innovations of the last informative refused reading, in the order of all numbers
    past: Past


class GateDecision(NamedTuple):
    """Result of the gate in a tick: weights of the numbers, growth of the covariance, and memory."""

    weights: dict[int, Value]  # of the numbers that measure the pose
    grown: Value  # d/√m of (3): factor on the standard deviations; 1 without evidence
    doubt: PlaceDoubt


def no_doubt(groups: tuple[tuple[int, ...], ...], m: int) -> PlaceDoubt:
    """Return the memory at the start, without refused readings; m is the number of all numbers."""
    none = np.zeros(len(groups))
    return PlaceDoubt(np.zeros(m), Past(LONG_AGO_S + none, none, none))


def gate_decision(
    groups: tuple[tuple[int, ...], ...], numbers: PlaceNumbers, doubt: PlaceDoubt, dt_s: Value, sigma: float
) -> GateDecision:
    """Return weights, growth and memory; `groups` are the indices of the numbers of each pose sensor.  (1)-(4)"""
    if not groups:
        return GateDecision({}, 1.0, doubt)
    weights: dict[int, Value] = {}
    factor, before, after = 1.0, list(doubt.y), []
    for group, *was in zip(groups, *doubt.past, strict=True):
        at, limit = list(group), gate(sigma, len(group))
        y, S, came = numbers.y[at], numbers.S[np.ix_(at, at)], np.max(numbers.has[at]) > 0.0
        d2, apart2 = square(S, y), square(2.0 * S, y - doubt.y[at])
        other2 = _nearest(S, y, [numbers.ways[k] for k in group])
        past = Past(was[0] + dt_s, *was[1:])
        right = 1.0 / (1.0 + MISTAKEN * np.exp(np.minimum(0.5 * (d2 - other2), LIKELY)))
        off = came & ((d2 > limit) | (right < 0.5))
        mistake = off & (right < 0.5) & (other2 <= limit) & (past.mistakes < OVERLOOKED)
        is_due = past.since_s >= AGAIN_S
        informative = off & ~mistake & is_due
        has_witness = informative & (past.witness > 0.0)
        same = has_witness & (apart2 <= limit)
        weights |= dict.fromkeys(group, np.where(same, 1.0, right / (1.0 + (d2 / limit) ** 4)))
        factor = np.maximum(factor, np.where(has_witness, np.sqrt(d2 / len(group)), 1.0))
        for k in group:
            before[k] = np.where(informative & ~same, numbers.y[k], before[k])
        after.append(_later(past, off & ~same, mistake, came & (same | ~off)))
    past = Past(*(np.array(column) for column in zip(*after, strict=True)))
    return GateDecision(weights, factor, PlaceDoubt(np.array(before), past))


def _later(past: Past, refusal: Value, mistake: Value, is_right: Value) -> Past:
    """Return the updated memory of one sensor after the reading of this tick."""
    counts = refusal & (past.since_s >= AGAIN_S)
    since_s = np.where(counts, 0.0, np.minimum(past.since_s, LONG_AGO_S))
    witness = np.where(counts & ~mistake, 1.0, past.witness)
    mistakes = past.mistakes + np.where(counts & mistake, 1.0, 0.0)
    return Past(
        *(
            np.where(is_right, a, b)
            for a, b in zip((LONG_AGO_S, 0.0, 0.0), (since_s, witness, mistakes), strict=True)
        )
    )


def _nearest(S: np.ndarray, y: np.ndarray, ways: list[np.ndarray]) -> Value:
    """Return the least d²ᵢ of (2) over the other tags; a very large number if the sensor cannot mistake a tag."""
    least = 1.0 / SMALL
    for way in np.stack(ways, axis=1):
        is_none = np.sum(way**2) < SMALL
        least = np.minimum(least, np.where(is_none, 1.0 / SMALL, square(S, y + way)))
    return least


def growth(grown: Value, sd: np.ndarray, most: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Return the diagonal D (n,) of (3): the factor of each standard deviation `sd` (n,).

    If `mask` (n,) is 1, the factor is `grown`, but limited so that it does not raise the deviation above `most` (n,).
    Else the factor is 1.
    """
    room = np.maximum(most / np.maximum(sd, 1e-12), 1.0)
    return np.where(mask > 0.0, np.minimum(grown, room), 1.0)


def square(S: np.ndarray, y: np.ndarray) -> Value:
    """Return yᵀ S⁻¹ y of a covariance S (m, m), by elimination."""
    rows, v, total = [[S[i, j] for j in range(len(y))] for i in range(len(y))], list(y), 0.0
    for k in range(len(y)):
        total = total + v[k] * v[k] / rows[k][k]
        for i in range(k + 1, len(y)):
            part = rows[i][k] / rows[k][k]
            v[i] = v[i] - part * v[k]
            for j in range(k + 1, len(y)):
                rows[i][j] = rows[i][j] - part * rows[k][j]
    return total
