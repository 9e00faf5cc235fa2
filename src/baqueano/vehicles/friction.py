"""Friction of the floor, the wheels and the gears.

    f(ν) = (d_l + d_c |ν|) ν + d_k tanh(ν / ν_k) + (k ν_x |ν_ψ|, 0, 0) + (F_l + F_r, 0, (F_r − F_l) b/2)   (1)
    F = t (d_f (1 + t) + d_b (1 − t)) / 2,   t = tanh(v / ν_k),   of a wheel at v = ν_x ∓ ν_ψ b/2           (2)

ν is the velocity. The first term is D(ν)ν of Grotz et al., `equ:D`, axis by axis, with d ≥ 0 (errata 1, 6); the paper
prints negative d. The second term is dry (Coulomb) friction, smoothed over ν_k so that it can be integrated and
differentiated (errata 12). The third term is the drag of cornering. The fourth is the dry friction of two wheels at the
distance b: d_f when a wheel rolls forward, d_b backward. A run distinguishes d_k of x from d_f and d_b only in tight
turns: let a fit estimate either d_k, or d_f and d_b, but not all three.

Each term opposes the motion: ν · f(ν) ≥ 0, so friction never adds energy to the vehicle. For RK4 with a step h and a
mass m, keep m ν_k / d_k and m / d_l above h/2: see rk4.py.
"""

from dataclasses import dataclass

import numpy as np

from baqueano.errors import Invalid
from baqueano.parameter import document, parameter
from baqueano.vehicles.bounds import check_bounds

NO_FRICTION = (0.0, 0.0, 0.0)


@document
@dataclass(frozen=True, slots=True, eq=False)
class Friction:
    """Friction of a rigid body in the plane, along body x and y and about z.

    Notes
    -----
    Equations (1) and (2) of the module; the first term is D(ν)ν of Grotz et al., `equ:D`.

    Examples
    --------
    >>> floor = Friction(linear=np.array([1.0, 1.0, 0.01]))
    >>> print(floor.force(np.array([0.2, 0.0, 1.0])))
    [0.2  0.   0.01]
    """

    linear: np.ndarray = parameter(
        "N s/m, N s/m, N m s/rad", "viscous friction d_l", low=0.0, high=1e6, default=NO_FRICTION, shape=(3,),
        shown_by=("driving forward and back, and coasting", "sliding sideways, as in fast tight turns",
        "turning, and coasting out of the turn"), symbol="d_{l}",
        label=("drag forward", "drag sideways", "drag in turning"),
    )  # fmt: skip
    quadratic: np.ndarray = parameter(
        "N s²/m², N s²/m², N m s²/rad²", "quadratic friction d_c", low=0.0, high=1e6, default=NO_FRICTION,
        shape=(3,), neutral=0.0,
        term=("quadratic drag forward", "quadratic drag sideways", "quadratic drag turning"),
        shown_by=("driving forward both slowly and at full speed",
        "sliding sideways both slowly and fast, as in turns at many speeds",
        "turning both slowly and at full rate"), symbol="d_{c}",
        label=("drag forward, ∝ v²", "drag sideways, ∝ v²", "drag in turning, ∝ r²"),
    )  # fmt: skip
    coulomb: np.ndarray = parameter(
        "N, N, N m", "dry friction d_k", low=0.0, high=1e6, default=NO_FRICTION, shape=(3,), role="term",
        term=("dry friction forward", "dry friction sideways", "dry friction turning"),
        shown_by=("driving slowly and stopping, many times", "sliding sideways slowly",
        "turning slowly and stopping, many times"), symbol="d_{k}",
        label=("dry friction forward", "dry friction sideways", "dry friction in turning"),
        sign_speed="coulomb_speed",
    )  # fmt: skip
    coulomb_speed: np.ndarray = parameter(
        "m/s, m/s, rad/s", "speed over which dry friction changes sign", low=1e-4, high=1e3,
        default=(0.05, 0.05, 0.5), shape=(3,), role="fixed",
    )  # fmt: skip
    cornering: float = parameter(
        "kg/rad", "drag of cornering k", low=0.0, high=1e6, default=0.0, role="rolling",
        term="drag of cornering", shown_by="turning at speed", symbol="k",
    )  # fmt: skip
    coulomb_forward: np.ndarray = parameter(
        "N", "dry friction of the left and the right wheel, forward", low=0.0, high=1e6, default=(0.0, 0.0),
        shape=(2,), role="term", term="dry friction of the wheels",
        shown_by=("the left wheel rolling forward slowly, and stopping, many times",
        "the right wheel rolling forward slowly, and stopping, many times"), symbol="c_{f}",
        sign_speed="coulomb_speed",
    )  # fmt: skip
    coulomb_backward: np.ndarray = parameter(
        "N", "dry friction of the left and the right wheel, backward", low=0.0, high=1e6, default=(0.0, 0.0),
        shape=(2,), role="term", term="dry friction of the wheels",
        shown_by=("the left wheel rolling backward slowly, and stopping, many times",
        "the right wheel rolling backward slowly, and stopping, many times"), symbol="c_{b}",
        sign_speed="coulomb_speed",
    )  # fmt: skip
    track_m: float = parameter(
        "m", "distance from the left to the right wheel, b; 0 if unknown", low=0.0, high=100.0, default=0.0,
        role="fixed", measured_by="the tape", shown_by="turns whose angle is known", symbol="b_{t}",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_bounds(self)
        if self.track_m == 0.0 and (np.any(self.coulomb_forward) or np.any(self.coulomb_backward)):
            raise Invalid.of("friction.track")

    def force(self, nu: np.ndarray) -> np.ndarray:
        """Return f(ν) (3,) [N, N, N m], the force and torque to be subtracted from the driving force.  (1)"""
        d = (self.linear + self.quadratic * np.abs(nu)) * nu
        dry_friction = self.coulomb * np.tanh(nu / self.coulomb_speed)
        turning_force = np.array([self.cornering * nu[0] * np.abs(nu[2]), 0.0, 0.0])
        return d + dry_friction + turning_force + self._wheel_friction(nu)

    def _wheel_friction(self, nu: np.ndarray) -> np.ndarray:
        """Return the dry friction (3,) [N, N, N m] of the two wheels.  (2)"""
        half_track = 0.5 * self.track_m
        t = np.tanh(
            np.array([nu[0] - half_track * nu[2], nu[0] + half_track * nu[2]]) / self.coulomb_speed[0]
        )
        F = 0.5 * t * (self.coulomb_forward * (1.0 + t) + self.coulomb_backward * (1.0 - t))
        return np.array([F[0] + F[1], 0.0, half_track * (F[1] - F[0])])
