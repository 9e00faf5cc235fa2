"""The signals between blocks. SI units and radians; map frame right-handed, ψ counter-clockwise;
body frame x forward, y left (REP 103).

Letters (Fossen): η = (x, y, ψ) pose in the map, ν = (ν_x, ν_y, ν_ψ) velocity in the body frame.
Time is an integer count of nanoseconds from the clock of the run; seconds are derived by `seconds` alone.
"""

from collections import namedtuple
from collections.abc import Callable, Iterator
from functools import cache
from typing import NamedTuple, Protocol, Self, TypeVar

import numpy as np

from baqueano.contracts.values import Tree, Value

NANOSECONDS = 1_000_000_000
Entry = TypeVar("Entry")
STANDARD_GRAVITY = 9.80665  # m/s², by definition: accelerometers are calibrated by it


def seconds(t_ns: Value, since_ns: Value = 0) -> Value:
    """The span from `since_ns` to `t_ns` [s]; the difference is taken before it is rounded to a float."""
    return (t_ns - since_ns) * 1e-9


class ByName(Protocol[Entry]):
    """A NamedTuple whose names are those of the sensors of a vehicle: `slots.imu`, `getattr(slots, name)`."""

    @property
    def _fields(self) -> tuple[str, ...]: ...
    def _asdict(self) -> dict[str, Entry]: ...
    def _replace(self, **entries: object) -> Self: ...
    def __iter__(self) -> Iterator[Entry]: ...
    def __len__(self) -> int: ...
    def __getitem__(self, index: int, /) -> Entry: ...
    def __getattr__(self, name: str, /) -> Entry: ...


class Command(NamedTuple):
    """The command of a controller, and the one that the supervisor passes on."""

    t_ns: int
    u: np.ndarray  # (n,) in the unit of the vehicle file; [-1, 1] on a real robot


class Motion(NamedTuple):
    """The true motion of a vehicle, which sensors measure."""

    eta: np.ndarray  # (3,) x, y [m], ψ [rad], map frame
    nu: np.ndarray  # (3,) ν_x, ν_y [m/s], ν_ψ [rad/s], body frame
    nu_dot: np.ndarray  # (3,) rate of change of the components of ν [m/s², m/s², rad/s²]
    gravity: np.ndarray  # (2,) gravity along body x and y [m/s²]; zero on a level floor
    tick: Tree = None  # (Motion, Motion, Motion) at begin, middle and end of the tick; None where not known


class Slot(NamedTuple):
    """A sensor's place in a tick; z is zero where `has` is 0."""

    has: float  # 1.0 when a measurement arrived since the previous tick, else 0.0
    z: np.ndarray  # (m,) the measurement, in the sensor's own units (SI)
    age_s: float = 0.0  # how long before the tick it was measured, as its stamp tells [s]


class Tick(NamedTuple):
    """The readings and the command up to `t_ns`."""

    t_ns: int
    u: np.ndarray  # (n,) the command that reached the motors during the interval that ends at t_ns
    sensors: ByName["Slot"]  # a NamedTuple with one Slot per sensor of the vehicle: tick.sensors.imu.z


class Estimate(NamedTuple):
    """The estimated motion at `t_ns`."""

    t_ns: int
    eta: np.ndarray  # (3,) pose, map frame [m, m, rad]
    nu: np.ndarray  # (3,) velocity, body frame [m/s, m/s, rad/s]
    cov: np.ndarray  # (6, 6) covariance of (η, ν)
    innovation: np.ndarray | None = None  # (m,) z − h(μ̄); NaN where nothing arrived; None: not reported
    innovation_cov: np.ndarray | None = None  # (m, m) S = H Σ̄ Hᵀ + Q
    weight: np.ndarray | None = (
        None  # (m,) of each innovation: 1 counts, below ½ is refused, NaN did not arrive
    )


class Reference(NamedTuple):
    """The wanted pose and velocity at `t_ns`."""

    t_ns: int
    eta: np.ndarray  # (3,) pose, map frame [m, m, rad]
    nu: np.ndarray  # (3,) velocity along the route, body frame of the route [m/s, m/s, rad/s]
    done: float  # 1.0 when the guide has nothing more to ask for, else 0.0


def measured_ns(t_ns: int, slot: Slot) -> int:
    """Return the time of measurement [ns] of a slot of the tick at `t_ns`."""
    return t_ns - round(slot.age_s * NANOSECONDS)


@cache
def sensor_slots(names: tuple[str, ...]) -> Callable[..., ByName[Tree]]:
    """The NamedTuple class that holds one Slot per sensor name; the same names give the same class."""
    made: Tree = namedtuple("Sensors", names)
    return made


def silent(sizes: dict[str, int]) -> ByName[Slot]:
    """Slots for sensors of the given sizes, all without a measurement."""
    return sensor_slots(tuple(sizes))(*(Slot(0.0, np.zeros(m)) for m in sizes.values()))
