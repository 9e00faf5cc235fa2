"""Transmit force from motor to floor: a motor of the second order, gears with play, a wheel that slips.

The rim of a wheel moves at speed r without slip, and faster by s with slip; f is the force of its motor:

    second order    λ₂ q̇ = p − q,   p the target force of the motor; λ ḟ = q − f                          (1)
    gears           T = f − e (r + s),   e its back-EMF [N s/m], which is part of the body's drag         (2)
    play            γ̇ = T/e within ± β/2;   T′ = T with γ at the end that T points to, else 0             (3)
    slip            m ṡ = T′ − G,   G = D tanh(C s/D) the force on the floor; without slip G = T′, s = 0  (4)
    on the body     F = G + e r,   because the drag subtracts e r: F = f without play and slip            (5)

A rotor without load reaches its new speed immediately, so (3) does not contain an inertia. C and m are of a wheel of
30 g.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from baqueano.study.truth.group import Group

CREEP_N_S_M = 30.0  # C [N s/m]
WHEEL_KG = 0.03  # m, the inertia of the wheel reduced to its rim
WHEEL_STATES = 3  # states of a wheel: q, γ, s


class WheelForces(NamedTuple):
    """Forces and state rates from the motors to the wheels of n vehicles."""

    target: np.ndarray  # (n, w) q
    force: np.ndarray  # (n, w) F
    rate: np.ndarray  # (n, 3 w) of the inner states


@dataclass(frozen=True)
class Transmission(Group):
    """Parameters of n transmissions: arrays (n,)."""

    second_lag_s: np.ndarray  # λ₂, 0 for a motor of the first order
    play_m: np.ndarray  # β at the rim, 0 for none
    grip_n: np.ndarray  # D of one wheel, infinity if it does not slip

    @classmethod
    def ideal(cls, n: int) -> Self:
        """Return n transmissions that transmit the motor force unchanged."""
        return cls(np.zeros(n), np.zeros(n), np.full(n, np.inf))

    @cached_property
    def is_ideal(self) -> bool:
        """Return True if second lag, play and slip are absent in all vehicles. Then inner states are not needed."""
        return not (np.any(self.second_lag_s) or np.any(self.play_m) or np.any(np.isfinite(self.grip_n)))

    def states(self, wheels: int) -> int:
        """Return the number of inner states of a vehicle."""
        return 0 if self.is_ideal else WHEEL_STATES * wheels

    def transmit(
        self, inner: np.ndarray, steady: np.ndarray, force: np.ndarray, rim: np.ndarray, emf: np.ndarray
    ) -> WheelForces:
        """Return target q, force F and state rates, from p and f (n, w), rim speeds r (n, w), and e (n, 1).  (1)-(5)"""
        q, gamma, s = np.split(inner, WHEEL_STATES, axis=1)
        lag_s, half_play_m, slips = self.second_lag_s[:, None], 0.5 * self.play_m[:, None], self._has_slip
        T = force - emf * (rim + s)
        is_in_mesh = (half_play_m == 0.0) | (gamma * np.sign(T) >= half_play_m)
        thrust = np.where(is_in_mesh, T, 0.0)
        G = np.where(slips, self._grip * np.tanh(CREEP_N_S_M * s / self._grip), thrust)
        second = lag_s > 0.0
        q_dot = np.where(second, (steady - q) / np.where(second, lag_s, 1.0), 0.0)
        gamma_dot, s_dot = np.where(is_in_mesh, 0.0, T / emf), np.where(slips, (thrust - G) / WHEEL_KG, 0.0)
        rate = np.concatenate([q_dot, gamma_dot, s_dot], axis=1)
        return WheelForces(np.where(second, q, steady), G + emf * rim, rate)

    def slip(self, inner: np.ndarray) -> np.ndarray:
        """Return the slip s (n,) [m/s], the mean of the wheels."""
        if inner.shape[1]:
            return np.mean(np.split(inner, WHEEL_STATES, axis=1)[2], axis=1)
        return np.zeros(len(inner))

    @cached_property
    def _has_slip(self) -> np.ndarray:
        return np.isfinite(self.grip_n)[:, None]

    @cached_property
    def _grip(self) -> np.ndarray:
        return np.where(self._has_slip, self.grip_n[:, None], 1.0)
