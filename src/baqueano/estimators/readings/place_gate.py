"""The gate of the sensors that measure the pose: it tests all channels together, and the filter by two readings.

    d² = yᵀ S⁻¹ y,   w = 1/(1 + (d²/χ²)⁴)         y: all m channels of a sensor, χ²: their limit (gate.py)      (1)
    d²ᵢ = (y + Δᵢ)ᵀ S⁻¹ (y + Δᵢ),   p = 1/(1 + MISTAKE_SHARE e^(½ (d² − min d²ᵢ))),   w ← p w                       (2)
    P ← D P D,   D = d/√m for η, κ, β, b; ψ, κ, β, b grow at most to their deviation at the start              (3)
    (y − y₋)ᵀ (2 S)⁻¹ (y − y₋) ≤ χ²                                                                          (4)

y is the innovation with covariance S, w the weight. Δᵢ is the vector from the tag that was read to tag i. p is the
probability that no tag was mistaken for another (Bar-Shalom and Tse 1975). One rejected reading is an outlier. Two
rejected readings, at least REPEAT_S apart, mean that a person moved the vehicle or that the filter is overconfident: P
grows (3). If the second reading agrees with the first, y₋, it is accepted at once (4); else the next reading decides.
Readings that a mistaken tag explains are counted only after MAX_MISTAKES such readings in a row. A rejected reading is
counted only if the previous counted one is at least REPEAT_S old.
"""

from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.estimators.readings.gate import gate_limit
from baqueano.numerics.gaussian_likelihood import squared_distance

REPEAT_S = 1.0
MISTAKE_SHARE = 0.05  # share of mistaken readings: a guess, because the distances between tags matter more
MAX_MISTAKES = 2.0  # readings in a row that a mistaken tag explains
NO_REJECTION_S = 1e9  # time since the last rejected reading, if no reading was rejected
MAX_EXPONENT = 50.0  # largest exponent, to avoid an overflow
MIN_SQUARED_DISTANCE = 1e-12  # m²: a smaller squared distance is the distance of a tag from itself
TURN_STD = np.pi / np.sqrt(3.0)  # rad, of an unknown heading: uniform between ±π


class PoseChannels(NamedTuple):
    """The channels of the pose sensors in a tick, compared with their prediction."""

    y: np.ndarray  # (m,) innovations; 0 for a channel without a measurement
    S: np.ndarray  # (m, m) their covariance; only the noise for a channel without a measurement
    mask: np.ndarray  # (m,) 1 for a channel with a measurement, else 0
    # of each channel (k,): Δ of (2), zeros for the tag that the sensor reported
    corrections: list[np.ndarray]


class GateHistory(NamedTuple):
    """Results of the gate for earlier readings of each sensor; each array is (sensors,)."""

    rejection_age_s: np.ndarray  # since a rejected reading; NO_REJECTION_S if the last one was accepted
    confirmation: np.ndarray  # 1 if an informative reading was rejected after the last accepted one
    mistake_count: np.ndarray  # readings in a row that a mistaken tag explains


class PoseMemory(NamedTuple):
    """Memory of the rejected readings, for each sensor that measures the pose."""

    # (m,) innovations of the last informative rejected reading, in the order of all channels; (0,) without a sensor
    y: np.ndarray
    history: GateHistory


class GateDecision(NamedTuple):
    """Result of the gate in a tick: weights of the channels, growth of the covariance, and memory."""

    weights: dict[int, Value]  # of the channels that measure the pose, by index
    growth_factor: Value  # d/√m of (3): factor on the standard deviations; 1 without evidence
    memory: PoseMemory


def empty_memory(groups: tuple[tuple[int, ...], ...], m: int) -> PoseMemory:
    """Return the memory at the start, without rejected readings; m is the number of all channels."""
    zeros = np.zeros(len(groups))
    return PoseMemory(np.zeros(m if groups else 0), GateHistory(NO_REJECTION_S + zeros, zeros, zeros))


def gate_decision(
    groups: tuple[tuple[int, ...], ...], channels: PoseChannels, memory: PoseMemory, dt_s: Value, sigma: float
) -> GateDecision:
    """Return the decision of a tick; `groups` contains the indices of the channels of each pose sensor.  (1)-(4)"""
    if not groups:
        return GateDecision({}, 1.0, memory)
    weights: dict[int, Value] = {}
    factor, innovations, histories = 1.0, list(memory.y), []
    for group, *record in zip(groups, *memory.history, strict=True):
        indices, limit = list(group), gate_limit(sigma, len(group))
        y = channels.y[indices]
        S = channels.S[np.ix_(indices, indices)]
        has_reading = np.max(channels.mask[indices]) > 0.0
        d2, difference_d2 = squared_distance(S, y), squared_distance(2.0 * S, y - memory.y[indices])
        mistake_d2 = _nearest_distance(S, y, [channels.corrections[k] for k in group])
        history = GateHistory(record[0] + dt_s, *record[1:])
        mistake_odds = MISTAKE_SHARE * np.exp(np.minimum(0.5 * (d2 - mistake_d2), MAX_EXPONENT))
        probability = 1.0 / (1.0 + mistake_odds)
        is_rejected = has_reading & ((d2 > limit) | (probability < 0.5))
        is_mistake = (
            is_rejected & (probability < 0.5) & (mistake_d2 <= limit) & (history.mistake_count < MAX_MISTAKES)
        )
        is_interval_over = history.rejection_age_s >= REPEAT_S
        is_informative = is_rejected & ~is_mistake & is_interval_over
        is_repetition = is_informative & (history.confirmation > 0.0)
        is_confirmed = is_repetition & (difference_d2 <= limit)
        weight = np.where(is_confirmed, 1.0, probability / (1.0 + (d2 / limit) ** 4))
        weights |= dict.fromkeys(group, weight)
        factor = np.maximum(factor, np.where(is_repetition, np.sqrt(d2 / len(group)), 1.0))
        for k in group:
            innovations[k] = np.where(is_informative & ~is_confirmed, channels.y[k], innovations[k])
        is_correct = has_reading & (is_confirmed | ~is_rejected)
        histories.append(_next_history(history, is_rejected & ~is_confirmed, is_mistake, is_correct))
    history = GateHistory(*(np.array(column) for column in zip(*histories, strict=True)))
    return GateDecision(weights, factor, PoseMemory(np.array(innovations), history))


def _next_history(
    history: GateHistory, is_rejected: Value, is_mistake: Value, is_correct: Value
) -> GateHistory:
    """Return the history of one sensor after the reading of this tick; reset it if the reading is right."""
    is_counted = is_rejected & (history.rejection_age_s >= REPEAT_S)
    rejection_age_s = np.where(is_counted, 0.0, np.minimum(history.rejection_age_s, NO_REJECTION_S))
    confirmation = np.where(is_counted & ~is_mistake, 1.0, history.confirmation)
    mistake_count = history.mistake_count + np.where(is_counted & is_mistake, 1.0, 0.0)
    pairs = zip((NO_REJECTION_S, 0.0, 0.0), (rejection_age_s, confirmation, mistake_count), strict=True)
    return GateHistory(*(np.where(is_correct, a, b) for a, b in pairs))


def _nearest_distance(S: np.ndarray, y: np.ndarray, corrections: list[np.ndarray]) -> Value:
    """Return the least d²ᵢ of (2) over the other tags; a very large number if the sensor cannot mistake a tag."""
    max_inverse = 1.0 / MIN_SQUARED_DISTANCE
    for correction in np.stack(corrections, axis=1):
        is_none = np.sum(correction**2) < MIN_SQUARED_DISTANCE
        max_inverse = np.minimum(
            max_inverse, np.where(is_none, 1.0 / MIN_SQUARED_DISTANCE, squared_distance(S, y + correction))
        )
    return max_inverse


def growth_factors(factor: Value, std: np.ndarray, max_std: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Return the diagonal D (n,) of (3): the factor of each standard deviation `std` (n,).

    If `mask` (n,) is 1, the factor is `factor`, limited so that it does not raise the deviation above `max_std` (n,).
    Otherwise the factor is 1.
    """
    max_factor = np.maximum(max_std / np.maximum(std, 1e-12), 1.0)
    return np.where(mask > 0.0, np.minimum(factor, max_factor), 1.0)
