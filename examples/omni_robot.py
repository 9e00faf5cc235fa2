"""Model a round robot with three omni wheels, 120° apart: it drives to any side and turns at the same time.

rim speed  w_i = −sin a_i ν_x + cos a_i ν_y + R ν_ψ,   a = 60°, 180°, 300°;   F_i = k u_i − d w_i − c tanh(w_i/0.05)
ν̇_x = −Σ sin a_i F_i / m + ν_ψ ν_y,   ν̇_y = Σ cos a_i F_i / m − ν_ψ ν_x,   ν̇_ψ = R Σ F_i / I
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from baqueano.parameter import parameter
from baqueano.vehicles import AccelerationModel

ANGLES = np.pi * np.array([1.0, 3.0, 5.0]) / 3.0
SIDE = np.stack([-np.sin(ANGLES), np.cos(ANGLES)])


@dataclass(frozen=True, slots=True, eq=False)
class OmniRobot(AccelerationModel):
    """An omni robot: u = (duty of wheel 1, 2, 3)."""

    commands: ClassVar[int] = 3

    mass_kg: float = parameter("kg", "mass m", low=0.01, high=1e3, role="fixed", measured_by="the scale")
    radius_m: float = parameter("m", "R", low=0.01, high=10.0, role="fixed", measured_by="the tape")
    inertia_kg_m2: float = parameter(
        "kg m²", "inertia I", low=1e-6, high=1e3, shown_by="turning on the spot, to and fro", symbol="I"
    )
    push: float = parameter(
        "N per unit of u", "force of a wheel, k", low=0.0, high=1e3, role="gain", shown_by="starts and stops"
    )
    drag: float = parameter("N s/m", "back EMF, d", low=0.0, high=1e3, shown_by="long drives to all sides")
    rollers: float = parameter(
        "N", "dry friction of the rollers of a wheel, c", low=0.0, high=1e2, default=0.0, role="term",
        term="dry friction of the rollers", shown_by="slow drives that stop, to all sides", symbol="c",
    )  # fmt: skip

    def nu_dot(self, nu: np.ndarray, effort: np.ndarray, psi: float = 0.0) -> np.ndarray:
        """Return ν̇ (3,) [m/s², m/s², rad/s²] at ν (3,) with the duties `effort` (3,)."""
        w = nu[:2] @ SIDE + self.radius_m * nu[2]
        F = self.push * effort - self.drag * w - self.rollers * np.tanh(w / 0.05)
        a = SIDE @ F / self.mass_kg + nu[2] * np.array([nu[1], -nu[0]])
        return np.array([a[0], a[1], self.radius_m * np.sum(F) / self.inertia_kg_m2])
