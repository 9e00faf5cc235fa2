"""Angles and planar poses.

J(ψ) = [cos ψ  −sin ψ  0;  sin ψ  cos ψ  0;  0  0  1]      body → map, Grotz et al. `equ:J`      (1)
"""

import numpy as np

from baqueano.contracts.values import Value

TAU = 2.0 * np.pi


def wrap(angle: Value) -> Value:
    """`angle` [rad] brought to [−π, π); same shape."""
    return angle - TAU * np.floor((angle + np.pi) / TAU)


def map_from_body(psi: Value) -> np.ndarray:
    """J(ψ), (3, 3): turns a velocity in the body frame into one in the map frame.  (1)"""
    c, s = np.cos(psi), np.sin(psi)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def pose_error(eta_ref: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """e = J(ψ)⁻¹ (η_ref − η), (3,): the reference seen from the body, heading difference wrapped."""
    d = eta_ref - eta
    e = map_from_body(eta[2]).T @ d
    return np.array([e[0], e[1], wrap(d[2])])


def compose(eta_a: np.ndarray, eta_b: np.ndarray) -> np.ndarray:
    """map_from_a ∘ a_from_b, (3,): pose b, given in the frame of pose a, seen from the map."""
    d = map_from_body(eta_a[2]) @ eta_b
    return np.array([eta_a[0] + d[0], eta_a[1] + d[1], wrap(eta_a[2] + eta_b[2])])


def align(xy_from: np.ndarray, xy_to: np.ndarray) -> tuple[float, np.ndarray]:
    """Rigid alignment in the plane: angle [rad] and shift (2,) [m] that take `xy_from` (n, 2) nearest to
    `xy_to` (n, 2) in least squares.  Kabsch 1976, without reflection; no scale."""
    a, b = xy_from - xy_from.mean(axis=0), xy_to - xy_to.mean(axis=0)
    psi = np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))
    return float(psi), xy_to.mean(axis=0) - map_from_body(psi)[:2, :2] @ xy_from.mean(axis=0)
