"""Protocols and state of a vehicle, the effort of a tick, and the end of a tick for vehicles with an acceleration.

The current of a motor lags behind the voltage w minus the back-EMF e = ρ D ν. D ν is the viscous drag. All are in the
unit of u. The drag of the body contains e without a lag, so the effort w_l is the current plus e:

    λ d(w_l − e)/dt = (w − e) − (w_l − e)   →   λ ẇ_l = w + λ ė − w_l,   ė = ρ D ν̇ in mid-tick            (1)
"""

from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.values import Tree, Value
from baqueano.signals import Motion
from baqueano.vehicles.drivetrain import Drivetrain, DrivetrainState
from baqueano.vehicles.effort import Effort


class VehicleState(NamedTuple):
    """Pose, velocity and acceleration of a vehicle at the end of a tick.

    Attributes
    ----------
    eta : ndarray (3,) [m, m, rad]
        Pose in the map; the heading is wrapped.
    nu : ndarray (3,) [m/s, m/s, rad/s]
        Velocity in the body frame.
    nu_dot : ndarray (3,) [m/s², m/s², rad/s²]
        Rate of change of the body components of ν.
    drivetrain : DrivetrainState
        State of the drivetrain.

    Examples
    --------
    >>> model = bq.load("small").vehicle
    >>> model.init(eta=np.array([1.0, 2.0, 0.0])).eta
    array([1., 2., 0.])
    """

    eta: np.ndarray
    nu: np.ndarray
    nu_dot: np.ndarray
    drivetrain: DrivetrainState


class Vehicle(Protocol):
    """Protocol of a vehicle for the loop, the estimators and the fit; n = `commands`.

    Examples
    --------
    The methods take η, ν in SI units; `step` advances by a tick.

    >>> model = bq.load("small").vehicle
    >>> state, motion = model.step(model.init(), np.zeros(3), 0.01, np.zeros(3))
    >>> state.nu
    array([0., 0., 0.])
    """

    commands: ClassVar[int]  # n, the length of the command

    @property
    def drivetrain(self) -> Drivetrain:
        """Return the drivetrain, which turns the command into the effort on the body."""
        ...

    def init(self, eta: np.ndarray | None = None, nu: np.ndarray | None = None) -> VehicleState:
        """Return the state at the pose `eta` (3,) in the map, with the body velocity `nu` (3,)."""
        ...

    def advance(
        self, eta: np.ndarray, nu: np.ndarray, effort: Effort, dt_s: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (η, ν, ν̇), (3,) each, after `dt_s` with an effort that is a straight line in time, without noise."""
        ...

    def gravity(self, psi: float) -> np.ndarray:
        """Return gravity along body x and y (2,) [m/s²]."""
        ...

    def step(
        self, state: VehicleState, u: np.ndarray, dt_s: float, noise: np.ndarray
    ) -> tuple[VehicleState, Motion]:
        """Return the state and the Motion after a tick with the command `u` (n,); `noise` (3,) is standard normal."""
        ...


class DynamicVehicle(Vehicle, Protocol):
    """Protocol of a dynamic vehicle, which also computes its acceleration; `optional.is_dynamic` tests for this."""

    def nu_dot(self, nu: np.ndarray, effort: np.ndarray, psi: Value = 0.0, /) -> np.ndarray:
        """Return ν̇ (3,) at ν (3,) with an effort, at the heading ψ."""
        ...


def tick_effort(
    vehicle: Tree, motors: DrivetrainState, psi: Value, nu: np.ndarray, u: np.ndarray, dt_s: Value
) -> tuple[DrivetrainState, Effort]:
    """Return the state of the motors and the effort over a tick with the command `u` (n,); heading ψ and velocity ν
    (3,) are those at its start.  (1)"""
    drivetrain, viscous_effort = vehicle.drivetrain, optional.attribute(vehicle, "viscous_effort")
    if viscous_effort is None or not drivetrain.has_back_emf or not drivetrain.has_lag:
        return drivetrain.step(motors, u, dt_s)
    share = drivetrain.back_emf_share
    nu_dot = vehicle.nu_dot(nu, drivetrain.unmix(motors.lag_state), psi)
    _, effort = drivetrain.step(motors, u, dt_s, share * viscous_effort(nu_dot))
    nu_dot = vehicle.nu_dot(nu + 0.5 * dt_s * nu_dot, effort.mean, psi)
    return drivetrain.step(motors, u, dt_s, share * viscous_effort(nu_dot))


def tick_end(
    model: DynamicVehicle,
    previous: VehicleState,
    eta: np.ndarray,
    nu: np.ndarray,
    drivetrain: DrivetrainState,
    effort: Effort,
    dt_s: Value,
) -> tuple[VehicleState, Motion]:
    """Return the state at the end of a tick with `effort`, and the Motion that the sensors measure.

    The Motion contains ν̇ at the end of the tick. For sensors with a low-pass it also contains the motion at start,
    middle and end of the tick: ν is a cubic curve, and the effort a line.
    """

    def motion_at(eta: np.ndarray, nu: np.ndarray, effort: np.ndarray) -> Motion:
        return Motion(eta, nu, model.nu_dot(nu, effort, eta[2]), model.gravity(eta[2]))

    motion_now = motion_at(eta, nu, effort.last)
    begin, end = motion_at(previous.eta, previous.nu, effort.start), motion_at(eta, nu, effort.end)
    middle = 0.5 * (previous.nu + nu) + 0.125 * dt_s * (begin.nu_dot - end.nu_dot)
    tick = begin, motion_at(eta, middle, effort.mean), end
    return VehicleState(eta, nu, motion_now.nu_dot, drivetrain), motion_now._replace(tick=tick)
