"""Define the signals between blocks, in SI units and radians.

Map frame: right-handed, ψ counter-clockwise. Body frame: x forward, y left (REP 103).
Letters (Fossen): η = (x, y, ψ) pose in the map, ν = (ν_x, ν_y, ν_ψ) velocity in the body frame.
Time is an integer [ns] of the run's clock; only `seconds` converts it to seconds.
"""

from collections import namedtuple
from collections.abc import Callable, Iterator
from functools import cache
from keyword import iskeyword
from typing import NamedTuple, Protocol, Self, TypeVar

import numpy as np

from baqueano.contracts.values import Tree, Value

__all__ = ["Command", "Estimate", "Motion", "Reference", "Slot", "Tick", "seconds"]

NANOSECONDS = 1_000_000_000
TICK_TOLERANCE_NS = 1000  # tick times are rounded to whole nanoseconds
Entry = TypeVar("Entry")
STANDARD_GRAVITY = 9.80665  # m/s², by definition; accelerometers are calibrated with this value


def seconds(t_ns: Value, since_ns: Value = 0) -> Value:
    """Return the time from `since_ns` to `t_ns` [s]; the difference is computed in integers, so it is exact.

    Parameters
    ----------
    t_ns : int or ndarray
        Time of the run's clock.
    since_ns : int or ndarray
        Time at which the duration begins.

    Returns
    -------
    float or ndarray [s]
        The duration, in the same shape.

    Examples
    --------
    >>> seconds(1_500_000_000)
    1.5
    """
    return (t_ns - since_ns) * 1e-9


class ByName(Protocol[Entry]):
    """A NamedTuple with a field for each sensor of a vehicle: `slots.imu`, `getattr(slots, name)`."""

    @property
    def _fields(self) -> tuple[str, ...]: ...
    def _asdict(self) -> dict[str, Entry]: ...
    def _replace(self, **entries: object) -> Self: ...
    def __iter__(self) -> Iterator[Entry]: ...
    def __len__(self) -> int: ...
    def __getitem__(self, index: int, /) -> Entry: ...
    def __getattr__(self, name: str, /) -> Entry: ...


class Command(NamedTuple):
    """The command of a controller or of the supervisor.

    Attributes
    ----------
    t_ns : int
        Time of the estimate for which the command was computed.
    u : ndarray (n,)
        Command of each channel, in the unit of the vehicle file; in [-1, 1] on a real robot.

    Examples
    --------
    >>> Command(0, np.array([0.5, 0.0, 0.1])).u
    array([0.5, 0. , 0.1])
    """

    t_ns: int
    u: np.ndarray


class Motion(NamedTuple):
    """The true motion of a vehicle, which sensors measure.

    Attributes
    ----------
    eta : ndarray (3,) [m, m, rad]
        Pose in the map: x, y, ψ.
    nu : ndarray (3,) [m/s, m/s, rad/s]
        Velocity in the body frame: ν_x, ν_y, ν_ψ.
    nu_dot : ndarray (3,) [m/s², m/s², rad/s²]
        Rate of change of the body components of ν.
    gravity : ndarray (2,) [m/s²]
        Gravity along body x and y; zero on a level floor.
    tick : tuple of Motion, optional
        Motion at the beginning, the middle and the end of the tick; None if unknown.

    Examples
    --------
    >>> forward = Motion(np.zeros(3), np.array([0.5, 0.0, 0.0]), np.zeros(3), np.zeros(2))
    >>> forward.nu
    array([0.5, 0. , 0. ])
    """

    eta: np.ndarray
    nu: np.ndarray
    nu_dot: np.ndarray
    gravity: np.ndarray
    tick: Tree = None


class Slot(NamedTuple):
    """The reading of a sensor in a tick; `z` is zero if `is_new` is 0.

    Attributes
    ----------
    is_new : float
        1.0 if a measurement arrived since the previous tick, else 0.0 [no unit].
    z : ndarray (m,) [SI]
        The measurement, in the SI units of the sensor.
    age_s : float
        Age of its timestamp at the tick.

    Examples
    --------
    >>> Slot(1.0, np.array([0.2]))
    Slot(is_new=1.0, z=array([0.2]), age_s=0.0)
    """

    is_new: float
    z: np.ndarray
    age_s: float = 0.0


class Tick(NamedTuple):
    """The readings and the command up to `t_ns`.

    Attributes
    ----------
    t_ns : int
        Time of the tick.
    u : ndarray (n,) [unit of u]
        Command that reached the motors during the interval that ends at t_ns.
    sensors : NamedTuple of Slot
        One field per sensor of the vehicle: `tick.sensors.imu.z`.

    Examples
    --------
    >>> tick = Tick(0, np.zeros(3), empty_slots({"imu": 3}))
    >>> tick.sensors.imu.is_new
    0.0
    """

    t_ns: int
    u: np.ndarray
    sensors: ByName["Slot"]


class Estimate(NamedTuple):
    """The estimated motion at `t_ns`.

    Attributes
    ----------
    t_ns : int
        Time of the tick.
    eta : ndarray (3,) [m, m, rad]
        Pose in the map.
    nu : ndarray (3,) [m/s, m/s, rad/s]
        Velocity in the body frame.
    cov : ndarray (6, 6) [SI, squared]
        Covariance of (η, ν).
    innovation : ndarray (m,), optional [SI]
        z − h(μ̄); NaN for a sensor without a measurement; None if the estimator does not report it.
    innovation_cov : ndarray (m, m), optional [SI, squared]
        S = H Σ̄ Hᵀ + Q.
    weight : ndarray (m,), optional
        Weight of each innovation [no unit]: 1 is the full weight, below ½ the channel is rejected. NaN without a
        measurement, and for a channel that cannot correct (η, ν) while the vehicle drives.
    file_innovation_cov : ndarray (m, m), optional [SI, squared]
        S with the noise of the vehicle file, from an estimator that adapts its noise to the run; else None.

    Examples
    --------
    >>> here = Estimate(0, np.array([1.0, 0.0, 0.0]), np.zeros(3), np.eye(6))
    >>> here.eta
    array([1., 0., 0.])
    """

    t_ns: int
    eta: np.ndarray
    nu: np.ndarray
    cov: np.ndarray
    innovation: np.ndarray | None = None
    innovation_cov: np.ndarray | None = None
    weight: np.ndarray | None = None
    file_innovation_cov: np.ndarray | None = None


class Reference(NamedTuple):
    """The desired pose and velocity at `t_ns`.

    Attributes
    ----------
    t_ns : int
        Time of the tick.
    eta : ndarray (3,) [m, m, rad]
        Pose in the map.
    nu : ndarray (3,) [m/s, m/s, rad/s]
        Velocity along the route, in the body frame of the route.
    at_end : float
        1.0 if the guide has reached its end, else 0.0 [no unit].

    Examples
    --------
    >>> Reference(0, np.zeros(3), np.array([0.2, 0.0, 0.0]), 0.0).nu
    array([0.2, 0. , 0. ])
    """

    t_ns: int
    eta: np.ndarray
    nu: np.ndarray
    at_end: float


def measured_ns(t_ns: int, slot: Slot) -> int:
    """Return the time of measurement [ns] of the reading `slot` in the tick at `t_ns`."""
    return t_ns - round(slot.age_s * NANOSECONDS)


def is_sensor_name(name: str) -> bool:
    """Return True for a name that a sensor can have, as a field of the tick."""
    return name.isidentifier() and not iskeyword(name) and not name.startswith("_")


@cache
def sensor_slots(names: tuple[str, ...]) -> Callable[..., ByName[Tree]]:
    """Return the NamedTuple class with one Slot per sensor name; equal names return the same class."""
    slots_class: Tree = namedtuple("Sensors", names)
    # pickle cannot import the class
    slots_class.__reduce__ = lambda slots: (_make_slots, (names, tuple(slots)))
    return slots_class


def _make_slots(names: tuple[str, ...], values: tuple[Tree, ...]) -> ByName[Tree]:
    return sensor_slots(names)(*values)


def empty_slots(sizes: dict[str, int]) -> ByName[Slot]:
    """Return slots for sensors of the given sizes, all without a measurement."""
    return sensor_slots(tuple(sizes))(*(Slot(0.0, np.zeros(m)) for m in sizes.values()))
