"""Use the real vehicle as a world of the loop: two wheels on a serial link, and an IMU on a bus.

  (l, r) = mix(u),  |l|, |r| ≤ 1                      duties that are sent                              (1)
  u = unmix(mean of the duties that were applied)     the command of a tick, as the motors had it       (2)
  z = mean of the samples since the last tick         IMU                                               (3)
  v = 2π r Δc / (N Δt)                                a wheel with N counts per turn                    (4)

The firmware's telemetry reports the applied duties, after slew, kick and dead-man timer. A model of the motors must
explain the applied duties, not the requested duties (applied_duty.py). This file does not depend on frames and
registers: `wheels` and `imu` are objects with the methods of the protocols below, in robot/ or emulated
(tests/emulated/).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.blocks import Sensor, SensorBlocks, World
from baqueano.diagnostics import Diagnostic, StopReason, stop
from baqueano.errors import UsageError
from baqueano.sensors.sampling import low_pass_s
from baqueano.signals import Command, Slot, Tick, seconds, sensor_slots
from baqueano.vehicles.drivetrain import mix, unmix
from baqueano.worlds.applied_duty import IDEAL_MOTORS, AppliedDuties, AppliedMotors
from baqueano.worlds.silent_encoders import SilentEncoders

TILT_MEAN_TICKS = 50  # time constant of the mean of a tilt: half a second
MAX_SILENT_S = 0.1  # longest time without telemetry: then ten frames are missing, and the vehicle must stop
MAX_NOISY_S = 1.0  # the same while damaged frames arrive: with 5 % wrong bytes, one frame in ten is undamaged


class Telemetry(NamedTuple):
    """The telemetry of one moment, in the clock of the host."""

    t_ns: int
    # duties of the left and the right motor, [-1, 1], mean since the previous telemetry
    applied_duty: tuple[float, float]
    counts: tuple[int, int]  # of the encoders since the firmware started; they wrap at 2³¹
    battery_v: float  # 0 if the measurement is not connected
    marks: int  # lines passed since the firmware started
    mark_ns: int  # time of the last line
    stop_reason: Diagnostic | None  # reason why the firmware has stopped the motors; None if they are driven
    encoder_silent: bool = False  # an encoder does not count although its motor is driven hard
    now: tuple[float, float] | None = None  # present duty; None: as `applied_duty`
    boot: int = 0  # a new value means that the firmware and its counts have restarted


class Sample(NamedTuple):
    """A reading of an IMU, along the axes of the body: forward, left, up."""

    t_ns: int
    accel: np.ndarray  # (3,) specific force [m/s²]
    gyro: np.ndarray  # (3,) [rad/s]
    temperature_c: float


class WheelLink(Protocol):
    """Protocol of a link that sends duties and receives telemetry; its calls do not wait for the serial line."""

    def drive(self, left: float, right: float) -> None:
        """Send the duties of both wheels, in [-1, 1], once; the link does not repeat them."""
        ...

    def receive(self) -> list[Telemetry]:
        """Return the telemetry since the last call, in order."""
        ...

    @property
    def noise_ns(self) -> int:
        """Return the time of the last damaged frame, in the clock of the host."""
        ...


class HardwareEvent(Protocol):
    """Protocol of an event of the hardware, with a message for the run."""

    @property
    def message(self) -> Diagnostic | str:
        """Return the message of the event."""
        ...


class ImuSource(Protocol):
    """Protocol of a reader of an IMU."""

    @property
    def delay_s(self) -> tuple[float, float]:
        """Return the delays [s] of accelerometers and gyro: the age of the motion at the timestamp of a sample."""
        ...

    def events(self) -> Sequence[HardwareEvent]:
        """Return the events of the IMU since the last call, each with its `message`."""
        ...

    def read(self) -> list[Sample]:
        """Return the readings since the last call, in order."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """The conversion from values of the hardware to quantities of the vehicle; `mixing` must be "two_wheels"."""

    mixing: str = "two_wheels"
    wheel_radius_m: float | None = None
    counts_per_turn: float | None = None
    motors: AppliedMotors = IDEAL_MOTORS  # conversion from a sent request to a duty in the firmware

    def __post_init__(self) -> None:
        if self.mixing != "two_wheels":
            raise UsageError.of("robot.mixing", mixing=self.mixing)


class Robot(World):
    """The real vehicle as a world of the loop. Its time begins with `begin`.

    Parameters
    ----------
    sensors : NamedTuple of Sensor
        The sensors of the vehicle file; a sensor that the robot does not have is silent.
    wheels : WheelLink
        Link that sends duties and receives telemetry.
    imu : ImuSource or None
        Reader of the IMU; None for a robot without IMU.
    body : Body
        Mixing, wheels and motors.
    now_ns : callable, optional
        The clock of the host; by default a command is sent at the time of its tick.

    Notes
    -----
    Equations (1)-(4) of the module.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> link = SimpleNamespace(drive=print, heard=list, noise_ns=0)  # instead of robot.link.Uno
    >>> robot = Robot(sensor_slots(())(), link, None, Body())
    >>> robot.write(Command(0, np.array([0.5, 0.0, 0.2])))  # left and right duty
    0.3 0.7
    """

    def __init__(
        self, sensors: SensorBlocks, wheels: WheelLink, imu: ImuSource | None, body: Body,
        now_ns: Callable[[], int] | None = None,
    ) -> None:  # fmt: skip
        self.commands: int = 3
        self._now_ns = now_ns
        self.notes = ()
        self.battery_v, self.temperature_c = float("nan"), float("nan")
        # angle between the z axis of the body and the vertical, averaged over TILT_MEAN_TICKS
        self.tilt_rad = 0.0
        self._force: np.ndarray | None = None
        self._sensors, self._wheels, self._imu, self._body = sensors, wheels, imu, body
        self._start_ns = 0
        self._duties = AppliedDuties(body.motors)
        self._last: Telemetry | None = None
        self._extras: list[tuple[str, int, np.ndarray]] = []
        self._events: list[tuple[int, Diagnostic | str]] = []
        self._encoders = SilentEncoders()

    def begin(self, now_ns: int) -> None:
        """Set the time of the host [ns] that is 0 in this world, and discard all data received before this time."""
        self._start_ns = now_ns
        self._extras, self._events = [], []  # these belong to a drive that ended within a tick
        self._last = (self._wheels.receive() or [self._last])[-1]
        self._encoders = SilentEncoders()
        if self._last is not None:
            self._update_duties(self._last)
        self._duties.begin(now_ns)
        if self._imu is not None:
            self._imu.read()
            self._imu.events()

    def read(self, t_ns: int) -> list[Tick]:
        """Return a list with one tick at `t_ns`, which contains all data since the last call."""
        telemetry = self._wheels.receive()
        previous, self._last = self._last, telemetry[-1] if telemetry else self._last
        if telemetry:
            self.battery_v = telemetry[-1].battery_v
            if self.battery_v > 0.0:
                self._extras.append(("battery", t_ns, np.array([self.battery_v])))
        for s in telemetry:
            self._update_duties(s)
        u = unmix(self._body.mixing, self._duties.mean(self._start_ns + t_ns))  # (2)
        self._events += [(t_ns, text) for s in telemetry for text in self._encoders.update(s)]
        imu = self._imu_slot(t_ns)
        names = tuple(self._sensors._fields)
        slots = (self._sensor_slot(t_ns, getattr(self._sensors, name), imu, previous) for name in names)
        return [Tick(t_ns, u, sensor_slots(names)(*slots))]

    def pop_events(self, t_ns: int) -> list[Diagnostic | str]:
        """Return the events of the hardware since the last call, and discard the readings: no drive is in progress."""
        self.read(t_ns)
        self.new_channels()
        return [message for _, message in self.new_events()]

    def write(self, command: Command) -> None:
        """Send the duties of this command.  (1)"""
        left, right = np.clip(mix(self._body.mixing, command.u), -1.0, 1.0).tolist()
        self._wheels.drive(left, right)
        now_ns = self._start_ns + command.t_ns if self._now_ns is None else self._now_ns()
        self._duties.record_command(now_ns, left, right)

    def stop_reason(self, t_ns: int) -> Diagnostic | None:
        """Return the reason why the vehicle must stop: the line is silent or noisy, or the firmware reports a stop.

        Return None if the vehicle is allowed to drive.
        """
        if self._last is None:
            return None if seconds(t_ns) < MAX_SILENT_S else stop(StopReason.UNO_UNHEARD)
        silent_s = seconds(t_ns, self._last.t_ns - self._start_ns)
        is_noisy = seconds(t_ns, self._wheels.noise_ns - self._start_ns) < MAX_SILENT_S
        if silent_s > MAX_SILENT_S and not is_noisy:
            return stop(StopReason.UNO_SILENT, silent_ms=1e3 * silent_s)
        if silent_s > MAX_NOISY_S:
            return stop(StopReason.LINE_NOISY, silent_ms=1e3 * silent_s)
        return self._last.stop_reason

    def new_channels(self) -> list[tuple[str, int, np.ndarray]]:
        """Return the name, time [ns] and value of readings without a sensor (battery, chip) since the last call."""
        extras, self._extras = self._extras, []
        return extras

    def new_events(self) -> list[tuple[int, Diagnostic | str]]:
        """Return the time [ns] and the message of each event of the hardware since the last call."""
        events, self._events = self._events, []
        return events

    def _update_duties(self, telemetry: Telemetry) -> None:
        duty = telemetry.applied_duty if telemetry.now is None else telemetry.now
        self._duties.update(telemetry.t_ns, telemetry.applied_duty, duty, telemetry.stop_reason is not None)

    def _imu_slot(self, t_ns: int) -> Slot | None:
        """Return (a_x, a_y, ω_z) of the body and its age, with the delay of the chip; None without a sample.  (3)"""
        samples = self._imu.read() if self._imu is not None else []
        if self._imu is not None:
            self._events += [(t_ns, event.message) for event in self._imu.events()]
        if not samples:
            return None
        accel = np.mean([s.accel for s in samples], axis=0)
        self._update_tilt(accel)
        gyro = np.mean([s.gyro for s in samples], axis=0)
        self.temperature_c = samples[-1].temperature_c
        self._extras.append(("imu_temperature", t_ns, np.array([self.temperature_c])))
        assert self._imu is not None
        middle_ns = sum(s.t_ns - self._start_ns for s in samples) // len(samples)
        # within the run
        age_s = min(max(0.0, seconds(t_ns, middle_ns) + self._imu.delay_s[1]), seconds(t_ns))
        return Slot(1.0, np.array([accel[0], accel[1], gyro[2]]), age_s)

    def _update_tilt(self, accel: np.ndarray) -> None:
        """Update the tilt [rad] from the low-passed specific force `accel` (3,); a drive disturbs it only briefly."""
        self._force = accel if self._force is None else self._force + (accel - self._force) / TILT_MEAN_TICKS
        self.tilt_rad = float(np.arctan2(np.hypot(self._force[0], self._force[1]), self._force[2]))

    def _sensor_slot(self, t_ns: int, sensor: Sensor, imu: Slot | None, previous: Telemetry | None) -> Slot:
        """Return the reading of this sensor in this tick; a sensor that the robot does not have is silent."""
        z: np.ndarray | None = None
        telemetry = self._last
        reads = optional.attribute(sensor, "reads")
        if reads == "imu" and imu is not None:
            # the delay of the low-pass is already in h
            return imu._replace(age_s=max(0.0, imu.age_s - float(low_pass_s(sensor))))
        if (
            telemetry is not None
            and previous is not None
            and telemetry is not previous
            and telemetry.boot == previous.boot
        ):
            if reads == "wheels":
                z = self._wheel_travel(previous, telemetry)
            elif reads == "encoders" and (travel := self._wheel_travel(previous, telemetry)) is not None:
                # the time to which a mean speed belongs
                middle_ns = (previous.t_ns + telemetry.t_ns) // 2 - self._start_ns
                return Slot(1.0, travel, seconds(t_ns, min(max(0, middle_ns), t_ns)))
            elif reads == "odometer":
                z = self._wheel_travel(previous, telemetry)
                z = None if z is None else np.mean(z, keepdims=True)
            elif reads == "mark" and telemetry.marks != previous.marks:
                # in this run, not after its tick
                passed_ns = min(max(0, telemetry.mark_ns - self._start_ns), t_ns)
                return Slot(1.0, np.zeros(1), seconds(t_ns, passed_ns))
        return Slot(0.0, np.zeros(sensor.size)) if z is None else Slot(1.0, z)

    def _wheel_travel(self, previous: Telemetry, telemetry: Telemetry) -> np.ndarray | None:
        """Return (v_l, v_r) [m/s] between two telemetry frames, or None for wheels without encoders.  (4)"""
        radius, turn = self._body.wheel_radius_m, self._body.counts_per_turn
        if radius is None or turn is None:
            return None
        counts = np.array(
            [count_increase(new, old) for new, old in zip(telemetry.counts, previous.counts, strict=True)]
        )
        return 2.0 * np.pi * radius * counts / (turn * seconds(telemetry.t_ns, previous.t_ns))


def count_increase(count: int, previous: int) -> int:
    """Return the increase from `previous` to `count` of a signed 32-bit counter, which wraps at 2³¹."""
    return (count - previous + (1 << 31)) % (1 << 32) - (1 << 31)
