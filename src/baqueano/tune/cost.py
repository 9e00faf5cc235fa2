"""Compute the cost of a set of gains: the paper's cost of a drive along its route, plus weights on the command.

    C(g) = Σ_t ‖η_ref(t) − η(t)‖_h                  Grotz et al., `equ:controller_cost_function`        (1)
    r² = Δx² + Δy² + (w Δψ)²,   ‖·‖_h = ½ r² for r ≤ k,   k r − ½ k² beyond                             (2)
    + q Σ_t Σ_i ((u_i,t − u_i,t−1) / limit_i)² + p Σ_t Σ_i (u_i,t / limit_i)²         not in the paper   (3)

g: gains; η: pose of the simulated vehicle ("obtained by simulating the system with the dynamic parameters"); η_ref:
reference; u: command; Δ: errors. The paper adds metres and radians; here w [m] is the weight of a radian. Its default
is half the track (errata 13): the distance of a wheel per radian of a turn in place. The paper does not define h; k is
0.1 m by default. Huber's norm is of the whole vector, so that a rotation of the map does not change it. The paper does
not weight the command, and its optimum oscillates along the route. q [m²] is the weight of jerks, by default 0.1. The
weight p [m²] of effort is 0 by default, because the route needs most of the effort. For the cost of the paper
set jerk_m2 = 0 and offset_m = 0, a start on the route.
"""

from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.geometry import wrap


class Weights(NamedTuple):
    """The weights w, k, q and p of the cost, (2) and (3)."""

    radian_m: float  # w
    huber_m: float  # k
    jerk_m2: float  # q; 0: the paper's cost
    effort_m2: float = 0.0  # p


class TickErrors(NamedTuple):
    """The errors of a tick that are reported in addition to its cost."""

    distance_m: Tree  # from the reference
    heading_rad: Tree
    at_limit: Tree  # 1.0 if the command is at its limit


def tick_cost(weights: Weights, limit: np.ndarray, output: Tree) -> Tree:
    """Return the cost of one tick, a scalar [m²]: path, jerk and effort.  (2), (3)"""
    cost = path_cost(weights, output)
    if weights.jerk_m2 != 0.0:
        cost = cost + weights.jerk_m2 * jerk(limit, output)
    return cost if weights.effort_m2 == 0.0 else cost + weights.effort_m2 * effort(limit, output)


def path_cost(weights: Weights, output: Tree) -> Tree:
    """Return the cost of the distance from the reference at a tick, a scalar [m²].  (2)"""
    d = output.record.reference.eta - output.truth.eta
    k = weights.huber_m
    r2 = d[0] * d[0] + d[1] * d[1] + (weights.radian_m * wrap(d[2])) ** 2
    linear_cost = k * np.sqrt(np.maximum(r2, k * k)) - 0.5 * k * k
    return np.where(r2 <= k * k, 0.5 * r2, linear_cost)


def jerk(limit: np.ndarray, output: Tree) -> Tree:
    """Return the squared change of the command at a tick, relative to its limit; q is its weight.  (3)"""
    change = (output.record.sent_command.u - output.record.tick.u) / _scale(limit)
    return np.sum(change * change)


def effort(limit: np.ndarray, output: Tree) -> Tree:
    """Return the square of the command at a tick, relative to its limit; p is its weight.  (3)"""
    relative_command = output.record.sent_command.u / _scale(limit)
    return np.sum(relative_command * relative_command)


def tick_errors(limit: np.ndarray, output: Tree) -> TickErrors:
    """Return distance [m], heading error [rad] and saturation of a tick: 1 if a command is at its limit, else 0."""
    d = output.record.reference.eta - output.truth.eta
    is_saturated = (np.abs(output.record.sent_command.u) >= limit) & (limit > 0.0)
    return TickErrors(np.hypot(d[0], d[1]), wrap(d[2]), np.max(np.where(is_saturated, 1.0, 0.0)))


def _scale(limit: np.ndarray) -> np.ndarray:
    return np.where((limit > 0.0) & np.isfinite(limit), limit, 1.0)
