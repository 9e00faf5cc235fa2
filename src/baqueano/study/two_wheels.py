"""A robot with two wheels whose physics shares nothing with the models that are fitted to it.

Its own equations, integrated by Runge and Kutta at 1 kHz, for n robots at once; nothing of vehicles/, sensors/,
simulate/ or symbolic/ is imported. With the body's origin between the wheels and the centre of mass c ahead of it:

    duty of a wheel  p = round(255 (u_x ∓ u_ψ)(t − d)) / 255,  within ±1                                  (1)
    motor            λ ḟ = g K (p − z sign p)₊ − f,   z the dead zone of this side and direction          (2)
    wheels           X = f_l + f_r − S(v_x) − a v_x − b |v_x| v_x,    N = (f_r − f_l) w/2 − S(ω) − …        (3)
    body             m (v̇_x − ω (v_y + c ω)) = X,   m (v̇_y + c ω̇ + ω v_x) = Y,   I ω̇ = N − c Y           (4)
    dry friction     S(v) = S₀ tanh(v/v₀) (1 + (k − 1) e^−(v/v_s)²),   breakaway k times that of driving  (5)

The same factor k raises a dead zone while its wheel stands. The IMU sits aside, turned and tilted, and shows the
instant at which it is read. Published figures of small gear motors: 0.6 m/s, dead zones of 0.27 to 0.34.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np

STEP_S = 1e-3
KEPT = 50  # commands that may still be on their way
GRAVITY = 9.80665


@dataclass(frozen=True)
class Robots:
    """Parameters of n robots: arrays (n,), or (n, 2) for left and right."""

    mass_kg: np.ndarray
    inertia_kg_m2: np.ndarray
    ahead_m: np.ndarray  # c
    track_m: np.ndarray  # w
    stall_n: np.ndarray  # K, of one wheel
    gain: np.ndarray  # g (n, 2)
    forward: np.ndarray  # z (n, 2)
    backward: np.ndarray  # z (n, 2)
    lag_s: np.ndarray  # λ
    delay_s: np.ndarray  # d
    supply: np.ndarray  # voltage, 1 at the identification
    viscous: np.ndarray  # a [N s/m]
    quadratic: np.ndarray  # b [N s²/m²]
    dry_n: np.ndarray  # S₀ ahead
    yaw_viscous: np.ndarray  # [N m s]
    yaw_dry_nm: np.ndarray
    tyre: np.ndarray  # sideways [N s/m]
    breakaway: np.ndarray  # k
    floor: np.ndarray  # (n, 3) white acceleration [m/s^1.5, m/s^1.5, rad/s^1.5]
    accel_bias: np.ndarray  # (n, 2)
    gyro_bias: np.ndarray
    imu_m: np.ndarray  # (n, 2) place
    imu_turn_rad: np.ndarray
    imu_tilt_rad: np.ndarray  # (n, 2)
    accel_noise: float = 0.1
    gyro_noise: float = 0.004
    dry_speed_m_s: float = 0.05  # v₀; ten times that in rad/s about z
    stribeck_m_s: float = 0.03  # v_s

    def changed(self, **values: Any) -> "Robots":
        """Return the robots with other parameters."""
        return replace(self, **values)

    def some(self, which: list[int]) -> "Robots":
        """Return a few of them."""
        return replace(self, **{name: value[which] for name, value in self._arrays()})

    def joined(self, others: "list[Robots]") -> "Robots":
        """Return these and the others as one group."""
        return replace(
            self, **{n: np.concatenate([v, *(getattr(o, n) for o in others)]) for n, v in self._arrays()}
        )

    def _arrays(self) -> list[tuple[str, np.ndarray]]:
        return [(f.name, v) for f in fields(self) if isinstance(v := getattr(self, f.name), np.ndarray)]


def drawn(n: int, seed: int) -> Robots:
    """Return n robots that differ as parts of one bag do."""
    draw = np.random.default_rng([seed, 20])

    def about(value: float, part: float, *more: int) -> np.ndarray:
        return value * (1.0 + part * draw.uniform(-1.0, 1.0, (n, *more)))

    return Robots(
        mass_kg=np.full(n, 0.61), inertia_kg_m2=about(0.0015, 0.1), ahead_m=about(0.008, 0.25),
        track_m=np.full(n, 0.12), stall_n=about(1.69, 0.1), gain=about(1.0, 0.05, 2), forward=about(0.29, 0.14, 2),
        backward=about(0.31, 0.14, 2), lag_s=about(0.05, 0.2), delay_s=draw.uniform(0.004, 0.017, n), supply=np.ones(n),
        viscous=about(3.3, 0.1), quadratic=about(0.8, 0.1), dry_n=about(0.25, 0.2), yaw_viscous=about(0.0115, 0.1),
        yaw_dry_nm=about(0.01, 0.2), tyre=about(40.0, 0.2), breakaway=np.ones(n),
        floor=np.tile([0.005, 0.002, 0.005], (n, 1)), accel_bias=draw.normal(0.0, 0.1, (n, 2)),
        gyro_bias=draw.normal(0.0, 0.01, n), imu_m=np.tile([0.02, 0.005], (n, 1)), imu_turn_rad=np.zeros(n),
        imu_tilt_rad=draw.normal(0.0, 0.015, (n, 2)),
    )  # fmt: skip


class Truth(NamedTuple):
    """Where n robots are at an instant."""

    eta: np.ndarray  # (n, 3) x, y [m], heading [rad], not wrapped
    nu: np.ndarray  # (n, 3) body frame
    nu_dot: np.ndarray  # (n, 3)


class TwoWheels:
    """n robots at rest at the poses `eta` (n, 3), each with noise of its own from `seed`."""

    def __init__(self, robots: Robots, seed: int, eta: np.ndarray | None = None) -> None:
        self.robots, n = robots, len(robots.mass_kg)
        self._noise = np.random.default_rng([seed, 21])
        self._x = np.zeros((n, 8))  # pose, velocity, force of the left and the right wheel
        if eta is not None:
            self._x[:, :3] = eta
        self._sent_s = np.full(KEPT, -np.inf)  # when the last commands were sent, and
        self._sent = np.zeros((KEPT, n, 3))  # the commands
        self.t_s = 0.0

    def tick(self, u: np.ndarray, dt_s: float) -> np.ndarray:
        """Return what the IMUs show (n, 3) after `dt_s` under the commands u (n, 3), sent from now on."""
        self._sent_s = np.append(self._sent_s[1:], self.t_s)
        self._sent = np.concatenate([self._sent[1:], np.array(u, dtype=float)[None]])
        steps = round(dt_s / STEP_S)
        kick = self.robots.floor * np.sqrt(STEP_S)
        for k in range(steps):
            at = self.t_s + k * STEP_S
            duty = self._duty(at + 0.5 * STEP_S)
            self._x = _runge_kutta(lambda x, duty=duty: self._rate(x, duty), self._x, STEP_S)
            self._x[:, 3:6] += kick * self._noise.standard_normal(kick.shape)
        self.t_s += steps * STEP_S
        return self._imu()

    @property
    def truth(self) -> Truth:
        """Where they are now."""
        rate = self._rate(self._x, self._duty(self.t_s - 0.5 * STEP_S))
        return Truth(self._x[:, :3].copy(), self._x[:, 3:6].copy(), rate[:, 3:6])

    def _duty(self, t_s: float) -> np.ndarray:
        """p (n, 2) at an instant.  (1)"""
        which = np.searchsorted(self._sent_s, t_s - self.robots.delay_s, side="right") - 1
        u = self._sent[which, np.arange(len(which))]
        p = np.stack([u[:, 0] - u[:, 2], u[:, 0] + u[:, 2]], axis=1)
        return self.robots.supply[:, None] * np.round(255.0 * np.clip(p, -1.0, 1.0)) / 255.0

    def _rate(self, x: np.ndarray, duty: np.ndarray) -> np.ndarray:
        """dx/dt (n, 8).  (2)-(5)"""
        q = self.robots
        psi, vx, vy, w = x[:, 2], x[:, 3], x[:, 4], x[:, 5]
        half = 0.5 * q.track_m
        rim = np.stack([vx - half * w, vx + half * w], axis=1)
        more = 1.0 + (q.breakaway[:, None] - 1.0) * np.exp(-((rim / q.stribeck_m_s) ** 2))
        zone = np.where(duty > 0.0, q.forward, q.backward) * more
        felt = np.sign(duty) * np.maximum(np.abs(duty) - zone, 0.0)
        force_dot = (q.gain * q.stall_n[:, None] * felt - x[:, 6:]) / q.lag_s[:, None]
        X = x[:, 6] + x[:, 7] - self._dry(vx, q.dry_n, 1.0) - q.viscous * vx - q.quadratic * np.abs(vx) * vx
        N = (x[:, 7] - x[:, 6]) * half - self._dry(w, q.yaw_dry_nm, 10.0) - q.yaw_viscous * w
        N = N - 0.0003 * np.abs(w) * w
        Y = -q.tyre * vy
        w_dot = (N - q.ahead_m * Y) / q.inertia_kg_m2
        vx_dot = X / q.mass_kg + w * (vy + q.ahead_m * w)
        vy_dot = Y / q.mass_kg - q.ahead_m * w_dot - w * vx
        c, s = np.cos(psi), np.sin(psi)
        pose_dot = np.stack([c * vx - s * vy, s * vx + c * vy, w], axis=1)
        return np.concatenate([pose_dot, np.stack([vx_dot, vy_dot, w_dot], axis=1), force_dot], axis=1)

    def _dry(self, v: np.ndarray, size: np.ndarray, scale: float) -> np.ndarray:
        """S(v) (n,).  (5)"""
        q = self.robots
        more = 1.0 + (q.breakaway - 1.0) * np.exp(-((v / (scale * q.stribeck_m_s)) ** 2))
        return size * more * np.tanh(v / (scale * q.dry_speed_m_s))

    def _imu(self) -> np.ndarray:
        """(n, 3): specific force along two axes and the turning rate, read at this instant."""
        q, truth = self.robots, self.truth
        (vx, vy, w), (vx_dot, vy_dot, w_dot) = truth.nu.T, truth.nu_dot.T
        lx, ly = q.imu_m.T
        along = vx_dot - w * vy - w * w * lx - w_dot * ly
        aside = vy_dot + w * vx - w * w * ly + w_dot * lx
        c, s = np.cos(q.imu_turn_rad), np.sin(q.imu_turn_rad)
        along, aside = c * along + s * aside, c * aside - s * along
        roll, pitch = q.imu_tilt_rad.T
        forward, left = (
            along * np.cos(pitch) - GRAVITY * np.sin(pitch),
            aside * np.cos(roll) + GRAVITY * np.sin(roll),
        )
        z = np.stack([forward, left, w], axis=1) + np.column_stack([q.accel_bias, q.gyro_bias])
        return z + self._noise.standard_normal(z.shape) * [q.accel_noise, q.accel_noise, q.gyro_noise]


def _runge_kutta(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray, h: float) -> np.ndarray:
    a = f(x)
    b = f(x + 0.5 * h * a)
    c = f(x + 0.5 * h * b)
    return x + h / 6.0 * (a + 2.0 * b + 2.0 * c + f(x + h * c))
