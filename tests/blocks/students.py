"""A good block for every package, as a student writes it. The tests break these blocks, each in one place."""

from baqueano.block_checks import check
from baqueano.blocks import resolve

HEAD = '''"""A block of a student."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.geometry import pose_error, wrap
from baqueano.signals import Command, Estimate, Motion, Reference, Slot


'''
FROZEN = "@dataclass(frozen=True, slots=True, eq=False)\n"

ESTIMATOR = (
    HEAD
    + """class Belief(NamedTuple):
    t_ns: int
    eta: np.ndarray
    cov: np.ndarray


"""
    + FROZEN
    + """class Block:
    def init(self):
        return Belief(-1, np.zeros(3), np.eye(6))

    def step(self, belief, tick):
        dt = np.where(belief.t_ns < 0, 0.0, (tick.t_ns - belief.t_ns) * 1e-9)
        z = tick.sensors.imu.z
        omega = np.where(np.isfinite(z[2]), z[2], 0.0)
        eta = belief.eta + dt * np.array([0.0, 0.0, omega])
        eta = np.array([eta[0], eta[1], wrap(eta[2])])
        cov = belief.cov + dt * np.eye(6)
        return Belief(tick.t_ns, eta, cov), Estimate(tick.t_ns, eta, np.zeros(3), cov)
"""
)

CONTROLLER = (
    HEAD
    + FROZEN
    + """class Block:
    gain: float = 2.0

    def init(self):
        return 0.0

    def step(self, state, reference, estimate):
        e = pose_error(reference.eta, estimate.eta)
        u = np.array([self.gain * e[0], 0.0, e[2]])
        return state + 1.0, Command(estimate.t_ns, u)
"""
)

GUIDE = (
    HEAD
    + FROZEN
    + """class Block:
    def init(self):
        return -1

    def step(self, state, estimate):
        state = np.where(state < 0, estimate.t_ns, state)
        psi = wrap((estimate.t_ns - state) * 1e-9)
        return state, Reference(estimate.t_ns, np.array([0.0, 0.0, psi]), np.zeros(3), 0.0)
"""
)

SUPERVISOR = (
    HEAD
    + FROZEN
    + """class Block:
    limit: float = 1.0

    def init(self):
        return 0.0

    def step(self, state, command, tick, estimate):
        bad = np.where(np.isfinite(np.sum(command.u) + np.sum(estimate.eta)), state, 1.0)
        u = np.where(bad > 0.0, 0.0, np.clip(command.u, -self.limit, self.limit))
        return bad, Command(command.t_ns, u)
"""
)

SENSOR = (
    HEAD
    + FROZEN
    + """class Block:
    size: int = 1
    noise_size: int = 1
    rate_hz: float = 50.0
    delay_s: float = 0.0
    measurement_noise_cov: np.ndarray | None = None

    @property
    def cov(self):
        return 0.01 * np.eye(1)

    def h(self, motion):
        return motion.nu[:1]

    def init(self):
        return 0.0

    def step(self, state, motion, dt_s, noise):
        return state, Slot(1.0, self.h(motion) + 0.1 * noise)
"""
)

VEHICLE = (
    HEAD.replace("Slot\n", "Slot\nfrom baqueano.vehicles import Drivetrain, VehicleState, constant_effort\n")
    + FROZEN
    + """class Block:
    commands = 2
    drivetrain = Drivetrain(commands=2)

    def init(self, eta=None, nu=None):
        zero = np.zeros(3)
        return VehicleState(zero if eta is None else eta, zero if nu is None else nu, zero, None)

    def gravity(self, psi):
        return np.zeros(2)

    def advance(self, eta, nu, effort, dt_s):
        e = effort.mean
        nu_dot = np.array([e[0], 0.0, e[1]]) - nu
        nu = nu + dt_s * nu_dot
        eta = eta + dt_s * nu
        return np.array([eta[0], eta[1], wrap(eta[2])]), nu, nu_dot

    def step(self, state, u, dt_s, noise):
        eta, nu, nu_dot = self.advance(state.eta, state.nu, constant_effort(u), dt_s)
        return VehicleState(eta, nu, nu_dot, None), Motion(eta, nu, nu_dot, np.zeros(2))
"""
)
GOOD = {
    "estimator": ESTIMATOR,
    "controller": CONTROLLER,
    "guide": GUIDE,
    "supervisor": SUPERVISOR,
    "sensor": SENSOR,
    "vehicle": VEHICLE,
}


def findings_about(tmp_path, room, text):
    """Return the diagnostics of the block check about the class Block in a file with this text."""
    (tmp_path / "mine.py").write_text(text, encoding="utf-8")
    kind = resolve(room, "mine.py:Block", tmp_path)
    return check(room, kind())
