"""Model predictive control with the user's own model: optimise the commands of `horizon_s` within their limits.

    x_{k+1} = f(x_k, ε_k)                     the vehicle's own step, with the motors' delay and lag       (1)
    r_k = ((e_x, e_y, e_ψ)_k / e_max,  max⁺(|v_k| − v_max),  (ε_k − ε_{k−1}) / command_change_max)          (2)
    min over E   ½ |r(E°) + ∂r/∂E (E − E°)|²,   static(−limit) ≤ mix(ε_k) ≤ static(limit)                 (3)
                 wall_low ≤ p_k + ∂p/∂E (E − E°) ≤ wall_high                                              (4)
    ψ_r ← ψ_r + β_r − β        β: slip of the vehicle at the yaw rate of the reference, with two commands   (5)
    8 T ḋ = ω − ω_m − d,    ψ̇ = ω_f + d                      ω_m: the model after the sent commands           (6)

x: state; p: position; v: speed; e: error from the reference; v_max = |v_r| + catch_up_m_s; max⁺: a smooth max(·, 0); E
= (ε_0, ε_1, …). ε is the effort after the dead zone, within which a command has no effect; u = drivetrain⁻¹(ε_0). The
reference at k is the present one, moved with its velocity: a bend is predicted only when the reference has reached it.
d: the steady error of the yaw rate; ω_f: yaw rate of f, from ω − d. E° is the previous plan, shifted in time; each
tick makes one step of (3) (real-time iteration). If the solver fails, the old plan continues; after MAX_FAILURES ticks
the drive ends. Source: Diehl, Bock and Schlöder, SIAM J. Control Optim., 2005; solver: Stellato et al., 2020.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from baqueano.controllers.following.tracking import MAX_CATCH_UP_M_S
from baqueano.controllers.mpc.horizon import Horizon
from baqueano.controllers.mpc.program import BoundedProgram
from baqueano.controllers.mpc.state import MpcState
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.errors import Invalid
from baqueano.parameter import INF, document, parameter
from baqueano.signals import Command, Estimate, Reference, seconds
from baqueano.vehicles.bounds import check_bounds, check_limit
from baqueano.vehicles.state import Vehicle

MAX_FAILURES = 10  # ticks without a solution, after which the drive ends


@document
@dataclass(frozen=True, eq=False)
class Mpc:
    """Model predictive controller: it optimises the commands over a horizon, to follow the reference.

    Parameters
    ----------
    vehicle : Vehicle
        The identified model: a block of vehicles/, or your own.
    rate_hz : float
        Ticks per second.

    Notes
    -----
    Equations (1)-(6) of the module. The controller needs a solver: `pip install osqp`. A tick takes less than 1 ms on a
    laptop. The step calls that solver, so it is not compiled: it works in `repeat` and `sweep`, and cannot be tuned.

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

    is_interpreted: ClassVar[bool] = True  # its solver is a library, so the step is not compiled

    vehicle: Vehicle
    horizon_s: float = parameter("s", "prediction horizon", low=0.1, high=5.0, default=0.8)
    e_max: np.ndarray = parameter(
        "m, m, rad", "along-track, cross-track and heading errors with the same weight", low=1e-4, shape=(3,),
        default=(0.05, 0.02, 0.15),
    )  # fmt: skip
    command_change_max: float = parameter(
        "1", "change of the command in a step, as a fraction of its limit, with the same weight as those errors",
        low=1e-3, default=0.3,
    )  # fmt: skip
    catch_up_m_s: float = parameter(
        "m/s", "speed above that of the reference, to catch up", low=0.01, default=MAX_CATCH_UP_M_S
    )
    wall_low: np.ndarray = parameter(
        "m, m", "smallest x and y that the origin may reach in the map", shape=(2,), default=(-INF, -INF)
    )
    wall_high: np.ndarray = parameter(
        "m, m", "largest x and y that the origin may reach in the map", shape=(2,), default=(INF, INF)
    )
    rate_hz: float = 100.0
    limit: np.ndarray = parameter(
        "unit of u", "largest command, (n,)", low=0.0, default=(INF, INF, INF), shape=None
    )

    def __post_init__(self) -> None:
        check_bounds(self)
        check_limit(self)

    def init(self) -> MpcState:
        """Return the plan of a vehicle at rest."""
        return MpcState(
            -1, *self._horizon.rest_state(), np.zeros(3), 0.0, 0, np.zeros(self._program.constraints)
        )

    def step(self, state: MpcState, reference: Reference, estimate: Estimate) -> tuple[MpcState, Command]:
        """Return the new plan and its first command (n,), or the command 0 after the end of the drive.

        Raise Invalid if the solver failed in more than MAX_FAILURES consecutive ticks, and UsageError if OSQP is not
        installed.
        """
        if reference.at_end > 0.0:  # a car would drive to and fro to turn
            return self.init(), Command(estimate.t_ns, np.zeros(self.vehicle.commands))
        dt_s = seconds(estimate.t_ns, state.t_ns) if state.t_ns >= 0 else 1.0 / self.rate_hz
        plan = self._horizon.linearised_program(state, dt_s, reference, estimate)
        E, drivetrain, model_nu, turn_error, program = plan
        solution = None if program is None else self._program.solve(program, E, state.multipliers)
        failures = 0 if solution is not None else state.failures + 1
        if failures > MAX_FAILURES:
            raise Invalid.of("mpc.unsolved", ticks=failures)
        E, multipliers = (E, np.zeros_like(state.multipliers)) if solution is None else solution
        u, effort = self._horizon.command(E[0])
        state = MpcState(estimate.t_ns, E, effort, drivetrain, model_nu, turn_error, failures, multipliers)
        return state, Command(estimate.t_ns, u)

    def diagnostic(self, state: MpcState) -> Diagnostic | None:
        """Return a warning for the run at the first tick of a series in which the solver failed, else None."""
        return note("mpc.old-plan", Severity.WARNING, maximum=MAX_FAILURES) if state.failures == 1 else None

    @cached_property
    def _horizon(self) -> Horizon:
        return Horizon(self)

    @cached_property
    def _program(self) -> BoundedProgram:
        horizon = self._horizon
        return BoundedProgram(*horizon.motor_constraints(), horizon.wall_count)
