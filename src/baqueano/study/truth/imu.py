"""Simulate n inertial measurement units, each with an offset from the origin, a rotation and a tilt.

A unit is at (l_x, l_y) from the origin.
It is turned by ζ to the left, then rolled by φ and pitched by θ (positive nose down):

    f = (v̇_x − ω v_y − ω² l_x − ω̇ l_y,  v̇_y + ω v_x − ω² l_y + ω̇ l_x) − gravity along the floor          (1)
    a_x = cos θ f_x' − sin θ g,    a_y = cos φ f_y' + sin φ (sin θ f_x' + cos θ g),   ω_z = s cos φ cos θ ω (2)

s is the scale of the gyro. The accelerometers have scales too, and each contains a small part of the other one. A
first-order low-pass can follow. A bias is a random walk from reading to reading; the converter rounds to whole steps.
"""

from dataclasses import dataclass

import numpy as np

from baqueano.study.truth.group import Group, TruthGroup

GRAVITY = 9.80665


def body_gravity(slope_rad: np.ndarray, uphill_rad: np.ndarray) -> np.ndarray:
    """Return gravity along body x and y (n, 2) on floors of slope `slope_rad` (n,), uphill at `uphill_rad` from x."""
    if not np.any(slope_rad):
        return np.zeros((len(slope_rad), 2))
    downhill = -GRAVITY * np.sin(slope_rad)
    return np.stack([downhill * np.cos(uphill_rad), downhill * np.sin(uphill_rad)], axis=1)


@dataclass(frozen=True)
class Imus(Group):
    """Mounts and errors of n inertial measurement units."""

    place_m: np.ndarray  # (n, 2)
    turn_rad: np.ndarray  # (n,)
    tilt_rad: np.ndarray  # (n, 2) roll, pitch
    gyro_scale: np.ndarray  # (n,)
    accel_scale: np.ndarray  # (n, 2) of a_x and a_y
    cross_axis: np.ndarray  # (n, 2) part of a_y in the reading of a_x, and part of a_x in the reading of a_y
    bias: np.ndarray  # (n, 3) [m/s², m/s², rad/s], like all below
    noise: np.ndarray  # (n, 3) of one reading
    walk: np.ndarray  # (n, 3) of the bias in 1 s
    step: np.ndarray  # (n, 3) of the converter, 0 for none
    low_pass_s: np.ndarray  # (n,) time constant of a low-pass before it, 0 for none

    def noiseless_readings(self, truth: TruthGroup, floor: np.ndarray) -> np.ndarray:
        """Return the readings (n, 3) without noise; `floor` (n, 2) is gravity along x and y."""
        (vx, vy, w), (vx_dot, vy_dot, w_dot) = truth.nu.T, truth.nu_dot.T
        lx, ly = self.place_m.T
        a_x = vx_dot - w * vy - w * w * lx - w_dot * ly - floor[:, 0]
        a_y = vy_dot + w * vx - w * w * ly + w_dot * lx - floor[:, 1]
        c, s = np.cos(self.turn_rad), np.sin(self.turn_rad)
        a_x, a_y = c * a_x + s * a_y, c * a_y - s * a_x
        (cr, cp), (sr, sp) = np.cos(self.tilt_rad).T, np.sin(self.tilt_rad).T
        forward = cp * a_x - sp * GRAVITY
        left = cr * a_y + sr * (sp * a_x + cp * GRAVITY)
        (sx, sy), (kx, ky) = self.accel_scale.T, self.cross_axis.T
        forward, left = sx * forward + kx * left, sy * left + ky * forward
        return np.stack([forward, left, self.gyro_scale * cr * cp * w], axis=1) + self.bias

    def readings(self, noise_free: np.ndarray, drift: np.ndarray, unit_noise: np.ndarray) -> np.ndarray:
        """Return the rounded readings (n, 3): `noise_free` readings, plus `drift`, plus the noise of the chip. The
        noise is `unit_noise`, normal with a variance of 1, times the standard deviation."""
        z = noise_free + drift + self.noise * unit_noise
        divisor = np.where(self.step > 0.0, self.step, 1.0)
        return np.where(self.step > 0.0, divisor * np.round(z / divisor), z)
