"""Would the parameters be others if the model had this too? Asked of many things at once, without a new fit.

Let r (N, m) be what a fit left, in standard deviations, d = ∂r/∂θ, ψ(r) the clipped residual of the Huber cost
and w = ψ'(r). A thing that is not in the model and would change the residuals by −D per unit of it has

    D⊥ = D − d A⁻¹ dᵀ w D,   A = dᵀ w d           what θ cannot imitate                                   (1)
    δ  = D⊥ᵀ ψ / (D⊥ᵀ w D⊥)                       how much of it the data ask for                         (2)
    Δθ = A⁻¹ dᵀ w D δ                             by how much θ would move if it were there               (3)

one step of Gauss and Newton from the fit to the larger model: a score (Lagrange multiplier) test with its
consequence. The scatter of (2) comes from the run itself, whatever the colour of its noise: the score is
summed over blocks of time, S_b, and

    var = B/(B−1) Σ_b (S_b − S̄)²,   z = Σ_b S_b / √var                                                   (4)

is distributed like Student's t with B − 1 degrees of freedom. B is 30 where the run allows it.

A parameter that is another in some part of the run is such a thing: D = 1_part d_j. What each run has for
itself (biases, starts) is taken out of d and D before, piece by piece and run by run. Sources: Rao 1948 for the
score test; Andrews 1993 for parts of a sample; batch means as in the analysis of simulations.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from baqueano.identify.problem import HUBER, Problem

BLOCKS = 30
SHORTEST_BLOCK = 20  # rows


class Own(NamedTuple):
    """What one run, or one piece of it, has for itself."""

    at: slice  # of N m
    d: np.ndarray  # (q, n m) slopes, without what was taken out before
    inverse: np.ndarray  # (q, q) of d w dᵀ
    sums: np.ndarray  # (q, B) of d ψ


class Left(NamedTuple):
    """What a fit left of all runs, one row after another; k shared entries of θ were told."""

    psi: np.ndarray  # (N m,)
    w: np.ndarray  # (N m,) 1 where the residual is not clipped and there is one
    d: np.ndarray  # (k, N m) slopes of what the model says, in standard deviations, without what is own
    own: list[Own]
    run: np.ndarray  # (N,) the number of the run
    blocks: np.ndarray  # (B,) their first rows
    inverse: np.ndarray  # A⁻¹ (k, k)
    weighted: np.ndarray  # (k, N m) d w
    score: np.ndarray  # (k, N) d ψ, summed over the channels
    sums: np.ndarray  # (k, B) of it


class Answer(NamedTuple):
    """Of one probe."""

    size: float  # δ (2)
    z: float  # (4)
    shift: np.ndarray  # (k,) Δθ (3)


def left_over(problem: Problem, theta: np.ndarray, kept: np.ndarray) -> Left:
    """What is left at θ; `kept` (p,) bool are the entries of θ that were told."""
    layout, pieces = problem.layout, problem.sensitivities(theta)
    s, m = layout.shared, len(problem.sigma)
    has = np.concatenate(problem.has).ravel() > 0.0
    r = np.concatenate([r.ravel() for r, _, _ in pieces])
    psi, w = np.where(has, np.clip(r, -HUBER, HUBER), 0.0), (has & (np.abs(r) < HUBER)).astype(float)
    flat = np.concatenate([d.reshape(-1, d.shape[2]).T for _, d, _ in pieces], axis=1)
    np.negative(flat, out=flat)
    q = len(flat)
    run = np.concatenate([np.full(len(r), k) for (r, _, _), k in zip(pieces, layout.runs, strict=True)])
    ends = np.cumsum([0, *(r.size for r, _, _ in pieces)])
    n = len(run)
    count = int(np.clip(n // SHORTEST_BLOCK, 2, BLOCKS))
    first = np.rint(np.linspace(0, n, count + 1)).astype(int)[:-1]
    scores = _Scores(psi, w, first, m)
    own: list[Own] = []
    for k, (a, b) in enumerate(pairwise(ends)):
        at = slice(int(a), int(b))
        told = kept[layout.of_starts(k)]
        own += _own(flat, scores, at, range(q - layout.by_piece, q), told, range(q - layout.by_piece))
    for k in range(max(layout.runs) + 1):
        rows = np.flatnonzero(run == k)
        at = slice(int(rows[0]) * m, (int(rows[-1]) + 1) * m)
        told = kept[s + k * layout.by_run : s + (k + 1) * layout.by_run]
        own += _own(flat, scores, at, range(s, s + layout.by_run), told, range(s))
    d = np.ascontiguousarray(flat[:s][kept[:s]])
    weighted, score = d * w, scores.rows(d)
    sums = np.add.reduceat(score, first, axis=1)
    return Left(psi, w, d, own, run, first, inverse(weighted @ d.T), weighted, score, sums)


class _Scores(NamedTuple):
    """ψ, w and the blocks, before the slopes are known."""

    psi: np.ndarray
    w: np.ndarray
    blocks: np.ndarray
    m: int

    def rows(self, D: np.ndarray) -> np.ndarray:
        """D (K, N m) → Σ_m D ψ (K, N)."""
        return (D * self.psi).reshape(len(D), -1, self.m).sum(axis=2)


def _own(
    flat: np.ndarray, scores: _Scores, at: slice, entries: range, kept: np.ndarray, others: range
) -> list[Own]:
    """The told ones of `entries` of a run or piece, taken out of the `others` of `flat` (q, N m)."""
    index = [i for i, told in zip(entries, kept, strict=True) if told]
    if not index:
        return []
    d = flat[index, at].copy()
    weighted = d * scores.w[at]
    alone = np.zeros((len(d), len(scores.psi)))
    alone[:, at] = d
    sums = np.add.reduceat(scores.rows(alone), scores.blocks, axis=1)
    own = Own(at, d, inverse(weighted @ d.T), sums)
    rest = flat[others.start : others.stop, at]
    rest -= (rest @ weighted.T) @ own.inverse @ d
    return [own]


def inverse(A: np.ndarray) -> np.ndarray:
    """A⁻¹ of scaled entries; a direction without information gets none."""
    root = np.sqrt(np.maximum(np.diagonal(A), 1e-300))
    return np.linalg.pinv(A / np.outer(root, root), rcond=1e-12, hermitian=True) / np.outer(root, root)


def ask(left: Left, D: np.ndarray) -> list[Answer]:
    """Probes D (K, N m), in standard deviations as `left` is: what the model would say more."""
    weighted = D * left.w
    rows = (D * left.psi).reshape(len(D), -1, len(left.psi) // len(left.run)).sum(axis=2)
    return _asked(left, weighted, np.einsum("ka,ka->k", weighted, D), rows)


def ask_part(left: Left, mask: np.ndarray) -> list[Answer]:
    """Whether each of the k entries is another in the rows `mask` (N,): D = 1_part d."""
    weighted = left.weighted * np.repeat(mask, len(left.psi) // len(left.run))
    return _asked(left, weighted, np.einsum("ka,ka->k", weighted, left.d), left.score * mask)


def _asked(left: Left, weighted: np.ndarray, whole: np.ndarray, rows: np.ndarray) -> list[Answer]:
    """(1)-(4) from w D (K, N m), D w Dᵀ (K,) and Σ_m D ψ (K, N)."""
    cross = weighted @ left.d.T  # (K, k)
    ties = cross @ left.inverse
    power = whole - np.einsum("ki,ki->k", cross, ties)
    sums = np.add.reduceat(rows, left.blocks, axis=1) - ties @ left.sums  # S_b (K, B)
    for own in left.own:
        mine = weighted[:, own.at] @ own.d.T
        ties_own = mine @ own.inverse
        power -= np.einsum("ki,ki->k", mine, ties_own)
        sums -= ties_own @ own.sums
    return _answers(sums, power, whole, ties)


def _answers(sums: np.ndarray, power: np.ndarray, whole: np.ndarray, ties: np.ndarray) -> list[Answer]:
    """(2)-(4)"""
    b = sums.shape[1]
    var = b / (b - 1.0) * np.sum((sums - sums.mean(axis=1, keepdims=True)) ** 2, axis=1)
    there = power > 1e-6 * np.maximum(whole, 1e-300)  # else θ imitates it, or nothing shows it
    total = np.where(there, sums.sum(axis=1), 0.0)
    size, z = total / np.where(there, power, 1.0), total / np.sqrt(np.maximum(var, 1e-300))
    return [Answer(float(size[k]), float(z[k]), -ties[k] * size[k]) for k in range(len(size))]
