"""The Cramér-Rao bound of a simulator, by finite differences of that simulator.

    G = ∂h/∂θ by (h(θ + s) − h(θ − s)) / 2s,   b_i = √((Σ_t Gᵀ Q⁻¹ G)⁻¹)_ii                               (1)

h is what the IMU shows without noise, Q that noise. All parameters that a fit has free are in (1) together, the
biases too; neither outliers nor a walk of the biases nor the rounding of the converter are.
"""

import numpy as np

from baqueano.study.counterpart import robot_values, with_values
from baqueano.study.truth import Robots

STEP = 1e-3  # of a parameter
LEAST = {  # a step where the parameter may be 0
    "friction.quadratic": 1e-4, "actuator_matrix": 1e-4, "lever_arm": 1e-4, "heading": 1e-3, "bias": 1e-3,
    "friction.quadratic[1]": 0.1,
}  # fmt: skip


def steps(robot: Robots) -> dict[str, float]:
    """Return path → step s of (1), of one robot."""
    out = {}
    for path, value in robot_values(robot).items():
        least = [size for part, size in LEAST.items() if part in path]
        out[path] = STEP * abs(float(value[0])) or least[-1]
    return out


def beside(robot: Robots) -> Robots:
    """Return two robots per parameter (2p,): with one step more, then with one less."""
    of = steps(robot)
    group = robot.some([0] * (2 * len(of)))
    values = {}
    for k, (path, step) in enumerate(of.items()):
        values[path] = robot_values(group)[path].copy()
        values[path][2 * k] += step
        values[path][2 * k + 1] -= step
    return with_values(group, values)


def bound_of(quiet: np.ndarray, robot: Robots) -> dict[str, float]:
    """Return path → b of (1) from what the robots of `beside` show, (N, 2p, 3)."""
    of = steps(robot)
    slopes = (quiet[:, 0::2] - quiet[:, 1::2]) / (2.0 * np.array([*of.values()])[:, None])
    G = np.moveaxis(slopes / robot.imu.noise[0], 1, 2).reshape(-1, len(of))
    size = np.linalg.norm(G, axis=0)
    R = np.linalg.qr(G / size, mode="r")
    sd = np.linalg.norm(np.linalg.solve(R, np.eye(len(R))), axis=1) / size  # (GᵀG)⁻¹ = R⁻¹ R⁻ᵀ
    return dict(zip(of, sd.tolist(), strict=True))
