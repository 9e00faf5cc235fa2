"""The paper's dynamic model: a rigid body in the plane, driven by forces that are linear in the command.

    M ν̇ + C(ν)ν + D(ν)ν + g(η) = T u          Grotz et al., `equ:movement_equation`                       (1)
    η̇ = J(ψ) ν                                                                                            (2)
    ν̇_ψ = (N − c Y) / I                       (X, Y, N) = T u − f(ν), f(ν) the friction of friction.py    (3)
    ν̇_x = X/m + g_x + ν_ψ ν_y + c ν_ψ²                                                                    (4)
    ν̇_y = Y/m + g_y − ν_ψ ν_x − c ν̇_ψ                                                                     (5)
    g_xy = −g sin α (cos(χ − ψ), sin(χ − ψ))  a floor that rises by α towards χ of the map                (6)

η: pose; ν: velocity; u: command, after the drivetrain; T: actuator matrix; m, I: mass and inertia about the centre of
mass. The origin of the body is on the axle; the centre of mass is c ahead of it. Departures from the printed text:
the third row of C(ν)ν is 0 for c = 0 (errata 2); D is dissipative, d ≥ 0 (errata 1, 6); g(η) is (6). Derivation:
docs/derivations/vehicles.md.
"""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from baqueano.geometry import map_from_body, wrap
from baqueano.parameter import document, parameter
from baqueano.signals import STANDARD_GRAVITY, Motion
from baqueano.vehicles.bounds import check_bounds, check_commands
from baqueano.vehicles.drivetrain import Drivetrain
from baqueano.vehicles.effort import Effort
from baqueano.vehicles.friction import NO_FRICTION, Friction
from baqueano.vehicles.rk4 import rk4
from baqueano.vehicles.state import VehicleState, tick_effort, tick_end


@document
@dataclass(frozen=True, slots=True, eq=False)
class Planar:
    """A vehicle that two forces and a torque move: (u_x, u_y, u_ψ) → (τ_x, τ_y, τ_ψ).

    Parameters
    ----------
    friction : Friction
        The friction forces, which oppose the motion.
    drivetrain : Drivetrain
        The block between the command and the effort.

    Notes
    -----
    Equations (1)-(6) of the module; Grotz et al., `equ:movement_equation`. docs/derivations/vehicles.md derives them.

    Examples
    --------
    >>> robot = Planar(mass_kg=0.6, inertia_kg_m2=1.5e-3, actuator_matrix=np.diag([0.9, 0.0, 0.02]))
    >>> print(robot.nu_dot(np.zeros(3), np.array([1.0, 0.0, 0.0])))
    [1.5 0.  0. ]
    """

    commands: ClassVar[int] = 3

    mass_kg: float = parameter(
        "kg", "mass m", low=1e-3, high=1e5, role="fixed", measured_by="the scale", symbol="m"
    )
    inertia_kg_m2: float = parameter(
        "kg m²", "inertia I about the centre of mass", low=1e-9, high=1e7, role="fixed",
        measured_by="½ m R²", symbol="I",
    )  # fmt: skip
    actuator_matrix: np.ndarray = parameter(
        "N, N, N m per unit of u", "force of a command, T", low=-1e6, high=1e6, shape=(3, 3), role="gain",
        term="cross-talk", symbol="T",
        label=("motor force", "sideways motor force", "motor torque"),
    )  # fmt: skip
    centre_of_mass_x_m: float = parameter(
        "m", "distance c from the axle forward to the centre of mass", low=-10.0, high=10.0, default=0.0, role="fixed",
        term="centre of mass", start=(0.01, -0.01), shown_by="sudden changes of yaw rate, and turning fast",
        symbol="x_{c}",
    )  # fmt: skip
    friction: Friction = field(default_factory=Friction)
    drivetrain: Drivetrain = field(default_factory=Drivetrain, metadata={"roles": {"coast": "fixed"}})
    slope_rad: float = parameter("rad", "slope of the floor, α", low=0.0, high=1.5, default=0.0, role="fixed")
    slope_heading_rad: float = parameter(
        "rad",
        "direction in the map in which the floor rises, χ",
        low=-7.0,
        high=7.0,
        default=0.0,
        role="fixed",
    )
    process_noise_std: np.ndarray = parameter(
        "m/s/√s, m/s/√s, rad/s/√s",
        "white body acceleration outside the model: its random walk of ν in 1 s", low=0.0, high=1e6,
        default=NO_FRICTION, shape=(3,), role="noise",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_bounds(self)
        check_commands(self, "u_x, u_y, u_psi")

    @property
    def turning_arm_m(self) -> float:
        """Return ν̇_y per ν̇_ψ [m]: the distance from the centre of mass forward to the origin."""
        return -self.centre_of_mass_x_m

    def gravity(self, psi: float) -> np.ndarray:
        """Return gravity along body x and y (2,) [m/s²].  (6)"""
        downhill = -STANDARD_GRAVITY * np.sin(self.slope_rad)
        return np.array(
            [downhill * np.cos(self.slope_heading_rad - psi), downhill * np.sin(self.slope_heading_rad - psi)]
        )

    def nu_dot(self, nu: np.ndarray, effort: np.ndarray, psi: float = 0.0) -> np.ndarray:
        """Return ν̇ = M⁻¹ (T u − C(ν)ν − D(ν)ν − g(η)), (3,).  (3)-(5)"""
        m, I, c = self.mass_kg, self.inertia_kg_m2, self.centre_of_mass_x_m
        X, Y, N = self.actuator_matrix @ effort - self.friction.force(nu)
        g = self.gravity(psi)
        psi_ddot = (N - c * Y) / I
        x_ddot = X / m + g[0] + nu[2] * nu[1] + c * nu[2] * nu[2]
        y_ddot = Y / m + g[1] - nu[2] * nu[0] - c * psi_ddot
        return np.array([x_ddot, y_ddot, psi_ddot])

    def viscous_effort(self, nu: np.ndarray) -> np.ndarray:
        """Return the effort (3,) of the commands along x, y and about z that balances the viscous drag at ν (3,)."""
        T = np.diag(self.actuator_matrix)
        return np.where(T != 0.0, self.friction.linear * nu / np.where(T != 0.0, T, 1.0), 0.0)

    def advance(
        self, eta: np.ndarray, nu: np.ndarray, effort: Effort, dt_s: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (η, ν, ν̇), (3,) each, after `dt_s` with an effort; ν̇ is the value at the end.  (1), (2)"""

        def x_dot(x: np.ndarray, effort: np.ndarray) -> np.ndarray:
            return np.concatenate([map_from_body(x[2]) @ x[3:], self.nu_dot(x[3:], effort, x[2])])

        x = rk4(x_dot, np.concatenate([eta, nu]), effort, dt_s)
        eta = np.array([x[0], x[1], wrap(x[2])])
        return eta, x[3:], self.nu_dot(x[3:], effort.last, eta[2])

    def init(self, eta: np.ndarray | None = None, nu: np.ndarray | None = None) -> VehicleState:
        """Return the state at `eta` (3,) in the map with `nu` (3,) in the body, both zero by default, motors off."""
        eta = np.zeros(3) if eta is None else eta
        nu = np.zeros(3) if nu is None else nu
        return VehicleState(eta, nu, self.nu_dot(nu, np.zeros(3), eta[2]), self.drivetrain.init())

    def step(
        self, state: VehicleState, u: np.ndarray, dt_s: float, noise: np.ndarray
    ) -> tuple[VehicleState, Motion]:
        """Return the state and the Motion after a tick with the command `u` (3,).

        `noise` (3,) is standard normal, or zero for a simulation without process noise. The noise changes ν at the end
        of the tick; ν̇ is the acceleration of the model at the changed ν.
        """
        drivetrain, effort = tick_effort(self, state.drivetrain, state.eta[2], state.nu, u, dt_s)
        eta, nu, _ = self.advance(state.eta, state.nu, effort, dt_s)
        nu = nu + self.process_noise_std * np.sqrt(dt_s) * noise
        return tick_end(self, state, eta, nu, drivetrain, effort, dt_s)
