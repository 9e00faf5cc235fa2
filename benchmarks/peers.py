"""Implement the paper's equations in NumPy and a Python loop, as is usual, without any of our code.

    M ν̇ = T u − C(ν)ν − D(ν)ν,   η̇ = J(ψ) ν,   RK4 at a fixed step                                      (1)

It is written as a careful student would write it: small matrices, without tricks and unnecessary work.
"""

import numpy as np

DT = 0.01


def parameters():
    """Return θ (15,) of case study I: d_l, d_c, T by rows; mass and inertia."""
    return np.array([7.0, 7.0, 500.553, 3.5, 3.5, 250.0, 1, 0, 0, 0, 1, 0, 0, 0, 29.99]), 1.47, 810.44


def right_hand_side(x, u, theta, m, I):
    """Return ẋ (6,) of x = (η, ν).  (1)"""
    psi, nu = x[2], x[3:]
    J = np.array([[np.cos(psi), -np.sin(psi), 0.0], [np.sin(psi), np.cos(psi), 0.0], [0.0, 0.0, 1.0]])
    C = np.array([[0.0, 0.0, -m * nu[1]], [0.0, 0.0, m * nu[0]], [0.0, 0.0, 0.0]])
    D = np.diag(theta[:3] + theta[3:6] * np.abs(nu))
    tau = theta[6:].reshape(3, 3) @ u
    nu_dot = (tau - C @ nu - D @ nu) / np.array([m, m, I])
    return np.concatenate([J @ nu, nu_dot])


def simulate(u, theta, m, I):
    """Return the states (N, 6) at the ends of N ticks, from rest."""
    x = np.zeros(6)
    out = np.empty((len(u), 6))
    for k, uk in enumerate(u):
        k1 = right_hand_side(x, uk, theta, m, I)
        k2 = right_hand_side(x + 0.5 * DT * k1, uk, theta, m, I)
        k3 = right_hand_side(x + 0.5 * DT * k2, uk, theta, m, I)
        k4 = right_hand_side(x + DT * k3, uk, theta, m, I)
        x = x + DT / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        out[k] = x
    return out


def measurements(u, theta, m, I):
    """Return the readings (N, 3) of the paper's IMU: ν̇_x, ν̇_y, ν_ψ."""
    x = simulate(u, theta, m, I)
    out = np.empty((len(u), 3))
    for k, uk in enumerate(u):
        out[k, :2] = right_hand_side(x[k], uk, theta, m, I)[3:5]
    out[:, 2] = x[:, 5]
    return out


def simulate_many(u, theta, m, I):
    """Return the final states (L, 6) of L vehicles, θ (L, 15): the same equations, vectorised over the vehicles."""

    def f(x, uk):
        c, s, nu = np.cos(x[2]), np.sin(x[2]), x[3:]
        tau = np.einsum("ijl,j->il", T, uk)
        drag = (theta[:, :3].T + theta[:, 3:6].T * np.abs(nu)) * nu
        nu_dot = (tau - drag) / np.array([m, m, I])[:, None]
        return np.stack(
            [
                c * nu[0] - s * nu[1],
                s * nu[0] + c * nu[1],
                nu[2],
                nu_dot[0] + nu[2] * nu[1],
                nu_dot[1] - nu[2] * nu[0],
                nu_dot[2],
            ]
        )

    T = np.moveaxis(theta[:, 6:].reshape(-1, 3, 3), 0, -1)
    x = np.zeros((6, len(theta)))
    for uk in u:
        k1 = f(x, uk)
        k2 = f(x + 0.5 * DT * k1, uk)
        k3 = f(x + 0.5 * DT * k2, uk)
        k4 = f(x + DT * k3, uk)
        x = x + DT / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return x.T


def filtered(u, z, theta, m, I, Q, R, P0):
    """Return velocities and accelerations (N, 6) of the paper's EKF in filterpy, with the paper's Jacobian in NumPy."""
    from filterpy.kalman import ExtendedKalmanFilter

    T, mass = theta[6:].reshape(3, 3), np.array([m, m, I])
    H = np.zeros((3, 6))
    H[0, 3] = H[1, 4] = H[2, 2] = 1.0

    def jacobian(x):
        nu = x[:3]
        drag = (theta[:3] + 2.0 * theta[3:6] * np.abs(nu)) / mass
        A = np.diag(-drag)
        A[0, 1], A[0, 2] = nu[2], nu[1]
        A[1, 0], A[1, 2] = -nu[2], -nu[0]
        return np.block([[np.eye(3), DT * np.eye(3)], [A, np.zeros((3, 3))]])

    class Paper(ExtendedKalmanFilter):
        def predict_x(self, u=0):
            nu = self.x[:3]
            turn = np.array([nu[2] * nu[1], -nu[2] * nu[0], 0.0])
            drag = (theta[:3] + theta[3:6] * np.abs(nu)) * nu
            self.x = np.concatenate([nu + DT * self.x[3:], (T @ u - drag) / mass + turn])

    ekf = Paper(dim_x=6, dim_z=3)
    ekf.x, ekf.P, ekf.Q, ekf.R = np.zeros(6), P0.copy(), R, Q  # filterpy swaps the letters
    out = np.empty((len(u), 6))
    for k in range(len(u)):
        ekf.F = jacobian(ekf.x)
        ekf.predict(u[k])
        ekf.update(z[k], lambda x: H, lambda x: H @ x)
        out[k] = ekf.x
    return out


def drive_loop(gains, route_t, route_eta, limit, theta, m, I, ticks, weight, huber):
    """Return the paper's cost of a drive with its PD controller, simulated in a Python loop."""
    x, u, last, cost = np.zeros(6), np.zeros(3), None, 0.0
    for k in range(ticks):
        k1 = right_hand_side(x, u, theta, m, I)
        k2 = right_hand_side(x + 0.5 * DT * k1, u, theta, m, I)
        k3 = right_hand_side(x + 0.5 * DT * k2, u, theta, m, I)
        k4 = right_hand_side(x + DT * k3, u, theta, m, I)
        x = x + DT / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        ref = np.array([np.interp(k * DT % route_t[-1], route_t, column) for column in route_eta.T])
        d = ref - x[:3]
        d[2] = (d[2] + np.pi) % (2.0 * np.pi) - np.pi
        r = np.sqrt(d[0] ** 2 + d[1] ** 2 + (weight * d[2]) ** 2)
        cost += 0.5 * r * r if r <= huber else huber * r - 0.5 * huber**2
        e_x = np.cos(x[2]) * d[0] + np.sin(x[2]) * d[1]
        change = 0.0 if last is None else ((d[2] - last + np.pi) % (2.0 * np.pi) - np.pi) / DT
        last = d[2]
        u = np.clip([gains[0] * e_x, 0.0, gains[1] * d[2] + gains[2] * change], -limit, limit)
    return cost


def driven_many(gains, start, route_t, route_eta, limit, theta, m, I, ticks, weight, huber):
    """Return the cost (L,) for L sets of gains (L, 3) from the pose `start`, vectorised over the drives."""
    T, mass, (k_x, k_psi, k_rate) = theta[6:].reshape(3, 3), np.array([m, m, I])[:, None], gains.T

    def f(x, u):
        c, s, nu = np.cos(x[2]), np.sin(x[2]), x[3:]
        drag = (theta[:3, None] + theta[3:6, None] * np.abs(nu)) * nu
        nu_dot = (T @ u - drag) / mass
        acceleration = nu_dot[0] + nu[2] * nu[1], nu_dot[1] - nu[2] * nu[0]
        return np.stack([c * nu[0] - s * nu[1], s * nu[0] + c * nu[1], nu[2], *acceleration, nu_dot[2]])

    x = np.zeros((6, len(gains)))
    x[:3] = np.asarray(start)[:, None]
    u, cost, last = np.zeros((3, len(gains))), np.zeros(len(gains)), None
    reference = [np.interp(np.arange(ticks) * DT % route_t[-1], route_t, column) for column in route_eta.T]
    for k in range(ticks):
        k1 = f(x, u)
        k2 = f(x + 0.5 * DT * k1, u)
        k3 = f(x + 0.5 * DT * k2, u)
        k4 = f(x + DT * k3, u)
        x = x + DT / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        d = np.stack([column[k] - x[i] for i, column in enumerate(reference)])
        d[2] = (d[2] + np.pi) % (2.0 * np.pi) - np.pi
        r = np.sqrt(d[0] ** 2 + d[1] ** 2 + (weight * d[2]) ** 2)
        cost += np.where(r <= huber, 0.5 * r * r, huber * r - 0.5 * huber**2)
        e_x = np.cos(x[2]) * d[0] + np.sin(x[2]) * d[1]
        change = 0.0 if last is None else ((d[2] - last + np.pi) % (2.0 * np.pi) - np.pi) / DT
        last = d[2]
        command = np.stack([k_x * e_x, np.zeros_like(e_x), k_psi * d[2] + k_rate * change])
        u = np.clip(command, -limit[:, None], limit[:, None])
    return cost
