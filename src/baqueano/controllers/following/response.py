"""Compute the response of a vehicle to its command, and the command for a response, by its model.

    η_p = η + J(ψ + ½ Δ_ψ) Δ,    Δ = D (½ (ν_1 + ν_2) + d) + λ ν_f     the pose when a present command acts (1)
    ν̇_m: the model at ε,    ½ D ν̇_1 = ν_m − ν_1,    ½ D ν̇_2 = ν_1 − ν_2,    8 T ḋ = ν − ν_2 − d           (1a)
    u = drivetrain⁻¹(ε),    ε: the model at ν_w accelerates with ν̇_f; within the limits of u              (5)

A vehicle is D = delay + lag behind its command, and T = D + λ behind its reference; d: model error. (5) inverts
friction, actuator matrix and dead zone in one Newton step per tick. docs/derivations/pd_feedforward.md
"""

from dataclasses import dataclass

import numpy as np

from baqueano.contracts.values import Value
from baqueano.geometry import map_from_body
from baqueano.symbolic import jacobian
from baqueano.vehicles.effort import constant_effort
from baqueano.vehicles.rk4 import row_counts
from baqueano.vehicles.state import DynamicVehicle

SMOOTHING_S = 0.08  # λ: a corner of 1.5 rad/s costs a tenth of full command
MODEL_ERROR_RATIO = 8.0  # time constant of d, as a multiple of T
MIN_EFFECT = np.array([0.1, 1.0])  # m/s², rad/s²; a command with less effect, as a servo at rest, stays
TINY = 1e-12  # keeps a model without throttle finite


@dataclass(frozen=True, slots=True, eq=False)
class ModelResponse:
    """The response of a model: the vehicle, the rate of its ticks, and the largest command (n,)."""

    vehicle: DynamicVehicle
    rate_hz: float
    limit: np.ndarray

    @property
    def command_delay_s(self) -> float:
        """Return D [s], the delay of the vehicle behind its command."""
        return self.vehicle.drivetrain.delay_s + self.vehicle.drivetrain.longest_lag_s

    @property
    def reference_delay_s(self) -> float:
        """Return T [s], the delay of the vehicle behind its reference."""
        return self.command_delay_s + SMOOTHING_S

    def next_pipeline(
        self, pipeline: np.ndarray, effort: np.ndarray, nu: np.ndarray, dt_s: Value
    ) -> np.ndarray:
        """Return ν_m, ν_1, ν_2 and d (4, 3) after a tick with the effort (n,), at the velocity ν (3,).  (1a)"""
        nu_m, nu_1, nu_2, d = pipeline
        nu_m = self._advance(nu_m, effort)
        share = dt_s / np.maximum(np.maximum(0.5 * self.command_delay_s, dt_s), TINY)
        nu_1 = nu_1 + share * (nu_m - nu_1)
        nu_2 = nu_2 + share * (nu_1 - nu_2)
        d = low_pass(d, nu - nu_2, MODEL_ERROR_RATIO * self.reference_delay_s, dt_s)
        return np.array([nu_m, nu_1, nu_2, d])

    def predicted_pose(self, eta: np.ndarray, pipeline: np.ndarray, nu_f: np.ndarray) -> np.ndarray:
        """Return η_p (3,), the pose when a present command acts, of a vehicle at η (3,).  (1)"""
        _, nu_1, nu_2, d = pipeline
        displacement = self.command_delay_s * (0.5 * (nu_1 + nu_2) + d) + SMOOTHING_S * nu_f
        return eta + map_from_body(eta[2] + 0.5 * displacement[2]) @ displacement

    def next_effort(self, effort: np.ndarray, nu: np.ndarray, nu_dot: np.ndarray) -> np.ndarray:
        """Return ε (n,): the model at (v_w, ν_y, ω_w) then has the acceleration `nu_dot` (2,) over one tick.  (5)"""
        dt_s = 1.0 / self.rate_hz

        def next_velocity(effort: np.ndarray) -> np.ndarray:
            return self._advance(nu, effort)[::2]

        max_command = np.where(np.isfinite(self.limit), self.limit, 1.0)
        b_v, b_r = jacobian(next_velocity)(effort) * max_command
        remainder_v, remainder_r = nu[::2] + nu_dot * dt_s - next_velocity(effort)
        min_v, min_r = (MIN_EFFECT * dt_s) ** 2
        step = b_v * remainder_v / (b_v @ b_v + min_v)
        b_turn = b_r - b_v * (b_r @ b_v) / (b_v @ b_v + TINY)  # a turn must not change the speed
        step = step + b_turn * (remainder_r - b_r @ step) / (b_turn @ b_turn + min_r)
        return np.clip(effort + max_command * step, -self.limit, self.limit)

    def limited_command(self, effort: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return u (n,) within its limits for the effort ε (n,), and the effort that this u causes."""
        drivetrain = self.vehicle.drivetrain
        u = drivetrain.prioritise_turn(np.clip(drivetrain.inverse(effort), -self.limit, self.limit))
        return u, drivetrain.unmix(drivetrain.static_response(drivetrain.mix(u)))

    def _advance(self, nu: np.ndarray, effort: np.ndarray) -> np.ndarray:
        """Return the velocity (3,) of the model after a tick of usual length, with a constant effort (n,)."""
        dt_s = 1.0 / self.rate_hz
        rows = int(row_counts(np.array(dt_s)))
        for _ in range(rows):
            _, nu, _ = self.vehicle.advance(np.zeros(3), nu, constant_effort(effort), dt_s / rows)
        return nu


def low_pass(value: Value, target: Value, constant_s: Value, dt_s: Value) -> Value:
    """Return `value` after a tick in which it follows `target` with the time constant `constant_s`.  (1a), (4)"""
    return value + dt_s / np.maximum(constant_s, dt_s) * (target - value)
