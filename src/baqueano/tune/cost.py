"""What a good set of gains is: the paper's cost of a drive along its route.

    C(p) = Σ_t ‖η_ref(t) − η(t)‖_h                               Grotz et al.,
    `equ:controller_cost_function`   (1) r² = Δx² + Δy² + (w Δψ)²,   ‖·‖_h = ½ r² for r ≤ k,  k r − ½ k²
    beyond                                (2)

η is the pose of the simulated vehicle ("obtained by simulating the system with the dynamic parameters").
The paper sums metres and radians: w [m] is what a radian weighs, by default half the track (errata.md), the
distance that a wheel moves when the vehicle turns in place by one. Nor does it give h: k is 0.1 m by
default. Huber's norm of the whole vector, not of its entries, so that turning the map changes nothing.
"""

from typing import Any, NamedTuple

import numpy as np

from baqueano.geometry import wrap


class Weights(NamedTuple):
    """The two settings of (2)."""

    radian_m: float  # w
    huber_m: float  # k


class Shown(NamedTuple):
    """What is told of a tick beside its cost."""

    distance_m: Any  # from the reference
    heading_rad: Any
    saturated: Any  # 1.0 where the supervisor or the vehicle's limit cut the command


def tick_cost(weights: Weights, heard: Any) -> Any:
    """One term of the sum, a scalar [m²].  (2)"""
    d = heard.record.reference.eta - heard.truth.eta
    k = weights.huber_m
    r2 = d[0] * d[0] + d[1] * d[1] + (weights.radian_m * wrap(d[2])) ** 2
    beyond = k * np.sqrt(np.maximum(r2, k * k)) - 0.5 * k * k
    return np.where(r2 <= k * k, 0.5 * r2, beyond)


def shown(limit: np.ndarray, heard: Any) -> Shown:
    """Distance, heading and saturation of a tick."""
    d = heard.record.reference.eta - heard.truth.eta
    u, n = heard.record.command.u, len(limit)
    full = [np.where((np.abs(u[i]) >= limit[i]) & (limit[i] > 0.0), 1.0, 0.0) for i in range(n)]
    saturated = full[0]
    for other in full[1:]:
        saturated = np.maximum(saturated, other)
    return Shown(np.hypot(d[0], d[1]), wrap(d[2]), saturated)
