"""Implement the same fit in JAX: the model in jax.numpy, `lax.scan`, forward derivatives, jit.

One compiled function in 64 bit computes all that depends on θ: simulation, sensitivities (`jacfwd`), Huber's weights,
normal equations. A second function computes the standard errors at the end. The state is only the velocity, which is
enough for an IMU. The optimiser is ours, with this function; compiling is not counted.
"""

from collections.abc import Callable

import numpy as np

from baqueano.identify.estimation.search import FINE_DECREMENT
from baqueano.numerics.least_squares import Solution, minimise
from baqueano.numerics.normal_equations import Evaluation
from benchmarks import peers

BEND = 1.345
UNROLL = 1  # ticks per pass of the loop: 1 is much faster than 4 and 16


def of(
    u: np.ndarray, z: np.ndarray, sigma: np.ndarray, m: float, I: float
) -> tuple[Callable[[np.ndarray], Solution], Callable[[np.ndarray], tuple[Solution, np.ndarray]]]:
    """Return two functions of the start (15,): the search, and the search with the standard errors (15,)."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    mass, u, z, sigma = jnp.array([m, m, I]), jnp.asarray(u), jnp.asarray(z), jnp.asarray(sigma)

    def nu_dot(nu, uk, theta):
        tau = theta[6:].reshape(3, 3) @ uk
        turning = jnp.array([m * nu[1] * nu[2], -m * nu[0] * nu[2], 0.0])
        return (tau + turning - (theta[:3] + theta[3:6] * jnp.abs(nu)) * nu) / mass

    def tick(nu, uk, theta):
        a = nu_dot(nu, uk, theta)
        b = nu_dot(nu + 0.5 * peers.DT * a, uk, theta)
        c = nu_dot(nu + 0.5 * peers.DT * b, uk, theta)
        d = nu_dot(nu + peers.DT * c, uk, theta)
        nu = nu + peers.DT / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        rates = nu_dot(nu, uk, theta)
        return nu, jnp.array([rates[0], rates[1], nu[2]])

    def residuals(theta):
        _, h = jax.lax.scan(lambda nu, uk: tick(nu, uk, theta), jnp.zeros(3), u, unroll=UNROLL)
        r = ((z - h) / sigma).ravel()
        return r, r

    @jax.jit
    def all_of(theta):
        slopes, r = jax.jacfwd(residuals, has_aux=True)(theta)
        size = jnp.abs(r)
        rho = jnp.where(size <= BEND, 0.5 * r * r, BEND * size - 0.5 * BEND**2)
        weighted_slopes = jnp.minimum(1.0, BEND / jnp.maximum(size, 1e-300))[:, None] * slopes
        return rho.sum(), weighted_slopes.T @ r, weighted_slopes.T @ slopes

    @jax.jit
    def errors_of(theta):
        slopes, r = jax.jacfwd(residuals, has_aux=True)(theta)
        size = jnp.abs(r)
        bread = (slopes * (size < BEND)[:, None]).T @ slopes
        meat = (slopes * jnp.minimum(size, BEND)[:, None] ** 2).T @ slopes
        half = jnp.linalg.solve(bread, jnp.linalg.cholesky(meat))
        return jnp.sqrt(jnp.sum(half * half, axis=1) * len(r) / (len(r) - len(theta)))

    def evaluate(theta):
        cost, gradient, hessian = all_of(theta)
        return Evaluation(float(cost), np.asarray(gradient), np.asarray(hessian))

    low = np.array([0.0] * 6 + [-np.inf] * 9)

    def search(first):
        return minimise(evaluate, first, low, np.full(15, np.inf), tolerance=FINE_DECREMENT)

    def fit(first):
        solution = search(first)
        return solution, np.asarray(errors_of(solution.theta))

    return search, fit
