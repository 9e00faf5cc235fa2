"""Simulate a world with faults, as one pure step with the disturbance of the tick as an input.

  ν ← ν + ½ δ a,   the vehicle's own tick,   ν ← ν + ½ δ a        a of push and floor, half before and half after  (1)
  a = P (F/m + g),   g = −g₀ Jᵀ(ψ) s                               s the slope; P projects on possible motions     (2)
  V ← part of V,   force of a motor ← grip of it                   battery_v and gain of the drivetrain            (3)
  z ← factor z + offset, or no z                                                                                   (4)

Like a real IMU, the simulated IMU measures F/m and not g. The same faults, seed and commands yield the same results,
bit for bit. Without a fault they equal the results of an undisturbed simulation.
"""

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.blocks import SensorBlocks
from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, note
from baqueano.errors import UsageError
from baqueano.geometry import map_from_body
from baqueano.sensors.sampling import difference
from baqueano.signals import NANOSECONDS, STANDARD_GRAVITY, ByName, Command, Motion, Slot, sensor_slots
from baqueano.symbolic import function, with_value
from baqueano.vehicles.state import Vehicle
from baqueano.worlds.faults.disturbance import Disturbance, DisturbanceConverter, SensorDisturbance
from baqueano.worlds.faults.fault import SOURCE, Fault, FaultLike
from baqueano.worlds.simulated import DrawnNoise, SimulatedWorld, WorldState, advance_rows, no_noise

MAX_FAULTS = 500  # of one drive


def disturbed_step(
    vehicle: Vehicle, sensors: SensorBlocks, state: WorldState, u: np.ndarray, dt_s: float, noise: DrawnNoise,
    shake: Disturbance,
) -> tuple[WorldState, Motion, ByName[Slot]]:  # fmt: skip
    """Return the state, the true motion and the readings after a disturbed tick with the command `u` (n,).  (1)-(4)"""
    vehicle = _with_disturbed_motors(vehicle, shake)
    previous_state = state.vehicle
    a, _ = _acceleration(vehicle, previous_state.eta, shake)
    pushed_state = previous_state._replace(nu=previous_state.nu + 0.5 * dt_s * a)
    vehicle_state, motion = vehicle.step(pushed_state, u, dt_s, noise.vehicle)
    a, gravity = _acceleration(vehicle, vehicle_state.eta, shake)
    nu = vehicle_state.nu + 0.5 * dt_s * a
    # ν̇ of the tick is its value before the second half of the change
    drag_change = _drag_difference(vehicle, vehicle_state.eta[2], vehicle_state.nu, nu)
    vehicle_state = vehicle_state._replace(nu=nu, nu_dot=vehicle_state.nu_dot + drag_change + a)
    truth = _disturbed_motion(motion, drag_change + a, gravity)._replace(nu=nu)
    if motion.tick is not None:
        begin, middle, end = motion.tick
        first_drag_change = _drag_difference(
            vehicle, previous_state.eta[2], pushed_state.nu, previous_state.nu
        )
        truth = truth._replace(
            tick=(
                _disturbed_motion(begin, first_drag_change + a, gravity),
                _disturbed_motion(middle, a, gravity),
                _disturbed_motion(end, drag_change + a, gravity),
            )
        )
    states, slots = [], []
    for s, x, w, disturbance in zip(sensors, state.sensors, noise.sensors, shake.sensors, strict=True):
        next_state, slot = s.step(x, truth, dt_s, w)
        states.append(next_state)
        slots.append(_disturbed_reading(s, slot, disturbance))
    readings = sensor_slots(tuple(sensors._fields))(*slots)
    return WorldState(vehicle_state, tuple(states)), truth._replace(tick=None), readings


def _with_gains(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle with one gain per channel of its drivetrain, even if all channels share one gain."""
    drivetrain = vehicle.drivetrain
    gains = replace(drivetrain, gain=drivetrain.gain * np.ones(drivetrain.channels))
    return with_value({"model": vehicle}, "model.drivetrain", gains)["model"]


def _with_disturbed_motors(vehicle: Vehicle, shake: Disturbance) -> Vehicle:
    """Return the vehicle with the disturbed voltage and the disturbed grip of its motors.  (3)"""
    tree, drivetrain = {"model": vehicle}, vehicle.drivetrain
    tree = with_value(tree, "model.drivetrain.battery_v", drivetrain.battery_v * shake.supply_factor)
    return with_value(tree, "model.drivetrain.gain", drivetrain.gain * shake.grip)["model"]


def _acceleration(vehicle: Vehicle, eta: np.ndarray, shake: Disturbance) -> tuple[np.ndarray, np.ndarray]:
    """Return the ν̇ (3,) that push and floor cause, and the gravity (2,) along the floor, in the body frame.  (2)"""
    body_from_map = map_from_body(eta[2])[:2, :2].T
    gravity = -STANDARD_GRAVITY * (body_from_map @ shake.slope)
    a = shake.force_in_body + body_from_map @ shake.force_in_map + gravity
    return vehicle.init(nu=np.array([a[0], a[1], 0.0])).nu, gravity


def _drag_difference(vehicle: Vehicle, psi: float, nu: np.ndarray, next_nu: np.ndarray) -> np.ndarray:
    """Return the change of ν̇ (3,) from the velocity `nu` to `next_nu`, with zero effort."""
    own_nu_dot, zero_command = optional.attribute(vehicle, "nu_dot"), np.zeros(vehicle.commands)
    if own_nu_dot is None:
        return np.zeros(3)
    return own_nu_dot(next_nu, zero_command, psi) - own_nu_dot(nu, zero_command, psi)


def _disturbed_motion(motion: Motion, a: np.ndarray, gravity: np.ndarray) -> Motion:
    return motion._replace(nu_dot=motion.nu_dot + a, gravity=motion.gravity + gravity)


def _disturbed_reading(sensor: Tree, slot: Slot, disturbance: SensorDisturbance) -> Slot:
    is_new = slot.is_new * disturbance.keep
    z, limit = disturbance.factor * slot.z + disturbance.offset, optional.attribute(sensor, "limit")
    # an angle is wrapped
    limited_difference = np.clip(difference(sensor, z, np.zeros(sensor.size)), -limit, limit)
    z = np.where(disturbance.offset != 0.0, limited_difference, z)
    return slot._replace(is_new=is_new, z=np.where(is_new > 0.0, z, 0.0))


class _FaultyVehicle(NamedTuple):
    """A vehicle with faults and its sensors as one block, for the engine."""

    vehicle: Vehicle
    sensors: SensorBlocks

    def step(
        self, state: WorldState, u: np.ndarray, dt_s: float, noise: DrawnNoise, shake: Disturbance
    ) -> tuple[WorldState, Motion, Tree]:
        return advance_rows(
            lambda state, row_s, unit: disturbed_step(self.vehicle, self.sensors, state, u, row_s, unit, shake),
            state, dt_s, noise,
        )  # fmt: skip


class FaultyWorld(SimulatedWorld):
    """A simulated vehicle with faults as a world of the loop.

    Parameters
    ----------
    vehicle : Vehicle
        The vehicle.
    sensors : NamedTuple of Sensor
        The sensors of the vehicle, by name.
    rate_hz : float
        Ticks per second.
    seed : int
        Seed of the noise, and of the random numbers of faults.
    eta0 : ndarray (3,), optional [m, m, rad]
        Pose at the start in the map; (6,) for pose and body velocity.
    backend : str
        "auto", "c", "python" or "numpy".
    shake : sequence of Fault or str
        The faults (see `worlds.Fault`); the method `begin_fault` adds faults during the drive.
    units : mapping of str to str
        The unit of each channel by its name, such as "imu[2]", for the messages of faults.

    Raises
    ------
    UsageError
        If this vehicle cannot have one of the faults.

    Notes
    -----
    Equations (1)-(4) of the module. Each fault is recorded as an event of the run, with all its parameters.

    Examples
    --------
    >>> robot = bq.load("small")
    >>> world = FaultyWorld(robot.vehicle, robot.sensors, shake=["0.02 s: push 0.3 N s left"])
    >>> _ = world.read(t_ns=100_000_000)
    >>> print(f"{world.truth.nu[1]:.2f} m/s to the left")
    0.02 m/s to the left
    """

    def __init__(
        self, vehicle: Vehicle, sensors: SensorBlocks, rate_hz: float = 100.0, seed: int = 0,
        eta0: np.ndarray | None = None, backend: str = "auto", shake: Iterable[FaultLike] = (),
        units: Mapping[str, str] = MappingProxyType({}),
    ) -> None:  # fmt: skip
        self._units = units
        self._converter = DisturbanceConverter(vehicle, sensors, rate_hz, seed)
        self.faults: list[Fault] = []  # the index of a fault is its number minus 1
        for description in shake:
            self._append_fault(self._converter.check(Fault.parse(description)))
        self._requested_changes: deque[Fault | int] = deque()
        self._pending: list[tuple[int, Diagnostic | str]] = []
        self._started_numbers, self._ended_numbers = set[int](), set[int]()
        super().__init__(vehicle, sensors, rate_hz, seed, eta0, backend)
        self._requested = self._u
        block = _FaultyVehicle(_with_gains(vehicle), sensors).step
        no_disturbance = self._converter.no_disturbance.disturbance()
        example = (self._state, self._u, 1.0 / rate_hz, no_noise(sensors, self._rows), no_disturbance)
        self._compiled_step = block if backend == "numpy" else function(block, *example, backend=backend)

    def begin_fault(self, fault_like: FaultLike) -> Fault:
        """Begin a fault with the next tick, which sets `start_s`, and return the fault. Any thread can call this.

        Raise UsageError for a fault that this vehicle cannot have, or for more than MAX_FAULTS faults.
        """
        valid_fault = self._converter.check(Fault.parse(fault_like))
        if len(self.faults) + len(self._requested_changes) >= MAX_FAULTS:
            raise UsageError.of("shake.too-many", maximum=MAX_FAULTS)
        self._requested_changes.append(valid_fault)
        return valid_fault

    def end_fault(self, number: int) -> None:
        """End the fault `number` with the next tick, from any thread. Raise UsageError for an unknown number."""
        if not 1 <= number <= len(self.faults):
            raise UsageError.of("shake.no-number", value=number, maximum=len(self.faults))
        self._requested_changes.append(number)

    def write(self, command: Command) -> None:
        """Set the command for the following ticks; a fault of the kind "lose" can discard it."""
        self._requested = np.array(command.u, dtype=float)

    def new_events(self) -> list[tuple[int, Diagnostic | str]]:
        """Return the time [ns] and the message of each fault that began or ended since the last call."""
        events, self._pending = self._pending, []
        return events

    def _advance(self, dt_s: float) -> ByName[Slot]:
        k = self._tick
        self._apply_changes(k)
        for number, fault_ in enumerate(self.faults, 1):
            if number not in self._started_numbers and self._converter.first_tick(fault_) <= k:
                self._started_numbers.add(number)
                self._pending.append((self._end_ns(k), self._message(number, float(self.truth.eta[2]))))
        shake, command_arrives = self._converter.disturbance_at(self.faults, k)
        if command_arrives:
            self._u = self._requested
        self._state, self.truth, slots = self._compiled_step(self._state, self._u, dt_s, self._noise(), shake)
        return slots

    def _apply_changes(self, k: int) -> None:
        """Begin and end the faults that were requested since the last tick."""
        now_s = k / self._rate_hz
        while self._requested_changes:
            change = self._requested_changes.popleft()
            if isinstance(change, Fault):
                if change.kind == "tilt":  # a tilt replaces the previous one
                    for number in [
                        n
                        for n in self._started_numbers - self._ended_numbers
                        if self.faults[n - 1].kind == "tilt"
                    ]:
                        self._end(number, k)
                self._append_fault(replace(change, start_s=now_s))
            else:
                self._end(change, k)

    def _end(self, number: int, k: int) -> None:
        fault_, now_s = self.faults[number - 1], k / self._rate_hz
        if (
            number in self._ended_numbers
            or self._converter.end_tick(fault_) <= k
            or number not in self._started_numbers
        ):
            return
        self._ended_numbers.add(number)
        ended_fault = replace(fault_, duration_s=now_s - fault_.start_s)
        self.faults[number - 1] = ended_fault
        message = note(
            "shake.end",
            subject=SOURCE,
            number=number,
            duration_s=ended_fault.duration_s,
            fault=self._message(number),
        )
        self._pending.append((self._end_ns(k), message))

    def _message(self, number: int, psi_rad: float = 0.0) -> Diagnostic:
        fault_ = self.faults[number - 1]
        return fault_.message(number, psi_rad, self._units.get(fault_.target, ""))

    def _append_fault(self, fault_: Fault) -> None:
        self.faults.append(fault_)

    def _end_ns(self, k: int) -> int:
        return round((k + 1) * NANOSECONDS / self._rate_hz)
