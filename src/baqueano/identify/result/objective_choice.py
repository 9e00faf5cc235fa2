"""Choose between two costs: θ̂ of the simulation error or θ̃ of the innovations.

    θ_b − θ = (A − A_b)⁻¹ g_b        of either fit, without block b of BLOCK_S (jackknife.py)             (1)
    D_b = C_b(θ̃_b) − C_b(θ̂_b),      z = Σ D_b / √(n var D_b)   over n blocks                              (2)
    t_i = (θ̂ − θ̃)_i / √((n − 1)/n Σ_b (δ_b − δ̄)_i²),   δ_b = θ̂_b − θ̃_b                                   (3)

C_b is the cost of an open-loop simulation of a held-out block. (3) is Hausman's test: both fits are consistent if the
model is right. docs/derivations/robust_covariance.md gives the reasons. The choice is

    process noise is 0                        the simulation: both agree, and it is the harder test of a model
    noise, one θ, ΣD_b below 0                the innovations: errors of the simulation are a random walk
    noise, one θ, ΣD_b > 0, not significant   the simulation: nothing is gained
    two θ by (3), or a larger error by (2)    the simulation, with a warning: the model lacks an effect

Sources: Stone 1974 for (2); Hausman 1978 for (3); Quenouille 1956 for (1).
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, note
from baqueano.identify.covariance.jackknife import (
    MIN_BLOCKS,
    MIN_REMAINDER,
    block_duration_s,
    edges_of,
    segment_derivatives,
)
from baqueano.identify.covariance.quantiles import student_quantile
from baqueano.identify.data.segments import derivatives_without_start
from baqueano.identify.estimation.prediction_error import (
    BETA,
    MaximumLikelihood,
    Prediction,
    Slopes,
    slope,
    weight,
)
from baqueano.identify.parallel import gram
from baqueano.identify.residuals.simulation import HUBER, Residuals
from baqueano.identify.result.verdict import ABOVE_NOISE
from baqueano.messages.language import number

RARE = 1e-3  # probability below which process noise is significant
UNITS = ("m/s", "m/s", "rad/s")
WORSE = 0.05  # probability below which the left-out error of the innovations' fit is significantly larger
TWO = 0.01  # probability below which the two fits differ significantly


class ObjectiveChoice(NamedTuple):
    """The chosen cost, and the reason."""

    cost: str  # "simulation" or "innovations"
    reason: Diagnostic
    explains: bool  # True if process noise explains the residuals of the simulation
    contradicted: bool = False  # True if two different fits or a larger error contradict process noise


def choose_objective(
    likely: MaximumLikelihood, axes: Sequence[int], both: "LeftOutBlocks | None", times: np.ndarray
) -> ObjectiveChoice:
    """Return the choice of the cost. `times` (m,) is the sensor noise without the floor's part, relative to the
    noise in the file; 0 if the file does not contain it."""
    odds: JsonObject = {"ratio": float(likely.ratio), "chance": _chance(likely.chance)}
    if likely.chance >= RARE:
        return ObjectiveChoice("simulation", note("cost.floor-still", **odds), False)
    odds["floor"] = _floor(likely, axes)
    if both is None:
        return ObjectiveChoice("simulation", note("cost.too-short", **odds), False)
    difference, name = both.furthest
    details = odds | {"apart": difference, "open_loop": _open_loop(both)}
    if difference > both.limit or both.worse:
        return ObjectiveChoice("simulation", note("cost.neither", subject=name, **details), False, True)
    explains = not likely.info.autocorrelated and not np.any(times > ABOVE_NOISE)
    if both.better:
        return ObjectiveChoice("innovations", note("cost.innovations", **details), explains)
    return ObjectiveChoice("simulation", note("cost.simulation", **details), explains)


def _open_loop(both: "LeftOutBlocks") -> Diagnostic:
    """Return a note on the open-loop error of the innovations' fit on held-out blocks."""
    if not np.isfinite(both.percent):
        return note("cost.runs-away")
    percent = abs(both.percent)
    return note("cost.smaller", percent=percent) if both.better else note("cost.larger", percent=percent)


def _floor(likely: MaximumLikelihood, axes: Sequence[int]) -> str:
    """Return the process noise with its error, axis by axis, as text."""
    messages = []
    for axis, v, sd in zip(axes, likely.noise.floor, likely.floor_sd, strict=True):
        if v > 0.0:
            error = f" ± {number(sd / (2.0 * np.sqrt(v))):.1g}" if np.isfinite(sd) else ""
            messages.append(f"{number(float(np.sqrt(v))):.2g}{error} {UNITS[axis]}")
    return ", ".join(messages)


def _chance(p: float) -> str:
    return f"{number(p):.2g}" if p >= 1e-6 else "< 1e-6"


class LeftOutBlocks(NamedTuple):
    """Comparison of both fits, block by block."""

    more: np.ndarray  # (n,) D_b of (2)
    cost: float  # Σ C_b(θ̂_b)
    apart: np.ndarray  # (k,) |t_i| of (3)
    names: Sequence[str]  # (k,)

    @property
    def z(self) -> float:
        """Return Σ D_b in standard errors, inf if the model diverged.  (2)"""
        if not np.isfinite(self.more).all():
            return float("inf")
        return float(self.more.sum() / max(np.sqrt(len(self.more) * np.var(self.more, ddof=1)), 1e-300))

    @property
    def percent(self) -> float:
        """Return the relative increase of the cost with the innovations' fit [%], negative for a decrease."""
        return 100.0 * float(self.more.sum()) / max(self.cost, 1e-300)

    @property
    def better(self) -> bool:
        """Return True if the innovations' fit has the smaller error on the held-out blocks."""
        return bool(self.more.sum() < 0.0)

    @property
    def worse(self) -> bool:
        """Return True if the innovations' fit has a significantly larger error on the held-out blocks."""
        return self.z > student_quantile(1.0 - WORSE, len(self.more) - 1)

    @property
    def limit(self) -> float:
        """Return the critical value of (3) above which the two fits differ significantly (Bonferroni)."""
        return student_quantile(1.0 - 0.5 * TWO / max(1, len(self.names)), len(self.more) - 1)

    @property
    def furthest(self) -> tuple[float, str]:
        """Return the largest value of (3), and the name of its parameter."""
        if not len(self.apart):
            return 0.0, ""
        k = int(np.argmax(self.apart))
        return float(self.apart[k]), self.names[k]


class _ObjectiveBlock(NamedTuple):
    """Gradient and Hessian of a block at a fit, and the derivatives of its open-loop residuals."""

    g: np.ndarray  # (q,)
    A: np.ndarray  # (q, q)
    indices: np.ndarray  # (q,) their indices in the fit
    r: np.ndarray  # (N m,)
    d: np.ndarray  # (N m, s) by the entries `of`
    of: np.ndarray  # (s,)


def leave_one_out(
    problem: Residuals,
    theta: np.ndarray,
    identifiable: np.ndarray,
    prediction: Prediction,
    x: np.ndarray,
    free: np.ndarray,
) -> LeftOutBlocks | None:
    """Return the comparison of two fits, or None with too few blocks. The fitted entries are `identifiable` of
    `theta` (p,) and `free` of `x`."""
    simulation = list(_of_simulation(problem, theta))
    innovation = list(_of_innovations(problem, prediction, x))
    if len(simulation) < MIN_BLOCKS:
        return None
    without = _without(simulation, identifiable), _without(innovation, free)
    cost = [_cost(block, change) for block, change in zip(simulation, without[0], strict=True)]
    more = [_cost(block, change) for block, change in zip(innovation, without[1], strict=True)]
    names = problem.shape.shared
    both = np.intersect1d(identifiable, free)
    both = both[both < len(names)]
    delta = without[0][:, both] - without[1][:, both]
    n = len(delta)
    sd = np.sqrt((n - 1) / n * np.sum((delta - delta.mean(axis=0)) ** 2, axis=0))
    difference = np.abs(theta[both] - x[both]) / np.maximum(sd, 1e-300)
    return LeftOutBlocks(np.subtract(more, cost), float(np.sum(cost)), difference, [names[k] for k in both])


def _of_simulation(problem: Residuals, theta: np.ndarray) -> Iterator[_ObjectiveBlock]:
    block_s = block_duration_s(problem)
    for (r, d, at), record in zip(segment_derivatives(problem, theta), problem.records, strict=True):
        for a, b in pairwise(edges_of(record, block_s, len(r))):
            e, slopes = r[a:b].ravel(), d[a:b].reshape(-1, d.shape[2])
            inside = slopes[np.abs(e) < HUBER]
            g = np.clip(e, -HUBER, HUBER) @ slopes
            yield _ObjectiveBlock(g, gram(inside), at, e, slopes, at)


def _of_innovations(problem: Residuals, prediction: Prediction, x: np.ndarray) -> Iterator[_ObjectiveBlock]:
    block_s, p = block_duration_s(problem), problem.size
    segments = zip(
        segment_derivatives(problem, x[:p]), prediction.slopes(x), problem.records, strict=True
    )  # fmt: skip
    for (r, d, of), slopes, record in segments:
        slopes = _without_start(slopes, problem) if d.shape[2] < np.sum(slopes.places < p) else slopes
        for a, b in pairwise(edges_of(record, block_s, len(r))):
            e, by_e, by_s = (
                slopes.e[a:b].ravel(),
                *(s[a:b].reshape(-1, s.shape[2]) for s in (slopes.e_slopes, slopes.s_slopes)),
            )
            g = (weight(e) * e) @ by_e + 0.5 * BETA * by_s.sum(axis=0)
            A = gram(by_e, slope(e)) + 0.25 * BETA * gram(by_s)
            yield _ObjectiveBlock(g, A, slopes.places, r[a:b].ravel(), d[a:b].reshape(-1, d.shape[2]), of)


def _without_start(slopes: Slopes, problem: Residuals) -> Slopes:
    """Return the derivatives of a segment with its start eliminated."""
    start = (slopes.places >= problem.layout.first_start) & (slopes.places < problem.size)
    w = np.maximum(slope(slopes.e), 0.0)
    return slopes._replace(
        e_slopes=derivatives_without_start(slopes.e_slopes, w, start),
        s_slopes=slopes.s_slopes[..., ~start],
        place_count=slopes.places[~start],
    )


def _without(blocks: Sequence[_ObjectiveBlock], identifiable: np.ndarray) -> np.ndarray:
    """Return the change (n, p) of a fit without each block; only the entries `identifiable` change.  (1)"""
    place = np.full(1 + max(int(max(block.indices.max(), block.of.max())) for block in blocks), -1)
    place[identifiable] = np.arange(len(identifiable))
    g, A = (
        np.zeros((len(blocks), len(identifiable))),
        np.zeros((len(blocks), len(identifiable), len(identifiable))),
    )
    for k, block in enumerate(blocks):
        inside = place[block.indices] >= 0
        at = place[block.indices[inside]]
        g[k, at], A[k][np.ix_(at, at)] = block.g[inside], block.A[np.ix_(inside, inside)]
    root = np.sqrt(np.maximum(np.diagonal(A.sum(axis=0)), 1e-300))
    g, A = g / root, A / np.outer(root, root)
    rest, out = A.sum(axis=0) + MIN_REMAINDER * np.eye(len(root)) - A, np.zeros((len(blocks), len(place)))
    out[:, identifiable] = np.linalg.solve(rest, g[:, :, None])[:, :, 0] / root
    return out


def _cost(block: _ObjectiveBlock, change: np.ndarray) -> float:
    """Return C_b from the open-loop residuals after the `change` of the fit."""
    with np.errstate(invalid="ignore", over="ignore"):  # a model that diverged
        r = np.abs(block.r + block.d @ change[block.of])
        limited = np.minimum(r, HUBER)
        return float(np.sum(limited * (r - 0.5 * limited)))
