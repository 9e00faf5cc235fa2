"""Base of a vehicle that is defined by its acceleration: a subclass writes only ν̇(ν, effort, ψ).

    η̇ = J(ψ) ν,   ν̇ = nu_dot(ν, effort, ψ); ν stays 0 along each axis that is not in `axes`                (1)

η is the pose, ψ its heading, ν the velocity, J(ψ) the rotation from body to map. A subclass defines its parameters and
`nu_dot`. It inherits the drivetrain, the process noise and the methods of `Vehicle`. The floor is level.
"""

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from baqueano.errors import MissingMethod
from baqueano.geometry import map_from_body, wrap
from baqueano.parameter import document, parameter
from baqueano.signals import Motion
from baqueano.vehicles.bounds import check_bounds
from baqueano.vehicles.drivetrain import Drivetrain
from baqueano.vehicles.effort import Effort
from baqueano.vehicles.friction import NO_FRICTION
from baqueano.vehicles.rk4 import rk4
from baqueano.vehicles.state import VehicleState, tick_end


@document
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AccelerationModel:
    """Base of a vehicle whose subclass defines `nu_dot`; the other methods follow from it.

    Parameters
    ----------
    drivetrain : Drivetrain
        The block between the command and the effort.

    Notes
    -----
    Equation (1) of the module. The class variable `commands` is the number of commands. `axes` lists the axes of the
    body along which the vehicle moves: 0 forward, 1 sideways, 2 turning.

    Examples
    --------
    >>> class Puck(AccelerationModel):
    ...     def nu_dot(self, nu, effort, psi=0.0):
    ...         return 2.0 * effort - nu
    >>> _, motion = Puck().step(Puck().init(), np.array([1.0, 0.0, 0.0]), 0.1, np.zeros(3))
    >>> print(f"{motion.nu[0]:.3f} m/s")
    0.190 m/s
    """

    commands: ClassVar[int] = 3
    axes: ClassVar[tuple[int, ...]] = (0, 1, 2)  # along which it moves: forward, sideways, turning

    drivetrain: Drivetrain = field(default_factory=Drivetrain)
    process_noise_std: np.ndarray = parameter(
        "m/s/√s, m/s/√s, rad/s/√s",
        "random walk of ν in 1 s",
        low=0.0,
        high=1e6,
        default=NO_FRICTION,
        shape=(3,),
        role="noise",
    )

    def __post_init__(self) -> None:
        check_bounds(self)
        if self.drivetrain.mixing == "none":
            object.__setattr__(self, "drivetrain", replace(self.drivetrain, commands=self.commands))

    def nu_dot(self, nu: np.ndarray, effort: np.ndarray, psi: float = 0.0) -> np.ndarray:
        """Return ν̇ (3,) [m/s², m/s², rad/s²] in the body frame, at ν (3,), with an effort (n,), at the heading `psi`.

        A subclass defines this method; the base class raises MissingMethod.
        """
        raise MissingMethod.of("vehicle.no-equation", vehicle=type(self).__name__)

    def gravity(self, psi: float) -> np.ndarray:
        """Return gravity along body x and y (2,) [m/s²]: zeros, because the floor is level."""
        return np.zeros(2)

    def advance(
        self, eta: np.ndarray, nu: np.ndarray, effort: Effort, dt_s: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (η, ν, ν̇), (3,) each, after `dt_s` with an effort; ν̇ is the value at the end.  (1)"""

        def x_dot(x: np.ndarray, effort: np.ndarray) -> np.ndarray:
            return np.concatenate(
                [map_from_body(x[2]) @ x[3:], self._mask_axes(self.nu_dot(x[3:], effort, x[2]))]
            )

        x = rk4(x_dot, np.concatenate([eta, nu]), effort, dt_s)
        eta = np.array([x[0], x[1], wrap(x[2])])
        return eta, x[3:], self.nu_dot(x[3:], effort.last, eta[2])

    def init(self, eta: np.ndarray | None = None, nu: np.ndarray | None = None) -> VehicleState:
        """Return the state at `eta` (3,) in the map with `nu` (3,) in the body, both zero by default, motors off."""
        eta = np.zeros(3) if eta is None else eta
        nu = np.zeros(3) if nu is None else self._mask_axes(nu)
        nu_dot = self.nu_dot(nu, np.zeros(self.commands), eta[2])
        return VehicleState(eta, nu, nu_dot, self.drivetrain.init())

    def step(
        self, state: VehicleState, u: np.ndarray, dt_s: float, noise: np.ndarray
    ) -> tuple[VehicleState, Motion]:
        """Return the state and the Motion after a tick with the command `u` (n,).

        `noise` (3,) is standard normal, or zero for a simulation without process noise.
        """
        drivetrain, effort = self.drivetrain.step(state.drivetrain, u, dt_s)
        eta, nu, _ = self.advance(state.eta, state.nu, effort, dt_s)
        nu = self._mask_axes(nu + self.process_noise_std * np.sqrt(dt_s) * noise)
        return tick_end(self, state, eta, nu, drivetrain, effort, dt_s)

    def _mask_axes(self, x: np.ndarray) -> np.ndarray:
        """Return x (3,) with zeros along the axes that are not in `axes`."""
        return x * np.array([1.0 if i in self.axes else 0.0 for i in range(3)])
