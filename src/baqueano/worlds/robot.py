"""The real vehicle as a world of the loop: two wheels behind a link, an IMU on a bus.

    (l, r) = mix(u),  |l|, |r| ≤ 1                      duties that are sent                              (1)
    u = unmix(mean of the duties that were applied)     the command of a tick, as the motors had it       (2)
    z = mean of the samples since the last tick         IMU                                               (3)
    v = 2π r Δc / (N Δt)                                a wheel with N counts in a turn                   (4)

What was applied comes from the firmware's telemetry, after its slew, kick and dead man: that, and not what was
asked for, is what a model of the motors has to explain (applied.py).

This file knows neither frames nor registers: `wheels` and `imu` are anything with the methods of the protocols
below, on the vehicle (robot/) or emulated (tests/emulated/).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from baqueano.errors import UsageError
from baqueano.sensors import Imu, Mark, Odometer, Wheels
from baqueano.signals import Command, Slot, Tick, seconds, sensor_slots
from baqueano.vehicles.drivetrain import mix, unmix
from baqueano.worlds.applied import Applied, Motors
from baqueano.worlds.silent_encoders import SilentEncoders

TILT_TICKS = 50  # over which a tilt is the mean: half a second
SILENT_S = 0.1  # without telemetry the link counts as broken: ten frames are missing
DEAF_S = 1.0  # the same while something damaged arrives: of frames with 5 % of their bytes wrong one in ten is whole


class Telemetry(NamedTuple):
    """What the firmware says of one moment, in the clock of the host."""

    t_ns: int
    applied: tuple[float, float]  # mean duty of the left and the right motor since the telemetry before, [-1, 1]
    counts: tuple[int, int]  # of the encoders since the firmware started
    battery_v: float  # 0 where it is not wired
    marks: int  # lines passed since the firmware started
    mark_ns: int  # when the last one was
    stopped: str  # why the firmware drives no motor, in words; "" if it does
    encoder_silent: bool = False  # one counts nothing though its motor is driven hard
    now: tuple[float, float] | None = None  # duty of this moment; None: as `applied`


class Sample(NamedTuple):
    """One reading of an IMU, axes of the body: ahead, to the left, up."""

    t_ns: int
    accel: np.ndarray  # (3,) specific force [m/s²]
    gyro: np.ndarray  # (3,) [rad/s]
    temperature_c: float


class WheelLink(Protocol):
    """What sends duties and hears telemetry; neither call ever waits for the line."""

    def drive(self, left: float, right: float) -> None:
        """Duties in [-1, 1], once: nothing sends them again."""
        ...

    def heard(self) -> list[Telemetry]:
        """What came since the last time, in order."""
        ...

    @property
    def noise_ns(self) -> int:
        """When something damaged came last, in the time of the host."""
        ...


class ImuSource(Protocol):
    """What reads an IMU."""

    def events(self) -> list[Any]:
        """What happened to it since the last time, each with a `text`."""
        ...

    def read(self) -> list[Sample]:
        """What was measured since the last time, in order."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """What turns the hardware's numbers into the vehicle's."""

    mixing: str = "two_wheels"
    wheel_radius_m: float | None = None
    counts_per_turn: float | None = None
    motors: Motors = Motors()  # what the firmware makes of a duty that is sent

    def __post_init__(self) -> None:
        if self.mixing != "two_wheels":
            raise UsageError(
                f'[model.drivetrain] mixing = "{self.mixing}": the firmware drives a left and a right wheel. '
                'Write: mixing = "two_wheels"'
            )


class Robot:
    """A world of the loop. Its time begins with `begin`.

    `sensors`: of the vehicle file; one that the robot has not is silent. `imu` None: no IMU.
    `now_ns`: the clock of the host; None: a command leaves at its tick.

    >>> from types import SimpleNamespace
    >>> link = SimpleNamespace(drive=print, heard=list, noise_ns=0)  # in place of robot.link.Uno
    >>> robot = Robot(sensor_slots(())(), link, None, Body())
    >>> robot.write(Command(0, np.array([0.5, 0.0, 0.2])))  # left and right duty
    0.3 0.7
    """

    def __init__(
        self, sensors: Any, wheels: WheelLink, imu: ImuSource | None, body: Body,
        now_ns: Callable[[], int] | None = None,
    ) -> None:  # fmt: skip
        self.commands: int = 3
        self._now_ns = now_ns
        self.notes: tuple[str, ...] = ()  # sentences for the beginning of a run
        self.battery_v, self.temperature_c = float("nan"), float("nan")
        self.tilt_rad = 0.0  # of the body, the mean over TILT_TICKS: between its z and what it stands on
        self._force: np.ndarray | None = None
        self._sensors, self._wheels, self._imu, self._body = sensors, wheels, imu, body
        self._start_ns = 0
        self._applied = Applied(body.motors)
        self._last: Telemetry | None = None
        self._extras: list[tuple[str, int, np.ndarray]] = []
        self._events: list[tuple[int, str]] = []
        self._stamps: dict[str, int] = {}
        self._encoders = SilentEncoders()

    def begin(self, now_ns: int) -> None:
        """The time of the host [ns] that is 0 in this world; what was heard before is forgotten."""
        self._start_ns = now_ns
        self._last = (self._wheels.heard() or [self._last])[-1]
        self._encoders = SilentEncoders()
        self._applied.begin(now_ns)
        if self._imu is not None:
            self._imu.read()
            self._imu.events()

    def read(self, t_ns: int) -> list[Tick]:
        """One tick of everything that came since the last one."""
        said = self._wheels.heard()
        before, self._last = self._last, said[-1] if said else self._last
        if said:
            self.battery_v = said[-1].battery_v
            if self.battery_v > 0.0:
                self._extras.append(("battery", t_ns, np.array([self.battery_v])))
        for s in said:
            self._applied.heard(s.t_ns, s.applied, s.applied if s.now is None else s.now, bool(s.stopped))
        u = unmix(self._body.mixing, self._applied.mean(self._start_ns + t_ns))  # (2)
        self._events += [(t_ns, text) for s in said for text in self._encoders.heard(s)]
        imu = self._felt(t_ns)
        names = tuple(self._sensors._fields)
        slots = sensor_slots(names)(
            *(self._slot(getattr(self._sensors, name), imu, before) for name in names)
        )
        self._stamps = {n: self._mark_ns(t_ns) for n in names if self._passed(n, getattr(slots, n))}
        return [Tick(t_ns, u, slots)]

    def write(self, command: Command) -> None:
        """The duties that this command asks for.  (1)"""
        left, right = np.clip(mix(self._body.mixing, command.u), -1.0, 1.0).tolist()
        self._wheels.drive(left, right)
        self._applied.sent(self._start_ns + command.t_ns if self._now_ns is None else self._now_ns(), left, right)

    def trouble(self, t_ns: int) -> str:
        """Why the vehicle must not go on, in words; "" if the link is well."""
        if self._last is None:
            return "" if seconds(t_ns) < SILENT_S else "the Uno has not spoken yet"
        silent_s = seconds(t_ns, self._last.t_ns - self._start_ns)
        noisy = seconds(t_ns, self._wheels.noise_ns - self._start_ns) < SILENT_S
        if silent_s > SILENT_S and not noisy:
            return f"the Uno has been silent for {1e3 * silent_s:.0f} ms"
        if silent_s > DEAF_S:
            return (
                f"nothing whole has come from the Uno for {1e3 * silent_s:.0f} ms: the line is noisy. Look at its "
                "cable, and at the capacitors across the motors"
            )
        return self._last.stopped

    def new_channels(self) -> list[tuple[str, int, np.ndarray]]:
        """Name, time [ns] and value of what no sensor of the vehicle holds, since this was last asked."""
        extras, self._extras = self._extras, []
        return extras

    def new_stamps(self) -> dict[str, int]:
        """When what the last tick holds was measured [ns], of sensors with a stamp of their own: the mark, which the
        firmware stamps at the edge, up to two ticks before telemetry tells of it."""
        stamps, self._stamps = self._stamps, {}
        return stamps

    def new_events(self) -> list[tuple[int, str]]:
        """Time [ns] and text of what happened to the hardware, since this was last asked."""
        events, self._events = self._events, []
        return events

    def _felt(self, t_ns: int) -> np.ndarray | None:
        """(a_x, a_y, ω_z) of the body; None where no sample came.  (3)"""
        samples = self._imu.read() if self._imu is not None else []
        if self._imu is not None:
            self._events += [(t_ns, event.text) for event in self._imu.events()]
        if not samples:
            return None
        felt = np.mean([s.accel for s in samples], axis=0)
        self._tilted(felt)
        gyro = np.mean([s.gyro for s in samples], axis=0)
        self.temperature_c = samples[-1].temperature_c
        self._extras.append(("imu_temperature", t_ns, np.array([self.temperature_c])))
        return np.array([felt[0], felt[1], gyro[2]])

    def _tilted(self, felt: np.ndarray) -> None:
        """The tilt of the mean force: driving shakes it, but not for long."""
        self._force = felt if self._force is None else self._force + (felt - self._force) / TILT_TICKS
        self.tilt_rad = float(np.arctan2(np.hypot(self._force[0], self._force[1]), self._force[2]))

    def _slot(self, sensor: Any, imu: np.ndarray | None, before: Telemetry | None) -> Slot:
        """What this sensor of the vehicle says in this tick; one that the robot has not is silent."""
        z: np.ndarray | None = None
        now = self._last
        if isinstance(sensor, Imu):
            z = imu
        elif now is not None and before is not None and now is not before:
            if isinstance(sensor, Wheels):
                z = self._rolled(before, now)
            elif isinstance(sensor, Odometer):
                z = self._rolled(before, now)
                z = None if z is None else np.mean(z, keepdims=True)
            elif isinstance(sensor, Mark) and now.marks != before.marks:
                z = np.zeros(1)
        return Slot(0.0, np.zeros(sensor.size)) if z is None else Slot(1.0, z)

    def _passed(self, name: str, slot: Slot) -> bool:
        return slot.has > 0.5 and isinstance(getattr(self._sensors, name), Mark)

    def _mark_ns(self, t_ns: int) -> int:
        """When the last line was passed, in this run and not after it was told."""
        assert self._last is not None
        return min(max(0, self._last.mark_ns - self._start_ns), t_ns)

    def _rolled(self, before: Telemetry, now: Telemetry) -> np.ndarray | None:
        """(v_l, v_r) from one telemetry to the next; None for wheels without encoders.  (4)"""
        radius, turn = self._body.wheel_radius_m, self._body.counts_per_turn
        if radius is None or turn is None:
            return None
        counts = np.subtract(now.counts, before.counts)
        return 2.0 * np.pi * radius * counts / (turn * seconds(now.t_ns, before.t_ns))
