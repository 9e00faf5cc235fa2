"""Replace the residual and the solver of `identify` by other classes and functions.

identify(run, file, residuals=Compressed, solver=by_scipy)
"""

import numpy as np
from scipy.optimize import minimize

from baqueano.identify import Residuals, solution_at

SHOCK = 0.3  # m/s² or rad/s: larger errors count as their logarithm


class Compressed(Residuals):
    """The residual r = k asinh((z − h)/k): large errors, as of a wheel at the edge of a tile, have little weight."""

    @staticmethod
    def difference(sensor, z, h):
        """Return the residual (m,) of a reading `z` (m,) and the model's `h` (m,), in the units of the sensor."""
        x = (z - h) / SHOCK
        return SHOCK * np.log(x + np.sqrt(x * x + 1.0))


def by_scipy(evaluate, theta, low, high, *, is_fixed, tolerance, max_evaluations, damping):
    """Minimise with SciPy's L-BFGS-B and the exact gradient; each entry of θ (p,) is scaled by its curvature."""
    moving = np.ones(len(theta), bool) if is_fixed is None else ~is_fixed
    start, unit = evaluate(theta), np.ones(len(theta))
    unit[moving] = 1.0 / np.sqrt(np.maximum(np.diagonal(np.asarray(start.hessian))[moving], 1e-12))

    def at(x):
        full = theta.copy()
        full[moving] = x * unit[moving]
        return np.clip(full, low, high)

    def cost_and_gradient(x):
        evaluation = evaluate(at(x))
        return evaluation.cost, evaluation.gradient[moving] * unit[moving]

    bounds = [(a / u, b / u) for a, b, u, m in zip(low, high, unit, moving, strict=True) if m]
    solution = minimize(
        cost_and_gradient, theta[moving] / unit[moving], jac=True, bounds=bounds, method="L-BFGS-B",
        options={"ftol": 1e-12, "maxiter": 500},
    )  # fmt: skip
    end = at(solution.x)
    return solution_at(end, evaluate(end), low, high, converged=solution.success, evaluations=solution.nfev)
