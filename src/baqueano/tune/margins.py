"""How much gain, phase and delay a loop bears: linearised where it drives straight on at a steady speed.

    x⁺ = A x + B u,    y = C x + D u          vehicle, delay, sensors, controller; u in force, y the next    (1)
    L_i(z) = −z⁻¹ (C (zI − A)⁻¹ B + D)_ii,    z = exp(jω δ)        channel i opened, the others closed         (2)
    gain: 1/|L_i| where L_i < 0,    phase: φ = π + arg L_i where |L_i| = 1,    delay: φ/ω                      (3)

(1) are the Jacobians of one tick of the loop, by the engine; the delay of the model is in A as its line of past
commands, z⁻ᵏ. The pose is known: an estimator adds a delay of its own. Source: Åström and Murray, Feedback Systems,
2008, section 9.3.
"""

from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.blocks import Controller
from baqueano.contracts.values import Tree
from baqueano.estimators import KnownState
from baqueano.guides.repeat import Repeat
from baqueano.guides.route import Route
from baqueano.sensors.truth import truth_sensor
from baqueano.simulate.open_loop import times
from baqueano.simulate.system import Input, System, SystemState, advance, begin
from baqueano.symbolic import jacobian
from baqueano.symbolic.graph.tree import build, leaves, shape_of, values

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

SETTLE_S = 1.0
STEADY_S, STEADY = 0.2, 0.05  # the command of the last time changes less, in its unit
SLOWEST_M_S = 0.01  # no steady drive below it
FREQUENCIES = 2000
LOWEST_RAD_S = 0.02
GROWS = 1.0 + 1e-5  # a tick: by 0.1 % in a second; an error that nothing corrects does not grow
STEPS = 50  # of a bisection


class LoopMargins(NamedTuple):
    """The margins of one channel of the command, the other channels closed."""

    channel: str  # "u_psi"
    gain_up: float  # factor at which the loop becomes unstable; inf: none does
    gain_down: float  # the same below 1; 0: none does
    phase_rad: float  # inf: |L| never is 1
    delay_s: float  # more than the vehicle has; inf likewise
    speed_m_s: float  # of the steady drive
    stable: bool  # the whole loop


class Linear(NamedTuple):
    """A linear system in discrete time.  (1)"""

    A: np.ndarray  # (n, n)
    B: np.ndarray  # (n, m)
    C: np.ndarray  # (k, n)
    D: np.ndarray  # (k, m)
    dt_s: float

    def at(self, omega: np.ndarray) -> np.ndarray:
        """Return the first entry of the transfer function at ω (f,) [rad/s]."""
        z = np.exp(1j * np.atleast_1d(omega) * self.dt_s)
        resolved = np.linalg.solve(
            z[:, None, None] * np.eye(len(self.A)) - self.A,
            np.broadcast_to(self.B[:, :1], (len(z), len(self.A), 1)),
        )
        return (self.C[:1] @ resolved)[:, 0, 0] + self.D[0, 0]


@lru_cache(maxsize=32)
def loop_margins(
    vehicle_file: "VehicleFile", controller: Controller, speed_m_s: float
) -> tuple[LoopMargins, ...]:
    """Return the margins of each channel that has a limit above 0; none where there is no steady drive."""
    if not speed_m_s > SLOWEST_M_S:
        return ()
    plant, steady = linearised(vehicle_file, controller, speed_m_s)
    if not all(np.isfinite(matrix).all() for matrix in plant[:4]):
        return ()
    names, limit = vehicle_file.command.names, vehicle_file.command.limit
    whole = np.block([[plant.A, plant.B], [plant.C, plant.D]])
    stable = steady and bool(np.max(np.abs(np.linalg.eigvals(whole))) < GROWS)
    return tuple(
        LoopMargins(names[k], *margins(opened(plant, k)), speed_m_s, stable)
        for k in np.flatnonzero(limit > 0.0)
    )


def margins(loop: Linear) -> tuple[float, float, float, float]:
    """Return the gain margins above and below 1, the phase margin and the delay margin of L.  (3)"""
    omega = np.geomspace(LOWEST_RAD_S, np.pi / loop.dt_s, FREQUENCIES)
    L = loop.at(omega)
    ends = np.flatnonzero(np.diff(np.sign(L.imag)) != 0)
    real = [loop.at(_crossing(loop, omega[k : k + 2], np.imag))[0].real for k in ends]
    factors = [-1.0 / x for x in [*real, L[-1].real] if x < 0.0]
    of_one = np.flatnonzero(np.diff(np.sign(np.abs(L) - 1.0)) != 0)
    at = [_crossing(loop, omega[k : k + 2], lambda x: np.abs(x) - 1.0) for k in of_one]
    phases = [float(np.angle(-loop.at(w)[0])) for w in at]
    delays = [(phase % (2.0 * np.pi)) / w for phase, w in zip(phases, at, strict=True)]
    return (
        min((f for f in factors if f > 1.0), default=np.inf),
        max((f for f in factors if f < 1.0), default=0.0),
        min(phases, key=abs, default=np.inf),
        min(delays, default=np.inf),
    )


def opened(plant: Linear, channel: int) -> Linear:
    """Return L of a channel, the others closed: their commands become states.  (2)"""
    A, B, C, D, dt_s = plant
    others = [k for k in range(B.shape[1]) if k != channel]
    n, m = len(A), len(others)
    A_closed = np.block([[A, B[:, others]], [C[others], D[np.ix_(others, others)]]])
    B_closed = np.vstack([B[:, [channel]], D[np.ix_(others, [channel])]])
    row = np.hstack([C[[channel]], D[np.ix_([channel], others)]])
    A_late = np.block([[A_closed, np.zeros((n + m, 1))], [row, np.zeros((1, 1))]])
    B_late = np.vstack([B_closed, D[[channel]][:, [channel]]])
    C_late = np.hstack([np.zeros((1, n + m)), -np.ones((1, 1))])
    return Linear(A_late, B_late, C_late, np.zeros((1, 1)), dt_s)


def linearised(vehicle_file: "VehicleFile", controller: Controller, speed_m_s: float) -> tuple[Linear, bool]:
    """Return a tick of the loop around a straight drive, and whether the command became steady.  (1)"""
    system, dt_s = _straight(vehicle_file, controller, speed_m_s), 1.0 / vehicle_file.rate_hz
    t_ns = times(round(SETTLE_S / dt_s) + 1, vehicle_file.rate_hz)
    state = begin(system)
    state = state._replace(world=state.world._replace(vehicle=_moving(state.world.vehicle, speed_m_s)))
    sent = []
    for t in t_ns[:-1]:
        state, _ = advance(system, dt_s, state, Input(int(t), None))
        sent.append(state.u)
    shape = shape_of((state.world, state.blocks), "state")
    now = [np.asarray(value, dtype=float) for value in values(shape, (state.world, state.blocks))]
    free = [k for k, leaf in enumerate(leaves(shape)) if leaf.kind == "f"]
    sizes = np.cumsum([0, *(now[k].size for k in free)])

    def tick(numbers: Tree) -> Tree:
        whole: list[Tree] = [
            int(v) if leaf.kind != "f" else v for leaf, v in zip(leaves(shape), now, strict=True)
        ]
        for k, first in zip(free, sizes[:-1], strict=True):
            piece = numbers[first : first + now[k].size]
            whole[k] = piece.reshape(now[k].shape) if now[k].shape else piece[0]
        world, blocks = build(shape, iter(whole))
        after, _ = advance(
            system, dt_s, SystemState(world, blocks, numbers[sizes[-1] :]), Input(int(t_ns[-1]), None)
        )
        ends = list(values(shape, (after.world, after.blocks)))
        return np.concatenate([*(np.reshape(ends[k], -1) for k in free), np.reshape(after.u, -1)])

    J = np.asarray(jacobian(tick)(np.concatenate([*(now[k].ravel() for k in free), state.u])), dtype=float)
    n = int(sizes[-1])
    steady = bool(np.max(np.ptp(sent[-round(STEADY_S / dt_s) :], axis=0)) < STEADY)
    return Linear(J[:n, :n], J[:n, n:], J[n:, :n], J[n:, n:], dt_s), steady


def _straight(vehicle_file: "VehicleFile", controller: Controller, speed_m_s: float) -> System:
    """The loop of the file with this controller on a straight route, pose and velocity known."""
    t_s = np.array([0.0, 2.0 * SETTLE_S])
    eta, nu = np.zeros((2, 3)), np.zeros((2, 3))
    eta[:, 0], nu[:, 0] = speed_m_s * t_s, speed_m_s
    guide = Repeat.along(Route(t_s, eta, nu, False))
    return System(
        vehicle_file.vehicle, truth_sensor(), KnownState(), guide, controller, vehicle_file.supervisor()
    )


def _moving(vehicle: Tree, speed_m_s: float) -> Tree:
    return vehicle._replace(nu=np.array([speed_m_s, 0.0, 0.0]))


def _crossing(loop: Linear, ends: np.ndarray, of: object) -> float:
    """The frequency between two where a function of L changes its sign."""
    low, high = (float(x) for x in ends)
    sign = np.sign(of(loop.at(low)[0]))  # type: ignore[operator]
    for _ in range(STEPS):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if np.sign(of(loop.at(middle)[0])) == sign else (low, middle)  # type: ignore[operator]
    return float(np.sqrt(low * high))
