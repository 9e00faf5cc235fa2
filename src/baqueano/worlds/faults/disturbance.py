"""Convert faults to the inputs of a tick: forces, slope of the floor, voltage, grip and changes of readings.

The inputs of tick k depend only on the faults, k and the seed. The random numbers of tick k are at a fixed position of
their stream, and are drawn even if no fault uses them. So the removal of a fault does not change other faults.
"""

from collections.abc import Sequence
from math import hypot, sin
from typing import NamedTuple

import numpy as np

from baqueano.contracts.blocks import SensorBlocks
from baqueano.contracts.optional import attribute, has_field, is_dynamic
from baqueano.contracts.values import Value
from baqueano.errors import UsageError
from baqueano.vehicles.state import Vehicle
from baqueano.worlds.faults.fault import CHANNEL_KINDS, DRIFT_S, SENSOR_KINDS, SLIP_FACTOR, Fault
from baqueano.worlds.noise import random_stream

BATCH_ROWS = 256  # rows of random numbers that are drawn at a time
WHEEL_SENSORS = ("wheels", "encoders")


class SensorDisturbance(NamedTuple):
    """Disturbance of the reading of a sensor in a tick: kept or lost, factor and offset."""

    keep: Value  # 1 or 0
    factor: np.ndarray  # (m,)
    offset: np.ndarray  # (m,) [unit of each]


class Disturbance(NamedTuple):
    """Disturbance of a simulated world in a tick: forces, slope of the floor, voltage, grip and readings."""

    force_in_body: np.ndarray  # (2,) acceleration of the centre of mass along body x, y [m/s²]
    force_in_map: np.ndarray  # (2,) the same along x, y of the map
    slope: np.ndarray  # (2,) sine of the floor's rise towards x, y of the map
    supply_factor: Value  # remaining share of the battery's voltage
    grip: np.ndarray  # (k,) remaining share of each motor's force
    sensors: tuple[SensorDisturbance, ...]


class ZeroDisturbance(NamedTuple):
    """The sizes of the arrays of a disturbance; it builds the disturbance of an undisturbed tick."""

    channels: int
    sizes: tuple[int, ...]

    def disturbance(self) -> Disturbance:
        """Return the disturbance of a tick without faults: zero forces and offsets, factors of 1."""
        sensors = tuple(SensorDisturbance(1.0, np.ones(m), np.zeros(m)) for m in self.sizes)
        return Disturbance(np.zeros(2), np.zeros(2), np.zeros(2), 1.0, np.ones(self.channels), sensors)


class DisturbanceConverter:
    """Conversion of the faults of one world to the disturbance of each tick."""

    def __init__(self, vehicle: Vehicle, sensors: SensorBlocks, rate_hz: float, seed: int) -> None:
        self.names, self._sensors, self._rate_hz = sensors._fields, sensors, rate_hz
        drivetrain = vehicle.drivetrain
        self.no_disturbance = ZeroDisturbance(drivetrain.channels, tuple(s.size for s in sensors))
        self._motors = drivetrain.channels - drivetrain.servos
        self._mass_kg = float(getattr(vehicle, "mass_kg", 0.0)) if has_field(vehicle, "mass_kg") else 0.0
        self._moves = is_dynamic(vehicle)
        self._line = random_stream(seed, "shake.line")
        self._spikes = [random_stream(seed, f"shake.spikes.{name}") for name in self.names]
        self._draws: list[np.ndarray] = []

    def check(self, fault_: Fault) -> Fault:
        """Return the fault unchanged. Raise UsageError if this vehicle cannot have it."""
        if fault_.kind in ("push", "tilt") and not self._moves:
            raise UsageError.of("shake.no-inertia", kind=fault_.kind)
        if fault_.kind == "push" and not self._mass_kg:
            raise UsageError.of("shake.no-mass", value=f"{hypot(fault_.x, fault_.y):g} N s")
        valid_names: list[str] = []
        if fault_.kind in SENSOR_KINDS:
            valid_names = list(self.names)
        if fault_.kind in CHANNEL_KINDS:
            valid_names = [
                f"{n}[{c}]"
                for n, m in zip(self.names, self.no_disturbance.sizes, strict=True)
                for c in range(m)
            ]
        if (fault_.kind in SENSOR_KINDS or fault_.kind in CHANNEL_KINDS) and fault_.target not in valid_names:
            raise UsageError.of(
                "shake.target", kind=fault_.kind, value=repr(fault_.target)[:40], valid=valid_names
            )
        if fault_.kind == "slip" and self._motors < 2 and fault_.target != "all":
            raise UsageError.of("shake.target", kind=fault_.kind, value=repr(fault_.target)[:40], valid="all")
        return fault_

    def first_tick(self, fault: Fault) -> int:
        """Return the index of the first tick that the fault affects."""
        return round(fault.start_s * self._rate_hz)

    def end_tick(self, fault: Fault) -> float:
        """Return the index of the first tick after the fault; infinity for a fault without an end."""
        if fault.end_s == float("inf"):
            return float("inf")
        return max(self.first_tick(fault) + 1, round(fault.end_s * self._rate_hz))

    def disturbance_at(self, faults: Sequence[Fault], k: int) -> tuple[Disturbance, bool]:
        """Return the disturbance of tick k by `faults`, and True if the command of the previous tick arrives."""
        chance, spikes = self._random(k)
        active_faults = [fault_ for fault_ in faults if self.first_tick(fault_) <= k < self.end_tick(fault_)]
        if not active_faults:
            return self.no_disturbance.disturbance(), True
        d = self.no_disturbance.disturbance()
        reading_shares, command_arrives, supply = [1.0] * len(self.names), True, 1.0
        for fault_ in active_faults:
            match fault_.kind:
                case "push":
                    ticks = self.end_tick(fault_) - self.first_tick(fault_)
                    force = np.array([fault_.x, fault_.y]) * (self._rate_hz / (ticks * self._mass_kg))
                    (d.force_in_map if fault_.frame == "map" else d.force_in_body)[:] += force
                case "tilt":
                    slope_rad = hypot(fault_.x, fault_.y)
                    d.slope[:] += np.array([fault_.x, fault_.y]) * (
                        sin(slope_rad) / slope_rad if slope_rad > 0.0 else 0.0
                    )
                case "cut":
                    reading_shares[self.names.index(fault_.target)] = 0.0
                case "drift":
                    s, c = self._channel(fault_)
                    age_s = (k - self.first_tick(fault_)) / self._rate_hz
                    d.sensors[s].offset[c] += fault_.size * min(1.0, age_s / DRIFT_S)
                case "spikes":
                    s, c = self._channel(fault_)
                    uniform, sign_draw = spikes[s][c]
                    d.sensors[s].offset[c] += (fault_.size if sign_draw < 0.5 else -fault_.size) * (
                        uniform < fault_.part
                    )
                case "slip":
                    self._slip(d, fault_)
                case "sag":
                    supply *= fault_.part
                case "lose":
                    command_arrives = command_arrives and bool(chance[0] >= fault_.part)
                    reading_shares = [
                        0.0 if chance[1 + s] < fault_.part else x for s, x in enumerate(reading_shares)
                    ]
        sensors = tuple(sensor._replace(keep=x) for sensor, x in zip(d.sensors, reading_shares, strict=True))
        return d._replace(supply_factor=supply, sensors=sensors), command_arrives

    def _slip(self, d: Disturbance, fault_: Fault) -> None:
        wheels = {"all": slice(None), "left": slice(0, 1), "right": slice(1, 2)}[fault_.target]
        d.grip[: self._motors][wheels] *= fault_.part
        for sensor, block in zip(d.sensors, self._sensors, strict=True):
            if attribute(block, "reads") in WHEEL_SENSORS:
                sensor.factor[wheels] *= SLIP_FACTOR
            elif attribute(block, "reads") == "odometer":
                sensor.factor[:] *= SLIP_FACTOR

    def _channel(self, fault_: Fault) -> tuple[int, int]:
        name, _, index_text = fault_.target.partition("[")
        return self.names.index(name), int(index_text[:-1])

    def _random(self, k: int) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return the uniform random numbers of tick k: (1 + sensors,) for lost frames, (m, 2) per sensor for spikes."""
        if k % BATCH_ROWS == 0:
            self._draws = [self._line.random((BATCH_ROWS, 1 + len(self.names)))]
            pairs = zip(self._spikes, self.no_disturbance.sizes, strict=True)
            self._draws += [generator.random((BATCH_ROWS, m, 2)) for generator, m in pairs]
        row = k % BATCH_ROWS
        return self._draws[0][row], [draw[row] for draw in self._draws[1:]]
