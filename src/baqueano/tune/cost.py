"""The cost of a set of gains: the paper's cost of a drive along its route.

    C(p) = Σ_t ‖η_ref(t) − η(t)‖_h                  Grotz et al., `equ:controller_cost_function`        (1)
    r² = Δx² + Δy² + (w Δψ)²,   ‖·‖_h = ½ r² for r ≤ k,   k r − ½ k² beyond                             (2)
    + q Σ_t Σ_i ((u_i,t − u_i,t−1) / limit_i)² + p Σ_t Σ_i (u_i,t / limit_i)²         ours; 0 in the paper  (3)

η is the pose of the simulated vehicle ("obtained by simulating the system with the dynamic parameters").
The paper sums metres and radians: w [m] is the weight of a radian. By default it is half the track (errata 13), the
distance that a wheel moves when the vehicle turns in place by one. Nor does it give h: k is 0.1 m by
default. Huber's norm of the whole vector, not of its entries, so that turning the map changes nothing.
The paper puts no price on the command, and the least cost is then a vehicle that trembles along its route;
q [m²] is the price of jerks, by default 0.1. The price p [m²] of effort is 0 by default: most of the effort is what
the route needs. For the paper's own cost write jerk_m2 = 0 and aside_m = 0, a start on the route.
"""

from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.geometry import wrap


class Weights(NamedTuple):
    """The settings of (2) and (3)."""

    radian_m: float  # w
    huber_m: float  # k
    jerk_m2: float  # q; 0: the paper's cost
    effort_m2: float = 0.0  # p


class TickErrors(NamedTuple):
    """The outputs of a tick beside its cost."""

    distance_m: Tree  # from the reference
    heading_rad: Tree
    saturated: Tree  # 1.0 where the supervisor or the vehicle's limit cut the command


def tick_cost(weights: Weights, limit: np.ndarray, output: Tree) -> Tree:
    """Return a term of the sum, a scalar [m²].  (2), (3)"""
    cost = path_cost(weights, output)
    if weights.jerk_m2 != 0.0:
        cost = cost + weights.jerk_m2 * jerk(limit, output)
    return cost if weights.effort_m2 == 0.0 else cost + weights.effort_m2 * effort(limit, output)


def path_cost(weights: Weights, output: Tree) -> Tree:
    """Return the cost of the distance from the reference at a tick, a scalar [m²].  (2)"""
    d = output.record.reference.eta - output.truth.eta
    k = weights.huber_m
    r2 = d[0] * d[0] + d[1] * d[1] + (weights.radian_m * wrap(d[2])) ** 2
    beyond = k * np.sqrt(np.maximum(r2, k * k)) - 0.5 * k * k
    return np.where(r2 <= k * k, 0.5 * r2, beyond)


def jerk(limit: np.ndarray, output: Tree) -> Tree:
    """Return the squared change of the command at a tick, in parts of its limit; q is its price.  (3)"""
    change = (output.record.command.u - output.record.tick.u) / _scale(limit)
    return np.sum(change * change)


def effort(limit: np.ndarray, output: Tree) -> Tree:
    """Return the square of the command at a tick, in parts of its limit; p is its price.  (3)"""
    part = output.record.command.u / _scale(limit)
    return np.sum(part * part)


def shown(limit: np.ndarray, output: Tree) -> TickErrors:
    """Distance, heading and saturation of a tick."""
    d = output.record.reference.eta - output.truth.eta
    full = (np.abs(output.record.command.u) >= limit) & (limit > 0.0)
    return TickErrors(np.hypot(d[0], d[1]), wrap(d[2]), np.max(np.where(full, 1.0, 0.0)))


def _scale(limit: np.ndarray) -> np.ndarray:
    return np.where((limit > 0.0) & np.isfinite(limit), limit, 1.0)
