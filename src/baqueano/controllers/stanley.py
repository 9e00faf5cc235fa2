"""Stanley's law: steer a front axle onto the path, as a driver who watches the front wheels.

    v = v_f + k_x e_x,    V = max(|v|, |v_f|),    l = max(axle_m, axle_s V, 1.35 T V)
    δ = e_χ ± atan(k_f (e_y ± l_f sin e_χ)),    ω = ω_f + V sin(δ) / l,    |δ| ≤ max_steering_rad         (1)
    k_f = k_y l / V,    l_f = (k_χ − V / l) / k_y                for l_f = l:  k_f = k / (v_soft + V)      (2)

v_f, ω_f: speed and yaw rate of the reference without jumps; e_x, e_y, e_χ: along-track, cross-track and course errors.
l: from the origin to an axle in front of it, which the vehicle does not need to have; − is for backward motion. The
cross-track error of this axle decays at the rate k. A loop that is faster than the delay T oscillates. So (6) of
model_following.py limits the gains k_χ and k_y of this law, which then uses the error at the distance l_f ≤ l. The axle
is compared with the axle of the reference, so a bend does not cause an error. MAX_APPROACH_RAD limits the arctangent.
The law does not correct errors at rest or in a turn on the spot.

Source: Hoffmann, Tomlin, Montemerlo and Thrun, ACC 2007. model_following.py predicts the pose, limits |v| by (4), and
computes the command.
"""

from dataclasses import dataclass

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.controllers.following.response import TINY
from baqueano.controllers.following.tracking import MAX_APPROACH_RAD, Tracking
from baqueano.controllers.model_following import ModelFollower
from baqueano.parameter import document, parameter


@document
@dataclass(frozen=True, slots=True, eq=False)
class Stanley(ModelFollower):
    """Controller that steers by the error of a front axle.

    References
    ----------
    Hoffmann, Tomlin, Montemerlo and Thrun, ACC 2007: equation (1) of the module.

    Examples
    --------
    >>> robot = bq.load("small")
    >>> law = Stanley(robot.vehicle, limit=robot.command.limit, k=3.0)
    >>> path_on_the_left = Tracking(np.array([0.0, 0.1, 0.0]), 0.0, np.array([0.2, 0.0, 0.0]), 0.0, 1.0, 0.01)
    >>> _, (v, omega) = law.velocity_law(law.memory(), path_on_the_left)
    >>> print(f"{v:.2f} m/s, {omega:.2f} rad/s")
    0.20 m/s, 1.54 rad/s
    """

    k_x: float = parameter("1/s", "speed per along-track error e_x", low=0.0, high=10.0, default=1.0)
    k: float = parameter(
        "1/s", "rate at which the cross-track error decreases", low=0.0, high=20.0, default=6.0
    )
    axle_m: float = parameter(
        "m", "smallest distance l from the vehicle to its front axle", low=0.001, high=10.0, default=0.1
    )
    axle_s: float = parameter(
        "s", "distance l per m/s, if it is more than axle_m", low=0.0, high=10.0, default=0.25
    )
    softening_speed_m_s: float = parameter(
        "m/s", "v_soft: makes the steering softer at low speed", low=1e-3, high=10.0, default=0.05
    )
    max_steering_rad: float = parameter("rad", "largest steering angle δ", low=0.01, high=1.57, default=1.2)

    def velocity_law(self, memory: np.ndarray, tracking: Tracking) -> tuple[np.ndarray, Tree]:
        """Return the unchanged memory, and the requested velocity (v, ω) [m/s, rad/s].  (1)"""
        (e_x, e_y, _), (v_f, _, omega_f) = tracking.e, tracking.nu_f
        speed = tracking.max_speed(v_f + self.k_x * e_x)
        axle_m = np.maximum(np.maximum(self.axle_m, self.axle_s * speed), speed / self.max_course_gain)
        rate = self.k * speed / (self.softening_speed_m_s + speed)
        k_chi, k_y = self.limited_gains(speed / axle_m + rate, rate / axle_m, speed, tracking.far_gain)
        correction = k_y * e_y + tracking.forward_sign * (k_chi - speed / axle_m) * np.sin(tracking.e_chi)
        approach_angle = np.arctan(correction * axle_m / np.maximum(speed, TINY))  # (2)
        approach_angle = np.clip(approach_angle, -MAX_APPROACH_RAD, MAX_APPROACH_RAD)
        delta = tracking.e_chi + tracking.forward_sign * approach_angle
        delta = np.clip(delta, -self.max_steering_rad, self.max_steering_rad)
        return memory, (v_f + self.k_x * e_x, omega_f + speed * np.sin(delta) / axle_m)
