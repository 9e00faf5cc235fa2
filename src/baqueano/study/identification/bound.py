"""Compute the Cramér-Rao bound of a simulator, by finite differences of its readings.

    G = ∂h/∂θ by (h(θ + s) − h(θ − s)) / 2s,   b_i = √((Σ_t Gᵀ Q⁻¹ G + P₀⁻¹)⁻¹)_ii                        (1)

h is the noise-free reading of the sensors, Q the covariance of their noise, and P₀ the covariance of the prior. Without
a prior, P₀⁻¹ = 0. (1) contains all free parameters of a fit together, including the biases. It does not contain
outliers, a random walk of the biases, or the rounding of the converter.
"""

from collections.abc import Mapping

import numpy as np

from baqueano.study.counterpart import car_unknowns, robot_values, with_car_unknowns, with_values
from baqueano.study.counterpart.cars import ODOMETER_M_S
from baqueano.study.truth import Cars, Robots

RELATIVE_STEP = 1e-3  # of a parameter
MIN_STEPS = {  # the step for a parameter that can be 0
    "friction.quadratic": 1e-4, "actuator_matrix": 1e-4, "lever_arm": 1e-4, "heading": 1e-3, "bias": 1e-3,
    "friction.quadratic[1]": 0.1, "cornering": 1e-4,
}  # fmt: skip


def free_values(vehicles: Robots | Cars) -> dict[str, np.ndarray]:
    """Return path → true values (n,) of all free parameters of (1)."""
    return robot_values(vehicles) if isinstance(vehicles, Robots) else car_unknowns(vehicles)


def with_free_values(vehicles: Robots | Cars, values: Mapping[str, np.ndarray]) -> Robots | Cars:
    """Return the vehicles with the given `values` (n,) of some of their `free_values`."""
    if isinstance(vehicles, Robots):
        return with_values(vehicles, values)
    return with_car_unknowns(vehicles, values)


def difference_steps(vehicle: Robots | Cars) -> dict[str, float]:
    """Return path → step s of (1), for one vehicle."""
    step_sizes = {}
    for path, value in free_values(vehicle).items():
        min_steps = [size for part, size in MIN_STEPS.items() if part in path]
        step_sizes[path] = RELATIVE_STEP * abs(float(value[0])) or min_steps[-1]
    return step_sizes


def perturbed_copies(vehicle: Robots | Cars) -> Robots | Cars:
    """Return 2p copies of the vehicle: for each of p parameters θ a copy with θ + s, then a copy with θ − s.  (1)"""
    step_sizes = difference_steps(vehicle)
    group = vehicle.subset([0] * (2 * len(step_sizes)))
    values = {}
    for k, (path, step) in enumerate(step_sizes.items()):
        values[path] = free_values(group)[path].copy()
        values[path][2 * k] += step
        values[path][2 * k + 1] -= step
    return with_free_values(group, values)


def cramer_rao_bound(
    noiseless: np.ndarray, vehicle: Robots | Cars, prior_sigma: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Return path → b of (1) from the readings (N, 2p, m) of the `perturbed_copies`; m = 4 with an odometer, else 3.

    `prior_sigma`: path → prior standard deviation, √P₀ of (1).
    """
    step_sizes = difference_steps(vehicle)
    noise = np.append(vehicle.imu.noise[0], ODOMETER_M_S)[: noiseless.shape[2]]
    jacobian = (noiseless[:, 0::2] - noiseless[:, 1::2]) / (2.0 * np.array([*step_sizes.values()])[:, None])
    G = np.moveaxis(jacobian / noise, 1, 2).reshape(-1, len(step_sizes))
    prior_std = np.array([(prior_sigma or {}).get(path, np.inf) for path in step_sizes])
    G = np.concatenate([G, np.diag(1.0 / prior_std)])
    scale = np.linalg.norm(G, axis=0)
    R = np.linalg.qr(G / scale, mode="r")
    stds = np.linalg.norm(np.linalg.solve(R, np.eye(len(R))), axis=1) / scale  # (GᵀG)⁻¹ = R⁻¹ R⁻ᵀ
    return dict(zip(step_sizes, stds.tolist(), strict=True))
