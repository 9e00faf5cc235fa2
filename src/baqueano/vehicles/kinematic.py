"""The paper's kinematic model: an effort causes a velocity immediately, without a phase of acceleration.

    ν = V e − (0, k ν_x ν_ψ, 0)                                                                           (1)
    ν̇ = V ė − (0, k (ν̇_x ν_ψ + ν_x ν̇_ψ), 0) with a lag,  (ν − ν_before) / δ without                       (2)
    η̇ = J(ψ) ν, without a lag with ν of (1) during the whole tick δ                                       (3)

η is the pose, ν the velocity, V a matrix. e is the present effort if the motors have a lag, else the mean effort of the
tick. Without a lag, the present effort would let ν jump at each command, which real vehicles do not do. Grotz et al.
mention "the kinematic model" and "the V matrix", but their text does not define them (errata 7).

The last term of (1) is not in the paper: wheels slip outward a little, in proportion to m ν_x ν_ψ, the force in a
curve. k [s] is the mass divided by the lateral resistance of the wheels. docs/benchmarks.md contains its value.
"""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from baqueano.geometry import map_from_body, wrap
from baqueano.parameter import document, parameter
from baqueano.signals import Motion
from baqueano.vehicles.bounds import check_bounds, check_commands
from baqueano.vehicles.delay import MIN_TICK_S
from baqueano.vehicles.drivetrain import Drivetrain
from baqueano.vehicles.effort import Effort, constant_effort
from baqueano.vehicles.friction import NO_FRICTION
from baqueano.vehicles.rk4 import rk4
from baqueano.vehicles.state import VehicleState


@document
@dataclass(frozen=True, slots=True, eq=False)
class Kinematic:
    """A vehicle whose velocity is linear in its command: (u_x, u_y, u_ψ) → (ν_x, ν_y, ν_ψ).

    `Planar` is usually better; `Kinematic` suits a vehicle that follows a command within one or two ticks.

    Parameters
    ----------
    drivetrain : Drivetrain
        The block between the command and the effort.

    Notes
    -----
    Equations (1)-(3) of the module; the model that Grotz et al. call kinematic (errata 7).

    Examples
    --------
    >>> cart = Kinematic(velocity_matrix=np.diag([0.5, 0.0, 6.0]))
    >>> _, motion = cart.step(cart.init(), np.array([1.0, 0.0, 0.5]), 0.01, np.zeros(3))
    >>> print(motion.nu)
    [0.5 0.  3. ]
    """

    commands: ClassVar[int] = 3

    velocity_matrix: np.ndarray = parameter(
        "m/s, m/s, rad/s per unit of u", "body velocity for a command, V", low=-1e6, high=1e6, shape=(3, 3),
        role="gain", term="cross-talk", symbol="V",
    )  # fmt: skip
    slide_s: float = parameter(
        "s", "slip outward in a curve per ν_x ν_ψ, k", low=0.0, high=10.0, default=0.0, role="term",
        shown_by="turning at speed, seen by a camera", symbol="k",
    )  # fmt: skip
    drivetrain: Drivetrain = field(default_factory=Drivetrain)
    process_noise_std: np.ndarray = parameter(
        "m/s, m/s, rad/s", "standard deviation of the body velocity in a tick", low=0.0, high=1e6, default=NO_FRICTION,
        shape=(3,),
        role="noise",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_bounds(self)
        check_commands(self, "u_x, u_y, u_psi")

    def gravity(self, psi: float) -> np.ndarray:
        """Return gravity along body x and y (2,) [m/s²]: zeros, because the floor is level."""
        return np.zeros(2)

    def advance(
        self, eta: np.ndarray, nu: np.ndarray, effort: Effort, dt_s: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (η, ν, ν̇), (3,) each, after `dt_s` with an effort.  (1)-(3)"""
        return self._travel(eta, nu, effort, dt_s, np.zeros(3))

    def velocity(self, effort: np.ndarray) -> np.ndarray:
        """Return ν (3,) for an effort (3,).  (1)"""
        nu = self.velocity_matrix @ effort
        return nu - np.array([0.0, self.slide_s * nu[0] * nu[2], 0.0])

    def init(self, eta: np.ndarray | None = None, nu: np.ndarray | None = None) -> VehicleState:
        """Return the state at `eta` (3,) in the map with `nu` (3,) in the body; both are zero by default."""
        eta = np.zeros(3) if eta is None else eta
        nu = np.zeros(3) if nu is None else nu
        return VehicleState(eta, nu, np.zeros(3), self.drivetrain.init())

    def step(
        self, state: VehicleState, u: np.ndarray, dt_s: float, noise: np.ndarray
    ) -> tuple[VehicleState, Motion]:
        """Return the state and the Motion after a tick with the command `u` (3,).

        `noise` (3,) is standard normal, or zero for a simulation without process noise.
        """
        drivetrain, effort = self.drivetrain.step(state.drivetrain, u, dt_s)
        scatter = self.process_noise_std * noise
        eta, nu, nu_dot = self._travel(state.eta, state.nu, effort, dt_s, scatter)
        motion = Motion(eta, nu, nu_dot, np.zeros(2))
        tick = motion, motion, motion
        if self.drivetrain.has_lag:
            lag_state = self.drivetrain.unmix(state.drivetrain.lag_state)
            efforts = _parabola(lag_state, effort.mean, effort.last)
            rates = _parabola(effort.start_rate, effort.mean_rate, effort.last_rate)
            tick = tuple(
                Motion(eta_k, self.velocity(e) + scatter, self._acceleration(e, e_dot), np.zeros(2))
                for eta_k, e, e_dot in zip((state.eta, eta, eta), efforts, rates, strict=True)
            )
        return VehicleState(eta, nu, nu_dot, drivetrain), motion._replace(tick=tick)

    def _acceleration(self, effort: np.ndarray, effort_dot: np.ndarray) -> np.ndarray:
        """Return ν̇ (3,) for an effort (3,) and its rate of change (3,).  (2)"""
        nu, nu_dot = self.velocity_matrix @ effort, self.velocity_matrix @ effort_dot
        return nu_dot - np.array([0.0, self.slide_s * (nu_dot[0] * nu[2] + nu[0] * nu_dot[2]), 0.0])

    def _travel(
        self, eta: np.ndarray, previous: np.ndarray, effort: Effort, dt_s: float, scatter: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (η, ν, ν̇) after `dt_s`, with `scatter` (3,) added to ν.  (2), (3)
        Without a lag, ν̇ = 0 if `dt_s` is 0.
        """
        has_lag = self.drivetrain.has_lag
        effort = effort if has_lag else constant_effort(effort.mean)
        x = rk4(lambda x, e: map_from_body(x[2]) @ (self.velocity(e) + scatter), eta, effort, dt_s)
        nu = self.velocity(effort.last) + scatter
        if has_lag:
            nu_dot = self._acceleration(effort.last, effort.last_rate)
        else:
            nu_dot = np.where(dt_s > 0.0, (nu - previous) / np.maximum(dt_s, MIN_TICK_S), 0.0)
        return np.array([x[0], x[1], wrap(x[2])]), nu, nu_dot


def _parabola(
    start: np.ndarray, mean: np.ndarray, end: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return start, middle and end (n,) of the parabola over a tick with this `mean`, by Simpson's rule."""
    return start, 1.5 * mean - 0.25 * (start + end), end
