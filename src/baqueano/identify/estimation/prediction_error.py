"""Evaluate the second cost of a fit: the likelihood of the innovations of a filter, whose noise is also fitted.

    J(x) = Σ ρ(e) + ½ β log s,   x = (θ, v, ½ log q),   ρ(e) = ½ K² atan(e²/K²),   ψ = ρ' = e/(1 + (e/K)⁴)  (1)
    ∂J = Σ ψ ∂e + ½ β ∂log s,      H = Σ w ∂e ∂eᵀ + ¼ β ∂log s ∂log sᵀ                                     (2)
    cov = A⁻¹ B A⁻¹,   A = Σ ψ' ∂e ∂eᵀ + ¼ β ∂log s ∂log sᵀ,   B = Σ U Uᵀ,   U = ψ ∂e + ½ β ∂log s          (3)
    2 (J(v = 0) − J)/τ  ~  at most χ² with as many degrees as v has axes,   τ = E ψ²/E ψ'                  (4)

The sums are over all measurements, with e and s of innovations.py. Without K and with β = 1, J is the Gaussian
likelihood. β = E ψ e puts the minimum of J where v and q are the variances of normal noise. Because of process noise,
the error of a simulation is a random walk. The filter discards old information at a rate given by v, and its e are
white. So the scores U_t of the ticks form a martingale (3). H is the Fisher information. v = 0 is the cost of the
simulation: the models are nested (4). The limit is "at most χ²" because v = 0 is on the boundary. Sources: Schweppe
1965; Ljung 1999, 7 and 10; Huber 1981, 6.3; Self and Liang 1987. docs/derivations/one_likelihood.md
"""

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import numpy as np

from baqueano.identify.covariance.information import Information, parameter_cov
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.parameters.theta import arrow_layout
from baqueano.identify.residuals.innovations import filter_kernel, noise_axes
from baqueano.identify.residuals.motion import cached_kernel
from baqueano.identify.residuals.simulation import Residuals
from baqueano.messages.language import translate as _
from baqueano.numerics.autocorrelation import WHITE_LIMIT, autocorrelated_scores, autocorrelation_sums
from baqueano.numerics.least_squares import DAMPING, Solution, minimise
from baqueano.numerics.normal_equations import Evaluation, segment_sum
from baqueano.numerics.parallel import gram, parallel_map
from baqueano.numerics.statistics import chi_square_tail

# K of (1): 97.5 % efficient on normal noise; the weight of an outlier of 20 σ is 1/2000
ROBUST_SCALE = 3.0
BETA = 0.8797543464799179  # E ψ e of a normal e
TAU = 0.9025241522034412  # E ψ²/E ψ' of a normal e
MAX_LOG_NOISE = 7.0  # of ½ log q: e⁷ is a thousand times the noise
TOLERANCE = 1e-7  # decrement at the end
MAX_EVALUATIONS, EVALUATION_BATCH = 60, 15  # in total, and between two progress messages
R = TypeVar("R")


class FilterNoise(NamedTuple):
    """Process noise and sensor noise of the filter."""

    floor: np.ndarray  # (k,) v of each axis, per second
    sensors: np.ndarray  # (m,) ½ log q: logarithm of the factor on σ of each channel


class MaximumLikelihood(NamedTuple):
    """The x of maximum likelihood, with its information and the ratio (4)."""

    solution: Solution  # in x
    theta: np.ndarray  # (p,)
    noise: FilterNoise
    floor_std: np.ndarray  # (k,) standard errors of v
    info: Information  # about x
    ratio: float  # (4): likelihood ratio to v = 0
    evaluations: int

    @property
    def p_value(self) -> float:
        """Return an upper limit of the p-value of the ratio (4), under the hypothesis v = 0."""
        return chi_square_tail(self.ratio, len(self.noise.floor))


class InnovationDerivatives(NamedTuple):
    """Innovations of one segment and their derivatives with respect to x, measurement by measurement."""

    e: np.ndarray  # (N, m), 0 without a measurement
    log_s: np.ndarray  # (N, m)
    e_derivatives: np.ndarray  # (N, m, p_segment) ∂e
    s_derivatives: np.ndarray  # (N, m, p_segment) ∂log s
    indices: np.ndarray  # (p_segment,) indices of these entries in x


class Prediction:
    """Innovations of the runs of `simulation`, as a function of x = (θ, v, ½ log q)."""

    def __init__(self, simulation: Residuals, blocks: FittedBlocks) -> None:
        self.simulation, self.size = simulation, simulation.size
        self.axes, self.channels = noise_axes(blocks.model), sum(simulation.sizes)
        self.kernel = cached_kernel(blocks, simulation.shape, simulation.scan.backend, filter_kernel)
        noise = self.size + np.arange(len(self.axes) + self.channels)
        # per segment the indices in x of its θ and of the noise
        self._indices = [np.concatenate([index, noise]) for index in simulation.layout.indices]

    def x(self, theta: np.ndarray, noise: FilterNoise | None = None) -> np.ndarray:
        """Return x = (θ, v, ½ log q). Without `noise`, v is 0 and σ comes from the simulation."""
        noise = noise or FilterNoise(np.zeros(len(self.axes)), np.zeros(self.channels))
        return np.concatenate([theta, *noise])

    def split_vector(self, x: np.ndarray) -> tuple[np.ndarray, FilterNoise]:
        """Return θ (p,) and the noise that x contains."""
        floor, sensors = np.split(x[self.size :], [len(self.axes)])
        return x[: self.size], FilterNoise(floor, sensors)

    def evaluate(self, x: np.ndarray) -> Evaluation:
        """Return J, its gradient and its Hessian with respect to x.  (1), (2)"""
        parts, zeros = self._map_segments(x, _segment_cost), np.zeros(len(x))
        places = arrow_layout(self.simulation.layout, len(x) - self.size)
        total = segment_sum(parts, self._indices, x, zeros, places)
        return total if np.isfinite(total.cost) else total._replace(cost=np.inf)

    def derivatives(self, x: np.ndarray) -> list[InnovationDerivatives]:
        """Return for each segment the innovations and their derivatives."""
        return self._map_segments(x, lambda slopes: slopes)

    def _map_segments(self, x: np.ndarray, map_segment: Callable[[InnovationDerivatives], R]) -> list[R]:
        """Return `map_segment(derivatives)` for each segment, computed on all cores."""
        m, rows = self.channels, self.simulation.rows

        def map_rows(rows: np.ndarray, indices: np.ndarray) -> R:
            v, d = self.kernel.sensitivities(rows, x[indices])
            return map_segment(InnovationDerivatives(v[:, :m], v[:, m:], d[:, :m], d[:, m:], indices))

        work_rows = sum(map(len, rows)) if self.kernel.backend == "c" else 0
        return parallel_map(map_rows, rows, self._indices, rows=work_rows)

    def information(self, x: np.ndarray) -> Information:
        """Return A and B with respect to x.  (3)"""
        A, B = np.zeros((len(x), len(x))), np.zeros((len(x), len(x)))
        by_channel = np.zeros((self.channels, len(x)))
        masks, records, segments = self.simulation.masks, self.simulation.records, self.derivatives(x)
        autocorrelation = autocorrelation_sums([slopes.e for slopes in segments], masks)
        is_autocorrelated = bool(np.any(np.abs(autocorrelation) > WHITE_LIMIT))
        for slopes, is_present, record in zip(segments, masks, records, strict=True):
            block, psi = np.ix_(slopes.indices, slopes.indices), weight(slopes.e) * slopes.e
            d_e, d_s = slopes.e_derivatives, slopes.s_derivatives
            A[block] += _hessian_sum(psi_derivative(slopes.e), d_e) + _hessian_sum(0.25 * BETA, d_s)
            by_channel[:, slopes.indices] += np.einsum("tmp,tmp->mp", d_e, d_e)
            if is_autocorrelated:
                B[block] += autocorrelated_scores(psi, is_present, d_e, record.dt_s)
                B[block] += _hessian_sum(0.25 * (BETA - psi * slopes.e) ** 2, d_s)
            else:
                B[block] += gram(np.einsum("tm,tmp->tp", psi, d_e) + 0.5 * BETA * d_s.sum(axis=1))
        samples = int(sum(is_present.sum() for is_present in masks))
        return Information(A, B, by_channel, is_autocorrelated, autocorrelation, samples)


def maximum_likelihood(
    prediction: Prediction, theta: np.ndarray, low: np.ndarray, high: np.ndarray, is_fixed: np.ndarray,
    floor: np.ndarray | None = None, progress: Callable[[str], object] | None = None,
) -> MaximumLikelihood:  # fmt: skip
    """Return the x of maximum likelihood. The search starts at `theta` (p,) of the simulation and stays between `low`
    and `high` (p,). `is_fixed` (p,) is a mask of entries that do not change. σ of a channel is at least `floor` (m,),
    given by its converter and by rounding. The first search has v = 0, the second one a free v. `progress` is called
    with a text; if it returns True, a search ends."""
    k, m, x = len(prediction.axes), prediction.channels, prediction.x(theta)
    min_factor = np.zeros(m) if floor is None else floor / prediction.simulation.sigma
    low = np.concatenate([low, np.zeros(k), np.log(np.clip(min_factor, np.exp(-MAX_LOG_NOISE), 1.0))])
    high = np.concatenate([high, np.full(k, np.inf), np.full(m, MAX_LOG_NOISE)])
    is_floor = np.zeros(len(x), bool)
    is_floor[len(theta) : len(theta) + k] = True
    is_fixed = np.concatenate([is_fixed, np.zeros(k + m, bool)])
    first_solution = _search(prediction, x, low, high, is_fixed | is_floor, DAMPING, progress)
    solution = _search(prediction, first_solution.theta, low, high, is_fixed, 1e-6, progress)
    ratio = 2.0 * (first_solution.evaluation.cost - solution.evaluation.cost) / TAU
    theta, noise = prediction.split_vector(solution.theta)
    info = prediction.information(solution.theta)
    is_positive = is_floor & (solution.theta > 0.0)
    std = np.full(len(x), np.nan)
    entries = np.flatnonzero((is_positive | (~is_fixed & ~is_floor)) & (np.diagonal(info.bread) > 0.0))
    std[entries] = np.sqrt(np.diagonal(parameter_cov(info, entries)))
    evaluations = first_solution.evaluations + solution.evaluations
    return MaximumLikelihood(solution, theta, noise, std[is_floor], info, ratio, evaluations)


def _search(
    prediction: Prediction, x: np.ndarray, low: np.ndarray, high: np.ndarray, is_fixed: np.ndarray, damping: float,
    progress: Callable[[str], object] | None,
) -> Solution:  # fmt: skip
    """Return the minimum of J, searched from `x`, until `progress` returns True."""
    evaluation_count, evaluation = 0, None
    while True:
        solution = minimise(
            prediction.evaluate, x, low, high, is_fixed=is_fixed, tolerance=TOLERANCE,
            max_evaluations=EVALUATION_BATCH, damping=damping, evaluation=evaluation,
        )  # fmt: skip
        evaluation_count += solution.evaluations
        cost = solution.evaluation.cost
        text = _("innovations: {count} evaluations, cost {cost:.6g}", count=evaluation_count, cost=cost)
        is_stopped = progress is not None and progress(text) is True
        if solution.converged or is_stopped or evaluation_count >= MAX_EVALUATIONS or not np.isfinite(cost):
            return solution._replace(evaluations=evaluation_count)
        x, evaluation, damping = solution.theta, solution.evaluation, 1e-6


def _segment_cost(slopes: InnovationDerivatives) -> Evaluation:
    """Return J of one segment, with its gradient and Hessian.  (1), (2)"""
    with np.errstate(over="ignore", invalid="ignore"):  # a model that diverges
        cost, w = float(np.sum(rho(slopes.e)) + 0.5 * BETA * np.sum(slopes.log_s)), weight(slopes.e)
    d_e, d_s = slopes.e_derivatives, slopes.s_derivatives
    g = _gradient_sum(w * slopes.e, d_e) + _gradient_sum(0.5 * BETA, d_s)
    return Evaluation(cost, g, _hessian_sum(w, d_e) + _hessian_sum(0.25 * BETA, d_s))


def rho(e: np.ndarray) -> np.ndarray:
    """Return ρ of the innovations e.  (1)"""
    return 0.5 * ROBUST_SCALE**2 * np.arctan((e / ROBUST_SCALE) ** 2)


def weight(e: np.ndarray) -> np.ndarray:
    """Return the weight w = ψ/e of the innovations e."""
    return 1.0 / (1.0 + (e / ROBUST_SCALE) ** 4)


def psi_derivative(e: np.ndarray) -> np.ndarray:
    """Return the derivative ψ' at the innovations e."""
    w = weight(e)
    return w * (4.0 * w - 3.0)


def _gradient_sum(factors: np.ndarray | float, slopes: np.ndarray) -> np.ndarray:
    """Return Σ f ∂ (p,) for derivatives (N, m, p) and factors f."""
    flat = slopes.reshape(-1, slopes.shape[-1])
    return np.broadcast_to(factors, slopes.shape[:-1]).ravel() @ flat


def _hessian_sum(factors: np.ndarray | float, slopes: np.ndarray) -> np.ndarray:
    """Return Σ f ∂ ∂ᵀ (p, p) for derivatives (N, m, p) and factors f."""
    flat = slopes.reshape(-1, slopes.shape[-1])
    return gram(flat, np.broadcast_to(factors, slopes.shape[:-1]).ravel())
