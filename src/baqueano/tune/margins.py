"""The gain, phase and delay margins of a loop, linearised at straight driving with a steady speed.

    x⁺ = A x + B u,    y = C x + D u          vehicle, delay, sensors, controller; u acts now, y in the next tick    (1)
    L_i(z) = −z⁻¹ (C (zI − A)⁻¹ B + D)_ii,    z = exp(jω δ)        channel i opened, the others closed         (2)
    gain: 1/|L_i| where L_i < 0,    phase: φ = π + arg L_i where |L_i| = 1,    delay: φ/ω                      (3)

x: state, u: command, y: next command, δ: tick, ω: frequency. (1) contains the Jacobians of one tick of the loop: from
the engine, or as finite differences if a block is not compiled, as mpc. A includes the past commands of the delay of
the model, z⁻ᵏ. The pose is exact; an estimator would add a delay. A channel that is inside its dead zone, such as a
servo in the middle, would have L = 0: it is linearised without this zone. Source: Åström and Murray, Feedback Systems,
2008, section 9.3.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import is_dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.blocks import Controller
from baqueano.contracts.values import Tree
from baqueano.estimators import PerfectState
from baqueano.guides.repeat import Repeat
from baqueano.guides.route import Route
from baqueano.sensors.truth import truth_sensor
from baqueano.simulate.open_loop import tick_times
from baqueano.simulate.system import Input, System, SystemState, advance, begin
from baqueano.symbolic import TraceError, function, jacobian
from baqueano.symbolic.function import KernelKey
from baqueano.symbolic.graph.tree import build, leaves, tree_shape, values

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

SETTLE_S = 0.1, 0.5, 4.0  # durations of a drive before Newton's method begins
MAX_NEWTON_STEPS, STEADY_TOLERANCE = 8, 1e-7  # steps and relative error at which Newton's method ends
MAX_CONTRACTION = 0.1  # of the error by a step, above which the Jacobian is computed again: it takes 12 ticks
CALM_WINDOW_S, CALM_TOLERANCE = 0.5, 0.05  # a drive is steady if its command then changes less
MIN_SPEED_M_S = 0.01  # a steady drive is faster
ROUNDING = 1e-12  # a smaller step of a flag, such as that of a stopped vehicle, is a rounding error
DIFFERENCE = (
    1e-3  # relative step of a finite difference: much larger than the relative error of a solver, 1e-4
)
MIN_COMPILED_TICKS = 100  # ticks of a drive; their compilation takes as long as 20 to 30 ticks
FREQUENCY_COUNT = 2000
MIN_FREQUENCY_RAD_S = 0.02
# per tick, 0.1 % per second: an error that is not corrected has an eigenvalue of 1
UNSTABLE_EIGENVALUE = 1.0 + 1e-5
BISECTION_STEPS = 50  # number of steps of a bisection


class LoopMargins(NamedTuple):
    """The margins of one channel of the command, with the other channels closed."""

    channel: str  # "u_psi"
    gain_up: float  # factor above 1 at which the loop becomes unstable; inf if it never does
    gain_down: float  # factor below 1 at which the loop becomes unstable; 0 if it never does
    phase_rad: float  # infinite if |L| is never 1
    delay_s: float  # additional delay; inf if |L| is never 1
    speed_m_s: float  # of the steady drive
    stable: bool  # the whole loop


class LinearSystem(NamedTuple):
    """The matrices of a linear system in discrete time.  (1)"""

    A: np.ndarray  # (n, n)
    B: np.ndarray  # (n, m)
    C: np.ndarray  # (k, n)
    D: np.ndarray  # (k, m)
    dt_s: float

    def frequency_response(self, omega: np.ndarray | float) -> np.ndarray:
        """Return the first entry of the transfer function (f,), complex, at ω (f,) [rad/s]."""
        z = np.exp(1j * np.atleast_1d(omega) * self.dt_s)
        response = np.linalg.solve(
            z[:, None, None] * np.eye(len(self.A)) - self.A,
            np.broadcast_to(self.B[:, :1], (len(z), len(self.A), 1)),
        )
        return (self.C[:1] @ response)[:, 0, 0] + self.D[0, 0]


@lru_cache(maxsize=32)
def loop_margins(
    vehicle_file: "VehicleFile", controller: Controller, speed_m_s: float
) -> tuple[LoopMargins, ...]:
    """Return the margins of each channel with a limit above 0; () at low speed or without a finite linearisation."""
    loop = _cached_loop(vehicle_file, KernelKey(controller), speed_m_s)
    if loop is None:
        return ()
    plant, is_stable = loop
    return tuple(
        LoopMargins(
            vehicle_file.command.names[k], *margins(loop_transfer(plant, int(k))), speed_m_s, is_stable
        )
        for k in np.flatnonzero(vehicle_file.command.limit > 0.0)
    )


def has_stable_loop(vehicle_file: "VehicleFile", controller: Controller, speed_m_s: float) -> bool:
    """Return True for a stable loop, and for a loop without margins."""
    loop = _cached_loop(vehicle_file, KernelKey(controller), speed_m_s)
    return loop is None or loop[1]


@lru_cache(maxsize=32)
def _cached_loop(
    vehicle_file: "VehicleFile", key: KernelKey, speed_m_s: float
) -> tuple[LinearSystem, bool] | None:
    (controller,) = key.parts
    return _linear_loop(vehicle_file, controller, speed_m_s)


def _linear_loop(
    vehicle_file: "VehicleFile", controller: Controller, speed_m_s: float
) -> tuple[LinearSystem, bool] | None:
    """Return one tick of the loop and True if it is stable; None at low speed or without a finite linearisation."""
    if not speed_m_s > MIN_SPEED_M_S:
        return None
    plant, is_steady = linearise(vehicle_file, controller, speed_m_s)
    if not all(np.isfinite(matrix).all() for matrix in plant[:4]):
        return None
    block_matrix = np.block([[plant.A, plant.B], [plant.C, plant.D]])
    return plant, is_steady and bool(np.max(np.abs(np.linalg.eigvals(block_matrix))) < UNSTABLE_EIGENVALUE)


def margins(loop: LinearSystem) -> tuple[float, float, float, float]:
    """Return gain margins of L above 1 (∞ if none) and below 1 (0 if none), phase margin [rad], delay margin [s].

    The delay margin is ∞ without a crossing.  (3)
    """
    omega = np.geomspace(MIN_FREQUENCY_RAD_S, np.pi / loop.dt_s, FREQUENCY_COUNT)
    L = loop.frequency_response(omega)
    ends = np.flatnonzero(np.diff(np.sign(np.imag(L))) != 0)
    real_parts = [
        loop.frequency_response(_crossing_frequency(loop, omega[k : k + 2], np.imag))[0].real for k in ends
    ]
    factors = [-1.0 / x for x in [*real_parts, L[-1].real] if x < 0.0]
    crossings = np.flatnonzero(np.diff(np.sign(np.abs(L) - 1.0)) != 0)
    frequencies = [_crossing_frequency(loop, omega[k : k + 2], lambda x: np.abs(x) - 1.0) for k in crossings]
    phases = [float(np.angle(-loop.frequency_response(w)[0])) for w in frequencies]
    delays = [(phase % (2.0 * np.pi)) / w for phase, w in zip(phases, frequencies, strict=True)]
    return (
        float(min((f for f in factors if f > 1.0), default=np.inf)),
        float(max((f for f in factors if f < 1.0), default=0.0)),
        min(phases, key=abs, default=np.inf),
        float(min(delays, default=np.inf)),
    )


def loop_transfer(plant: LinearSystem, channel: int) -> LinearSystem:
    """Return L of a channel with the other channels closed: their commands become states.  (2)

    It contains only the states that change with the command and change L: half of all, so a response takes a fifth.
    """
    A, B, C, D, dt_s = plant
    closed_channels = [k for k in range(B.shape[1]) if k != channel]
    n, m = len(A), len(closed_channels)
    A_closed = np.block(
        [[A, B[:, closed_channels]], [C[closed_channels], D[np.ix_(closed_channels, closed_channels)]]]
    )
    B_closed = np.vstack([B[:, [channel]], D[np.ix_(closed_channels, [channel])]])
    row = np.hstack([C[[channel]], D[np.ix_([channel], closed_channels)]])
    A_delayed = np.block([[A_closed, np.zeros((n + m, 1))], [row, np.zeros((1, 1))]])
    B_delayed = np.vstack([B_closed, D[[channel]][:, [channel]]])
    C_delayed = np.hstack([np.zeros((1, n + m)), -np.ones((1, 1))])
    is_coupled = _reached_states(A_delayed, B_delayed[:, 0]) & _reached_states(A_delayed.T, C_delayed[0])
    A_coupled = A_delayed[np.ix_(is_coupled, is_coupled)]
    return LinearSystem(A_coupled, B_delayed[is_coupled], C_delayed[:, is_coupled], np.zeros((1, 1)), dt_s)


def _reached_states(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a mask of the states that x⁺ = A x + b u changes, by the entries of A and b that are not 0."""
    is_reached = b != 0.0
    for _ in range(len(A)):
        is_reached = is_reached | ((A != 0.0) @ is_reached)
    return is_reached


def linearise(
    vehicle_file: "VehicleFile", controller: Controller, speed_m_s: float
) -> tuple[LinearSystem, bool]:
    """Return one tick of the loop, linearised at a straight drive, and True if that drive is steady.  (1)

    Newton's method finds the state x in which a tick f changes only the position: f(x) = x + v δ ∂x/∂position.
    """
    system = _straight_loop(vehicle_file, controller, speed_m_s)
    plant, is_steady, u = _linearise_system(system, speed_m_s, vehicle_file.rate_hz)
    model = _without_idle_zones(system.model, u)
    if model is not system.model:
        system = system._replace(model=model, controller=_without_idle_zones(controller, u))
        plant, is_steady, _ = _linearise_system(system, speed_m_s, vehicle_file.rate_hz)
    return plant, is_steady


def _linearise_system(
    system: System, speed_m_s: float, rate_hz: float
) -> tuple[LinearSystem, bool, np.ndarray]:
    """Return the linear system, True if its drive is steady, and the command u (m,) of this drive."""
    dt_s = 1.0 / rate_hz
    state = begin(system)
    flat_state = _NumberRow(state)
    direction = flat_state.row(begin(system, np.array([1.0, 0.0, 0.0]))) - flat_state.row(state)
    moving_vehicle = state.world.vehicle._replace(nu=np.array([speed_m_s, 0.0, 0.0]))
    state = state._replace(world=state.world._replace(vehicle=moving_vehicle))
    t_ns = tick_times(1 + round(SETTLE_S[-1] * rate_hz), rate_hz)

    def tick_at(state: SystemState, t_ns: int) -> Callable[[Tree], Tree]:
        flat_state = _NumberRow(state)
        return lambda row: flat_state.row(advance(system, dt_s, flat_state.state(row), Input(t_ns, None))[0])

    is_interpreted = any(optional.attribute(block, "is_interpreted") for block in system.blocks)
    derivative = _finite_differences if is_interpreted else _engine_jacobian
    x, J, is_steady, end_tick, commands = flat_state.row(state), np.zeros(0), False, 0, np.zeros((1, 0))
    for settle_s in SETTLE_S:  # a longer drive only if Newton's method began too far away
        begin_tick, end_tick = end_tick, max(2, round(settle_s * rate_hz))  # the controller has a past
        state, commands = _drive_system(system, state, dt_s, t_ns[begin_tick:end_tick], is_interpreted)
        tick, x = tick_at(state, int(t_ns[end_tick])), flat_state.row(state)
        x, J, is_steady = _steady_state(tick, x, speed_m_s * dt_s * direction, derivative)
        if is_steady:
            break
    if not is_steady:  # for example, the controller does not correct the cross-track error
        x = flat_state.row(state)
        J = derivative(tick_at(state, int(t_ns[end_tick])), x)
        is_steady = bool(np.max(np.ptp(commands[-round(CALM_WINDOW_S * rate_hz) :], axis=0)) < CALM_TOLERANCE)
    n = len(x) - system.model.commands
    return LinearSystem(J[:n, :n], J[:n, n:], J[n:, :n], J[n:, n:], dt_s), is_steady, x[n:]


def _without_idle_zones(block: Tree, u: np.ndarray) -> Tree:
    """Return a vehicle, or a controller with a vehicle, without the dead zones that contain the command u (m,)."""
    if not is_dataclass(block):
        return block
    vehicle = getattr(block, "vehicle", None)
    if vehicle is not None:
        return replace(cast(Tree, block), vehicle=_without_idle_zones(vehicle, u))
    drivetrain = getattr(block, "drivetrain", None)
    remove_zones = getattr(drivetrain, "without_idle_zones", None)
    if remove_zones is None or (new_drivetrain := remove_zones(u)) is drivetrain:
        return block
    return replace(cast(Tree, block), drivetrain=new_drivetrain)


def _engine_jacobian(f: Callable[[Tree], Tree], x: np.ndarray) -> np.ndarray:
    return np.asarray(jacobian(f)(x), dtype=float)


def _finite_differences(f: Callable[[Tree], Tree], x: np.ndarray) -> np.ndarray:
    """Return the Jacobian (n, n) of f at x (n,), by central differences."""
    steps = np.diag(DIFFERENCE * (1.0 + np.abs(x)))
    return np.column_stack([(f(x + h) - f(x - h)) / (2.0 * h.sum()) for h in steps])


def _steady_state(
    tick: Callable[[Tree], Tree],
    x: np.ndarray,
    shift: np.ndarray,
    derivative: Callable[[Callable[[Tree], Tree], np.ndarray], np.ndarray] = _engine_jacobian,
) -> tuple[np.ndarray, np.ndarray, bool]:
    """Return the row x with tick(x) = x + shift, the Jacobian at x, and True if Newton's method converged."""
    J, last_error = np.zeros((len(x), len(x))), 0.0
    for _ in range(MAX_NEWTON_STEPS):
        with np.errstate(over="ignore", invalid="ignore"):  # a step may end where the model diverges
            gap = x + shift - tick(x)
            error = float(np.max(np.abs(gap) / (1.0 + np.abs(x))))
            is_steady = error < STEADY_TOLERANCE
            if is_steady or error > MAX_CONTRACTION * last_error:
                J = derivative(tick, x)
        if not np.isfinite(J).all() or not np.isfinite(gap).all():
            break
        if is_steady:
            return x, J, True
        last_error = error
        step = np.linalg.lstsq(J - np.eye(len(x)), gap, rcond=1e-9)[0]
        x = x + np.where(np.abs(step) < ROUNDING * (1.0 + np.abs(x)), 0.0, step)
    return x, J, False


def _drive_system(
    system: System, state: SystemState, dt_s: float, t_ns: np.ndarray, is_interpreted: bool
) -> tuple[SystemState, np.ndarray]:
    """Return the state after the ticks at `t_ns` (N,), and the commands (N, m). A long drive is compiled."""

    def tick(state: SystemState, t_ns: int) -> SystemState:
        return advance(system, dt_s, state, Input(t_ns, None))[0]

    if len(t_ns) >= MIN_COMPILED_TICKS and not is_interpreted:
        with suppress(TraceError):  # of a block that runs only as written
            tick = function(tick, state, 0, backend="python")
    commands, shape = [], tree_shape(_parts(state), "state")
    for t in t_ns.tolist():
        state = tick(state, t)
        commands.append(state.u)
    kinds_and_values = zip(leaves(shape), values(shape, _parts(state)), strict=True)
    # compiled, a flag of 0.0 becomes False
    state_values = (float(x) if leaf.kind == "f" and np.ndim(x) == 0 else x for leaf, x in kinds_and_values)
    return SystemState(*build(shape, state_values)), np.array(commands)


class _NumberRow:
    """Conversion between a state and the row of its non-integer numbers, with the command at the end."""

    def __init__(self, example: SystemState) -> None:
        self.shape = tree_shape(_parts(example), "state")
        self.leaves = list(leaves(self.shape))
        self.example = [np.asarray(value, dtype=float) for value in values(self.shape, _parts(example))]
        self.free = [k for k, leaf in enumerate(self.leaves) if leaf.kind == "f"]

    def row(self, state: SystemState) -> Tree:
        """Return the row of the non-integer numbers of a state."""
        state_values = list(values(self.shape, _parts(state)))
        return np.concatenate([np.reshape(state_values[k], -1) for k in self.free])

    def state(self, row: Tree) -> SystemState:
        """Return the state with the numbers of a row, and the integers of the example."""
        all_values: list[Tree] = [
            int(x) if leaf.kind != "f" else x for leaf, x in zip(self.leaves, self.example, strict=True)
        ]
        offset = 0
        for k in self.free:
            shape, size = self.example[k].shape, self.example[k].size
            all_values[k] = row[offset : offset + size].reshape(shape) if shape else row[offset]
            offset += size
        return SystemState(*build(self.shape, iter(all_values)))


def _parts(state: SystemState) -> tuple[Tree, ...]:
    return state.world, state.blocks, state.u


def _straight_loop(vehicle_file: "VehicleFile", controller: Controller, speed_m_s: float) -> System:
    """Return the loop of the file with this controller on a straight route, with exact pose and velocity."""
    t_s = np.array([0.0, 2.0 * SETTLE_S[-1]])
    eta, nu = np.zeros((2, 3)), np.zeros((2, 3))
    eta[:, 0], nu[:, 0] = speed_m_s * t_s, speed_m_s
    guide = Repeat.along(Route(t_s, eta, nu, closed=False), acceleration_m_s2=np.inf)
    return System(
        vehicle_file.vehicle, truth_sensor(), PerfectState(), guide, controller, vehicle_file.supervisor()
    )


def _crossing_frequency(loop: LinearSystem, ends: np.ndarray, function: Callable[[complex], float]) -> float:
    """Return the frequency [rad/s] between both `ends` at which a function of L changes its sign, by bisection."""
    low, high = (float(x) for x in ends)
    sign = np.sign(function(loop.frequency_response(low)[0]))
    for _ in range(BISECTION_STEPS):
        midpoint = float(np.sqrt(low * high))
        has_same_sign = np.sign(function(loop.frequency_response(midpoint)[0])) == sign
        low, high = (midpoint, high) if has_same_sign else (low, midpoint)
    return float(np.sqrt(low * high))
