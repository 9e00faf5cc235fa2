"""Compute with angles and planar poses.

J(ψ) = [cos ψ  −sin ψ  0;  sin ψ  cos ψ  0;  0  0  1]      body → map, Grotz et al. `equ:J`      (1)
"""

from collections.abc import Sequence

import numpy as np

from baqueano.contracts.values import Value

__all__ = ["align", "compose", "map_from_body", "pose_error", "wrap"]

TAU = 2.0 * np.pi
TURNS_PER_RADIAN = 1.0 / TAU  # a product is faster than a quotient


def wrap(angle: Value) -> Value:
    """Return the angle wrapped to [−π, π).

    Parameters
    ----------
    angle : float or ndarray [rad]
        Any angle, of any shape.

    Returns
    -------
    float or ndarray [rad]
        Angle in [−π, π), in the same shape.

    Examples
    --------
    >>> print(f"{wrap(3.5 * np.pi) / np.pi:.1f} π")
    -0.5 π
    """
    return angle - TAU * np.floor(angle * TURNS_PER_RADIAN + 0.5)


def map_from_body(psi: Value) -> np.ndarray:
    """Return the matrix that transforms a velocity from the body frame to the map frame.

    Parameters
    ----------
    psi : float [rad]
        Heading, counter-clockwise from the x axis of the map.

    Returns
    -------
    ndarray (3, 3)
        J(ψ) [no unit], which multiplies a velocity of the body.

    Notes
    -----
    Grotz et al., `equ:J`.

    Examples
    --------
    >>> print(map_from_body(np.pi / 2).round(3) @ [1.0, 0.0, 0.0])
    [0. 1. 0.]
    """
    c, s = np.cos(psi), np.sin(psi)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def pose_error(eta_ref: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Return the error of the pose in the body frame: e = J(ψ)⁻¹ (η_ref − η); the heading error is wrapped.

    Parameters
    ----------
    eta_ref : ndarray (3,) [m, m, rad]
        Pose of the reference in the map.
    eta : ndarray (3,) [m, m, rad]
        Pose of the vehicle in the map.

    Returns
    -------
    ndarray (3,) [m, m, rad]
        Error along body x, error along body y, and error of the heading.

    Examples
    --------
    >>> print(pose_error(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, np.pi / 2])).round(2))
    [ 0.   -1.   -1.57]
    """
    d = eta_ref - eta
    e = map_from_body(eta[2]).T @ d
    return np.array([e[0], e[1], wrap(d[2])])


def compose(eta_a: np.ndarray, eta_b: np.ndarray) -> np.ndarray:
    """Return pose b in the map; `eta_b` gives it in the frame of pose a: map_from_a ∘ a_from_b.

    Parameters
    ----------
    eta_a : ndarray (3,) [m, m, rad]
        Pose a in the map.
    eta_b : ndarray (3,) [m, m, rad]
        Pose b relative to pose a.

    Returns
    -------
    ndarray (3,) [m, m, rad]
        Pose b in the map; the heading is wrapped.

    Examples
    --------
    >>> print(compose(np.array([1.0, 0.0, np.pi / 2]), np.array([0.5, 0.0, 0.0])).round(2))
    [1.   0.5  1.57]
    """
    d = map_from_body(eta_a[2]) @ eta_b
    return np.array([eta_a[0] + d[0], eta_a[1] + d[1], wrap(eta_a[2] + eta_b[2])])


def align(source_xy: np.ndarray, target_xy: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the rotation and the shift, without scale, that fit points to other points by least squares.

    Parameters
    ----------
    source_xy : ndarray (n, 2) [m]
        Points to move, in the first frame.
    target_xy : ndarray (n, 2) [m]
        Corresponding points in the second frame, in the same order.

    Returns
    -------
    angle : float [rad]
        Rotation about the origin, counter-clockwise.
    shift : ndarray (2,) [m]
        Shift in the second frame, added after the rotation.

    References
    ----------
    Kabsch, Acta Crystallographica A, 1976; without reflection.

    Examples
    --------
    >>> square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    >>> angle, shift = align(square, square + np.array([0.5, 0.0]))
    >>> print(f"{angle:.2f}", shift)
    -0.00 [0.5 0. ]
    """
    a, b = source_xy - source_xy.mean(axis=0), target_xy - target_xy.mean(axis=0)
    psi = np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))
    return float(psi), target_xy.mean(axis=0) - map_from_body(psi)[:2, :2] @ source_xy.mean(axis=0)


def axes_rotation(names: Sequence[str]) -> np.ndarray | None:
    """Return the rotation (3, 3) to axes that are named in the old frame; None for names without a rotation.

    Parameters
    ----------
    names : sequence of str
        The old axes that point along the new x, y and z, such as ("-y", "x", "z").

    Returns
    -------
    ndarray (3, 3) or None [no unit]
        The rotation; None if an axis is missing or unknown, or if the new axes are left-handed.

    Examples
    --------
    >>> axes_rotation(("x", "-y", "-z")) @ np.array([1.0, 2.0, 3.0])
    array([ 1., -2., -3.])
    """
    rows = {f"{'-' * (sign < 0)}{'xyz'[k]}": sign * np.eye(3)[k] for k in range(3) for sign in (1.0, -1.0)}
    if len(names) != 3 or not rows.keys() >= set(names):
        return None
    rotation = np.array([rows[name] for name in names])
    return rotation if round(np.linalg.det(rotation)) == 1 else None
