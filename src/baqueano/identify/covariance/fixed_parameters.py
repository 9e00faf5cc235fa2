"""Compute the errors of a fit by parameters that it keeps fixed although they are uncertain: scales, mounts, lengths.

    S = −A_κθ A_θθ⁻¹                   the change of θ̂ per change of the fixed parameters κ                 (1)
    g = (1, S) ∂C                      the score of κ, with the information N and the covariance M        (2)

A, B: (1) and (2) of information.py for (θ, κ); N, M: (2) of numerics/normal_equations.py. Σ is the covariance of κ in
the vehicle file. The runs show a part of κ: for example, wheels and a gyro measure the same turns. Given the runs, the
error of κ has the mean δ and the covariance P, (4) there. The fit does not use δ, so its mean square is P + δ δᵀ.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.calibration.tolerances import ZERO_RATE_RAD_S, declared_covariance, std_of_tolerance
from baqueano.identify.covariance.information import information
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.parameters.free import value
from baqueano.identify.parameters.theta import eliminate_starts
from baqueano.identify.residuals.simulation import Residuals
from baqueano.numerics.least_squares import Solution
from baqueano.numerics.normal_equations import eliminate, mean_square_error, pseudo_inverse

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile


class FixedParameters(NamedTuple):
    """K uncertain parameters that a fit keeps fixed."""

    paths: tuple[str, ...]
    cov: np.ndarray  # (K, K) mean square of their errors
    shifts: np.ndarray  # (K, p) change of the estimates per change of κ  (1)
    in_cov: np.ndarray  # (K,) True if the covariance of θ contains the error

    @property
    def estimate_cov(self) -> np.ndarray:
        """Return the part (p, p) of the covariance of the estimates that is `in_cov`."""
        S = self.shifts * self.in_cov[:, None]
        return S.T @ self.cov @ S

    def gyro_shift(self) -> np.ndarray:
        """Return the change (p,) of the estimates per change of the gyro's scale, 0 if it is exact or fitted."""
        return self.shifts[[path.endswith(".gyro_scale") for path in self.paths]].sum(axis=0)


def fixed_parameters(
    vehicle_file: "VehicleFile", blocks: FittedBlocks, problem: Residuals, solution: Solution, mask: np.ndarray,
    with_zero: bool,
) -> FixedParameters:  # fmt: skip
    """Return the uncertain parameters of `blocks` that were fixed in a search with the end `solution`. `mask` (p,) is
    that of the identifiable entries of θ. `with_zero` includes the zero of the gyro.

    The covariance of θ contains this zero and the scales of a gyro-aided fit, which are fixed in every run.
    """
    theta, s, shared_paths = solution.theta, problem.layout.shared_count, problem.shape.shared_paths
    exact_paths = {path for path, is_free in zip(shared_paths, mask, strict=False) if is_free}
    exact_paths |= {*problem.shape.per_run}
    paths, prior = declared_covariance(vehicle_file, blocks, exact_paths, with_zero)
    free, K = np.flatnonzero(mask & (solution.bound[: len(mask)] == 0)), len(paths)
    if not (K and len(free) and np.isfinite(theta).all()):
        return FixedParameters((), np.zeros((0, 0)), np.zeros((0, len(mask))), np.zeros(0, bool))
    new = [path for path in paths if path not in shared_paths]
    joint = problem.with_paths(new)
    joint_theta = np.insert(theta, s, [value(blocks, path) for path in new])
    info, gradient = information(joint, joint_theta), joint.evaluate(joint_theta).gradient
    A, B = info.bread, info.meat
    if joint.layout.has_split_runs:
        A, B = eliminate_starts(A, B, joint.layout)
    std, shifts = np.sqrt(np.diagonal(prior)), np.zeros((K, len(mask)))
    index = np.r_[[joint.shape.shared_paths.index(path) for path in paths], free + (free >= s) * len(new)]
    unit = np.r_[std, np.ones(len(free))]
    A, B = (x[np.ix_(index, index)] * np.outer(unit, unit) for x in (A, B))
    S = -A[:K, K:] @ pseudo_inverse(A[K:, K:])
    shifts[:, free] = S / std[:, None]
    in_cov = np.array(
        [x.endswith(".gyro_bias") or (problem.has_fixed_scales and "_scale" in x) for x in paths]
    )
    # a zero that was measured at rest is known better than by a model, which may lack some effects
    is_updated = ~(in_cov & (std < std_of_tolerance(ZERO_RATE_RAD_S))) & (not problem.has_fixed_scales)
    cov, k = prior / np.outer(std, std), np.ix_(is_updated, is_updated)
    N, M = eliminate(A, B, K, [slice(K, len(A))])
    g = np.hstack([np.eye(K), S]) @ (unit * gradient[index])
    cov[k] = mean_square_error(cov[k], N[k], M[k], g[is_updated])
    return FixedParameters(tuple(paths), cov * np.outer(std, std), shifts, in_cov)
