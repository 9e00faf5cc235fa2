"""Simulate robots with two wheels, with physics that is independent of the models fitted to them.

The origin of the body is between the wheels, and the centre of mass is c in front of it:
    duty of a wheel  q = round(255 (u_x ∓ u_ψ)(t − d)) / 255,  within ±1,  p = V (1 − s (|q_l| + |q_r|)/2) q    (1)
    motor            λ ḟ = g K (p − z sign p)₊ − γ e r − f,   z the dead zone of this side and direction     (2)
    forces           X = Σ (f + γ e r) − S(v_x) − a v_x − b |v_x| v_x − k_c v_x |ω|,   N = f_r w_r − …      (3)
    body             m (v̇_x − ω (v_y + c ω)) = X,   m (v̇_y + c ω̇ + ω v_x) = Y,   I ω̇ = N − c Y           (4)
    dry friction     S(v) = S₀ tanh(v/v₀) (1 + (k − 1) e^−(v/v_s)²),   at rest k times that in motion     (5)
    unequal wheels   of radius r relative to their mean: each has g K / r, and half of the motors' drag a,
                     a / r² at the speed of its rim                                                       (6)

V is the supply and s its sag; e r is the back-EMF, ½ a at the speed r of the rim. With γ = 1 the current lags, so the
back-EMF acts late too; with γ = 0 only the voltage lags. A wheel that toes in also pushes sideways. While a wheel is at
rest, its dead zone is multiplied by k. Between (2) and (3) is transmission.py, with ½ a as the back-EMF of a motor.
Published values of small gear motors are 0.6 m/s and dead zones of 0.27 to 0.34.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from baqueano.study.truth.group import Group
from baqueano.study.truth.imu import Imus, body_gravity
from baqueano.study.truth.transmission import Transmission

DRY_SPEED_M_S = 0.05  # v₀; ten times that in rad/s about z
STRIBECK_M_S = 0.03  # v_s, likewise
SIDES = np.array([-1.0, 1.0])
SPEED_SCALE = np.array([1.0, 1.0, 10.0])


@dataclass(frozen=True)
class Robots(Group):
    """Parameters of n robots: arrays (n,), or (n, 2) for left and right."""

    commands: ClassVar[int] = 3

    mass_kg: np.ndarray
    inertia_kg_m2: np.ndarray
    ahead_m: np.ndarray  # c
    arm_m: np.ndarray  # w (n, 2) from the origin to the wheels
    toe_rad: np.ndarray  # (n, 2) of the wheels, to the left
    stall_n: np.ndarray  # K, of one wheel
    gain: np.ndarray  # g (n, 2)
    wheel: np.ndarray  # r (n, 2) by their mean
    forward: np.ndarray  # z (n, 2)
    backward: np.ndarray  # z (n, 2)
    lag_s: np.ndarray  # λ
    delay_s: np.ndarray  # d
    supply: np.ndarray  # V, 1 at the identification
    sag: np.ndarray  # s, the part of the supply that is lost at full duty of both motors
    lagging_emf: np.ndarray  # γ, the part of the back-EMF that acts after the lag
    levels: np.ndarray  # of the duty: 255 of 8 bits
    viscous: np.ndarray  # (n, 3) a along, sideways (tyres), about z [N s/m, N s/m, N m s]
    quadratic: np.ndarray  # (n, 3) b
    cornering: np.ndarray  # k_c [kg/rad]
    dry: np.ndarray  # (n, 3) S₀ [N, N, N m]
    dry_speed_m_s: np.ndarray  # v₀; ten times that in rad/s about z
    breakaway: np.ndarray  # k
    floor: np.ndarray  # (n, 3) white acceleration [m/s^1.5, m/s^1.5, rad/s^1.5]
    slope_rad: np.ndarray  # rise of the floor
    slope_heading_rad: np.ndarray  # direction in which it rises
    transmission: Transmission
    imu: Imus

    @property
    def states(self) -> int:
        """Return the number of states: pose, velocity, force of both motors, and the states of the transmission."""
        return 8 + self.transmission.states(2)

    def rolling_speed(self, x: np.ndarray) -> np.ndarray:
        """Return the mean rolling speed (n,) of the wheels."""
        return x[:, 3] + self.transmission.slip(x[:, 8:])

    def state_derivative(self, u: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Return dx/dt (n, k) as a function of the states (n, k), under the commands in effect (n, 3).  (1)-(5)"""
        m, c, I, lag_s = self.mass_kg, self.ahead_m, self.inertia_kg_m2, self.lag_s[:, None]
        (left, right), (cos_toe, sin_toe), force_target = self.arm_m.T, self._toe, self._force_target(u)

        def rate(x: np.ndarray) -> np.ndarray:
            psi, vx, vy, w = x[:, 2], x[:, 3], x[:, 4], x[:, 5]
            target, force, cos, sin, x_dot = (
                force_target(x),
                x[:, 6:8],
                np.cos(psi),
                np.sin(psi),
                np.empty_like(x),
            )
            rim, emf = self._rim(x), 0.5 * self.viscous[:, :1]
            if self._has_lagging_emf:
                lagging_effort = self.lagging_emf[:, None] * emf * rim
                target, force = target - lagging_effort, force + lagging_effort
            if not self.transmission.is_ideal:
                target, force, x_dot[:, 8:] = self.transmission.transmit(x[:, 8:], target, force, rim, emf)
            longitudinal, lateral = force * cos_toe, force * sin_toe
            resistance = self._friction(x[:, 3:6]) + self._unequal_radii_friction(x[:, 3:6])
            g = self.gravity(psi)
            X = longitudinal[:, 0] + longitudinal[:, 1] - resistance[:, 0] - self.cornering * vx * np.abs(w)
            Y = lateral[:, 0] + lateral[:, 1] - resistance[:, 1]
            N = longitudinal[:, 1] * right - longitudinal[:, 0] * left - resistance[:, 2]
            w_dot = (N - c * Y) / I
            x_dot[:, 0], x_dot[:, 1], x_dot[:, 2] = cos * vx - sin * vy, sin * vx + cos * vy, w
            x_dot[:, 3] = X / m + g[:, 0] + w * (vy + c * w)
            x_dot[:, 4] = Y / m + g[:, 1] - c * w_dot - w * vx
            x_dot[:, 5] = w_dot
            x_dot[:, 6:8] = (target - x[:, 6:8]) / lag_s
            return x_dot

        return rate

    def gravity(self, heading_rad: np.ndarray) -> np.ndarray:
        """Return gravity along body x and y (n, 2)."""
        return body_gravity(self.slope_rad, self.slope_heading_rad - heading_rad)

    def _unequal_radii_friction(self, v: np.ndarray) -> np.ndarray | float:
        """Return the additional friction (n, 3) of wheels with unequal radii, at the velocities (n, 3).  (6)"""
        if not self._has_unequal_radii:
            return 0.0
        added_friction = (
            0.5 * self.viscous[:, :1] * (self.wheel**-2 - 1.0) * (v[:, :1] + v[:, 2:] * self.arm_m * SIDES)
        )
        yaw_friction = added_friction[:, 1] * self.arm_m[:, 1] - added_friction[:, 0] * self.arm_m[:, 0]
        return np.stack([added_friction[:, 0] + added_friction[:, 1], np.zeros(len(v)), yaw_friction], axis=1)

    @cached_property
    def _has_unequal_radii(self) -> bool:
        return bool(np.any(self.wheel != 1.0))

    @cached_property
    def _has_lagging_emf(self) -> bool:
        return bool(np.any(self.lagging_emf != 0.0))

    @cached_property
    def _has_breakaway(self) -> bool:
        return bool(np.any(self.breakaway != 1.0))

    @cached_property
    def _toe(self) -> tuple[np.ndarray, np.ndarray]:
        return np.cos(self.toe_rad), np.sin(self.toe_rad)

    @cached_property
    def _dry_speed(self) -> np.ndarray:
        return SPEED_SCALE * self.dry_speed_m_s[:, None]

    def _rim(self, x: np.ndarray) -> np.ndarray:
        """Return the rim speeds (n, 2) [m/s] of wheels without slip."""
        return x[:, 3, None] + x[:, 5, None] * self.arm_m * SIDES

    def _force_target(self, u: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Return the target forces (n, 2) of the motors as a function of the states.  (1), (2)"""
        duty, levels = u[:, :1] + u[:, 2:] * SIDES, self.levels[:, None]
        duty = np.round(levels * np.minimum(np.maximum(duty, -1.0), 1.0)) / levels
        voltage_ratio = 1.0 - self.sag * 0.5 * (np.abs(duty[:, 0]) + np.abs(duty[:, 1]))
        duty = (self.supply * voltage_ratio)[:, None] * duty
        zone = np.where(duty > 0.0, self.forward, self.backward)
        max_force_n = self.gain / self.wheel * self.stall_n[:, None]
        sign, magnitude = np.sign(duty), np.abs(duty)
        if not self._has_breakaway:
            steady = max_force_n * (sign * np.maximum(magnitude - zone, 0.0))
            return lambda x: steady

        def motor_forces(x: np.ndarray) -> np.ndarray:
            stribeck = np.exp(-((self._rim(x) / STRIBECK_M_S) ** 2))
            dead_zone = zone * (1.0 + (self.breakaway[:, None] - 1.0) * stribeck)
            return max_force_n * (sign * np.maximum(magnitude - dead_zone, 0.0))

        return motor_forces

    def _friction(self, v: np.ndarray) -> np.ndarray:
        """Return the friction in (X, Y, N) at the velocities (n, 3).  (3), (5)"""
        dry = self.dry * np.tanh(v / self._dry_speed)
        if self._has_breakaway:
            dry = dry * (
                1.0 + (self.breakaway[:, None] - 1.0) * np.exp(-((v / (SPEED_SCALE * STRIBECK_M_S)) ** 2))
            )
        return dry + (self.viscous + self.quadratic * np.abs(v)) * v


def draw_robots(n: int, seed: int) -> Robots:
    """Return n robots with the tolerances of real parts."""
    draw = np.random.default_rng([seed, 20])

    def about(value: float, part: float, *shape: int) -> np.ndarray:
        return value * (1.0 + part * draw.uniform(-1.0, 1.0, (n, *shape)))

    ones, three = np.ones(n), np.ones((n, 3))
    return Robots(
        mass_kg=0.61 * ones, inertia_kg_m2=about(0.0015, 0.1), ahead_m=about(0.008, 0.25), arm_m=np.full((n, 2), 0.06),
        toe_rad=np.zeros((n, 2)), stall_n=about(1.69, 0.1), gain=about(1.0, 0.05, 2), wheel=np.ones((n, 2)),
        forward=about(0.29, 0.14, 2), backward=about(0.31, 0.14, 2),
        lag_s=about(0.05, 0.2), delay_s=draw.uniform(0.004, 0.017, n), supply=ones, sag=0.0 * ones,
        lagging_emf=0.0 * ones, cornering=0.0 * ones, levels=255.0 * ones,
        viscous=np.stack([about(3.3, 0.1), about(40.0, 0.2), about(0.0115, 0.1)], axis=1),
        quadratic=np.stack([about(0.8, 0.1), 0.0 * ones, 0.0003 * ones], axis=1),
        dry=np.stack([about(0.25, 0.2), 0.0 * ones, about(0.01, 0.2)], axis=1), dry_speed_m_s=DRY_SPEED_M_S * ones,
        breakaway=ones, floor=np.array([0.005, 0.002, 0.005]) * three, slope_rad=0.0 * ones,
        slope_heading_rad=0.0 * ones, transmission=Transmission.ideal(n),
        imu=Imus(
            place_m=np.tile([0.02, 0.005], (n, 1)), turn_rad=0.0 * ones, tilt_rad=draw.normal(0.0, 0.015, (n, 2)),
            gyro_scale=ones, accel_scale=np.ones((n, 2)), cross_axis=np.zeros((n, 2)),
            bias=draw.normal(0.0, 1.0, (n, 3)) * [0.1, 0.1, 0.01],
            noise=np.array([0.1, 0.1, 0.004]) * three,
            walk=0.0 * three, step=0.0 * three, low_pass_s=np.zeros(n),
        ),
    )  # fmt: skip
