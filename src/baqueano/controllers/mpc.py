"""Model predictive control on the user's own model: the commands of the next `horizon_s`, with their limits in the sum.

    x_{k+1} = f(x_k, ε_k)                     the vehicle's own step, with the motors' delay and lag       (1)
    r_k = ((e_x, e_y, e_ψ)_k / e_max,  (ε_k − ε_{k−1}) / change_max)     e against the reference at k     (2)
    min over E   ½ |r(E°) + ∂r/∂E (E − E°)|²,   static(−limit) ≤ mix(ε_k) ≤ static(limit)                 (3)
                 wall_low ≤ p_k + ∂p/∂E (E − E°) ≤ wall_high                                              (4)

ε is the effort behind the dead zone, in which a command has no slope; u = drivetrain⁻¹(ε_0). The reference at k is that
of now, driven on with its velocity. E° is the plan of the tick before, moved on by the time that has passed; one step
of (3) a tick follows the optimum (real-time iteration). r and ∂r/∂E are one call of the engine's kernel. Where the
solver fails, the old plan goes on, and after FAILURES ticks the drive ends. Source: Diehl, Bock and Schlöder, SIAM
Journal on Control and Optimization, 2005; solver: OSQP, Stellato et al., 2020.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.diagnostics import fault
from baqueano.errors import Invalid, UsageError
from baqueano.geometry import compose, pose_error
from baqueano.parameter import INF, documented, parameter
from baqueano.signals import Command, Estimate, Reference, seconds
from baqueano.symbolic import scan
from baqueano.vehicles.bounds import check_bounds
from baqueano.vehicles.state import Vehicle, VehicleState

FAILURES = 10  # ticks without a solution, after which the drive ends
FAR = 1e6
LONGEST_S = 0.02  # of a step of the model, whose tyres are stiff
NUDGE = 1e-6  # a motor that stands exactly still has no slope
EVEN = {"dead_zone_forward": 0.0, "dead_zone_backward": 0.0, "gain": 1.0, "limit": FAR, "coast": 0.0}
STEADY = {"duty_step": 0.0, "sag": 0.0, "battery_effect": 0.0}
SMALL = 1e-6  # of the curvature of (3), so that a command without effect stays where it is


class Plan(NamedTuple):
    """Memory of a controller that looks ahead.

    Attributes
    ----------
    t_ns : int
        Time of the last tick; −1 before the first.
    E : ndarray (N, k) [unit of u]
        Efforts of the next steps, of the commands that the vehicle has.
    effort : ndarray (k,) [unit of u]
        Of the last command.
    drivetrain : DrivetrainState
        Delay and lag, under the commands that were given.
    failures : int
        Ticks in a row in which the solver failed.
    """

    t_ns: int
    E: np.ndarray
    effort: np.ndarray
    drivetrain: Tree
    failures: int


@documented
@dataclass(frozen=True)
class Mpc:
    """The commands that bring the vehicle onto its reference best within a horizon.

    Parameters
    ----------
    vehicle : Vehicle
        The identified model: a block of vehicles/, also one of yours.
    rate_hz : float
        Ticks a second.

    Notes
    -----
    Equations (1)-(4) of the module. It needs the solver: `pip install osqp`. Each tick takes a few ms, so it suits
    a laptop at 50 Hz, not a Raspberry Pi beside its other work.

    References
    ----------
    Diehl, Bock and Schlöder, SIAM Journal on Control and Optimization, 2005.

    Examples
    --------
    >>> robot = bq.load("small")
    >>> law = Mpc(robot.vehicle, limit=robot.command.limit, rate_hz=robot.rate_hz)
    >>> ahead = Reference(0, np.array([0.1, 0.0, 0.0]), np.zeros(3), 0.0)
    >>> _, command = law.step(law.init(), ahead, Estimate(0, np.zeros(3), np.zeros(3), np.eye(6)))
    >>> bool(command.u[0] > 0.3)
    True
    """

    as_written: ClassVar[bool] = True  # its solver is a library, so the step is not compiled
    steps: ClassVar[int] = 12  # of the horizon

    vehicle: Vehicle
    horizon_s: float = parameter("s", "time that is looked ahead", low=0.1, high=5.0, default=0.8)
    e_max: np.ndarray = parameter(
        "m, m, rad", "errors ahead, beside and of the heading that matter alike", low=1e-4, shape=(3,),
        default=(0.05, 0.02, 0.15),
    )  # fmt: skip
    change_max: float = parameter(
        "1",
        "change of the command in a step, in parts of its limit, worth such errors",
        low=1e-3,
        default=0.3,
    )
    wall_low: np.ndarray = parameter(
        "m, m", "least x and y that the origin may reach in the map", shape=(2,), default=(-INF, -INF)
    )
    wall_high: np.ndarray = parameter("m, m", "largest x and y", shape=(2,), default=(INF, INF))
    rate_hz: float = 100.0
    limit: np.ndarray = parameter(
        "unit of u", "largest command, (n,)", low=0.0, default=(INF, INF, INF), shape=None
    )

    def __post_init__(self) -> None:
        check_bounds(self)
        if self.limit.shape != (self.vehicle.commands,):
            shape, commands = str(self.limit.shape), self.vehicle.commands
            raise Invalid(fault("field.limit", block=type(self).__name__, found=shape, commands=commands))

    def init(self) -> Plan:
        """Return the plan of a vehicle at rest."""
        k = int(np.count_nonzero(self.limit))
        return Plan(-1, np.zeros((self.steps, k)), np.zeros(k), self._even.drivetrain.init(), 0)

    def step(self, state: Plan, reference: Reference, estimate: Estimate) -> tuple[Plan, Command]:
        """Return the plan from here, and its first command (n,)."""
        dt_s = seconds(estimate.t_ns, state.t_ns) if state.t_ns >= 0 else 1.0 / self.rate_hz
        drivetrain = self._even.drivetrain.step(state.drivetrain, self._alive.T @ state.effort, dt_s)[0]
        E = self._moved_on(state.E, dt_s if state.t_ns >= 0 else 0.0)
        solution = self._solved(E, state.effort, drivetrain, reference, estimate)
        failures = 0 if solution is not None else state.failures + 1
        if failures > FAILURES:
            raise Invalid(fault("mpc.unsolved", ticks=failures))
        E = E if solution is None else solution
        motors = self.vehicle.drivetrain
        u = motors.turn_first(np.clip(motors.inverse(self._alive.T @ E[0]), -self.limit, self.limit))
        effort = self._alive @ motors.unmix(motors.static(motors.mix(u)))
        return Plan(estimate.t_ns, E, effort, drivetrain, failures), Command(estimate.t_ns, u)

    def _moved_on(self, E: np.ndarray, dt_s: float) -> np.ndarray:
        """Return the plan (N, k) as it stands `dt_s` later; its end goes on."""
        k = np.minimum(np.arange(self.steps) + dt_s * self.steps / self.horizon_s, self.steps - 1.0)
        E = np.column_stack([np.interp(k, np.arange(self.steps), column) for column in E.T])
        return np.where(np.abs(E) < NUDGE, NUDGE * np.arange(1.0, E.shape[1] + 1.0), E)

    def _solved(
        self, E: np.ndarray, before: np.ndarray, drivetrain: Tree, reference: Reference, estimate: Estimate
    ) -> np.ndarray | None:
        """Return the plan (N, k) that (3) and (4) ask for, None where the solver finds none."""
        start = VehicleState(estimate.eta, estimate.nu, np.zeros(3), drivetrain)
        ahead = np.arange(1.0, self.steps + 1.0) * self.horizon_s / self.steps
        eta_r = np.array([compose(reference.eta, _travelled(reference.nu, t)) for t in ahead])
        inputs = (np.repeat(one, self._parts, axis=0) for one in (np.eye(self.steps), eta_r))
        out, slopes = self._kernel.sensitivities(tuple(inputs), E.ravel(), (start, before))
        out = out.reshape(self.steps, self._parts, -1)
        slopes = slopes.reshape(*out.shape, E.size)
        r = np.concatenate([out[:, -1, :3].ravel(), out[:, 0, 5:].ravel()])
        J = np.concatenate([slopes[:, -1, :3].reshape(-1, E.size), slopes[:, 0, 5:].reshape(-1, E.size)])
        if not (np.isfinite(r).all() and np.isfinite(J).all()):
            return None
        P, q = J.T @ J + SMALL * np.eye(E.size), J.T @ (r - J @ E.ravel())
        p, p_E = out[:, -1, 3:5].ravel(), slopes[:, -1, 3:5].reshape(-1, E.size)
        free = p - p_E @ E.ravel()
        low, high = (np.tile(wall, self.steps) - free for wall in (self.wall_low, self.wall_high))
        return self._qp.solve(P, q, p_E, low, high, E)

    @property
    def _parts(self) -> int:
        """Return the steps of the model in a step of the plan."""
        return max(1, int(np.ceil(self.horizon_s / self.steps / LONGEST_S)))

    @cached_property
    def _alive(self) -> np.ndarray:
        """Return the rows (k, n) of the commands that have a limit above 0."""
        return np.eye(self.vehicle.commands)[self.limit > 0.0]

    @cached_property
    def _even(self) -> Any:
        """Return the vehicle behind motors without a dead zone: delay and lag alone."""
        even = {name: value * np.ones(1) for name, value in EVEN.items()}
        drivetrain = replace(self.vehicle.drivetrain, **even, **STEADY)
        vehicle: Any = self.vehicle
        return replace(vehicle, drivetrain=drivetrain)

    @cached_property
    def _kernel(self) -> Any:
        """Return r and positions over the horizon, and their slopes by E.  (1), (2)"""
        k, dt_s = len(self._alive), self.horizon_s / (self.steps * self._parts)
        limit = self._alive @ np.minimum(self.limit, FAR)
        change = self.change_max * np.where(limit < FAR, limit, 1.0)

        def step(theta: np.ndarray, carry: Tree, x: Tree) -> tuple[Tree, np.ndarray]:
            (state, before), (here, eta_r) = carry, x
            effort = here @ np.reshape(theta, (self.steps, k))
            state, _ = self._even.step(state, self._alive.T @ effort, dt_s, np.zeros(3))
            e = pose_error(eta_r, state.eta)
            return (state, effort), np.concatenate(
                [e / self.e_max, state.eta[:2], (effort - before) / change]
            )

        start = self._even.init(), np.zeros(k)
        return scan(step, start, (np.zeros(self.steps), np.zeros(3)), np.zeros(self.steps * k))

    @cached_property
    def _qp(self) -> "BoundedProgram":
        drivetrain = self.vehicle.drivetrain
        mix = np.column_stack([drivetrain.mix(row) for row in self._alive])
        most = np.minimum(np.abs(mix) @ np.minimum(self._alive @ self.limit, FAR), drivetrain.limit)
        low, high = (np.tile(drivetrain.static(sign * most), self.steps) for sign in (-1.0, 1.0))
        return BoundedProgram(np.kron(np.eye(self.steps), mix), low, high)


class BoundedProgram:
    """min ½ zᵀ P z + qᵀ z,  least ≤ rows z ≤ most,  low ≤ A z ≤ high, solved again and again by OSQP."""

    def __init__(self, rows: np.ndarray, least: np.ndarray, most: np.ndarray) -> None:
        self._rows, self._least, self._most, self._program = rows, least, most, None

    def solve(
        self,
        P: np.ndarray,
        q: np.ndarray,
        A: np.ndarray,
        low: np.ndarray,
        high: np.ndarray,
        start: np.ndarray,
    ) -> np.ndarray | None:
        """Return z in the shape of `start`, None where no solution was found in time."""
        from scipy.sparse import csc_matrix

        walls = np.isfinite(low) | np.isfinite(high)
        A = np.where(walls[:, None], A, 0.0)
        whole = np.vstack([self._rows, A])
        low = np.concatenate([self._least, np.where(walls, low, -FAR)])
        high = np.concatenate([self._most, np.where(walls, high, FAR)])
        upper = np.triu(np.ones_like(P)) > 0.0
        if self._program is None:
            pattern = np.vstack([self._rows != 0.0, np.ones_like(A, bool)])
            self._at = [np.nonzero(one.T) for one in (upper, pattern)]
            matrices = [csc_matrix(np.where(one, 1.0, 0.0)) for one in (upper, pattern)]
            for matrix, value, at in zip(matrices, (P, whole), self._at, strict=True):
                matrix.data = value.T[at]
            self._program = _osqp()
            self._program.setup(
                matrices[0], q, matrices[1], low, high, verbose=False, eps_abs=1e-4, eps_rel=1e-4, max_iter=400,
                polishing=False, check_termination=10, adaptive_rho_interval=50,
            )  # fmt: skip
        else:
            values = [value.T[at] for value, at in zip((P, whole), self._at, strict=True)]
            self._program.update(q=q, l=low, u=high, Px=values[0], Ax=values[1])
        self._program.warm_start(x=start.ravel())
        answer = self._program.solve(raise_error=False)
        solved = answer.info.status_val in (1, 2) and np.isfinite(answer.x).all()
        return np.reshape(answer.x, start.shape) if solved else None


def _travelled(nu: np.ndarray, t_s: float) -> np.ndarray:
    """Return the pose (3,) after `t_s` with the velocity ν (3,), from the origin."""
    from baqueano.geometry import map_from_body

    way = nu * t_s
    return map_from_body(0.5 * way[2]) @ (way * np.array([np.sinc(0.5 * way[2] / np.pi)] * 2 + [1.0]))


def _osqp() -> Any:
    """Return a program of the solver; UsageError where it is not installed."""
    try:
        import osqp
    except ImportError as error:
        raise UsageError(fault("mpc.no-solver", "pip install osqp")) from error
    return osqp.OSQP()
