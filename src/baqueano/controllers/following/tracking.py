"""Compute the errors of a vehicle at the point of its path beside it, the inputs of a law of `ModelFollower`.

    e = J(ψ_p)⁻¹ (η_r − η_p) + b (1 − cos e_χ, − sin e_χ, 0),    e_χ = ψ_r + β_r − ψ_p − β_f              (2)
    e ← e + c(s) − (s, 0, 0),    e_χ ← e_χ + κ s                        errors at the point beside the vehicle (2a)

β = atan(ν_y / ν_x); b: from the centre of turning to the origin; c(s): along a circle of curvature κ. The index p is
the pose when a present command acts, (1) of response.py; f: (3) of model_following.py; r: reference.
"""

from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.controllers.following.response import TINY
from baqueano.geometry import pose_error, wrap
from baqueano.signals import Reference

MAX_ALONG_ERROR_M = 0.3  # limit of e_x: a larger error does not increase the requested speed
MAX_CATCH_UP_M_S = 0.3  # v_c, however large the gains are
MAX_ARC_M = 0.5  # of (2a): farther away, the path has another curvature
MIN_RADIUS_RATIO = 0.5  # of (2a): of the vehicle, relative to that of the circle
NEAR_M = 0.03  # of (6): a vehicle within this distance has joined its path
NEAR_S = 1.0  # of (6): time near the path before another approach; an oscillation crosses the path sooner
MAX_APPROACH_RAD = 0.9  # largest angle between course and path when a law approaches from far
MIN_COURSE_SPEED_M_S = 0.02  # below this speed the course is the heading


class Tracking(NamedTuple):
    """Inputs of a law of `ModelFollower`.

    Attributes
    ----------
    e : ndarray (3,) [m, m, rad]
        Error of the pose of the centre of turning, in the body frame: e_x along the path to the reference, at most
        MAX_ALONG_ERROR_M; e_y and e_ψ at the point of the path beside the vehicle.
    e_chi : float [rad]
        Error of the course, at the point of the path beside the vehicle.
    nu_f : ndarray (3,) [m/s, m/s, rad/s]
        Velocity of the reference without jumps, in the body frame; ν_y is that of the vehicle at this yaw rate.
    kappa : float [1/m]
        Curvature of the reference.
    forward_sign : float
        Direction of the reference [no unit]: 1 forward, −1 backward, 0 at rest, with a smooth transition.
    dt_s : float
        Time since the last tick.
    far_gain : float
        g of (6) of model_following.py [no unit]: 1 near the path, and up to 2 during an approach from far.

    Examples
    --------
    >>> now = Tracking(np.array([0.0, 0.1, 0.0]), 0.0, np.array([0.2, 0.0, 0.0]), 0.0, 1.0, 0.01)
    >>> print(now.e[1])
    0.1
    """

    e: np.ndarray
    e_chi: float
    nu_f: np.ndarray
    kappa: float
    forward_sign: float
    dt_s: Value
    far_gain: Value = 1.0

    def max_speed(self, v: Value) -> Value:
        """Return the larger speed [m/s] of the reference and of a request `v`, limited as in (4), for the gains."""
        return np.abs(self.nu_f[0]) + np.clip(np.abs(v) - np.abs(self.nu_f[0]), 0.0, MAX_CATCH_UP_M_S)


def tracking_errors(
    reference: Reference, eta_p: np.ndarray, nu_f: np.ndarray, turning_arm_m: np.ndarray, dt_s: Value, near_s: Value,
) -> tuple[Tracking, Value]:  # fmt: skip
    """Return the errors of a vehicle at η_p (3,) with the velocity ν_f (3,), and the new `near_s`.  (2), (2a)

    `turning_arm_m` is b, and `near_s` that of FollowerState.
    """
    eta_r, nu_r = reference.eta, reference.nu
    e_chi = wrap(eta_r[2] + slip(nu_r) - eta_p[2] - slip(nu_f))
    e = pose_error(eta_r, eta_p)
    e = e + turning_arm_m * np.array([1.0 - np.cos(e_chi), -np.sin(e_chi), 0.0])
    kappa = nu_r[2] * nu_r[0] / (nu_r[0] ** 2 + MIN_COURSE_SPEED_M_S**2)
    s = arc_to_vehicle(e, e_chi, kappa)
    x, y = point_ahead(e, e_chi, kappa, s)
    e_x = np.clip(x - s, -MAX_ALONG_ERROR_M, MAX_ALONG_ERROR_M)
    forward_sign = nu_f[0] / np.hypot(nu_f[0], MIN_COURSE_SPEED_M_S)
    e = np.array([e_x, y, e[2] + kappa * s])
    near_s = approach_clock(near_s, y, dt_s)
    return Tracking(e, e_chi + kappa * s, nu_f, kappa, forward_sign, dt_s, far_gain(y, near_s)), near_s


def slip(nu: np.ndarray) -> Value:
    """Return β [rad], the angle from the heading to the course for ν (3,); positive to the left, even backward.

    β is 0 at rest.  (2)
    """
    return np.arctan(nu[1] * nu[0] / (nu[0] * nu[0] + MIN_COURSE_SPEED_M_S**2))


def approach_clock(near_s: Value, e_y: Value, dt_s: Value) -> Value:
    """Return `near_s` of FollowerState one tick later, at the cross-track error `e_y` [m]."""
    is_far = np.abs(e_y) >= NEAR_M
    far_s = np.where(near_s >= NEAR_S, 2.0 * NEAR_S, near_s)
    return np.where(is_far, far_s, np.where(near_s > NEAR_S, 0.0, np.minimum(near_s + dt_s, NEAR_S)))


def far_gain(e_y: Value, near_s: Value) -> Value:
    """Return g, from 1 near the path to 2 far from it: the factor by which T limits k_y less.  (6)"""
    return np.where(near_s > NEAR_S, 2.0 - NEAR_M / np.maximum(np.abs(e_y), NEAR_M), 1.0)


def arc_to_vehicle(e: np.ndarray, e_chi: Value, kappa: Value) -> Value:
    """Return s [m], the distance along the path from the reference to the point beside the vehicle.  (2a)

    The path has the curvature `kappa` of the reference. It bends by at most 1 rad over s, and |s| is at most MAX_ARC_M.
    """
    along_m = np.cos(e_chi) * e[0] + np.sin(e_chi) * e[1]  # of the reference, from the vehicle
    across_m = np.cos(e_chi) * e[1] - np.sin(e_chi) * e[0]
    slope_m = -along_m / np.maximum(1.0 + kappa * across_m, MIN_RADIUS_RATIO)
    s = slope_m / (1.0 + (kappa * slope_m) ** 2 / 3.0)  # atan(κ slope_m) / κ, finite for κ = 0
    max_m = np.minimum(MAX_ARC_M, 1.0 / np.maximum(np.abs(kappa), TINY))
    return np.clip(s, -max_m, max_m)


def point_ahead(e: np.ndarray, e_chi: Value, kappa: Value, distance_m: Value) -> tuple[Value, Value]:
    """Return x and y [m], in the body frame, of the point of the path `distance_m` after the point with the error e.

    The path has the curvature `kappa`, and bends by at most 1 rad over `distance_m`.
    """
    angle = np.clip(kappa * distance_m, -1.0, 1.0)
    chord_m, chord = distance_m * (1.0 - angle**2 / 24.0), e_chi + 0.5 * angle
    return e[0] + chord_m * np.cos(chord), e[1] + chord_m * np.sin(chord)
