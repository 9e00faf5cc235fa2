"""What a vehicle file says before its blocks: the command's channels and the body's measures."""

from dataclasses import dataclass

import numpy as np

from baqueano.parameter import INF, parameter

FORMAT = 1
TOP_LEVEL = ("format", "name", "about", "rate_hz")
TABLES = (
    "command", "geometry", "model", "sensors", "estimator", "controller", "guide", "supervisor",
    "provenance", "parameter_cov",
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Channels:
    """The command u (n,): what its entries are called, in which unit, and how far they go."""

    names: tuple[str, ...]
    limit: np.ndarray = parameter(
        "unit of u", "largest size of each entry", low=0.0, default=(INF,), shape=None
    )
    unit: str = "1"


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """What a tape measure says; all of it may be left out."""

    radius_m: float | None = parameter("m", "radius of a round platform", low=1e-3, high=100.0, default=None)
    length_m: float | None = parameter(
        "m", "length of a rectangular platform", low=1e-3, high=100.0, default=None
    )
    width_m: float | None = parameter(
        "m", "width of a rectangular platform", low=1e-3, high=100.0, default=None
    )
    track_m: float | None = parameter(
        "m", "from the left wheel to the right one", low=1e-3, high=100.0, default=None
    )
    wheel_radius_m: float | None = parameter("m", "radius of a wheel", low=1e-3, high=10.0, default=None)


@dataclass(frozen=True, slots=True, eq=False)
class Top:
    """The keys above the first table."""

    format: int
    name: str
    rate_hz: float = parameter("Hz", "ticks of the loop a second", low=1.0, high=2000.0)
    about: str = ""


def reach(geometry: Geometry) -> float | None:
    """From the middle of the platform to its edge [m]; None if nobody measured it."""
    if geometry.radius_m is not None:
        return geometry.radius_m
    if geometry.length_m is not None and geometry.width_m is not None:
        return 0.5 * float(np.hypot(geometry.length_m, geometry.width_m))
    return None


def solid_inertia(mass_kg: float, geometry: Geometry) -> float | None:
    """Inertia of a uniform platform about its middle [kg m²]: ½ m R² of a disc, m (l² + w²)/12 of a plate
    (errata 4; the paper prints m/R²)."""
    if geometry.radius_m is not None:
        return 0.5 * mass_kg * geometry.radius_m**2
    if geometry.length_m is not None and geometry.width_m is not None:
        return mass_kg * (geometry.length_m**2 + geometry.width_m**2) / 12.0
    return None
