"""Simulate the model that the filters assume, and compute its bound, without any of our code.

    v̇_x = (K_x u_x − a v_x)/m + v_y r + d_x + w_x,   v̇_y = −b v_y/m − v_x r + w_y,
    ṙ = (K_r u_r − c r)/I + d_r + w_r,   ḋ = −d/T + w_d,   biases β̇ = w_β,   κ constant               (1)
    map: (ẋ, ẏ, ψ̇) = J(ψ) (1 + κ) (v_x, v_y, r)                                                          (2)
    z: v̇_x − v_y r − w_x + β_0,   v̇_y + v_x r − w_y + β_1,   r + β_2,   and v_x of an odometer          (3)

Four steps a tick: Runge and Kutta for the smooth part, half of a random walk before and half after each (Strang). The
posterior Cramér-Rao bound of Tichavsky, Muravchik and Nehorai (1998), over s = (v_x, v_y, r, d_x, d_r, β), has
expectations over all drives:  J⁺ = E[Q⁻¹] + E[Hᵀ N⁻¹ H] − E[Q⁻¹ F] (J + E[Fᵀ Q⁻¹ F])⁻¹ E[Fᵀ Q⁻¹]              (4)
No measurement depends on κ, so the bound of the estimated velocity, (1 + κ) v, is J⁻¹ plus σ_κ² E v².
"""

from typing import NamedTuple

import numpy as np

DT, STEPS = 0.01, 4
M, I = np.array([0.61, 0.61]), 0.0015
PUSH, TWIST, ALONG, ACROSS, SPIN = 3.0, 0.1, 3.0, 40.0, 0.012
POSE, NU, D, KAPPA, BETA = slice(0, 3), slice(3, 6), slice(6, 8), slice(8, 10), slice(10, 13)
INNER = [3, 4, 5, 6, 7, 10, 11, 12]  # s, as entries of x
# x in the filter's state: its course, sideslip and bend are certain in this model
OF_FILTER = [*range(10), 13, 14, 15]


class AssumedNoise(NamedTuple):
    """The noise that a filter assumes."""

    start: np.ndarray  # (13,) standard deviations of x = (η, ν, d, κ, β)
    walk: np.ndarray  # (3,) of ν in 1 s
    disturbance: np.ndarray  # (2,) of d
    fade_s: np.ndarray  # (2,)
    bias_walk: np.ndarray  # (3,) in 1 s
    reading: np.ndarray  # (4,) of a_x, a_y, gyro, odometer


class Drives(NamedTuple):
    """Simulated drives: N ticks of n vehicles under the same commands."""

    u: np.ndarray  # (N, 3)
    x: np.ndarray  # (N, n, 13)
    z: np.ndarray  # (N, n, 4)


def rates(x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return ẋ (n, 13) without noise, at x (n, 13), with β and d constant.  (1), (2)"""
    psi, vx, vy, r = x[:, 2:6].T
    scale, turn = 1.0 + x[:, 8], 1.0 + x[:, 9]
    cos, sin, out = np.cos(psi), np.sin(psi), np.zeros_like(x)
    out[:, 0], out[:, 1] = scale * (cos * vx - sin * vy), scale * (sin * vx + cos * vy)
    out[:, 2] = turn * r
    out[:, 3] = (PUSH * u[0] - ALONG * vx) / M[0] + vy * r + x[:, 6]
    out[:, 4] = -ACROSS * vy / M[1] - vx * r
    out[:, 5] = (TWIST * u[2] - SPIN * r) / I + x[:, 7]
    return out


def readings(x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return z (n, 4) without noise.  (3)"""
    rate, (vx, vy, r) = rates(x, u), x[:, NU].T
    z = [rate[:, 3] - vy * r + x[:, 10], rate[:, 4] + vx * r + x[:, 11], r + x[:, 12], vx]
    return np.stack(z, axis=1)


def drive_matched(assumed_noise: AssumedNoise, u: np.ndarray, n: int, seed: int) -> Drives:
    """Return n simulated drives under the commands u (N, 3).  (1)-(3)"""
    rng, h = np.random.default_rng(seed), DT / STEPS
    x, xs, zs = assumed_noise.start * rng.standard_normal((n, 13)), [], []
    x[:, D] = assumed_noise.disturbance * rng.standard_normal((n, 2))
    keep = np.exp(-0.5 * h / assumed_noise.fade_s)
    fresh = assumed_noise.disturbance * np.sqrt(1.0 - keep**2)
    walk, of_bias = (density * np.sqrt(0.5 * h) for density in (assumed_noise.walk, assumed_noise.bias_walk))

    def add_walk(x: np.ndarray) -> np.ndarray:
        draw, x = rng.standard_normal((n, 8)), x.copy()
        x[:, NU] += walk * draw[:, :3]
        x[:, D] = keep * x[:, D] + fresh * draw[:, 3:5]
        x[:, BETA] += of_bias * draw[:, 5:]
        return x

    for row in u:
        for _ in range(STEPS):
            x = add_walk(x)
            k1 = rates(x, row)
            k2 = rates(x + 0.5 * h * k1, row)
            k3 = rates(x + 0.5 * h * k2, row)
            x = add_walk(x + h / 6.0 * (k1 + 2.0 * (k2 + k3) + rates(x + h * k3, row)))
        xs.append(x)
        zs.append(readings(x, row) + assumed_noise.reading * rng.standard_normal((n, 4)))
    return Drives(u, np.stack(xs), np.stack(zs))


def bound(assumed_noise: AssumedNoise, drives: Drives, m: int) -> np.ndarray:
    """Return the least variances (N, 3) of an estimator of (1 + κ) v, with the first m readings.  (4)"""
    indices = [
        k for k in range(8) if k < 5 or assumed_noise.start[INNER[k]] > 0.0
    ]  # a bias without error is a constant
    states = [INNER[k] for k in indices]
    std = np.where(np.isin(INNER, range(6, 8)), 0.0, assumed_noise.start[INNER])
    std[3:5] = assumed_noise.disturbance
    J, out, before = np.diag(1.0 / std[indices] ** 2), np.empty((len(drives.u), 3)), None
    noise = np.concatenate(
        [
            assumed_noise.walk**2,
            2.0 * assumed_noise.disturbance**2 / assumed_noise.fade_s,
            assumed_noise.bias_walk**2,
        ]
    )
    for k, (row, x) in enumerate(zip(drives.u, drives.x, strict=True)):
        before = x if before is None else before
        F, Q = _transition(before, noise, assumed_noise.fade_s)
        F, W = F[:, indices][:, :, indices], np.linalg.inv(Q[:, indices][:, :, indices])
        WF = W @ F
        D11, D12, D22 = np.mean(np.swapaxes(F, 1, 2) @ WF, axis=0), np.mean(WF, axis=0), np.mean(W, axis=0)
        H = _slopes(x, row)[:, :m, states]
        information_of_readings = np.mean(
            np.swapaxes(H, 1, 2) @ (H / assumed_noise.reading[:m, None] ** 2), axis=0
        )
        J = D22 + information_of_readings - D12 @ np.linalg.solve(J + D11, D12.T)
        spread = np.repeat(assumed_noise.start[KAPPA], [2, 1]) ** 2
        out[k] = np.diag(np.linalg.inv(J))[:3] + spread * np.mean(x[:, NU] ** 2, axis=0)
        before = x
    return out


def _slopes(x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return H (n, 4, 13) by central differences of (3); they are exact, as (3) is of the second degree at most."""
    slopes = [(readings(x + step, u) - readings(x - step, u)) / 2e-3 for step in 1e-3 * np.eye(x.shape[1])]
    return np.stack(slopes, axis=2)


def _transition(x: np.ndarray, noise: np.ndarray, fade_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return F (n, 8, 8) of s over a tick, to the fourth order, and Q (n, 8, 8), summed over steps of h."""
    n, h = len(x), DT / STEPS
    (vx, vy, r), A = x[:, NU].T, np.zeros((len(x), 8, 8))
    A[:, 0, 0], A[:, 0, 1], A[:, 0, 2], A[:, 0, 3] = -ALONG / M[0], r, vy, 1.0
    A[:, 1, 0], A[:, 1, 1], A[:, 1, 2] = -r, -ACROSS / M[1], -vx
    A[:, 2, 2], A[:, 2, 4] = -SPIN / I, 1.0
    A[:, 3, 3], A[:, 4, 4] = -1.0 / fade_s
    identity, power = np.broadcast_to(np.eye(8), A.shape).copy(), np.eye(8)
    for k in range(1, 5):
        power = power @ A * (h / k)
        identity = identity + power
    F, Q, half = np.broadcast_to(np.eye(8), A.shape), np.zeros((n, 8, 8)), np.diag(0.5 * h * noise)
    for _ in range(STEPS):
        F, Q = identity @ F, identity @ (Q + half) @ np.swapaxes(identity, 1, 2) + half
    return F, Q
