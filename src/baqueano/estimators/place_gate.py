"""The gate of the sensors that show the pose: a reading is judged as a whole, a filter by two readings.

    d² = yᵀ S⁻¹ y,   w = 1/(1 + (d²/χ²)⁴)         y all numbers of a sensor, χ² of m numbers at gate_sigma     (1)
    P ← D P D,   D = d/√m for η, κ and b; of ψ, κ and b at most up to their deviation at the start             (2)
    (y − y₋)ᵀ (2 S)⁻¹ (y − y₋) ≤ χ²                                                                          (3)

A tag that is taken for another may agree in one of its numbers by chance: none of them is believed. One reading that is
refused is an outlier. Two in a row, AGAIN_S or more apart, are not: somebody moved the vehicle, or the filter is surer
than it may be. So its covariance grows to what the second reading shows (2), and if that one says what the one before
said, y₋, it is believed at once (3); else the next one decides. Readings that follow a refused one sooner are not
another witness: a reader may tell one tag twice.
"""

from typing import Any, NamedTuple

import numpy as np

from baqueano.estimators.gate import gate

AGAIN_S = 1.0
LONG_AGO_S = 1e9  # nothing was refused
TURN_STD = np.pi / np.sqrt(3.0)  # rad, of a heading that nobody knows


class PlaceDoubt(NamedTuple):
    """What was refused before, for each sensor that shows the pose."""

    y: np.ndarray  # (m,) the last innovation that was another witness, in the order of all numbers
    since_s: (
        np.ndarray
    )  # (sensors,) since the reading that was refused; LONG_AGO_S where the last one was not


class Judgement(NamedTuple):
    """What is to be believed of the numbers of a tick."""

    weights: dict[int, Any]  # of the numbers that show the pose
    grown: Any  # how much farther off than claimed the state is, d/√m of (2); 1 where nothing says so
    doubt: PlaceDoubt


def no_doubt(groups: tuple[tuple[int, ...], ...], m: int) -> PlaceDoubt:
    """Return the doubt of a filter that begins."""
    return PlaceDoubt(np.zeros(m), LONG_AGO_S * np.ones(len(groups)))


def judged(
    groups: tuple[tuple[int, ...], ...],
    y: np.ndarray,
    S: np.ndarray,
    has: np.ndarray,
    doubt: PlaceDoubt,
    dt_s: Any,
    sigma: float,
) -> Judgement:
    """Return the weights; `groups` are the numbers of each sensor that shows the pose, y (m,) is 0 and S (m, m) that of
    the noise where `has` (m,) is 0.  (1)-(3)"""
    weights: dict[int, Any] = {}
    grown, since_s, before = 1.0, [], list(doubt.y)
    for group, ago_s in zip(groups, doubt.since_s + dt_s, strict=True):
        at, limit = list(group), gate(sigma, len(group))
        came, part = np.max(has[at]) > 0.0, S[np.ix_(at, at)]
        d2 = square(part, y[at])
        off, waited = came & (d2 > limit), ago_s >= AGAIN_S
        again = off & waited & (ago_s < LONG_AGO_S)
        same = again & (0.5 * square(part, (y - doubt.y)[at]) <= limit)
        weight = 1.0 / (1.0 + (np.where(same, 0.0, d2) / limit) ** 4)
        weights |= dict.fromkeys(group, weight)
        grown = np.maximum(grown, np.where(again, np.sqrt(d2 / len(group)), 1.0))
        refused = off & ~same
        since_s.append(np.where(came & ~refused, LONG_AGO_S, np.where(refused & waited, 0.0, ago_s)))
        for k in group:
            before[k] = np.where(refused & waited, y[k], before[k])
    return Judgement(weights, grown, PlaceDoubt(np.array(before), np.minimum(np.array(since_s), LONG_AGO_S)))


def growth(grown: Any, sd: np.ndarray, most: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return D (n,) of (2): deviations `sd` (n,) grow where `at` (n,) is 1, up to `most` (n,)."""
    room = np.maximum(most / np.maximum(sd, 1e-12), 1.0)
    return np.where(at > 0.0, np.minimum(grown, room), 1.0)


def square(S: np.ndarray, y: np.ndarray) -> Any:
    """Return yᵀ S⁻¹ y of a covariance (m, m), by elimination."""
    rows, v, total = [[S[i, j] for j in range(len(y))] for i in range(len(y))], list(y), 0.0
    for k in range(len(y)):
        total = total + v[k] * v[k] / rows[k][k]
        for i in range(k + 1, len(y)):
            part = rows[i][k] / rows[k][k]
            v[i] = v[i] - part * v[k]
            for j in range(k + 1, len(y)):
                rows[i][j] = rows[i][j] - part * rows[k][j]
    return total
