"""Pure pursuit: drive on the arc that ends at a point of the path ahead.

    L = max(look_ahead_m, look_ahead_s V, 2.45 T V),    l = max(√(L² − e_y²), |e_y| / tan χ_max)
    v = v_f + k_x e_x,    V = max(|v|, |v_f|),    ω = ± V 2 y / (x² + y²)                                 (1)

(x, y): point of the path at the distance L from the vehicle, in the body frame; l: its distance along the path from the
point beside the vehicle. v_f: speed of the reference without jumps; e_x, e_y: along-track and cross-track errors;
+ forward, − backward. (1) is the curvature of the arc that leaves the vehicle along its course and ends at (x, y). With
a longer L the motion is smoother, but cuts corners. A loop that is faster than the delay T of the vehicle oscillates:
T limits L. From a distance, the chord to (x, y) has the angle χ_max to the path. The law cannot turn on the spot, and
does not correct at rest. If T at least doubles L, g e_y replaces e_y in (x, y), with g of (6) of model_following.py.

Sources: Coulter, CMU-RI-TR-92-01, 1992; L as in Macenski et al., Autonomous Robots, 2023. model_following.py predicts
the pose, limits |v| by (4), and computes the command.
"""

from dataclasses import dataclass

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.controllers.following.tracking import Tracking, point_ahead
from baqueano.controllers.model_following import ModelFollower
from baqueano.parameter import document, parameter

DELAY_RATIO = 2.45  # of L / V and T
MAX_APPROACH_RAD = 0.65  # χ_max, with e_y


@document
@dataclass(frozen=True, slots=True, eq=False)
class PurePursuit(ModelFollower):
    """Controller that steers to a point of the path; its main parameter is the distance L to this point.

    References
    ----------
    Coulter, CMU-RI-TR-92-01, 1992: equation (1) of the module.

    Examples
    --------
    >>> robot = bq.load("small")
    >>> law = PurePursuit(robot.vehicle, limit=robot.command.limit, look_ahead_m=0.15)
    >>> path_on_the_left = Tracking(np.array([0.0, 0.1, 0.0]), 0.0, np.array([0.2, 0.0, 0.0]), 0.0, 1.0, 0.01)
    >>> _, (v, omega) = law.velocity_law(law.memory(), path_on_the_left)
    >>> print(f"{v:.2f} m/s, {omega:.2f} rad/s")
    0.20 m/s, 1.47 rad/s
    """

    k_x: float = parameter("1/s", "speed per along-track error e_x", low=0.0, high=10.0, default=1.0)
    look_ahead_m: float = parameter("m", "smallest look-ahead distance L", low=0.001, high=10.0, default=0.1)
    look_ahead_s: float = parameter(
        "s",
        "look-ahead distance L per m/s, if it is more than look_ahead_m; at least 2.45 T",
        low=0.0,
        high=10.0,
        default=0.3,
    )

    def velocity_law(self, memory: np.ndarray, tracking: Tracking) -> tuple[np.ndarray, Tree]:
        """Return the unchanged memory, and the requested velocity (v, ω) [m/s, rad/s].  (1)"""
        v_f = tracking.nu_f[0]
        v = v_f + self.k_x * tracking.e[0]
        speed = tracking.max_speed(v)
        L = np.maximum(self.look_ahead_s, DELAY_RATIO * self.response_delay_s) * speed
        L = np.maximum(self.look_ahead_m, L)
        e_y, e_chi = tracking.e[1], tracking.e_chi
        ahead_m = np.sqrt(np.maximum(L**2 - e_y**2, (e_y / np.tan(MAX_APPROACH_RAD)) ** 2))
        e_y = e_y * np.minimum(tracking.far_gain, np.maximum(0.5 * L / self.look_ahead_m, 1.0) ** 2)
        offset_m = np.array([-np.sin(e_chi) * e_y, e_y])
        kappa = np.clip(tracking.kappa, -1.0 / ahead_m, 1.0 / ahead_m)  # the arc bends by at most 1 rad
        x, y = point_ahead(offset_m, e_chi, kappa, tracking.forward_sign * ahead_m)
        curvature = 2.0 * y / np.maximum(x * x + y * y, 0.25 * L * L) - kappa  # 0 on a bend without errors
        return memory, (v, tracking.nu_f[2] + tracking.forward_sign * speed * curvature)
