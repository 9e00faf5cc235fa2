"""Compute the covariance of the parameters of a robust fit, and their errors by parameters that stay fixed.

    A = Σ ψ'(r) ∂r ∂rᵀ,   B = Σ ψ(r)² ∂r ∂rᵀ,   cov = A⁻¹ B A⁻¹ N/(N − p)                                  (1)
    B = Σ_c Σ_t Σ_s γ_c(t − s) (1 − |t − s|/L) ∂r_ct ∂r_csᵀ    if residuals are autocorrelated            (2)
    cov_ii ← max(cov_ii, (A⁻¹ Σ_k s_k s_kᵀ A⁻¹)_ii K/(K − q)),   s_k = Σ_t∈k ψ ∂r                          (3)
    S = −A_κθ A_θθ⁻¹,   g = (1, S) ∂C     change of θ̂ per change of κ, score of κ                           (4)

(3) is for a run in K segments with q shared parameters; it does not change the correlations. If a channel has fewer
than MIN_MEASUREMENTS, ψ² is set to 1. docs/derivations/robust_covariance.md derives (1) to (3). κ are the fixed scales,
mounts and lengths with the covariance Σ of the file. Runs show a part of κ: wheels and a gyro measure the same turns.
Given the runs, κ has the mean error δ and the covariance P: (4) of numerics/normal_equations.py. The fit does not use
δ, so the mean square is P + δ δᵀ. In a gyro-aided fit κ also includes fixed parameters of tyres, of unknown size: δ is
the step of Gauss-Newton within their bounds.
"""

from itertools import compress
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baqueano.calibration.tolerances import ZERO_RATE_RAD_S, declared_covariance, tolerance_std
from baqueano.identify.covariance.clusters import are_finite, block_duration_s, block_edges, inflation_factors
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.parameters.free import entries, free_parameter, value
from baqueano.identify.parameters.theta import eliminate_starts
from baqueano.identify.residuals.informative_rows import MIN_MEASUREMENTS
from baqueano.identify.residuals.simulation import Residuals
from baqueano.numerics.autocorrelation import WHITE_LIMIT, autocorrelated_scores, autocorrelation_sums
from baqueano.numerics.block_sums import ScoreBlocks
from baqueano.numerics.least_squares import Solution
from baqueano.numerics.normal_equations import eliminate, mean_square_error, pseudo_inverse, square_root
from baqueano.numerics.parallel import gram, parallel_map
from baqueano.numerics.statistics import HUBER, change_covariance
from baqueano.vehicles.freedoms import tyre_paths

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

MIN_SEGMENTS_PER_PARAMETER = 2  # a fit of fewer segments pulls the sums of scores to 0


class Information(NamedTuple):
    """Information of the data about θ, with the sums from which the covariance of θ is computed."""

    bread: np.ndarray  # A (p, p)
    meat: np.ndarray  # B (p, p)
    channel_information: np.ndarray  # (m, p) diagonal of Σ ∂r ∂rᵀ, channel by channel
    autocorrelated: bool  # True if B is that of (2)
    autocorrelation: np.ndarray  # (m,) sum of the autocorrelation of the residuals over LAGS ticks
    sample_count: int
    # (K, p) s_k of (3); None if the runs are not split, or the residuals are white
    scores: np.ndarray | None = None
    shared_count: int = 0  # q
    gradient: np.ndarray = np.zeros(0)  # (p,) of the Huber cost
    blocks: tuple[ScoreBlocks, ...] = ()  # of each segment; NaN if the model diverged

    def part(self, entries: np.ndarray) -> "Information":
        """Return the information about the `entries` of θ, if the others are fixed."""
        index = np.ix_(entries, entries)
        scores = None if self.scores is None else self.scores[:, entries]
        return self._replace(
            bread=self.bread[index], meat=self.meat[index], scores=scores, gradient=self.gradient[entries],
            channel_information=self.channel_information[:, entries],
            blocks=tuple(segment.part(entries) for segment in self.blocks),
        )  # fmt: skip


def information(problem: Residuals, theta: np.ndarray) -> Information:
    """Return A and B at θ (p,): B of (2) if the residuals are autocorrelated, else of (1)."""
    p, m = problem.size, len(problem.sigma)
    A, B, by_channel = np.zeros((p, p)), np.zeros((p, p)), np.zeros((m, p))
    segments, masks = problem.sensitivities(theta), problem.masks
    autocorrelation = autocorrelation_sums([r for r, _, _ in segments], masks)
    is_autocorrelated = bool(np.any(autocorrelation > WHITE_LIMIT))
    is_sparse, scores = problem.counts < MIN_MEASUREMENTS, np.zeros((len(segments), p))
    block_s = block_duration_s(problem)

    def segment_sums(
        segment: Any, record: Any, mask: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, ScoreBlocks]:
        r, d, index = segment
        if not (are_finite(d) and np.isfinite(r).all()):  # a model that diverges gives no information
            none = np.zeros((m, len(index))), np.zeros((len(index), len(index)))
            return *none, ScoreBlocks.nan_block(index)
        psi = np.clip(r, -HUBER, HUBER)
        if is_autocorrelated:
            meat = autocorrelated_scores(np.where(is_sparse, 0.0, psi), mask, d, record.dt_s)
            meat += np.einsum("tmp,tmq->pq", d[:, is_sparse], d[:, is_sparse])
        else:
            psi = np.where(is_sparse & (mask > 0.0) & (np.abs(r) < HUBER), 1.0, psi)
            meat = gram((d * psi[..., None]).reshape(-1, d.shape[2]))
        return (
            np.einsum("tmp,tmp->mp", d, d),
            meat,
            ScoreBlocks.from_rows(r, d, index, block_edges(record, block_s, len(r))),
        )

    sums = parallel_map(segment_sums, segments, problem.records, masks, rows=sum(map(len, masks)))
    for k, (energy, meat, blocks) in enumerate(sums):
        by_channel[:, blocks.entries] += energy
        B[np.ix_(blocks.entries, blocks.entries)] += meat
        if not blocks.has_diverged:
            A[np.ix_(blocks.entries, blocks.entries)] += blocks.information.sum(axis=0)
            scores[k, blocks.entries] = blocks.scores.sum(axis=0)
    has_scores = is_autocorrelated and problem.layout.has_split_runs
    return Information(
        A, B, by_channel, is_autocorrelated, autocorrelation, int(sum(mask.sum() for mask in masks)),
        scores if has_scores else None, problem.layout.first_start, problem.prior * theta + scores.sum(axis=0),
        tuple(blocks for _, _, blocks in sums),
    )  # fmt: skip


def parameter_cov(info: Information, identifiable: np.ndarray) -> np.ndarray:
    """Return the covariance (k, k) of the entries `identifiable` of θ, if the others are fixed.  (1), (3)"""
    index = np.ix_(identifiable, identifiable)
    information = np.diagonal(info.bread)[identifiable]
    scale = np.sqrt(np.where(information > 0.0, information, 1.0))  # all rows of an entry can be outliers
    A = info.bread[index] / np.outer(scale, scale)
    B = info.meat[index] / np.outer(scale, scale)
    factor = np.linalg.solve(A, square_root(B))
    cov = factor @ factor.T  # A⁻¹ B A⁻¹
    cov = cov * (info.sample_count / max(1, info.sample_count - len(identifiable)))
    if info.scores is not None and len(info.scores) >= MIN_SEGMENTS_PER_PARAMETER * info.shared_count:
        moves = np.linalg.solve(A, (info.scores[:, identifiable] / scale).T).T
        factors = inflation_factors(
            np.diagonal(cov), np.diagonal(change_covariance(moves, info.shared_count))
        )
        cov = cov * np.outer(factors, factors)
    return cov / np.outer(scale, scale)


class FixedParameters(NamedTuple):
    """K uncertain parameters that a fit keeps fixed."""

    paths: tuple[str, ...]
    cov: np.ndarray  # (K, K) mean square of their errors
    shifts: np.ndarray  # (K, p) change of the estimates per change of κ  (4)
    is_in_cov: np.ndarray  # (K,) True if the covariance of θ contains the error

    @property
    def estimate_cov(self) -> np.ndarray:
        """Return the part (p, p) of the covariance of the estimates that is `is_in_cov`."""
        return self.cov_part(self.is_in_cov)

    def cov_part(self, mask: np.ndarray) -> np.ndarray:
        """Return the part (p, p) of the covariance of the estimates by the parameters with the `mask` (K,)."""
        S = self.shifts * mask[:, None]
        return S.T @ self.cov @ S

    def gyro_shift(self) -> np.ndarray:
        """Return the change (p,) of the estimates per change of the gyro's scale, 0 if it is exact or fitted."""
        return self.shifts[[path.endswith(".gyro_scale") for path in self.paths]].sum(axis=0)


class UncertainParameters(NamedTuple):
    """K parameters of a vehicle file whose error is declared, and tyres of unknown error."""

    paths: tuple[str, ...]
    cov: np.ndarray  # (K, K) as declared, 0 for tyres

    def added_paths(self, problem: Residuals) -> list[str]:
        """Return the paths that the θ of `problem` does not contain."""
        return [path for path in self.paths if path not in problem.shape.shared_paths]


def uncertain_parameters(
    vehicle_file: "VehicleFile", blocks: FittedBlocks, problem: Residuals, with_zero: bool
) -> UncertainParameters:
    """Return the uncertain parameters of `blocks`, `with_zero` of the gyro; tyres if the scales are fixed."""
    paths, cov = declared_covariance(vehicle_file, blocks, {*problem.shape.per_run}, with_zero)
    tyres = [path for field in tyre_paths(blocks.model) for path in entries(blocks, field)]
    tyres = [x for x in tyres if problem.has_fixed_scales and x not in (*problem.shape.shared_paths, *paths)]
    return UncertainParameters((*paths, *tyres), np.pad(cov, (0, len(tyres))))


def joint_information(problem: Residuals, theta: np.ndarray, uncertain: UncertainParameters) -> Information:
    """Return the information about θ (p,) with the uncertain parameters after its shared entries. The starts of
    segments are eliminated from A and B."""
    s, new = problem.layout.shared_count, uncertain.added_paths(problem)
    joint = problem.with_paths(new)
    info = information(joint, np.insert(theta, s, [value(joint.blocks, path) for path in new]))
    if joint.layout.has_split_runs:
        A, B = eliminate_starts(info.bread, info.meat, joint.layout)
        blocks = tuple(segment.without(joint.layout.first_start) for segment in info.blocks)
        info = info._replace(bread=A, meat=B, blocks=blocks)
    return info


def fixed_parameters(
    uncertain: UncertainParameters, joint_info: Information, problem: Residuals, solution: Solution, mask: np.ndarray
) -> FixedParameters:  # fmt: skip
    """Return those of the `uncertain` parameters that were fixed in a search with the end `solution`. `joint_info` is
    their `joint_information`, and `mask` (p,) selects the identifiable entries of θ.

    The covariance of θ contains the zero of the gyro and the scales of a gyro-aided fit, which are fixed in every run.
    """
    theta, s, shared_paths = solution.theta, problem.layout.shared_count, problem.shape.shared_paths
    exact_paths = {path for path, is_free in zip(shared_paths, mask, strict=False) if is_free}
    is_fixed = [path not in exact_paths for path in uncertain.paths]
    paths, prior = [*compress(uncertain.paths, is_fixed)], uncertain.cov[np.ix_(is_fixed, is_fixed)]
    free, K = np.flatnonzero(mask & (solution.bound[: len(mask)] == 0)), len(paths)
    if not (K and len(free) and np.isfinite(theta).all()):
        return FixedParameters((), np.zeros((0, 0)), np.zeros((0, len(mask))), np.zeros(0, bool))
    blocks, new, A, B = problem.blocks, uncertain.added_paths(problem), joint_info.bread, joint_info.meat
    is_tyre, shifts = np.diagonal(prior) == 0.0, np.zeros((K, len(mask)))
    std = np.where(is_tyre, 1.0, np.sqrt(np.diagonal(prior)))
    index = np.r_[[(*shared_paths, *new).index(path) for path in paths], free + (free >= s) * len(new)]
    unit = np.r_[std, np.ones(len(free))]
    A, B = (x[np.ix_(index, index)] * np.outer(unit, unit) for x in (A, B))
    S = -A[:K, K:] @ pseudo_inverse(A[K:, K:])
    shifts[:, free] = S / std[:, None]
    is_in_cov = np.array(
        [x.endswith(".gyro_bias") or (problem.has_fixed_scales and "_scale" in x) for x in paths]
    )
    # a zero measured at rest is more accurate than one estimated by a model, which may lack effects
    is_updated = ~(is_in_cov & (std < tolerance_std(ZERO_RATE_RAD_S))) & (not problem.has_fixed_scales)
    cov, k = prior / np.outer(std, std), np.ix_(is_updated, is_updated)
    N, M = eliminate(A, B, K, [slice(K, len(A))])
    g = np.hstack([np.eye(K), S]) @ (unit * joint_info.gradient[index])
    cov[k] = mean_square_error(cov[k], N[k], M[k], g[is_updated])
    for i in np.flatnonzero(is_tyre & (np.diagonal(N) > 0.0)).tolist():
        tyre, now = free_parameter(blocks, paths[i], {}), value(blocks, paths[i])
        cov[i, i] = np.clip(-g[i] / N[i, i], tyre.low - now, tyre.high - now) ** 2
    return FixedParameters(tuple(paths), cov * np.outer(std, std), shifts, is_in_cov)
