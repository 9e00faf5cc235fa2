"""A controller of your own: it also steers back to the path, which the paper's PD does not.

    u_x = v_r cos e_ψ / v_1 + k_x e_x
    u_ψ = (ω_r + v_r (k_y e_y + k_ψ sin e_ψ)) / ω_1              after Kanayama et al., ICRA 1990

It runs without changes. Change it, then:

    baqueano blocks check my_controller.py:MyController
    baqueano repeat lap --controller my_controller.py:MyController
"""

from dataclasses import dataclass

import numpy as np

from baqueano.geometry import pose_error
from baqueano.parameter import parameter
from baqueano.signals import Command, Estimate, Reference


@dataclass(frozen=True, slots=True, eq=False)
class MyController:
    """A controller with gains from the table [controller] of the vehicle file.

    v_1 (full_speed_m_s) and ω_1 (full_turn_rad_s) are the speed and the yaw rate at a command of 1. `baqueano tune`
    searches the fields that are parameters, within their bounds.
    """

    k_x: float = parameter(
        "unit of u per m", "command per along-track error", low=0.0, high=20.0, default=3.0
    )
    k_y: float = parameter("rad/m²", "curvature per cross-track error", low=0.0, high=200.0, default=40.0)
    k_psi: float = parameter("rad/m", "curvature per heading error", low=0.0, high=40.0, default=8.0)
    full_speed_m_s: float = 0.5
    full_turn_rad_s: float = 8.0

    def init(self) -> None:
        """Return None: this controller does not have a state."""
        return None

    def step(self, state: None, reference: Reference, estimate: Estimate) -> tuple[None, Command]:
        """Return the command (u_x, 0, u_psi), each in [-1, 1]: the reference's velocity plus a correction."""
        e = pose_error(reference.eta, estimate.eta)
        v, w = reference.nu[0], reference.nu[2]
        u_x = v * np.cos(e[2]) / self.full_speed_m_s + self.k_x * e[0]
        u_psi = (w + v * (self.k_y * e[1] + self.k_psi * np.sin(e[2]))) / self.full_turn_rad_s
        u = np.clip(np.array([u_x, 0.0, u_psi]), -1.0, 1.0)
        return state, Command(estimate.t_ns, u)
