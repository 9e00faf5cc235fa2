"""Kanayama's tracking law: stable by a Lyapunov function, for each error and each speed but 0.

    v = v_f cos e_χ + k_x e_x,    ω = ω_f + v_f (k_y e_y + k_χ sin e_χ)                                   (1)

An error fades over a way, not over a time: with k_χ² = 4 k_y critically, over 2 / k_χ metres. A far path is approached
at STEEPEST_RAD at most. At rest it corrects nothing beside the vehicle, and it keeps the error of a turn on the spot
until it moves on.
Source: Kanayama, Kimura, Miyazaki and Noguchi, ICRA 1990. Letters and command: model_following.py.
"""

from dataclasses import dataclass

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.controllers.model_following import STEEPEST_RAD, ModelFollower, Tracking
from baqueano.parameter import documented, parameter


@documented
@dataclass(frozen=True, slots=True, eq=False)
class Kanayama(ModelFollower):
    """Track a moving reference with one gain per error.

    References
    ----------
    Kanayama, Kimura, Miyazaki and Noguchi, ICRA 1990: equation (1) of the module.

    Examples
    --------
    >>> robot = bq.load("small")
    >>> law = Kanayama(robot.vehicle, limit=robot.command.limit, k_y=30.0)
    >>> path_on_the_left = Tracking(np.array([0.0, 0.1, 0.0]), 0.0, np.array([0.2, 0.0, 0.0]), 0.0, 1.0, 0.01)
    >>> _, (v, omega) = law.velocity_law(law.memory(), path_on_the_left)
    >>> print(f"{v:.2f} m/s, {omega:.2f} rad/s")
    0.20 m/s, 0.60 rad/s
    """

    k_x: float = parameter("1/s", "speed per error ahead e_x", low=0.0, high=10.0, default=1.0)
    k_y: float = parameter("1/m²", "curvature per error beside e_y", low=0.0, high=1e3, default=20.0)
    k_chi: float = parameter("1/m", "curvature per error of the course e_χ", low=0.0, high=1e3, default=8.0)

    def velocity_law(self, memory: np.ndarray, now: Tracking) -> tuple[np.ndarray, Tree]:
        """Return the velocity wanted.  (1)"""
        (e_x, e_y, _), (v_f, _, omega_f) = now.e, now.nu_f
        steepest = self.k_chi * np.sin(STEEPEST_RAD)
        lateral = np.clip(self.k_y * e_y, -steepest, steepest)
        # v_f changes its sign backwards, and the damping of the course must not.
        turn = v_f * lateral + np.abs(v_f) * self.k_chi * np.sin(now.e_chi)
        return memory, (v_f * np.cos(now.e_chi) + self.k_x * e_x, omega_f + turn)
