"""PD control with feed-forward from the vehicle's model: the recommended controller, with smooth motion.

    v = v_f + k_x e_x,    ω = ω_f + k (e_χ ± atan(g e_y / L)),  L = max(join_m, 1.44 V / k)                (1)
    k = max(k_χ, min(1.44 V / join_m, 1 / (1.5 T))),    V = max(|v|, |v_f|)                               (2)

v_f, ω_f: speed and yaw rate of the reference without jumps; e_x, e_y, e_χ: along-track, cross-track and course errors.
The vehicle steers towards a point of the path that is L ahead of it (line of sight); + forward, − backward. The
damping ratio √(k L / V) / 2 is at least 0.6. At a high speed, (2) increases k as far as the delay T permits, for a
short L. g is 1 near the path, and up to 2 far from it, where the vehicle approaches at a larger angle: (6) of
model_following.py, which also predicts the pose, limits |v| by (4), and computes the command. The controller works at
any speed and in turns on the spot.

Source: Fossen, Handbook of Marine Craft, 2011, ch. 12. Derivation: docs/derivations/pd_feedforward.md.
"""

from dataclasses import dataclass

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.controllers.following.tracking import Tracking
from baqueano.controllers.model_following import ModelFollower
from baqueano.parameter import document, parameter

DAMPING_RATIO = 1.44  # k L / speed, for a damping ratio of 0.6
MAX_GAIN_SHARE = 0.9  # fraction of k_T of model_following.py, which is 1 / (1.5 T)


@document
@dataclass(frozen=True, slots=True, eq=False)
class PdFeedforward(ModelFollower):
    """Controller with feed-forward from the model and weak feedback of position and course: the recommended controller.

    References
    ----------
    Fossen, Handbook of Marine Craft, 2011, ch. 12: equation (1) of the module. docs/derivations/pd_feedforward.md.

    Examples
    --------
    >>> robot = bq.load("small")
    >>> law = PdFeedforward(robot.vehicle, limit=robot.command.limit, join_m=0.2)
    >>> path_on_the_left = Tracking(np.array([0.0, 0.1, 0.0]), 0.0, np.array([0.2, 0.0, 0.0]), 0.0, 1.0, 0.01)
    >>> _, (v, omega) = law.velocity_law(law.memory(), path_on_the_left)
    >>> print(f"{v:.2f} m/s, {omega:.2f} rad/s")
    0.20 m/s, 1.85 rad/s
    """

    k_x: float = parameter("1/s", "speed per along-track error e_x", low=0.0, high=10.0, default=1.0)
    k_chi: float = parameter("1/s", "smallest yaw rate per course error e_χ", low=0.0, high=20.0, default=4.0)
    join_m: float = parameter(
        "m", "smallest distance L within which the vehicle joins the path", low=0.01, high=10.0, default=0.25
    )

    def velocity_law(self, memory: np.ndarray, tracking: Tracking) -> tuple[np.ndarray, Tree]:
        """Return the unchanged memory, and the requested velocity (v, ω) [m/s, rad/s].  (1)"""
        v = tracking.nu_f[0] + self.k_x * tracking.e[0]
        speed = tracking.max_speed(v)
        needed_k = DAMPING_RATIO * speed / self.join_m
        k = np.maximum(self.k_chi, np.minimum(needed_k, MAX_GAIN_SHARE * self.max_course_gain))  # (2)
        L = np.maximum(self.join_m, DAMPING_RATIO * speed / np.maximum(k, 1e-3))
        turn = tracking.e_chi + tracking.forward_sign * np.arctan(tracking.far_gain * tracking.e[1] / L)
        return memory, (v, tracking.nu_f[2] + k * turn)
