"""Evaluate the second cost of a fit: the likelihood of the innovations of a filter, whose noise is fitted too.

    J(x) = Σ ρ(e) + ½ β log s,   x = (θ, v, ½ log q),   ρ(e) = ½ K² atan(e²/K²),   ψ = ρ' = e/(1 + (e/K)⁴)  (1)
    ∂J = Σ ψ ∂e + ½ β ∂log s,      H = Σ w ∂e ∂eᵀ + ¼ β ∂log s ∂log sᵀ                                     (2)
    cov = A⁻¹ B A⁻¹,   A = Σ ψ' ∂e ∂eᵀ + ¼ β ∂log s ∂log sᵀ,   B = Σ U Uᵀ,   U = ψ ∂e + ½ β ∂log s          (3)
    2 (J(v = 0) − J)/τ  ~  at most χ² with as many degrees as v has axes,   τ = E ψ²/E ψ'                  (4)

The sums are over all measurements, with e and s of innovations.py. Without K and with β = 1, J is the Gaussian
likelihood. β = E ψ e puts the minimum of J where v and q are the variances of normal noise. A floor makes the error of
a simulation a random walk. The filter forgets at the rate of v, and its e are white, so that the scores U_t of the
ticks form a martingale (3). H is the Fisher information. v = 0 is the cost of the simulation: the models are nested
(4). The limit is "at most χ²" because v = 0 is on the boundary.
Sources: Schweppe 1965; Ljung 1999, 7 and 10; Huber 1981, 6.3; Self and Liang 1987. docs/derivations/one_likelihood.md
"""

from collections.abc import Callable
from math import erfc, exp, pi, sqrt
from typing import NamedTuple, TypeVar

import numpy as np

from baqueano.identify.covariance.information import (
    WHITE_LIMIT,
    Information,
    autocorrelated_scores,
    autocorrelation_sums,
    covariance_of,
)
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.estimation.least_squares import DAMPING, Solution, minimise
from baqueano.identify.parallel import gram, parallel_map
from baqueano.identify.residuals.block_arrow import Evaluation, add, dense, diagonal_matrix, places_of
from baqueano.identify.residuals.innovations import axes_of, filter_kernel
from baqueano.identify.residuals.simulation import Residuals, cached_kernel
from baqueano.messages.language import translate as _

# K of (1): 97.5 % efficient on normal noise; an outlier of 20 σ keeps a two-thousandth of its weight
FAR = 3.0
BETA = 0.8797543464799179  # E ψ e of a normal e
TAU = 0.9025241522034412  # E ψ²/E ψ' of a normal e
WIDEST = 7.0  # of ½ log q: e⁷ is a thousand times the noise
TOLERANCE = 1e-7  # decrement at the end
MOST, PATIENCE = 60, 15  # evaluations, in all and between two progress messages
R = TypeVar("R")


class FloorNoise(NamedTuple):
    """Process noise and sensor noise of the filter."""

    floor: np.ndarray  # (k,) v of each axis, per second
    sensors: np.ndarray  # (m,) ½ log q: logarithm of the factor on σ of each channel

    @property
    def vector(self) -> np.ndarray:
        """Return v and ½ log q as one vector (k + m,)."""
        return np.concatenate([self.floor, self.sensors])


class MaximumLikelihood(NamedTuple):
    """The x of maximum likelihood, with its information and the ratio (4)."""

    solution: Solution  # in x
    theta: np.ndarray  # (p,)
    noise: FloorNoise
    floor_sd: np.ndarray  # (k,) standard errors of v
    info: Information  # about x
    ratio: float  # (4): likelihood ratio to v = 0
    evaluations: int

    @property
    def chance(self) -> float:
        """Return an upper limit of the p-value of the ratio (4), under the hypothesis v = 0."""
        return tail(self.ratio, len(self.noise.floor))


class Slopes(NamedTuple):
    """Innovations of one segment and their derivatives with respect to x, measurement by measurement."""

    e: np.ndarray  # (N, m), 0 without a measurement
    log_s: np.ndarray  # (N, m)
    e_slopes: np.ndarray  # (N, m, p_segment) ∂e
    s_slopes: np.ndarray  # (N, m, p_segment) ∂log s
    places: np.ndarray  # (p_segment,) positions of these entries in x


class Prediction:
    """Innovations of the runs of a `Residuals`, as a function of x = (θ, v, ½ log q).

    θ, rows, σ and weights are taken from `simulation`.
    """

    def __init__(self, simulation: Residuals, blocks: FittedBlocks) -> None:
        self.simulation, self.size = simulation, simulation.size
        self.axes, self.channels = axes_of(blocks.model), sum(simulation.sizes)
        self.kernel = cached_kernel(blocks, simulation.shape, simulation.scan.backend, filter_kernel)

    def x(self, theta: np.ndarray, noise: FloorNoise | None = None) -> np.ndarray:
        """Return x = (θ, v, ½ log q); without `noise`, v = 0 and the σ of the simulation."""
        noise = noise or FloorNoise(np.zeros(len(self.axes)), np.zeros(self.channels))
        return np.concatenate([theta, noise.vector])

    def parts(self, x: np.ndarray) -> tuple[np.ndarray, FloorNoise]:
        """Return θ (p,) and the noise of x."""
        floor, sensors = np.split(x[self.size :], [len(self.axes)])
        return x[: self.size], FloorNoise(floor, sensors)

    def evaluate(self, x: np.ndarray) -> Evaluation:
        """Return J, its gradient and its Hessian with respect to x.  (1), (2)"""
        cost, g = 0.0, np.zeros(len(x))
        H = diagonal_matrix(g, places_of(self.simulation.layout, len(x) - self.size))
        parts, places = self._each(x, _normal), self._places()
        for part, index in zip(parts, places, strict=True):
            cost += part.cost
            g[index] += part.gradient
        add(H, places, [dense(part.hessian) for part in parts])
        return Evaluation(cost if np.isfinite(cost) else np.inf, g, H)

    def innovations(self, x: np.ndarray) -> list[np.ndarray]:
        """Return for each segment e (N, m), 0 without a measurement."""
        return self._each(x, lambda slopes: slopes.e)

    def slopes(self, x: np.ndarray) -> list[Slopes]:
        """Return for each segment the innovations and their derivatives."""
        return self._each(x, lambda slopes: slopes)

    def _each(self, x: np.ndarray, part: Callable[[Slopes], R]) -> list[R]:
        """Return `part(slopes)` of each segment, computed on all cores."""

        def of_piece(rows: np.ndarray, places: np.ndarray) -> R:
            return part(self._slopes(rows, x, places))

        rows = self.simulation.rows
        worth = sum(map(len, rows)) if self.kernel.backend == "c" else 0
        return parallel_map(of_piece, rows, self._places(), rows=worth)

    def _places(self) -> list[np.ndarray]:
        """Return for each segment the positions of its θ and of the noise in x."""
        noise = self.size + np.arange(len(self.axes) + self.channels)
        return [np.concatenate([index, noise]) for index in self.simulation.layout.indices]

    def _slopes(self, rows: np.ndarray, x: np.ndarray, places: np.ndarray) -> Slopes:
        m = self.channels
        out, d = self.kernel.sensitivities(rows, x[places])
        return Slopes(out[:, :m], out[:, m:], d[:, :m], d[:, m:], places)

    def information(self, x: np.ndarray) -> Information:
        """Return A and B with respect to x.  (3)"""
        A, B = np.zeros((len(x), len(x))), np.zeros((len(x), len(x)))
        channels = np.zeros((self.channels, len(x)))
        has, records = self.simulation.has, self.simulation.records
        autocorrelation = autocorrelation_sums(self.innovations(x), has)
        is_autocorrelated = bool(np.any(np.abs(autocorrelation) > WHITE_LIMIT))
        segments = zip(self.simulation.rows, self._places(), has, records, strict=True)
        for rows, places, presence, record in segments:
            slopes = self._slopes(rows, x, places)
            at, psi = np.ix_(slopes.places, slopes.places), weight(slopes.e) * slopes.e
            A[at] += _square(slope(slopes.e), slopes.e_slopes) + _square(0.25 * BETA, slopes.s_slopes)
            channels[:, slopes.places] += np.einsum("tmp,tmp->mp", slopes.e_slopes, slopes.e_slopes)
            if is_autocorrelated:
                B[at] += autocorrelated_scores(psi, presence, slopes.e_slopes, record.dt_s)
                B[at] += _square(0.25 * (BETA - psi * slopes.e) ** 2, slopes.s_slopes)
            else:
                U = np.einsum("tm,tmp->tp", psi, slopes.e_slopes) + 0.5 * BETA * slopes.s_slopes.sum(axis=1)
                B[at] += gram(U)
        return Information(
            A, B, channels, is_autocorrelated, autocorrelation, int(sum(presence.sum() for presence in has))
        )


def most_likely(
    prediction: Prediction,
    theta: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    fixed: np.ndarray,
    least: np.ndarray | None = None,
    progress: Callable[[str], object] | None = None,
) -> MaximumLikelihood:
    """Return the x of maximum likelihood, searched from `theta` (p,) of the simulation between the bounds.

    `fixed` (p,) marks entries that do not move. σ of a sensor is at least `least` (m,), given by its converter and
    by rounding. The first search has v = 0, the second one a free v. `progress` receives the progress; if it returns
    True, a search ends.
    """
    k, m, x = len(prediction.axes), prediction.channels, prediction.x(theta)
    quiet = np.zeros(m) if least is None else least / prediction.simulation.sigma
    low = np.concatenate([low, np.zeros(k), np.log(np.clip(quiet, np.exp(-WIDEST), 1.0))])
    high = np.concatenate([high, np.full(k, np.inf), np.full(m, WIDEST)])
    floor = np.zeros(len(x), bool)
    floor[len(theta) : len(theta) + k] = True
    fixed = np.concatenate([fixed, np.zeros(k + m, bool)])
    before = _search(prediction, x, low, high, fixed | floor, DAMPING, progress)
    solution = _search(prediction, before.theta, low, high, fixed, 1e-6, progress)
    ratio = 2.0 * (before.evaluation.cost - solution.evaluation.cost) / TAU
    theta, noise = prediction.parts(solution.theta)
    info = prediction.information(solution.theta)
    inside = floor & (solution.theta > 0.0)
    sd = np.full(len(x), np.nan)
    entries = np.flatnonzero((inside | (~fixed & ~floor)) & (np.diagonal(info.bread) > 0.0))
    sd[entries] = np.sqrt(np.diagonal(covariance_of(info, entries)))
    return MaximumLikelihood(
        solution, theta, noise, sd[floor], info, ratio, before.evaluations + solution.evaluations
    )


def tail(ratio: float, degrees: int) -> float:
    """Return the probability that χ² with 1, 2 or 3 degrees of freedom exceeds `ratio`."""
    half = max(ratio, 0.0) / 2.0
    if degrees == 2:
        return exp(-half)
    probability = erfc(sqrt(half))
    return probability if degrees == 1 else probability + 2.0 * sqrt(half / pi) * exp(-half)


def _search(
    prediction: Prediction,
    x: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    is_fixed: np.ndarray,
    damping: float,
    progress: Callable[[str], object] | None,
) -> Solution:
    """Return the minimum of J from `x`. `progress` receives the progress; if it returns True, the search ends."""
    count, at = 0, None
    while True:
        solution = minimise(
            prediction.evaluate, x, low, high,
            fixed=is_fixed, tolerance=TOLERANCE, most=PATIENCE, damping=damping, evaluation=at,
        )  # fmt: skip
        count += solution.evaluations
        reason = (
            progress is not None
            and progress(
                _(
                    "innovations: {count} evaluations, cost {cost:.6g}",
                    count=count,
                    cost=solution.evaluation.cost,
                )
            )
            is True
        )
        if solution.converged or reason or count >= MOST or not np.isfinite(solution.evaluation.cost):
            return solution._replace(evaluations=count)
        x, at, damping = solution.theta, solution.evaluation, 1e-6


def _normal(slopes: Slopes) -> Evaluation:
    """Return J of one segment, with its gradient and Hessian.  (1), (2)"""
    with np.errstate(over="ignore", invalid="ignore"):  # a model that diverges
        cost, w = float(np.sum(rho(slopes.e)) + 0.5 * BETA * np.sum(slopes.log_s)), weight(slopes.e)
    g = _along(w * slopes.e, slopes.e_slopes) + _along(0.5 * BETA, slopes.s_slopes)
    return Evaluation(cost, g, _square(w, slopes.e_slopes) + _square(0.25 * BETA, slopes.s_slopes))


def rho(e: np.ndarray) -> np.ndarray:
    """Return ρ of the innovations e.  (1)"""
    return 0.5 * FAR**2 * np.arctan((e / FAR) ** 2)


def weight(e: np.ndarray) -> np.ndarray:
    """Return the weight w = ψ/e of the innovations e."""
    return 1.0 / (1.0 + (e / FAR) ** 4)


def slope(e: np.ndarray) -> np.ndarray:
    """Return the derivative ψ' at the innovations e."""
    w = weight(e)
    return w * (4.0 * w - 3.0)


def _along(factors: np.ndarray | float, slopes: np.ndarray) -> np.ndarray:
    """Return Σ f ∂ (p,) for derivatives (N, m, p) and factors f."""
    flat = slopes.reshape(-1, slopes.shape[-1])
    return np.broadcast_to(factors, slopes.shape[:-1]).ravel() @ flat


def _square(factors: np.ndarray | float, slopes: np.ndarray) -> np.ndarray:
    """Return Σ f ∂ ∂ᵀ (p, p) for derivatives (N, m, p) and factors f."""
    flat = slopes.reshape(-1, slopes.shape[-1])
    return gram(flat, np.broadcast_to(factors, slopes.shape[:-1]).ravel())
