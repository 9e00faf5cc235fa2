"""Define the units of sensor channels, and detect a wrong unit in a key: `mass_g = 610` instead of `mass_kg`.

value in the unit of the file = factor · value in the other unit (+ offset)                                   (1)
"""

from math import pi
from typing import TYPE_CHECKING, NamedTuple

from baqueano.contracts.blocks import SensorBlocks
from baqueano.diagnostics import Diagnostic, note
from baqueano.signals import STANDARD_GRAVITY

if TYPE_CHECKING:
    from baqueano.vehicle_file.file import VehicleFile

CHANNEL_UNITS = {
    "imu": ("m/s²", "m/s²", "rad/s"),
    "odometer": ("m/s",),
    "wheels": ("m/s", "m/s"),
    "encoders": ("m/s", "m/s"),
    "pose": ("m", "m", "rad"),
    "mark": ("m",),
    "tags": ("m", "m"),
    "beacon": ("m",),
    "rangefinder": ("m",),
    "compass": ("rad",),
    "tape": ("m",),
    "back_on_mark": ("m", "m"),
    "battery": ("V",),
}
NON_MOTION_CHANNELS = "battery", "imu_temperature"  # channels of a run that are not sensors of the vehicle


class Unit(NamedTuple):
    """The notation of a unit at the end of a key, and its factor."""

    dimension: str
    factor: float  # of the unit, relative to the SI unit
    words: str


UNITS: dict[str, Unit] = {
    "kg": Unit("mass", 1.0, "kg"),
    "g": Unit("mass", 1e-3, "g"),
    "gr": Unit("mass", 1e-3, "g"),
    "t": Unit("mass", 1e3, "t"),
    "lb": Unit("mass", 0.45359237, "lb"),
    "oz": Unit("mass", 0.028349523, "oz"),
    "m": Unit("length", 1.0, "m"),
    "mm": Unit("length", 1e-3, "mm"),
    "cm": Unit("length", 1e-2, "cm"),
    "km": Unit("length", 1e3, "km"),
    "in": Unit("length", 0.0254, "inches"),
    "inch": Unit("length", 0.0254, "inches"),
    "ft": Unit("length", 0.3048, "feet"),
    "s": Unit("time", 1.0, "s"),
    "sec": Unit("time", 1.0, "s"),
    "ms": Unit("time", 1e-3, "ms"),
    "us": Unit("time", 1e-6, "µs"),
    "min": Unit("time", 60.0, "minutes"),
    "hz": Unit("rate", 1.0, "Hz"),
    "khz": Unit("rate", 1e3, "kHz"),
    "rad": Unit("angle", 1.0, "rad"),
    "deg": Unit("angle", pi / 180.0, "degrees"),
    "rad_s": Unit("turning", 1.0, "rad/s"),
    "deg_s": Unit("turning", pi / 180.0, "degrees/s"),
    "dps": Unit("turning", pi / 180.0, "degrees/s"),
    "rpm": Unit("turning", pi / 30.0, "rpm"),
    "m_s": Unit("speed", 1.0, "m/s"),
    "cm_s": Unit("speed", 1e-2, "cm/s"),
    "mm_s": Unit("speed", 1e-3, "mm/s"),
    "km_h": Unit("speed", 1.0 / 3.6, "km/h"),
    "kmh": Unit("speed", 1.0 / 3.6, "km/h"),
    "mph": Unit("speed", 0.44704, "mph"),
    "m_s2": Unit("acceleration", 1.0, "m/s²"),
    "g0": Unit("acceleration", STANDARD_GRAVITY, "g"),
    "mg": Unit("acceleration", 1e-3 * STANDARD_GRAVITY, "mg"),
    "kg_m2": Unit("inertia", 1.0, "kg m²"),
    "kg_cm2": Unit("inertia", 1e-4, "kg cm²"),
    "g_cm2": Unit("inertia", 1e-7, "g cm²"),
    "g_mm2": Unit("inertia", 1e-9, "g mm²"),
    "kg_mm2": Unit("inertia", 1e-6, "kg mm²"),
    "v": Unit("voltage", 1.0, "V"),
    "mv": Unit("voltage", 1e-3, "mV"),
    "c": Unit("temperature", 1.0, "°C"),
}
_PARAMETER_QUANTITIES = {
    "m/s²": "acceleration",
    "rad/s": "turning",
    "m/s": "speed",
    "m": "length",
    "s": "time",
}


def split_unit(key: str) -> tuple[str, str]:
    """Return ("mass", "kg") for "mass_kg", ("name", "") for a name without a unit."""
    parts = key.split("_")
    for count in (2, 1):
        unit = "_".join(parts[-count:]).lower()
        if len(parts) > count and unit in UNITS:
            return "_".join(parts[:-count]), unit
    return key, ""


def wrong_unit(key: str, value: object, unit_by_key: dict[str, str]) -> Diagnostic | None:
    """Return a suggestion if `key` is a key of `unit_by_key` with another unit or without unit; else None."""
    stem, unit = split_unit(key)
    for valid_key, its_unit in unit_by_key.items():
        right_stem, right_unit = split_unit(valid_key)
        same_stem = right_stem == stem and unit != right_unit
        is_other_unit = valid_key == stem and unit != ""  # accel_bias_mg for accel_bias
        if not (same_stem or is_other_unit):
            continue
        if not unit:
            unit_words = UNITS[right_unit].words
            return note("vehicle.unit-missing", key=valid_key, value=_unit_text(value), unit_name=unit_words)
        dimension = (
            UNITS[right_unit].dimension
            if right_unit
            else _PARAMETER_QUANTITIES.get(its_unit.split(",")[0], "")
        )
        source_unit = UNITS["g0"] if unit == "g" and dimension == "acceleration" else UNITS[unit]
        if source_unit.dimension != dimension:
            continue
        factor = source_unit.factor / (UNITS[right_unit].factor if right_unit else 1.0)
        unit_words = UNITS[right_unit].words if right_unit else its_unit.split(",")[0]
        return note(
            "vehicle.unit-other", unit_name=unit_words, value=_unit_text(value), given_unit=source_unit.words,
            key=valid_key, converted_value=_scaled_text(value, factor),
        )  # fmt: skip
    return None


def _scaled_text(value: object, factor: float) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(_scaled_text(v, factor) for v in value) + "]"
    return f"{value * factor:.6g}" if isinstance(value, int | float) else f"… × {factor:g}"


def _unit_text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def channel_units(vehicle_file: "VehicleFile", sensors: SensorBlocks | None = None) -> dict[str, str]:
    """Return the unit of each channel by its name, such as "imu[2]", of the file's sensors or of `sensors`."""
    blocks = (sensors or vehicle_file.sensors)._asdict().items()
    return {
        f"{name}[{k}]": channel_unit(vehicle_file, name, k)
        for name, block in blocks
        for k in range(block.size)
    }


def channel_unit(vehicle_file: "VehicleFile", sensor: str, entry: int) -> str:
    """Return the unit of one channel of a sensor, from its kind in the vehicle file; "" for a sensor of the user."""
    kind = vehicle_file.data.get("sensors", {}).get(sensor, {}).get("kind", sensor)
    units = CHANNEL_UNITS.get(kind, ())
    return units[entry] if entry < len(units) else ""
