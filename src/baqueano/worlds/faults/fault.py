"""Define the faults of a simulated vehicle: kind, parameters, start and duration.

  push     x, y [N s]   impulse at the centre of mass, in the frame "body" (x forward, y left) or "map"; in PUSH_S
  tilt     x, y [rad]   rise of the floor towards x and y of the map, in addition to the slope in the vehicle file
  cut      of           a sensor, "imu", that does not send samples
  drift    of, size     a channel, "imu[2]", whose zero changes by `size` [unit of the channel], linearly in DRIFT_S
  spikes   of, size     a channel, in which the share `part` of the samples is wrong by ± `size`
  slip     of, part     a wheel, left, right or all, that pushes with this part of its force; its sensor measures
                         SLIP_FACTOR times the speed
  sag      part         the battery has this part of its voltage
  lose     part         share of the frames that are lost on the line: incoming readings, outgoing commands

A fault can also be written as text: "12 s: push 0.3 N s left" (text.py).
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from math import atan2, degrees, hypot, isfinite, pi
from typing import Self, TypeAlias

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, note
from baqueano.errors import UsageError

PUSH_S, DRIFT_S = 0.05, 1.0
SLIP_FACTOR = 1.5  # factor on the reading of a wheel that slips
SOURCE = "shake"  # source of the events of faults in a run
WHEELS = ("left", "right", "all")
DIRECTION_NAMES = ("ahead", "left", "back", "right")
DefaultAndRange: TypeAlias = tuple[float, float]  # smallest and largest value of a field

FIELD_RANGES: dict[str, dict[str, DefaultAndRange]] = {  # fields that a kind uses, in addition to `of`
    "push": {"x": (-100.0, 100.0), "y": (-100.0, 100.0)},
    "tilt": {"x": (-0.5, 0.5), "y": (-0.5, 0.5)},
    "cut": {},
    "drift": {"size": (-1e4, 1e4)},
    "spikes": {"size": (-1e4, 1e4), "part": (0.0, 1.0)},
    "slip": {"part": (0.0, 1.0)},
    "sag": {"part": (0.1, 1.0)},
    "lose": {"part": (0.0, 1.0)},
}
CHANNEL_KINDS, SENSOR_KINDS, WHEEL_KINDS = ("drift", "spikes"), ("cut",), ("slip",)
FaultLike: TypeAlias = "Fault | str | JsonObject"


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault of a simulated world.

    Parameters
    ----------
    kind : str
        One of push, tilt, cut, drift, spikes, slip, sag, lose; the module lists the fields of each kind.
    start_s : float [s]
        Time of the drive at which the fault begins; the tick that begins at this time is the first affected tick.
    duration_s : float, optional [s]
        Duration; by default until the end of the drive. A push lasts PUSH_S.
    target : str
        The sensor, channel or wheel.
    x, y : float [N s] or [rad]
        Components of a push or a tilt.
    size : float [unit of the channel]
        Largest change of the reading by a drift or by spikes.
    part : float [no unit]
        Share of the samples, the force, the voltage or the frames.
    frame : str
        Frame of a push: "body" or "map".

    Examples
    --------
    >>> Fault.parse("12 s: push 0.3 N s left")
    Fault(kind='push', start_s=12.0, duration_s=None, target='', x=0.0, y=0.3, size=0.0, part=0.0, frame='body')
    """

    kind: str
    start_s: float = 0.0
    duration_s: float | None = None
    target: str = ""
    x: float = 0.0
    y: float = 0.0
    size: float = 0.0
    part: float = 0.0
    frame: str = "body"

    def __post_init__(self) -> None:
        if self.kind not in FIELD_RANGES:
            raise UsageError.of("shake.kind", value=str(self.kind), valid=FIELD_RANGES)
        time_ranges = {"start_s": (0.0, 1e6)} | (
            {} if self.duration_s is None else {"duration_s": (0.0, 1e6)}
        )
        for name, (low, high) in (time_ranges | FIELD_RANGES[self.kind]).items():
            value = getattr(self, name)
            is_number = isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
            if not (is_number and low <= value <= high):
                limits = {"kind": self.kind, "name": name, "low": low, "high": high}
                raise UsageError.of("shake.number", value=repr(value)[:40], **limits)
        if self.kind in WHEEL_KINDS and self.target not in WHEELS:
            raise UsageError.of("shake.target", kind=self.kind, value=repr(self.target)[:40], valid=WHEELS)
        if self.frame not in ("body", "map"):
            raise UsageError.of("shake.target", kind="frame", value=repr(self.frame)[:40], valid="body, map")

    @property
    def end_s(self) -> float:
        """Return the time [s] at which the fault ends; infinity if it lasts until the end of the drive."""
        if self.kind == "push":
            return self.start_s + PUSH_S
        return float("inf") if self.duration_s is None else self.start_s + self.duration_s

    def to_json(self) -> JsonObject:
        """Return the fields of the fault by name, for JSON."""
        return asdict(self)

    def message(self, number: int, psi_rad: float = 0.0, unit: str = "") -> Diagnostic:
        """Return the message of the fault, with all its parameters.

        `psi_rad` is the heading of the vehicle, `unit` the unit of the channel.
        """
        magnitude, direction_rad = hypot(self.x, self.y), atan2(self.y, self.x)
        if self.kind == "push" and self.frame == "map":
            direction_rad -= psi_rad
        direction_name = DIRECTION_NAMES[round(direction_rad / (pi / 2.0)) % 4]
        figures: JsonObject = {
            "impulse_n_s": magnitude,
            "slope_deg": degrees(magnitude),
            "uphill_deg": degrees(direction_rad),
        }
        if self.kind == "push":
            figures["direction"] = note(f"shake.way-{direction_name}")
        if self.kind == "slip":
            figures["wheel"] = note(f"shake.wheel-{self.target}")
        if self.kind in CHANNEL_KINDS:
            figures["unit"] = unit
        figures["percent"] = 100.0 * self.part
        return note(f"shake.{self.kind}", subject=SOURCE, number=number, **self.to_json(), **figures)

    @classmethod
    def from_diagnostic(cls, message: Diagnostic) -> Self:
        """Return the fault from a diagnostic that the method `message` returned. This is the inverse of that method."""
        return cls(**{field.name: message.figures[field.name] for field in fields(cls)})

    @classmethod
    def parse(cls, description: FaultLike) -> Self:
        """Return the fault of a text or of a mapping of fields. Raise UsageError for an invalid description."""
        from baqueano.worlds.faults.text import parse_fields

        if isinstance(description, cls):
            return description
        if isinstance(description, str):
            return cls(**parse_fields(description))
        names = [field.name for field in fields(cls)]
        if (
            not isinstance(description, Mapping)
            or "kind" not in description
            or not set(description) <= set(names)
        ):
            raise UsageError.of("shake.fields", value=repr(description)[:120], valid=names)
        values: JsonObject = dict(description)
        for name, value in description.items():
            if isinstance(value, int) and not isinstance(value, bool):
                values[name] = float(value)
        for name in ("kind", "target", "frame"):
            values[name] = str(description.get(name, "body" if name == "frame" else ""))
        return cls(**values)
