"""Would the parameters be others if the model had this too? Asked of many things at once, without a new fit.

Let r (N, m) be what a fit left, in standard deviations, d = ∂r/∂θ, ψ(r) the clipped residual of the Huber cost
and w = ψ'(r). A thing that is not in the model and would change the residuals by −D per unit of it has

    D⊥ = D − d A⁻¹ dᵀ w D,   A = dᵀ w d           what θ cannot imitate                                   (1)
    δ  = D⊥ᵀ ψ / (D⊥ᵀ w D⊥)                       how much of it the data ask for                         (2)
    Δθ = A⁻¹ dᵀ w D δ                             by how much θ would move if it were there               (3)

one step of Gauss and Newton from the fit to the larger model: a score (Lagrange multiplier) test with its
consequence. The scatter of (2) comes from the run itself, whatever the colour of its noise: scores and their
information are summed over B blocks of time, S_b and P_b = D⊥ᵀ w D⊥, and with what each block says when it is
left out (the jackknife),

    e_b = (S_b − δ P_b) / (1 − h_b),   h_b = P_b / Σ P,   z = Σ S_b / √Σ e_b²                              (4)

is distributed about like Student's t with 1/Σ h_b² − 1 degrees of freedom. B is 60 where the run allows it. What
white noise would give is worked out first; what is not clear even then is not looked at further.

A parameter that is another in some part of the run is such a thing: D = 1_part d_j. What each run has for
itself (biases, starts) is taken out of d and D before, piece by piece and run by run. Sources: Rao 1948 for the
score test; Andrews 1993 for parts of a sample; batch means as in the analysis of simulations.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from baqueano.identify.solve.problem import HUBER, Problem

BLOCKS = 60
SHORTEST_BLOCK = 20  # rows
PROMISING = 3.0  # standard errors of white noise
UNSEEN = 1e-6  # part of a probe that θ does not imitate, below which there is none


class Own(NamedTuple):
    """What one run, or one piece of it, has for itself."""

    at: slice  # of N m
    d: np.ndarray  # (q, n m) slopes, without what was taken out before
    inverse: np.ndarray  # (q, q) of d w dᵀ


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
    power: float  # of ψ where white noise has 1, over the part of it that is not clipped


class Answer(NamedTuple):
    """Of one probe."""

    size: float  # δ (2)
    z: float  # (4)
    freedom: float  # degrees of it
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
    own: list[Own] = []
    for k, (a, b) in enumerate(pairwise(ends)):
        at = slice(int(a), int(b))
        told = kept[layout.of_starts(k)]
        own += _own(flat, w, at, range(q - layout.by_piece, q), told, range(q - layout.by_piece))
    for k in range(max(layout.runs) + 1):
        rows = np.flatnonzero(run == k)
        at = slice(int(rows[0]) * m, (int(rows[-1]) + 1) * m)
        told = kept[s + k * layout.by_run : s + (k + 1) * layout.by_run]
        own += _own(flat, w, at, range(s, s + layout.by_run), told, range(s))
    d = np.ascontiguousarray(flat[:s][kept[:s]])
    weighted, power = d * w, float(psi @ psi / max(np.sum(w), 1.0))
    return Left(psi, w, d, own, run, first, inverse(weighted @ d.T), weighted, power)


def _own(
    flat: np.ndarray, w: np.ndarray, at: slice, entries: range, kept: np.ndarray, others: range
) -> list[Own]:
    """The told ones of `entries` of a run or piece, taken out of the `others` of `flat` (q, N m)."""
    index = [i for i, told in zip(entries, kept, strict=True) if told]
    if not index:
        return []
    d = flat[index, at].copy()
    weighted = d * w[at]
    own = Own(at, d, inverse(weighted @ d.T))
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
    return _asked(left, weighted, np.einsum("ka,ka->k", weighted, D), D @ left.psi, lambda k: D[k])


def ask_part(left: Left, mask: np.ndarray) -> list[Answer]:
    """Whether each of the k entries is another in the rows `mask` (N,): D = 1_part d."""
    there = np.repeat(mask, len(left.psi) // len(left.run)).astype(float)
    weighted, d = left.weighted * there, left.d
    return _asked(
        left, weighted, np.einsum("ka,ka->k", weighted, d), d @ (left.psi * there), lambda k: d[k] * there
    )


def _asked(
    left: Left,
    weighted: np.ndarray,
    whole: np.ndarray,
    total: np.ndarray,
    column: Callable[[np.ndarray], np.ndarray],
) -> list[Answer]:
    """(1)-(3) from w D (K, N m), D w Dᵀ (K,) and D ψ (K,); (4) of those `column`s that may be clear."""
    cross = weighted @ left.d.T  # (K, k)
    ties = cross @ left.inverse
    power = whole - np.einsum("ki,ki->k", cross, ties)
    total = total - ties @ (left.d @ left.psi)
    ties_own = []
    for own in left.own:
        mine = weighted[:, own.at] @ own.d.T
        ties_own.append(mine @ own.inverse)
        power -= np.einsum("ki,ki->k", mine, ties_own[-1])
        total = total - ties_own[-1] @ (own.d @ left.psi[own.at])
    there = power > UNSEEN * np.maximum(whole, 1e-300)  # else θ imitates it, or nothing shows it
    size = np.where(there, total / np.where(there, power, 1.0), 0.0)
    clear = np.flatnonzero(there & (np.abs(total) > PROMISING * np.sqrt(np.maximum(power, 0.0) * left.power)))
    out = [Answer(float(size[k]), 0.0, 1.0, -ties[k] * size[k]) for k in range(len(size))]
    if len(clear):
        D = column(clear) - ties[clear] @ left.d
        for own, tie in zip(left.own, ties_own, strict=True):
            D[:, own.at] -= tie[clear] @ own.d
        for k, (z, freedom) in zip(clear, _jackknife(left, D), strict=True):
            out[k] = out[k]._replace(z=z, freedom=freedom)
    return out


def _jackknife(left: Left, D: np.ndarray) -> list[tuple[float, float]]:
    """z and degrees of freedom of D⊥ (K, N m).  (4)"""
    first = left.blocks * (len(left.psi) // len(left.run))
    S, P = np.add.reduceat(D * left.psi, first, axis=1), np.add.reduceat(D * D * left.w, first, axis=1)
    total, power = S.sum(axis=1, keepdims=True), P.sum(axis=1, keepdims=True)
    h = P / power
    e = (S - total * h) / np.maximum(1.0 - h, 1e-3)
    z = total[:, 0] / np.sqrt(np.maximum(np.sum(e**2, axis=1), 1e-300))
    freedom = 1.0 / np.sum(h**2, axis=1) - 1.0
    return list(zip(z.tolist(), freedom.tolist(), strict=True))
