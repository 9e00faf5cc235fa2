"""Implement the augmented filter with filterpy and with dynamax: the same 13 states, g and h as ours.

    x = (η, ν, d, κ, β);   g: Runge and Kutta, then d and κ in first order;   h: specific force and turning, with β

The gain is Kalman's, without gate and detection of rest, which both libraries lack. For filterpy the Jacobian of Runge
and Kutta is computed stage by stage, with disturbance and scales to the first order. The library dynamax differentiates
automatically. Only the numbers of the model are from our code.
"""

from typing import Any

import numpy as np

from benchmarks.matched import ACROSS, ALONG, DT, PUSH, SPIN, TWIST, I, M

MASS, DRAG = np.array([*M, I]), np.array([ALONG, ACROSS, SPIN])


def nu_dot(nu, u, np=np):
    """Return the acceleration ν̇ (3,) of the model without a disturbance."""
    turning = np.array([nu[1] * nu[2], -nu[0] * nu[2], 0.0])
    return (np.array([PUSH * u[0], 0.0, TWIST * u[2]]) - DRAG * nu) / MASS + turning


def next_state(x, u, keep, np=np):
    """Return g (13,), the state after a tick; `keep` (2,) is the factor by which a disturbance decays in a tick."""

    def rate(pose, nu):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        return np.array([c * nu[0] - s * nu[1], s * nu[0] + c * nu[1], nu[2]]), nu_dot(nu, u, np)

    pose, nu, d, kappa = x[:3], x[3:6], x[6:8], x[8:10]
    p1, n1 = rate(pose, nu)
    p2, n2 = rate(pose + 0.5 * DT * p1, nu + 0.5 * DT * n1)
    p3, n3 = rate(pose + 0.5 * DT * p2, nu + 0.5 * DT * n2)
    p4, n4 = rate(pose + DT * p3, nu + DT * n3)
    D = np.array([d[0], 0.0, d[1]])
    next_nu = nu + DT / 6.0 * (n1 + 2.0 * n2 + 2.0 * n3 + n4) + DT * D
    pose = pose + DT / 6.0 * (p1 + 2.0 * p2 + 2.0 * p3 + p4)
    shift = 0.5 * DT**2 * D + 0.5 * DT * np.array([kappa[0], kappa[0], kappa[1]]) * (nu + next_nu)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    pose = pose + np.array([c * shift[0] - s * shift[1], s * shift[0] + c * shift[1], shift[2]])
    return np.concatenate([pose, next_nu, keep * d, x[8:]])


def imu_readings(x, u, np=np):
    """Return h (3,), the predicted readings of the IMU."""
    nu = x[3:6]
    rate = nu_dot(nu, u, np)
    return np.array([rate[0] - nu[2] * nu[1] + x[6] + x[10], rate[1] + nu[2] * nu[0] + x[11], nu[2] + x[12]])


class Filterpy:
    """The augmented filter in filterpy, tick by tick."""

    def __init__(self, keep, P0, R, Q) -> None:
        from filterpy.kalman import ExtendedKalmanFilter

        class AugmentedEkf(ExtendedKalmanFilter):
            def predict_x(self, u=0):
                self.x = next_state(self.x, u, keep)

        self.ekf, self.keep = AugmentedEkf(dim_x=13, dim_z=3), keep
        self.ekf.x, self.ekf.P, self.ekf.Q, self.ekf.R = np.zeros(13), P0.copy(), R, Q  # Q and R are swapped

    def step(self, u, z):
        """Return the state (13,) after a tick with the command `u` and the reading `z`."""
        self.predicted(u)
        self.ekf.update(z, self._of_readings, lambda x: imu_readings(x, u))
        return self.ekf.x

    def predicted(self, u):
        """Return the filter after its prediction."""
        self.ekf.F = self._of_motion(self.ekf.x, u)
        self.ekf.predict(u)
        return self.ekf

    def _of_motion(self, x, u):
        F, identity, state, slope, total = np.eye(13), np.eye(6), x[:6], np.eye(6), np.zeros((6, 6))
        for weight, step in ((1.0, 0.5), (2.0, 0.5), (2.0, 1.0), (1.0, 0.0)):
            slope = self._rate(state) @ slope
            total += weight * slope
            c, s = np.cos(state[2]), np.sin(state[2])
            velocity = np.array([c * state[3] - s * state[4], s * state[3] + c * state[4], state[5]])
            state = x[:6] + step * DT * np.concatenate([velocity, nu_dot(state[3:], u)])
            slope = identity + step * DT * slope
        F[:6, :6] += DT / 6.0 * total
        F[3, 6] = F[5, 7] = DT
        F[6, 6], F[7, 7] = self.keep
        (psi, vx, vy, w) = x[2:6]
        c, s = np.cos(psi), np.sin(psi)
        F[0, 8], F[1, 8], F[2, 9] = DT * (c * vx - s * vy), DT * (s * vx + c * vy), DT * w
        return F

    def _rate(self, state):
        (psi, vx, vy, w), A = state[2:], np.zeros((6, 6))
        c, s = np.cos(psi), np.sin(psi)
        A[0, 2], A[1, 2] = -s * vx - c * vy, c * vx - s * vy
        A[:2, 3:5] = [[c, -s], [s, c]]
        A[2, 5] = 1.0
        A[3:, 3:] = self._drag(vx, vy, w)
        return A

    def _of_readings(self, x):
        vx, vy, w = x[3:6]
        H, A = np.zeros((3, 13)), self._drag(vx, vy, w)
        H[0, 3:6], H[1, 3:6] = A[0] - [0.0, w, vy], A[1] + [w, 0.0, vx]
        H[2, 5] = H[0, 6] = H[0, 10] = H[1, 11] = H[2, 12] = 1.0
        return H

    @staticmethod
    def _drag(vx, vy, w):
        return np.array([[0.0, w, vy], [-w, 0.0, -vx], [0.0, 0.0, 0.0]]) - np.diag(DRAG / MASS)


def dynamax(u, z, keep, P0, R, Q) -> Any:
    """Return a compiled function that returns the states (N, 13); ImportError if dynamax is not installed."""
    import jax
    import jax.numpy as jnp
    from dynamax.nonlinear_gaussian_ssm import ParamsNLGSSM, extended_kalman_filter

    jax.config.update("jax_enable_x64", True)
    first = Filterpy(keep, P0, R, Q).predicted(u[0])  # dynamax begins with a measurement
    params = ParamsNLGSSM(
        initial_mean=jnp.asarray(first.x), initial_covariance=jnp.asarray(first.P), dynamics_covariance=jnp.asarray(R),
        dynamics_function=lambda x, u: next_state(x, u, jnp.asarray(keep), jnp),
        emission_function=lambda x, u: imu_readings(x, u, jnp), emission_covariance=jnp.asarray(Q),
    )  # fmt: skip
    u, z = jnp.asarray(u), jnp.asarray(z)
    run = jax.jit(lambda: extended_kalman_filter(params, z, inputs=u).filtered_means)
    return lambda: np.asarray(run())
