"""Convert units of recordings to SI; only the import does this."""

import difflib
import math
from typing import NamedTuple

from baqueano.messages.language import mark as N_
from baqueano.signals import STANDARD_GRAVITY

RAD_PER_DEGREE = math.pi / 180.0


class ColumnUnit(NamedTuple):
    """The quantity of a unit, and its factor to the SI unit."""

    measures: str
    si_factor: float


_TABLE = {
    N_("length"): {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "in": 0.0254, "ft": 0.3048},
    N_("speed"): {"m/s": 1.0, "mm/s": 1e-3, "cm/s": 1e-2, "km/h": 1 / 3.6, "mph": 0.44704, "kn": 1852 / 3600},
    N_("acceleration"): {
        "m/s^2": 1.0,
        "mm/s^2": 1e-3,
        "cm/s^2": 1e-2,
        "g": STANDARD_GRAVITY,
        "mg": 1e-3 * STANDARD_GRAVITY,
    },
    N_("angle"): {"rad": 1.0, "deg": RAD_PER_DEGREE, "mrad": 1e-3, "turn": 2.0 * math.pi},
    N_("angular rate"): {
        "rad/s": 1.0,
        "deg/s": RAD_PER_DEGREE,
        "mrad/s": 1e-3,
        "rpm": math.pi / 30.0,
        "turn/s": 2.0 * math.pi,
    },
    N_("ratio"): {"1": 1.0, "%": 1e-2},
    N_("voltage"): {"V": 1.0, "mV": 1e-3},
    N_("current"): {"A": 1.0, "mA": 1e-3},
    N_("time"): {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    N_("counts"): {"counts": 1.0},  # of an encoder; counts_per_turn of the map converts them to an angle
    N_("raw"): {"raw": 1.0},  # of any other quantity; the scale of the map converts them to SI
}
UNITS = {name: ColumnUnit(measures, si) for measures, units in _TABLE.items() for name, si in units.items()}
_ALIASES = {
    "m/s²": "m/s^2",
    "m/s/s": "m/s^2",
    "m/s2": "m/s^2",
    "mm/s²": "mm/s^2",
    "cm/s²": "cm/s^2",
    "count": "counts",
    "ticks": "counts",
    "pulses": "counts",
    "rev": "turn",
    "turns": "turn",
    "rev/s": "turn/s",
    "rps": "turn/s",
    "r/min": "rpm",
    "rev/min": "rpm",
    "U/min": "rpm",
    "deg/sec": "deg/s",
    "rad/sec": "rad/s",
    "°": "deg",
    "degrees": "deg",
    "°/s": "deg/s",
    "dps": "deg/s",
    "kmh": "km/h",
    "kph": "km/h",
    "µs": "us",
    "μs": "us",
    "": "1",
    "-": "1",
    "sec": "s",
    "percent": "%",
    "radians": "rad",
    "metres": "m",
    "meters": "m",
}
_LOWER_CASE_UNITS = {name.lower(): name for name in UNITS} | {
    name.lower(): unit for name, unit in _ALIASES.items()
}


def unit(name: str) -> ColumnUnit | None:
    """Return the unit with that name; None for an unknown name."""
    return UNITS.get(canonical_name(name))


def canonical_name(name: str) -> str:
    """Return the standard spelling of a unit: "deg/s" for "°/s", "dps" and "Deg/s"; an unknown name is unchanged."""
    name = name.strip()
    full_name = _ALIASES.get(name, name)
    # MV is not mV
    return full_name if full_name in UNITS or len(name) < 3 else _LOWER_CASE_UNITS.get(name.lower(), name)


def nearest_units_text(name: str) -> str:
    """Return the units whose names are most similar to `name`, for a message; "" without a similar unit."""
    close_names = difflib.get_close_matches(name, UNITS, n=3, cutoff=0.4)
    return ", ".join(close_names)


def all_units() -> str:
    """Return all units, for a message."""
    return ", ".join(UNITS)


def unit_list(measures: str) -> str:
    """Return the units of a quantity, for a message."""
    return ", ".join(_TABLE[measures])
