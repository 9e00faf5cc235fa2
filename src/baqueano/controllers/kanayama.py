"""Kanayama's tracking law: a Lyapunov function proves its stability for each error and each speed except 0.

    v = v_f cos e_χ + k_x e_x,    ω = ω_f ± v k_y e_y + v k_θ sin e_χ                                    (1)

v_f, ω_f: speed and yaw rate of the reference without jumps; e_x, e_y, e_χ: along-track, cross-track and course errors.
In ω, v is the larger of |v_f| and |v_f + k_x e_x|; + forward, − backward.
e_y decays over a distance, not over a time, with the damping ratio k_θ / (2 √k_y): by default 0.75 over 0.22 m. So the
loop would be too fast for the delay at a high speed. The gains are then limited by (6) of model_following.py.
The law approaches a far path at an angle of at most MAX_APPROACH_RAD. At rest it does not correct e_y. The error after
a turn on the spot remains until the vehicle moves on.

Source: Kanayama, Kimura, Miyazaki and Noguchi, ICRA 1990 (k_θ is its K_θ). model_following.py predicts the pose,
limits |v| by (4), and computes the command.
"""

from dataclasses import dataclass

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.controllers.following.tracking import MAX_APPROACH_RAD, Tracking
from baqueano.controllers.model_following import ModelFollower
from baqueano.parameter import document, parameter


@document
@dataclass(frozen=True, slots=True, eq=False)
class Kanayama(ModelFollower):
    """Controller that tracks a moving reference with one gain per error.

    References
    ----------
    Kanayama, Kimura, Miyazaki and Noguchi, ICRA 1990: equation (1) of the module.

    Examples
    --------
    >>> robot = bq.load("small")
    >>> law = Kanayama(robot.vehicle, limit=robot.command.limit, k_y=40.0)
    >>> path_on_the_left = Tracking(np.array([0.0, 0.1, 0.0]), 0.0, np.array([0.2, 0.0, 0.0]), 0.0, 1.0, 0.01)
    >>> _, (v, omega) = law.velocity_law(law.memory(), path_on_the_left)
    >>> print(f"{v:.2f} m/s, {omega:.2f} rad/s")
    0.20 m/s, 0.80 rad/s
    """

    k_x: float = parameter("1/s", "speed per along-track error e_x", low=0.0, high=10.0, default=1.0)
    k_y: float = parameter("1/m²", "curvature per cross-track error e_y", low=0.0, high=1e3, default=36.0)
    k_theta: float = parameter("1/m", "curvature per course error e_χ", low=0.0, high=1e3, default=9.0)

    def velocity_law(self, memory: np.ndarray, tracking: Tracking) -> tuple[np.ndarray, Tree]:
        """Return the unchanged memory, and the requested velocity (v, ω) [m/s, rad/s].  (1)"""
        (e_x, e_y, _), (v_f, _, omega_f) = tracking.e, tracking.nu_f
        speed = tracking.max_speed(v_f + self.k_x * e_x)
        k_theta, k_y = self.limited_gains(self.k_theta * speed, self.k_y * speed, speed, tracking.far_gain)
        max_correction = k_theta * np.sin(MAX_APPROACH_RAD)
        lateral_term = np.clip(k_y * e_y, -max_correction, max_correction)
        # the correction of e_y changes its sign backward, the damping of the course does not
        turn = np.sign(v_f) * lateral_term + k_theta * np.sin(tracking.e_chi)
        return memory, (v_f * np.cos(tracking.e_chi) + self.k_x * e_x, omega_f + turn)
