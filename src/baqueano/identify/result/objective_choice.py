"""Choose between two costs: θ̂ of the simulation error or θ̃ of the innovations.

    θ_b − θ = (A − A_b)⁻¹ g_b        of either fit, without block b of BLOCK_S (clusters.py)              (1)
    D_b = C_b(θ̃_b) − C_b(θ̂_b),      z = Σ D_b / √(n var D_b)   over n blocks                              (2)
    t_i = (θ̂ − θ̃)_i / √((n − 1)/n Σ_b (δ_b − δ̄)_i²),   δ_b = θ̂_b − θ̃_b                                   (3)

C_b is the cost of an open-loop simulation of a held-out block. The choice is

    process noise is 0                        the simulation: both agree, and it is the harder test of a model
    noise, one θ, ΣD_b below 0                the innovations: errors of the simulation are a random walk
    noise, one θ, ΣD_b > 0, not significant   the simulation: nothing is gained
    two θ by (3), or a larger error by (2)    the simulation, with a warning: the model lacks an effect

docs/derivations/robust_covariance.md gives the reasons and the sources.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, note
from baqueano.identify.covariance.clusters import (
    MIN_BLOCKS,
    block_duration_s,
    block_edges,
    segment_derivatives,
)
from baqueano.identify.estimation.prediction_error import (
    BETA,
    InnovationDerivatives,
    MaximumLikelihood,
    Prediction,
    psi_derivative,
    weight,
)
from baqueano.identify.residuals.simulation import Residuals
from baqueano.identify.result.verdict import MAX_NOISE_RATIO
from baqueano.messages.language import number
from baqueano.numerics.block_sums import MIN_REMAINDER
from baqueano.numerics.normal_equations import projected_derivatives
from baqueano.numerics.parallel import gram
from baqueano.numerics.statistics import HUBER, change_covariance, huber_cost, student_quantile

FLOOR_P_VALUE = 1e-3  # probability below which process noise is significant
UNITS = ("m/s", "m/s", "rad/s")
LARGER_ERROR_P_VALUE = 0.05  # below it, the left-out error of the innovations' fit is significantly larger
DIFFERENCE_P_VALUE = 0.01  # probability below which the two fits differ significantly


class ObjectiveChoice(NamedTuple):
    """The chosen cost, and the reason."""

    cost: str  # "simulation" or "innovations"
    reason: Diagnostic
    is_explained: bool  # True if process noise explains the residuals of the simulation
    is_contradicted: bool = False  # True if two different fits or a larger error contradict process noise


def choose_objective(
    optimum: MaximumLikelihood,
    axes: Sequence[int],
    comparison: "LeaveOneOutComparison | None",
    times: np.ndarray,
) -> ObjectiveChoice:
    """Return the choice of the cost. `times` (m,) is the sensor noise without the process noise, relative to the noise
    in the file; 0 if the file does not contain it."""
    chance = f"{number(optimum.p_value):.2g}" if optimum.p_value >= 1e-6 else "< 1e-6"
    figures: JsonObject = {"ratio": float(optimum.ratio), "chance": chance}
    if optimum.p_value >= FLOOR_P_VALUE:
        return ObjectiveChoice("simulation", note("cost.floor-still", **figures), False)
    figures["floor"] = _process_noise_text(optimum, axes)
    if comparison is None:
        return ObjectiveChoice("simulation", note("cost.too-short", **figures), False)
    difference, name = comparison.largest_change
    details = figures | {"difference": difference, "open_loop": _open_loop(comparison)}
    if difference > comparison.limit or comparison.is_worse:
        return ObjectiveChoice("simulation", note("cost.neither", subject=name, **details), False, True)
    is_explained = not optimum.info.autocorrelated and not np.any(times > MAX_NOISE_RATIO)
    if comparison.is_better:
        return ObjectiveChoice("innovations", note("cost.innovations", **details), is_explained)
    return ObjectiveChoice("simulation", note("cost.simulation", **details), is_explained)


def _open_loop(comparison: "LeaveOneOutComparison") -> Diagnostic:
    """Return a note on the open-loop error of the fit by innovations on held-out blocks."""
    if not np.isfinite(comparison.cost_increase_percent):
        return note("cost.diverged")
    code = "cost.smaller" if comparison.is_better else "cost.larger"
    return note(code, percent=abs(comparison.cost_increase_percent))


def _process_noise_text(optimum: MaximumLikelihood, axes: Sequence[int]) -> str:
    """Return the process noise with its error, axis by axis, as text."""
    messages = []
    for axis, v, std in zip(axes, optimum.noise.floor, optimum.floor_std, strict=True):
        if v > 0.0:
            error = f" ± {number(std / (2.0 * np.sqrt(v))):.1g}" if np.isfinite(std) else ""
            messages.append(f"{number(float(np.sqrt(v))):.2g}{error} {UNITS[axis]}")
    return ", ".join(messages)


class LeaveOneOutComparison(NamedTuple):
    """Comparison of both fits, block by block."""

    cost_changes: np.ndarray  # (n,) D_b of (2)
    cost: float  # Σ C_b(θ̂_b)
    distances: np.ndarray  # (k,) |t_i| of (3)
    names: Sequence[str]  # (k,)

    @property
    def z(self) -> float:
        """Return Σ D_b in standard errors, inf if the model diverged.  (2)"""
        if not np.isfinite(self.cost_changes).all():
            return float("inf")
        std = np.sqrt(len(self.cost_changes) * np.var(self.cost_changes, ddof=1))
        return float(self.cost_changes.sum() / max(std, 1e-300))

    @property
    def cost_increase_percent(self) -> float:
        """Return the relative increase of the cost with the fit by innovations [%], negative for a decrease."""
        return 100.0 * float(self.cost_changes.sum()) / max(self.cost, 1e-300)

    @property
    def is_better(self) -> bool:
        """Return True if the fit by innovations has the smaller error on the held-out blocks."""
        return bool(self.cost_changes.sum() < 0.0)

    @property
    def is_worse(self) -> bool:
        """Return True if the fit by innovations has a significantly larger error on the held-out blocks."""
        return self.z > student_quantile(1.0 - LARGER_ERROR_P_VALUE, len(self.cost_changes) - 1)

    @property
    def limit(self) -> float:
        """Return the critical value of (3) above which the two fits differ significantly (Bonferroni)."""
        p_value = 0.5 * DIFFERENCE_P_VALUE / max(1, len(self.names))
        return student_quantile(1.0 - p_value, len(self.cost_changes) - 1)

    @property
    def largest_change(self) -> tuple[float, str]:
        """Return the largest value of (3), and the name of its parameter."""
        if not len(self.distances):
            return 0.0, ""
        k = int(np.argmax(self.distances))
        return float(self.distances[k]), self.names[k]


class _ObjectiveBlock(NamedTuple):
    """Gradient and Hessian of a block at a fit, and the derivatives of its open-loop residuals."""

    g: np.ndarray  # (q,)
    A: np.ndarray  # (q, q)
    indices: np.ndarray  # (q,) their indices in the fit
    r: np.ndarray  # (N m,)
    d: np.ndarray  # (N m, s) by the entries `of`
    entries: np.ndarray  # (s,)


def leave_one_out(
    problem: Residuals,
    theta: np.ndarray,
    identifiable: np.ndarray,
    prediction: Prediction,
    x: np.ndarray,
    free: np.ndarray,
) -> LeaveOneOutComparison | None:
    """Return the comparison of two fits, or None with too few blocks. The fitted entries are `identifiable` of
    `theta` (p,) and `free` of `x`."""
    simulation = list(_simulation_blocks(problem, theta))
    innovation = list(_innovation_blocks(problem, prediction, x))
    if len(simulation) < MIN_BLOCKS:
        return None
    changes = _leave_out(simulation, identifiable), _leave_out(innovation, free)
    cost = [_cost(block, change) for block, change in zip(simulation, changes[0], strict=True)]
    other_cost = [_cost(block, change) for block, change in zip(innovation, changes[1], strict=True)]
    names = problem.shape.shared_paths
    shared_indices = np.intersect1d(identifiable, free)
    shared_indices = shared_indices[shared_indices < len(names)]
    delta = changes[0][:, shared_indices] - changes[1][:, shared_indices]
    std = np.sqrt(np.diagonal(change_covariance(delta)))
    difference = np.abs(theta[shared_indices] - x[shared_indices]) / np.maximum(std, 1e-300)
    return LeaveOneOutComparison(
        np.subtract(other_cost, cost), float(np.sum(cost)), difference, [names[k] for k in shared_indices]
    )


def _simulation_blocks(problem: Residuals, theta: np.ndarray) -> Iterator[_ObjectiveBlock]:
    block_s = block_duration_s(problem)
    for (r, d, entries), record in zip(segment_derivatives(problem, theta), problem.records, strict=True):
        for a, b in pairwise(block_edges(record, block_s, len(r))):
            e, derivatives = r[a:b].ravel(), d[a:b].reshape(-1, d.shape[2])
            inliers = derivatives[np.abs(e) < HUBER]
            g = np.clip(e, -HUBER, HUBER) @ derivatives
            yield _ObjectiveBlock(g, gram(inliers), entries, e, derivatives, entries)


def _innovation_blocks(
    problem: Residuals, prediction: Prediction, x: np.ndarray
) -> Iterator[_ObjectiveBlock]:
    block_s, p = block_duration_s(problem), problem.size
    segments = zip(
        segment_derivatives(problem, x[:p]), prediction.derivatives(x), problem.records, strict=True
    )
    for (r, d, entries), derivatives, record in segments:
        if d.shape[2] < np.sum(derivatives.indices < p):
            derivatives = _eliminate_start(derivatives, problem)
        for a, b in pairwise(block_edges(record, block_s, len(r))):
            e = derivatives.e[a:b].ravel()
            d_e, d_s, d_r = (
                x[a:b].reshape(-1, x.shape[2])
                for x in (derivatives.e_derivatives, derivatives.s_derivatives, d)
            )
            g = (weight(e) * e) @ d_e + 0.5 * BETA * d_s.sum(axis=0)
            A = gram(d_e, psi_derivative(e)) + 0.25 * BETA * gram(d_s)
            yield _ObjectiveBlock(g, A, derivatives.indices, r[a:b].ravel(), d_r, entries)


def _eliminate_start(derivatives: InnovationDerivatives, problem: Residuals) -> InnovationDerivatives:
    """Return the derivatives of a segment with its start eliminated."""
    start = (derivatives.indices >= problem.layout.first_start) & (derivatives.indices < problem.size)
    w = np.maximum(psi_derivative(derivatives.e), 0.0)
    return derivatives._replace(
        e_derivatives=projected_derivatives(derivatives.e_derivatives, w, start),
        s_derivatives=derivatives.s_derivatives[..., ~start],
        indices=derivatives.indices[~start],
    )


def _leave_out(blocks: Sequence[_ObjectiveBlock], identifiable: np.ndarray) -> np.ndarray:
    """Return the change (n, p) of a fit without each block; only the entries `identifiable` change.  (1)"""
    position = np.full(1 + max(int(max(block.indices.max(), block.entries.max())) for block in blocks), -1)
    position[identifiable] = np.arange(len(identifiable))
    g = np.zeros((len(blocks), len(identifiable)))
    A = np.zeros((len(blocks), len(identifiable), len(identifiable)))
    for k, block in enumerate(blocks):
        is_included = position[block.indices] >= 0
        rows = position[block.indices[is_included]]
        g[k, rows], A[k][np.ix_(rows, rows)] = block.g[is_included], block.A[np.ix_(is_included, is_included)]
    root = np.sqrt(np.maximum(np.diagonal(A.sum(axis=0)), 1e-300))
    g, A = g / root, A / np.outer(root, root)
    remainder = A.sum(axis=0) + MIN_REMAINDER * np.eye(len(root)) - A
    changes = np.zeros((len(blocks), len(position)))
    changes[:, identifiable] = np.linalg.solve(remainder, g[:, :, None])[:, :, 0] / root
    return changes


def _cost(block: _ObjectiveBlock, change: np.ndarray) -> float:
    """Return C_b from the open-loop residuals after the `change` of the fit."""
    with np.errstate(invalid="ignore", over="ignore"):  # a model that diverged
        return huber_cost(block.r + block.d @ change[block.entries])
