"""Test many effects that a model lacks by score tests, without a new fit.

    D⊥ = D − d A⁻¹ dᵀ w D,   A = dᵀ w d           the part of D that θ cannot explain                     (1)
    δ  = D⊥ᵀ ψ / (D⊥ᵀ w D⊥)                       the size of the effect                                  (2)
    Δθ = A⁻¹ dᵀ w D δ                             the change of θ if the effect were in the model                 (3)
    e_b = (S_b − δ P_b) / (1 − h_b),   h_b = P_b / Σ P,   z = Σ S_b / √Σ e_b²                              (4)
    min ½ xᵀA x + α cᵀx + ½ (cᵀA⁻¹c + ρ) α² − ρ α,   low ≤ θ + x ≤ high,   c = −A Δθ,   ρ = δ D⊥ᵀψ         (5)

r (N, m) are the residuals in standard deviations, and d = ∂r/∂θ. −D is the change of r by a unit of the effect. z is
Student's t with 1/Σ h_b² − 1 degrees of freedom. An effect can be a parameter that differs in a part of the run,
D = 1_part d_j. Biases and starts are eliminated from d and D first. (5) is (2) and (3) for bounded parameters: α δ
and x.
docs/derivations/robust_covariance.md derives (1) to (4). Sources: Rao 1948; Andrews 1993 for parts of a sample.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from baqueano.numerics.least_squares import minimise
from baqueano.numerics.normal_equations import Evaluation, pseudo_inverse
from baqueano.numerics.parallel import cache_slices, inner
from baqueano.numerics.statistics import HUBER

MAX_BLOCKS = 60
MIN_BLOCK_ROWS = 20  # rows
MIN_WHITE_Z = 3.0  # standard errors of white noise
EFFECT_BATCH = 16  # effects
# an effect with a smaller part that θ cannot explain is not tested: a variance inflation factor above 10,000
MIN_OWN_FRACTION = 1e-4


class Nuisance(NamedTuple):
    """Nuisance parameters of one run or one segment: columns of ∂r from the column `first` on."""

    rows: slice  # of N
    first: int
    identifiable: np.ndarray  # (n,) mask of the parameters that the data determine


class NuisanceDerivatives(NamedTuple):
    """Derivatives of the nuisance parameters of one run or one segment."""

    rows: slice  # of N
    columns: slice  # of N m
    d: np.ndarray  # (q, n m) derivatives, with earlier nuisance parameters eliminated
    weighted_slopes: np.ndarray  # (q, n m) d w
    inverse: np.ndarray  # (q, q) of d w dᵀ
    projections: np.ndarray  # (first, q) the part of each earlier derivative that d explains


class FitResiduals(NamedTuple):
    """Residuals of all runs, row after row; k shared entries of θ are identifiable."""

    residuals: list[np.ndarray]  # per segment (n, m)
    clipped_residuals: np.ndarray  # (N m,)
    w: np.ndarray  # (N m,) 1 where a residual exists and is not clipped
    d: np.ndarray  # (k, N m) derivatives of the prediction, in standard deviations, without nuisance
    score: np.ndarray  # (k,) d ψ
    nuisances: list[NuisanceDerivatives]
    run: np.ndarray  # (N,) the number of the run
    blocks: np.ndarray  # (B,) first row of each block
    inverse: np.ndarray  # A⁻¹ (k, k)
    weighted_rows: np.ndarray  # (k + 1, N m) d w, and ψ
    identifiable: np.ndarray  # (s,) mask of the k shared entries of θ
    power: float  # Σ ψ² / Σ w: the sum over all residuals, divided by the number that is not clipped
    signal: float  # Σ of the squared measurements in standard deviations, about the mean of each channel


class ScoreTest(NamedTuple):
    """Result of the test of one effect."""

    size: float  # δ (2)
    z: float  # (4)
    freedom: float  # degrees of freedom of z
    shift: np.ndarray  # (k,) Δθ (3)
    nuisance_shifts: list[np.ndarray]  # (q,) each: change of the nuisance parameters if θ does not change
    gain: float  # ρ (5)


class _ScoreSums(NamedTuple):
    """Sums over the rows for K columns D, for (1) to (3)."""

    energy: np.ndarray  # (K,) D w D
    total: np.ndarray  # (K,) D ψ
    cross: np.ndarray  # (K, k) D w dᵀ
    nuisances: list[np.ndarray]  # (K, q) D w dᵀ with each nuisance


def score_test_residuals(
    segments: Sequence[tuple[np.ndarray, np.ndarray]],
    mask: np.ndarray,
    run: np.ndarray,
    identifiable: np.ndarray,
    nuisances: Sequence[Nuisance],
    signal: float,
) -> FitResiduals:
    """Return the residuals as the tests need them. `segments` contain r (n, m) and ∂r (n, m, q), `mask` (N m,) that of
    the measurements, `run` (N,) the number of the run. The first columns of ∂r are the shared parameters, with
    the mask `identifiable` (s,). The derivatives of `nuisances` are eliminated in order from all columns before theirs.
    """
    s, m = len(identifiable), segments[0][0].shape[1]
    r = np.concatenate([r.ravel() for r, _ in segments])
    psi, w = np.where(mask, np.clip(r, -HUBER, HUBER), 0.0), (mask & (np.abs(r) < HUBER)).astype(float)
    slopes = [d.reshape(-1, d.shape[2]) for _, d in segments]
    flat_slopes = (np.concatenate(slopes) if len(slopes) > 1 else slopes[0]).T  # (q, N m); rows stay together
    np.negative(flat_slopes, out=flat_slopes)
    count = int(np.clip(len(run) // MIN_BLOCK_ROWS, 2, MAX_BLOCKS))
    blocks = np.rint(np.linspace(0, len(run), count + 1)).astype(int)[:-1]
    nuisance_derivatives = [
        _eliminate(flat_slopes, w, m, nuisance) for nuisance in nuisances if nuisance.identifiable.any()
    ]
    is_complete = identifiable.all() and len(flat_slopes) == s
    d = flat_slopes if is_complete else np.ascontiguousarray(flat_slopes[:s][identifiable].T).T
    weighted_rows = np.empty((len(w), len(d) + 1)).T
    np.multiply(d, w, out=weighted_rows[:-1])
    weighted_rows[-1] = psi
    products = _product(weighted_rows, d.T)
    power = float(np.sum(psi * psi) / max(np.sum(w), 1.0))
    inverse, residuals = pseudo_inverse(products[:-1]), [r for r, _ in segments]
    return FitResiduals(
        residuals,
        psi,
        w,
        d,
        products[-1],
        nuisance_derivatives,
        run,
        blocks,
        inverse,
        weighted_rows,
        identifiable,
        power,
        signal,
    )


def _product(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return x y for x (a, n) and y (n,) or (n, b), computed in parts of the n measurements that fit in the cache."""
    if y.ndim == 1:
        return np.einsum("an,n->a", x, y)
    product = np.zeros((len(x), *y.shape[1:]))
    for rows in cache_slices(len(y), product.size):
        product += x[:, rows] @ y[rows]
    return product


def _eliminate(flat_slopes: np.ndarray, w: np.ndarray, m: int, nuisance: Nuisance) -> NuisanceDerivatives:
    """Return the derivatives of the identifiable parameters of `nuisance`, and eliminate them from the columns of ∂r
    before theirs, the first rows of `flat_slopes` (q, N m), in place."""
    rows, first, identifiable = nuisance
    columns = slice(rows.start * m, rows.stop * m)
    d = flat_slopes[first + np.flatnonzero(identifiable), columns].copy()
    weighted_slopes = d * w[columns]
    inverse = pseudo_inverse(_product(weighted_slopes, d.T))
    other_rows = flat_slopes[:first, columns]
    projections = _product(other_rows, weighted_slopes.T) @ inverse
    _subtract(other_rows, projections, d)
    return NuisanceDerivatives(rows, columns, d, weighted_slopes, inverse, projections)


def _subtract(D: np.ndarray, projection: np.ndarray, d: np.ndarray) -> None:
    """Subtract `projection` (K, q) times `d` (q, n) from D (K, n), in place."""
    for columns in cache_slices(D.shape[1], projection.size):
        D[:, columns] -= projection @ d[:, columns]


def score_test(fit: FitResiduals, D: np.ndarray) -> list[ScoreTest]:
    """Return the test of each effect, a column of D (K, N, m): the change of the prediction in standard deviations. A
    column that diverged is treated as 0."""
    sums = _sums(fit, D)
    is_infinite = ~np.isfinite(sums.energy)
    for effect_sums in (sums.energy, sums.total, sums.cross, *sums.nuisances) if is_infinite.any() else ():
        effect_sums[is_infinite] = 0.0
    return _score_tests(fit, sums, lambda k: D[k].reshape(len(k), -1))


def _sums(fit: FitResiduals, D: np.ndarray) -> _ScoreSums:
    """Return the sums for the columns D (K, N, m)."""
    count, n, m = D.shape
    energy, products = np.zeros(count), np.zeros((len(fit.weighted_rows), count))
    with np.errstate(invalid="ignore", over="ignore"):
        for rows in cache_slices(n, m * products.size):
            columns = D[:, rows].transpose(1, 2, 0).reshape(-1, count)  # copied part by part: in the cache
            span = slice(rows.start * m, rows.stop * m)
            energy += fit.w[span] @ (columns * columns)
            products += fit.weighted_rows[:, span] @ columns
        summed_nuisances = [
            _product(D[:, nuisance.rows].reshape(count, -1), nuisance.weighted_slopes.T)
            for nuisance in fit.nuisances
        ]
    return _ScoreSums(energy, products[-1], products[:-1].T, summed_nuisances)


def bounded_test(fit: FitResiduals, test: ScoreTest, low: np.ndarray, high: np.ndarray) -> ScoreTest:
    """Return the test with the size and the shifts of an effect for bounded parameters; `low` and `high` (k,) are the
    distances of θ to its bounds. The size is multiplied by α.  (5)"""
    if np.all((test.shift >= low) & (test.shift <= high)):
        return test
    A = pseudo_inverse(fit.inverse)
    c = -A @ test.shift
    H = np.block([[A, c[:, None]], [c[None], np.array([[test.gain - c @ test.shift]])]])
    g = np.append(np.zeros(len(c)), -test.gain)

    def quadratic(x: np.ndarray) -> Evaluation:
        return Evaluation(float(x @ (0.5 * (H @ x) + g)), H @ x + g, H)

    *shift, part = minimise(quadratic, np.zeros(len(g)), np.append(low, 0.0), np.append(high, np.inf)).theta
    nuisance_shifts = [part * own_shift for own_shift in test.nuisance_shifts]
    return test._replace(size=part * test.size, shift=np.array(shift), nuisance_shifts=nuisance_shifts)


def nuisance_shift(fit: FitResiduals, test: ScoreTest, count: int) -> np.ndarray:
    """Return the change of the parameters of the last `count` nuisances by the effect of a test. Each row belongs to
    at most one of these nuisances."""
    pairs = [*zip(fit.nuisances, test.nuisance_shifts, strict=True)][len(fit.nuisances) - count :]
    shifts = [
        own_shift - nuisance.projections[fit.identifiable].T @ test.shift for nuisance, own_shift in pairs
    ]
    return np.concatenate([np.zeros(0), *shifts])


def score_test_parts(fit: FitResiduals, masks: Sequence[np.ndarray]) -> list[list[ScoreTest]]:
    """Return, for each mask (N,), the tests if each of the k entries differs in its rows, with D = 1_part d."""
    k, n = len(fit.d), len(fit.run)
    m, part_masks = len(fit.clipped_residuals) // n, np.array(masks)
    rows = fit.weighted_rows[:-1].T.reshape(n, m, k)
    code = 2 ** np.arange(len(part_masks)) @ part_masks
    pattern = (np.cumsum(np.bincount(code) > 0) - 1)[code]
    A = _part_sums(rows, rows, pattern, part_masks)  # w is 0 or 1
    scores = np.einsum("nmk,nm->nk", fit.d.T.reshape(n, m, k), fit.clipped_residuals.reshape(n, m))
    summed_nuisances = []
    for nuisance in fit.nuisances:
        weighted_rows = nuisance.weighted_slopes.T.reshape(-1, m, len(nuisance.d))
        row_masks = part_masks[:, nuisance.rows]
        summed_nuisances.append(
            _part_sums(rows[nuisance.rows], weighted_rows, pattern[nuisance.rows], row_masks)
        )
    energy, total = np.einsum("pkk->pk", A).ravel(), _product(part_masks.astype(float), scores).ravel()
    summed_nuisances = [products.reshape(len(part_masks) * k, -1) for products in summed_nuisances]
    sums = _ScoreSums(energy, total, A.reshape(-1, k), summed_nuisances)

    def column(index: np.ndarray) -> np.ndarray:
        return fit.d[index % k] * np.repeat(part_masks[index // k], m, axis=1)

    tests = _score_tests(fit, sums, column)
    return [tests[i : i + k] for i in range(0, len(tests), k)]


def _part_sums(x: np.ndarray, y: np.ndarray, pattern: np.ndarray, part_masks: np.ndarray) -> np.ndarray:
    """Return Σ xᵀ y (P, k, q) of the rows x (n, m, k), y (n, m, q) of each part (P, n). Rows with the same number in
    `pattern` (n,) are in the same parts, so that each row is multiplied once."""
    small_pattern = pattern.astype(np.min_scalar_type(pattern.max()))  # a small type sorts faster
    order = np.argsort(small_pattern, kind="stable")
    edges = np.flatnonzero(np.diff(pattern[order], prepend=-1, append=-1))
    k, q = x.shape[2], y.shape[2]
    rows = x[order].reshape(-1, k)
    x, y = rows, rows if y is x else y[order].reshape(-1, q)
    sums, m = np.empty((len(edges) - 1, k, q)), len(x) // max(len(order), 1)
    for total, (a, b) in zip(sums, pairwise((edges * m).tolist()), strict=True):
        total[...] = inner(x[a:b], y[a:b])
    groups = part_masks[:, order[edges[:-1]]].T.astype(float)
    return inner(groups, sums.reshape(len(sums), -1)).reshape(-1, k, q)


def _score_tests(
    fit: FitResiduals, sums: _ScoreSums, column: Callable[[np.ndarray], np.ndarray]
) -> list[ScoreTest]:
    """Return the test of each effect. (1) to (3) are computed from the `sums`; (4) is added if the effect can be
    significant. `column` returns D for the given indices."""
    ties = sums.cross @ fit.inverse
    power = sums.energy - np.einsum("ki,ki->k", sums.cross, ties)
    total = sums.total - ties @ fit.score
    nuisance_ties = []
    for nuisance, nuisance_sums in zip(fit.nuisances, sums.nuisances, strict=True):
        nuisance_ties.append(nuisance_sums @ nuisance.inverse)
        power -= np.einsum("ki,ki->k", nuisance_sums, nuisance_ties[-1])
        total = total - nuisance_ties[-1] @ _product(nuisance.d, fit.clipped_residuals[nuisance.columns])
    # otherwise θ explains the effect, so that any misfit becomes a large Δθ, or it does not change a measurement
    is_shown = power > MIN_OWN_FRACTION * np.maximum(sums.energy, 1e-300)
    size = np.where(is_shown, total / np.where(is_shown, power, 1.0), 0.0)
    is_shown &= size**2 * sums.energy <= fit.signal  # an effect is smaller than all that was measured
    size = np.where(is_shown, size, 0.0)
    candidates = np.flatnonzero(
        is_shown & (np.abs(total) > MIN_WHITE_Z * np.sqrt(np.maximum(power, 0.0) * fit.power))
    )
    shift = -ties * size[:, None]
    gain = size**2 * power
    nuisance_shifts = [[-tie[k] * size[k] for tie in nuisance_ties] for k in range(len(size))]
    rows = zip(size.tolist(), shift, nuisance_shifts, gain.tolist(), strict=True)
    tests = [ScoreTest(d, 0.0, 1.0, move, moves, rho) for d, move, moves, rho in rows]
    for first in range(0, len(candidates), EFFECT_BATCH):
        indices = candidates[first : first + EFFECT_BATCH]
        D = column(indices)
        _subtract(D, ties[indices], fit.d)
        for nuisance, nuisance_tie in zip(fit.nuisances, nuisance_ties, strict=True):
            _subtract(D[:, nuisance.columns], nuisance_tie[indices], nuisance.d)
        for k, (z, freedom) in zip(indices, _jackknife(fit, D), strict=True):
            tests[k] = tests[k]._replace(z=z, freedom=freedom)
    return tests


def _jackknife(fit: FitResiduals, D: np.ndarray) -> list[tuple[float, float]]:
    """Return z and the degrees of freedom for each D⊥ (K, N m).  (4)"""
    first = fit.blocks * (len(fit.clipped_residuals) // len(fit.run))
    S, P = (np.add.reduceat(D * x, first, axis=1) for x in (fit.clipped_residuals, D * fit.w))
    total, power = S.sum(axis=1, keepdims=True), P.sum(axis=1, keepdims=True)
    h = P / power
    e = (S - total * h) / np.maximum(1.0 - h, 1e-3)
    z = total[:, 0] / np.sqrt(np.maximum(np.sum(e**2, axis=1), 1e-300))
    freedom = 1.0 / np.sum(h**2, axis=1) - 1.0
    return list(zip(z.tolist(), freedom.tolist(), strict=True))
