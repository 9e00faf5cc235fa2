"""Simulate cars as dynamic bicycles: tyres that slip and saturate, a motor and a servo that lag.

The origin is the centre of mass, a behind the front axle and b in front of the rear axle. The rear axle is driven.

    motor     λ Ḟ = K (u_t − z sign u_t)₊ − F                                                             (1)
    servo     λ_s δ̇ = k u_s + δ₀ − δ                                                                      (2)
    a tyre    at the velocity (v_∥, v_⊥) in its own plane:  s = −v_⊥ / √(v_∥² + ε²),  Y = D tanh(C s / D)  (3)
    body      m (v̇_x − ω v_y) = F − R(v_x) − Y_f sin δ,   m (v̇_y + ω v_x) = Y_f cos δ + Y_r                (4)
              I ω̇ = a Y_f cos δ − b Y_r,   R(v) = S₀ tanh(v/v₀) + r₁ v + r₂ |v| v                           (5)

Gravity on a slope is added to both equations of (4). transmission.py is between (1) and (4), with r₁ as back-EMF. On a
steady circle at small angles δ = L ω/v + U v ω, U = m (b C_r − a C_f) / (L C_f C_r): U > 0 understeers. The default
values are of a car of 1:18. An odometer turns with the rear wheels.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from baqueano.study.truth.group import Group
from baqueano.study.truth.imu import Imus, body_gravity
from baqueano.study.truth.transmission import Transmission

MIN_SLIP_SPEED_M_S = 0.1  # ε: below it a tyre is a damper


@dataclass(frozen=True)
class Cars(Group):
    """Parameters of n cars: arrays (n,), or (n, 2) for front and rear."""

    commands: ClassVar[int] = 2

    mass_kg: np.ndarray
    inertia_kg_m2: np.ndarray
    axle_m: np.ndarray  # (n, 2) a, b
    tyre_n_rad: np.ndarray  # C (n, 2)
    grip_n: np.ndarray  # D (n, 2)
    stall_n: np.ndarray  # K
    zone: np.ndarray  # z (n, 2) forward, backward
    lag_s: np.ndarray  # λ
    servo_rad: np.ndarray  # k
    servo_offset_rad: np.ndarray  # δ₀
    servo_lag_s: np.ndarray  # λ_s
    delay_s: np.ndarray
    dry_n: np.ndarray  # S₀
    dry_speed_m_s: np.ndarray  # v₀
    rolling: np.ndarray  # r₁ [N s/m]
    air_drag: np.ndarray  # r₂ [N s²/m²]
    floor: np.ndarray  # (n, 3) white acceleration
    slope_rad: np.ndarray  # rise of the floor
    slope_heading_rad: np.ndarray  # direction in which it rises
    transmission: Transmission
    imu: Imus

    @property
    def states(self) -> int:
        """Return the number of states: pose, velocity, motor force, steering angle, and the states of the
        transmission."""
        return 8 + self.transmission.states(1)

    def rolling_speed(self, x: np.ndarray) -> np.ndarray:
        """Return the rolling speed (n,) of the rear wheels."""
        return x[:, 3] + self.transmission.slip(x[:, 8:])

    def state_derivative(self, u: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Return dx/dt (n, k) as a function of the states (n, k), under the commands in effect (n, 2).  (1)-(5)"""
        m, (a, b) = self.mass_kg, self.axle_m.T
        zone = np.where(u[:, 0] > 0.0, self.zone[:, 0], self.zone[:, 1])
        force_target = self.stall_n * (
            np.sign(u[:, 0]) * np.maximum(np.minimum(np.abs(u[:, 0]), 1.0) - zone, 0.0)
        )
        angle_target = self.servo_rad * u[:, 1] + self.servo_offset_rad

        def rate(x: np.ndarray) -> np.ndarray:
            (psi, vx, vy, w, force, delta), g = x[:, 2:8].T, self.gravity(x[:, 2])
            target, F, x_dot = force_target, force, np.empty_like(x)
            if not self.transmission.is_ideal:
                wheel = (force_target[:, None], force[:, None], vx[:, None], self.rolling[:, None])
                target, F, x_dot[:, 8:] = self.transmission.transmit(x[:, 8:], *wheel)
                target, F = target[:, 0], F[:, 0]
            cos, sin = np.cos(delta), np.sin(delta)
            front, rear = vy + a * w, vy - b * w
            Yf = self._sideways(0, vx * cos + front * sin, front * cos - vx * sin)
            Yr = self._sideways(1, vx, rear)
            R = (
                self.dry_n * np.tanh(vx / self.dry_speed_m_s)
                + (self.rolling + self.air_drag * np.abs(vx)) * vx
            )
            c, s = np.cos(psi), np.sin(psi)
            x_dot[:, 0], x_dot[:, 1], x_dot[:, 2] = c * vx - s * vy, s * vx + c * vy, w
            x_dot[:, 3] = (F - R - Yf * sin) / m + w * vy + g[:, 0]
            x_dot[:, 4] = (Yf * cos + Yr) / m - w * vx + g[:, 1]
            x_dot[:, 5] = (a * Yf * cos - b * Yr) / self.inertia_kg_m2
            x_dot[:, 6], x_dot[:, 7] = (
                (target - force) / self.lag_s,
                (angle_target - delta) / self.servo_lag_s,
            )
            return x_dot

        return rate

    def gravity(self, heading_rad: np.ndarray) -> np.ndarray:
        """Return gravity along body x and y (n, 2)."""
        return body_gravity(self.slope_rad, self.slope_heading_rad - heading_rad)

    @property
    def understeer(self) -> np.ndarray:
        """Return the understeer U (n,) [rad s²/m]."""
        (a, b), (front, rear) = self.axle_m.T, self.tyre_n_rad.T
        return self.mass_kg * (b * rear - a * front) / ((a + b) * front * rear)

    def _sideways(self, axle: int, v_x: np.ndarray, v_y: np.ndarray) -> np.ndarray:
        """Return the sideways force Y (n,) of an axle.  (3)"""
        slip = -v_y / np.sqrt(v_x**2 + MIN_SLIP_SPEED_M_S**2)
        return self.grip_n[:, axle] * np.tanh(self.tyre_n_rad[:, axle] * slip / self.grip_n[:, axle])


def draw_cars(n: int, seed: int) -> Cars:
    """Return n cars with the tolerances of real parts. They understeer a little: U is about 0.008 rad s²/m."""
    draw = np.random.default_rng([seed, 30])

    def about(value: float, part: float) -> np.ndarray:
        return value * (1.0 + part * draw.uniform(-1.0, 1.0, n))

    ones, three = np.ones(n), np.ones((n, 3))
    return Cars(
        mass_kg=0.5 * ones, inertia_kg_m2=about(0.0022, 0.1), axle_m=np.full((n, 2), 0.075),
        tyre_n_rad=np.stack([about(15.0, 0.1), about(22.0, 0.1)], axis=1), grip_n=np.full((n, 2), 2.2),
        stall_n=about(3.7, 0.1), zone=np.stack([about(0.03, 0.3), about(0.03, 0.3)], axis=1), lag_s=about(0.03, 0.2),
        servo_rad=about(0.47, 0.05), servo_offset_rad=draw.normal(0.0, 0.005, n), servo_lag_s=about(0.045, 0.1),
        delay_s=draw.uniform(0.024, 0.037, n), dry_n=about(0.3, 0.1), dry_speed_m_s=0.05 * ones,
        rolling=about(0.9, 0.1), air_drag=about(0.025, 0.2), floor=0.0 * three, slope_rad=0.0 * ones,
        slope_heading_rad=0.0 * ones, transmission=Transmission.ideal(n),
        imu=Imus(
            place_m=np.zeros((n, 2)), turn_rad=0.0 * ones, tilt_rad=draw.normal(0.0, 0.01, (n, 2)),
            gyro_scale=ones, accel_scale=np.ones((n, 2)), cross_axis=np.zeros((n, 2)),
            bias=draw.normal(0.0, 1.0, (n, 3)) * [0.1, 0.1, 0.005],
            noise=np.array([0.6, 1.1, 0.05]) * three,
            walk=0.0 * three, step=0.0 * three, low_pass_s=np.zeros(n),
        ),
    )  # fmt: skip
