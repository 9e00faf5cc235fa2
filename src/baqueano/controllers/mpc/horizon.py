"""The model over the horizon, and its quadratic program: equations (1), (2), (4) and (5) of mpc.py.

    J = ∂r/∂E,   P = JᵀJ + DᵀD,   q = Jᵀ (r − J E°) − Dᵀ d,   D E − d = Δε / command_change_max            (1)

r contains e / e_max and the excess of the speed at each step. e is the error of the pose, E the plan: the efforts ε,
divided by the change that the cost weights with 1. In this unit a fixed step size of the solver suits each vehicle. The
model is linearised at the plan E°. P and q are defined in program.py. D is constant. The engine computes r and its
derivatives in one call, in model steps of at most MAX_STEP_S. A call before it computes the start state, and a call
after it computes the command.
"""

from dataclasses import replace
from functools import cached_property
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.values import Tree, Value
from baqueano.controllers.following.response import MODEL_ERROR_RATIO, SMOOTHING_S, low_pass
from baqueano.controllers.following.tracking import slip
from baqueano.controllers.model_following import max_turn_error
from baqueano.controllers.mpc.state import MpcState
from baqueano.geometry import compose, map_from_body, pose_error
from baqueano.signals import Estimate, Reference
from baqueano.symbolic import Scan, function, scan
from baqueano.vehicles.drivetrain import DrivetrainState
from baqueano.vehicles.rk4 import MAX_ROW_S, ROW_TOLERANCE
from baqueano.vehicles.state import VehicleState

if TYPE_CHECKING:
    from baqueano.controllers.mpc.mpc import Mpc

STEPS = 12  # length of the horizon
RESIDUALS = 4  # of a step: e / e_max (3,), and the excess of the speed
EXCESS_M_S = 0.005  # excess of the speed with the same weight as the errors e_max
SMOOTH_M_S = 0.01  # width of the smooth maximum; with a kink, the commands of successive ticks alternate
NO_LIMIT = 1e6
MAX_STEP_S = (1.0 + ROW_TOLERANCE) * MAX_ROW_S  # longest stable step of the model
MIN_EFFORT = 1e-6  # effort instead of 0, where a motor is not differentiable
MIN_CURVATURE = 1e-6  # added to the curvature of (1), so that a command without effect does not change
LINEAR_MOTORS = {
    "dead_zone_forward": 0.0,
    "dead_zone_backward": 0.0,
    "gain": 1.0,
    "limit": NO_LIMIT,
    "coast": 0.0,
}
STEADY_MOTORS = {"duty_step": 0.0, "sag": 0.0, "battery_effect": 0.0}


class QuadraticProgram(NamedTuple):
    """A quadratic program: min ½ zᵀ P z + qᵀ z with low ≤ A z ≤ high."""

    P: np.ndarray  # (m, m)
    q: np.ndarray  # (m,)
    A: np.ndarray  # (w, m)
    low: np.ndarray  # (w,)
    high: np.ndarray


class Horizon:
    """The model of a controller over its horizon, compiled at the first use."""

    def __init__(self, law: "Mpc") -> None:
        linear_fields = {name: value * np.ones(1) for name, value in LINEAR_MOTORS.items()}
        self._motors, vehicle = law.vehicle.drivetrain, law.vehicle
        body: Any = vehicle
        # only delay and lag
        self._linear_vehicle = replace(
            body, drivetrain=replace(self._motors, **linear_fields, **STEADY_MOTORS)
        )
        self._delay_s = self._motors.delay_s + self._motors.longest_lag_s + SMOOTHING_S
        self._limit, self._e_max, self._catch_up_m_s = law.limit, law.e_max, law.catch_up_m_s
        self._active_rows = np.eye(vehicle.commands)[law.limit > 0.0]  # (k, n) commands with a limit above 0
        self._k, self._step_s = len(self._active_rows), law.horizon_s / STEPS
        max_command = self._active_rows @ np.minimum(law.limit, NO_LIMIT)
        max_change = law.command_change_max * np.where(max_command < NO_LIMIT, max_command, 1.0)
        self._max_change = max_change
        D = np.kron(np.eye(STEPS) - np.eye(STEPS, k=-1), np.eye(self._k))
        self._P = D.T @ D + MIN_CURVATURE * np.diag(np.tile(max_change, STEPS) ** 2)
        wall = np.array([law.wall_low, law.wall_high])
        self._with_wall = np.isfinite(wall).any(axis=0)
        self._walls = np.tile(wall[:, self._with_wall], STEPS)  # (2, w)
        self.wall_count = self._walls.shape[1]  # w: coordinates with a wall, over all steps
        self._no_walls = np.zeros((0, STEPS * self._k)), *np.zeros((2, 0))

    def rest_state(self) -> tuple[np.ndarray, np.ndarray, Tree]:
        """Return the plan (N, k), the effort (k,) and the state of the drivetrain after a long time at rest."""
        return np.zeros((STEPS, self._k)), np.zeros(self._k), self._linear_vehicle.drivetrain.init()

    def motor_constraints(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the rows (c, N k) that map the plan to the efforts of all motors and steps, and their bounds (c,)."""
        mix = np.column_stack([self._motors.mix(row) for row in self._active_rows])
        max_duty = np.minimum(
            np.abs(mix) @ np.minimum(self._active_rows @ self._limit, NO_LIMIT), self._motors.limit
        )
        low, high = (np.tile(self._motors.static_response(sign * max_duty), STEPS) for sign in (-1.0, 1.0))
        return np.kron(np.eye(STEPS), mix * self._max_change), low, high

    def linearised_program(
        self, state: MpcState, dt_s: float, reference: Reference, estimate: Estimate
    ) -> tuple[np.ndarray, Tree, np.ndarray, float, QuadraticProgram | None]:
        """Return the shifted plan (N, k), the drivetrain, velocity (3,) and turn error of the model, and the program.

        The program is None if the model diverges.
        """
        has_plan, poses = float(state.t_ns >= 0), (estimate.eta, estimate.nu, reference.eta, reference.nu)
        E, *model, start = self._begin_kernel(state[1:6], dt_s, has_plan, *poses)
        outputs, jacobians = self._kernel(z := E.ravel(), start)
        r, J = outputs[:, :RESIDUALS].reshape(-1), jacobians[:, :RESIDUALS].reshape(-1, len(z))
        P = J.T.dot(J)
        q = r.dot(J)
        q -= P.dot(z)
        q[: self._k] -= state.effort / self._max_change
        if not isfinite(q.dot(q)):
            return E, *model, None
        P += self._P
        if not self.wall_count:
            return E, *model, QuadraticProgram(P, q, *self._no_walls)
        A = jacobians[:, RESIDUALS:].reshape(-1, len(z))
        low, high = self._walls - (outputs[:, RESIDUALS:].ravel() - A.dot(z))
        return E, *model, QuadraticProgram(P, q, A, low, high)

    def command(self, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the command (n,) for a step of the plan (k,), within the limits, and the effort (k,) of it."""
        return self._command_kernel(step)

    @cached_property
    def _begin_kernel(self) -> Any:
        E, effort, drivetrain = self.rest_state()
        state = E, effort, drivetrain, np.zeros(3), 0.0
        return function(self._begin, state, 0.0, 0.0, *np.zeros((4, 3))).call

    @cached_property
    def _kernel(self) -> Any:
        return self._scan().bind_sensitivities(np.eye(STEPS))

    @cached_property
    def _command_kernel(self) -> Any:
        return function(self._command, np.zeros(self._k)).call

    def _command(self, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        motors, effort = self._motors, self._active_rows.T @ (step * self._max_change)
        u = np.clip(motors.inverse(effort), -self._limit, self._limit)
        u = motors.prioritise_turn(u)
        return u, self._active_rows @ motors.unmix(motors.static_response(motors.mix(u)))

    def _begin(
        self, previous: Tree, dt_s: Value, has_plan: Value, eta: Value, nu: Value, eta_r: Value, nu_r: Value
    ) -> tuple[np.ndarray, Tree, np.ndarray, Value, np.ndarray]:
        """Return the present plan, drivetrain, velocity and turn error of the model, and all inputs of the kernel."""
        E, effort, drivetrain, model_nu, turn_error = previous
        model = VehicleState(np.zeros(3), model_nu, np.zeros(3), drivetrain)
        model, _ = self._linear_vehicle.step(model, self._active_rows.T @ effort, dt_s, np.zeros(3))
        drivetrain, model_nu = model.drivetrain, np.where(has_plan > 0.0, model.nu, nu)
        turn_error = low_pass(turn_error, nu[2] - model_nu[2], MODEL_ERROR_RATIO * self._delay_s, dt_s)  # (6)
        turn_error = np.clip(turn_error, -max_turn_error(nu_r), max_turn_error(nu_r))
        k = np.minimum(np.arange(STEPS) + has_plan * dt_s / self._step_s, STEPS - 1.0)
        # linear interpolation between the steps
        E = np.maximum(1.0 - np.abs(k[:, None] - np.arange(STEPS)), 0.0) @ E
        min_step = MIN_EFFORT / self._max_change
        E = np.where(np.abs(E) < min_step, min_step * np.arange(1.0, self._k + 1.0), E)
        eta_r, nu_r = self._vehicle_reference(eta_r, nu_r, nu)
        entries = (
            eta,
            nu - np.array([0.0, 0.0, turn_error]),
            drivetrain.past_commands.ravel(),
            drivetrain.steps_s,
            drivetrain.lag_state,
            eta_r,
            nu_r,
            np.array([turn_error]),
        )
        return E, drivetrain, model_nu, turn_error, np.concatenate(entries)

    def _vehicle_reference(self, eta_r: Value, nu_r: Value, nu: Value) -> tuple[Value, Value]:
        """Return the reference (3,), (3,) with the slip that the vehicle has at the yaw rate of the reference.  (5)
        A vehicle with three commands can choose its slip.
        """
        if self._k > 2:
            return eta_r, nu_r
        b = optional.turning_arm_m(self._linear_vehicle)
        beta_r, beta = slip(nu_r), slip(np.array([nu_r[0], nu[1] + b * (nu_r[2] - nu[2]), 0.0]))
        speed = nu_r[0] * np.cos(beta_r) + nu_r[1] * np.sin(beta_r)
        eta = eta_r + np.array([0.0, 0.0, beta_r - beta])
        return eta, np.array([speed * np.cos(beta), speed * np.sin(beta), nu_r[2]])

    def _scan(self) -> Scan:
        """Return the kernel, which computes r and the coordinates with walls at the end of each step."""
        substeps = max(1, int(np.ceil(self._step_s / MAX_STEP_S)))
        dt_s, rest_state = self._step_s / substeps, self._linear_vehicle.drivetrain.init()
        offsets = np.cumsum(
            [3, 3, rest_state.past_commands.size, rest_state.steps_s.size, rest_state.lag_state.size, 3, 3]
        )

        # about the centre of turning
        turn = np.array([0.0, optional.turning_arm_m(self._linear_vehicle), 1.0])

        def step(theta: np.ndarray, x: np.ndarray, row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            eta, nu, *motor_parts, eta_r, nu_r, turn_error = np.split(x, offsets)
            motors = DrivetrainState(
                np.reshape(motor_parts[0], rest_state.past_commands.shape), *motor_parts[1:]
            )
            effort = self._active_rows.T @ (row @ np.reshape(theta, (STEPS, self._k)) * self._max_change)
            state = VehicleState(eta, nu, np.zeros(3), motors)
            for _ in range(substeps):
                state, _ = self._linear_vehicle.step(state, effort, dt_s, np.zeros(3))
                state = state._replace(eta=compose(state.eta, turn_error[0] * dt_s * turn))  # (6)
                eta_r = compose(eta_r, _arc(nu_r * dt_s))
            eta, motors = state.eta, state.drivetrain
            entries = (
                eta,
                state.nu,
                motors.past_commands.ravel(),
                motors.steps_s,
                motors.lag_state,
                eta_r,
                nu_r,
                turn_error,
            )
            margin = np.abs(state.nu[0]) - np.abs(nu_r[0]) - self._catch_up_m_s
            excess = 0.5 * (margin + np.sqrt(margin**2 + SMOOTH_M_S**2)) / EXCESS_M_S
            residuals = [pose_error(eta_r, eta) / self._e_max, np.array([excess])]
            outputs = [*residuals, eta[:2][self._with_wall]]
            return np.concatenate(entries), np.concatenate(outputs)

        return scan(step, np.zeros(offsets[-1] + 1), np.eye(STEPS)[0], np.zeros(STEPS * self._k))


def _arc(displacement: np.ndarray) -> np.ndarray:
    """Return the pose (3,) after a small displacement (3,) along an arc, from the origin."""
    chord = 1.0 - displacement[2] ** 2 / 24.0
    return map_from_body(0.5 * displacement[2]) @ np.array(
        [chord * displacement[0], chord * displacement[1], displacement[2]]
    )
