"""Find the axes of the IMU on the vehicle, and its biases: from gravity, a lift of the front, and half a turn.

    level     the mean force f̄₁ at rest: the chip's axis nearest to it points up                            (1)
    lifted    the front is lifted and kept up: specific force grows along the axis that points ahead,
              f_ahead ≈ g sin(lift); left = up × ahead                                                      (2)
    turned    half a turn to the left by hand, put down: θ = ∫ (ω − ω̄₁) dt must be positive                (3)
    biases    from both positions, (a_x, a_y): f̄₁ = b + s, f̄₂ = b + R(−θ) s  ⇒  s, b                       (4)

s is the slope of the floor, which turns with the vehicle's heading while the bias does not: the floor need not be
level. The gyro's bias is the mean of both rests. b contains the zero error of the accelerometer and the tilt of the
IMU. A fit identifies only their sum (sensors/imu.py), so [sensors.imu] tilt_rad stays unchanged, and the biases contain
the rest. The axes are found in steps of a right angle. A fit finds the remaining turn about z, [sensors.imu]
heading_rad.
"""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from baqueano.diagnostics import fault
from baqueano.errors import AnswerNo
from baqueano.messages.language import mark as N_
from baqueano.messages.language import translate as _
from baqueano.robot.workshop.floor_tests import STILL_M_S2, STILL_RAD_S
from baqueano.signals import STANDARD_GRAVITY, Motion

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject, TableRow
    from baqueano.vehicle_file.file import VehicleFile

REST_S = 8.0  # the mean of the gyro, with noise 0.04 °/s at 200 Hz and 44 Hz, is then known to 0.002 °/s
STEADY_S = 0.5
PATIENCE_S = 60.0
HELD = 5.0  # times the scatter at rest: a hand moves more than a floor
UPRIGHT = np.cos(np.radians(25.0))
LEAST_LIFT = np.sin(np.radians(8.0))  # more than the slope of any floor
CLEAR = np.tan(np.radians(30.0))  # limit between a lift of the front and a lift of a corner
LEAST_TURN_RAD = np.radians(90.0)
LETTERS = ("x", "y", "z")
Notify = Callable[[str], object]


@dataclass
class ImuReader:
    """A reader of the IMU in the chip's axes, which integrates the rates; with a function to wait and a clock."""

    imu: Any
    wait: Callable[[float], object] = time.sleep
    now_ns: Callable[[], int] = time.monotonic_ns

    def __post_init__(self) -> None:
        self.bias = np.zeros(3)  # bias of the gyro, once it is known
        self.turned = np.zeros(3)  # ∫ (gyro − bias) dt [rad]
        self._last_ns = 0

    def samples(self, seconds: float) -> tuple[np.ndarray, np.ndarray]:
        """Return specific forces (n, 3) [m/s²] and rates (n, 3) [rad/s] of this duration.

        Raise AnswerNo without a sample.
        """
        end, read = self.now_ns() + round(seconds * 1e9), []
        while self.now_ns() < end:
            self.wait(0.01)
            for sample in self.imu.read():
                if self._last_ns:
                    self.turned = (
                        self.turned + (sample.gyro - self.bias) * (sample.t_ns - self._last_ns) * 1e-9
                    )
                self._last_ns = sample.t_ns
                read.append(sample)
        if not read:
            raise AnswerNo(fault("calibrate.no-sample", "baqueano robot doctor", within_s=seconds))
        return np.array([s.accel for s in read]), np.array([s.gyro for s in read])

    def still(self, seconds: float, quantity: str) -> tuple[np.ndarray, np.ndarray]:
        """Wait for rest, and return the means of force (3,) and rate (3,) over this duration of rest.

        Raise AnswerNo after a minute without rest.
        """
        end = self.now_ns() + round(PATIENCE_S * 1e9)
        while self.now_ns() < end:
            if not _steady(*self.samples(STEADY_S)):
                continue
            accel, gyro = self.samples(seconds)
            if _steady(accel, gyro):
                return accel.mean(axis=0), gyro.mean(axis=0)
        raise AnswerNo(fault("calibrate.not-still", what=quantity, within_s=PATIENCE_S))

    def wait_for_force(self, quantity: str, accepts: Callable[[np.ndarray], bool]) -> np.ndarray:
        """Return the mean force (3,) once the IMU is at rest and `accepts` returns True for the force.

        Raise AnswerNo if this has not happened after a minute.
        """
        end = self.now_ns() + round(PATIENCE_S * 1e9)
        while self.now_ns() < end:
            accel, gyro = self.samples(STEADY_S)
            at_rest = np.abs(gyro.mean(axis=0) - self.bias).max() < HELD * STILL_RAD_S
            if at_rest and _steady(accel, gyro, HELD) and accepts(accel.mean(axis=0)):
                return accel.mean(axis=0)
        raise AnswerNo(fault("calibrate.not-felt", what=quantity, within_s=PATIENCE_S))


def _steady(accel: np.ndarray, gyro: np.ndarray, times: float = 1.0) -> bool:
    return bool(
        np.all(accel.std(axis=0) < times * STILL_M_S2) and np.all(gyro.std(axis=0) < times * STILL_RAD_S)
    )


@dataclass(frozen=True)
class MountedImu:
    """The result of `calibrate`.

    Biases (a_x, a_y) [m/s²] and ω [rad/s] are the sensor's means at rest; `slope_rad` is the slope of the floor.
    """

    axes: tuple[str, str, str]  # the chip's axes that point ahead, left, up
    accel: np.ndarray
    gyro: float
    slope_rad: float
    lift_rad: float
    turn_rad: float
    oblique_rad: float  # angle between the chip's up axis and the vehicle's

    verdict = "FOUND"

    def rows(self) -> list["TableRow"]:
        """Return the result as a list of one row."""
        return [asdict(self)]

    @classmethod
    def of(cls, row: "TableRow") -> "MountedImu":
        """Return the result from a row in JSON: the inverse of `rows`."""
        return cls(**row | {"axes": tuple(row["axes"]), "accel": np.array(row["accel"])})

    def table(self) -> str:
        """Return axes, biases, slope and turn as text."""
        a_x, a_y = self.accel
        return _(
            "axes that point ahead, left, up: {axes}; {oblique_rad:.1f}° from upright\nat rest: "
            "accelerometer ({a_x:+.3f}, {a_y:+.3f}) m/s² ahead and left, gyro {gyro:+.3f} °/s\nthe "
            "floor slopes by {slope_rad:.1f}°; the turn was {turn_rad:.0f}°",
            axes=", ".join(self.axes),
            oblique_rad=np.degrees(self.oblique_rad),
            a_x=a_x,
            a_y=a_y,
            gyro=np.degrees(self.gyro),
            slope_rad=np.degrees(self.slope_rad),
            turn_rad=np.degrees(self.turn_rad),
        )

    def values(self, vehicle_file: "VehicleFile") -> "JsonObject":
        """Return the changes of a vehicle file: the axes, and biases that fit the means with its tilt and scales."""
        values: JsonObject = {"robot.imu_axes": list(self.axes)}
        if "imu" in vehicle_file.sensors._fields:
            imu = vehicle_file.sensors.imu
            zero = np.zeros(3)
            expected = np.asarray(imu.h(Motion(zero, zero, zero, zero)), dtype=float)
            values["sensors.imu.accel_bias"] = np.round(imu.accel_bias + self.accel - expected[:2], 5)
            values["sensors.imu.gyro_bias"] = round(float(imu.gyro_bias + self.gyro - expected[2]), 6)
        return values


def calibrate(watched: ImuReader, notify: Notify) -> MountedImu:
    """Guide the operator through rest, lift and turn, and return axes and biases. The IMU must use its chip's axes."""
    notify(
        _(
            "put the vehicle on the floor, wheels down, and do not touch it for {steady_s:g} s",
            steady_s=REST_S + STEADY_S,
        )
    )
    first, gyro_1 = watched.still(REST_S, N_("at rest"))
    up, watched.bias = upward(first), gyro_1
    notify(_("now lift its front by about 10 cm, straight up, and hold it there"))
    least = LEAST_LIFT * STANDARD_GRAVITY

    def is_tilted(accel: np.ndarray) -> bool:
        return bool(np.abs(_across(accel - first, up)).max() > least)

    axes, lift = ahead(watched.wait_for_force(N_("the lift of the front"), is_tilted) - first, up)
    notify(_("put it down and turn it on the floor by about half a turn to the left; then do not touch it"))
    before = watched.turned
    watched.wait_for_force(
        N_("the turn"), lambda accel: _is_turned(watched, before, up) and not is_tilted(accel)
    )
    second, gyro_2 = watched.still(REST_S, N_("after the turn"))
    gyro = float(0.5 * up @ (gyro_1 + gyro_2))
    turn = float(up @ (watched.turned - before))
    bias, slope = biases((axes @ first)[:2], (axes @ second)[:2], turn)
    oblique = float(np.arccos(np.clip(axes[2] @ first / np.linalg.norm(first), -1.0, 1.0)))
    return MountedImu(
        names(axes), bias, gyro, float(np.linalg.norm(slope) / STANDARD_GRAVITY), lift, turn, oblique
    )


def _is_turned(reader: ImuReader, before: np.ndarray, up: np.ndarray) -> bool:
    """Return True if the vehicle was turned to the left. Raise AnswerNo if it was turned to the right.  (3)

    Turns of at most 90° in either direction do not count.
    """
    turn = float(up @ (reader.turned - before))
    if turn < -LEAST_TURN_RAD:
        raise AnswerNo(fault("calibrate.turned-right", turned_deg=-np.degrees(turn)))
    return turn > LEAST_TURN_RAD


def upward(force: np.ndarray) -> np.ndarray:
    """Return the chip's axis (3,), with its sign, that points up. Raise AnswerNo if none points nearly up.  (1)"""
    place = int(np.argmax(np.abs(force)))
    if abs(force[place]) < UPRIGHT * np.linalg.norm(force):
        x, y, z = force
        raise AnswerNo(fault("calibrate.not-upright", x=x, y=y, z=z))
    up = np.zeros(3)
    up[place] = np.sign(force[place])
    return up


def ahead(change: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the axes (3, 3), rows ahead, left, up in the chip's axes, and the lift [rad].  (2)

    Raise AnswerNo if the vehicle was lifted over a corner.
    """
    gains = _across(change, up)
    first, second = np.argsort(-np.abs(gains))[:2]
    if abs(gains[second]) > CLEAR * abs(gains[first]):
        raise AnswerNo(
            fault(
                "calibrate.lifted-over-corner",
                first_m_s2=abs(gains[first]),
                second_m_s2=abs(gains[second]),
                clear=CLEAR,
            )
        )
    front = np.zeros(3)
    front[first] = np.sign(gains[first])
    return np.stack([front, np.cross(up, front), up]), float(
        np.arcsin(min(1.0, abs(gains[first]) / STANDARD_GRAVITY))
    )


def biases(first: np.ndarray, second: np.ndarray, turn_rad: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the bias b (2,) and the slope s (2,) [m/s²] of (4), from the mean forces of both positions."""
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    slope = np.linalg.solve(np.array([[c, s], [-s, c]]) - np.eye(2), second - first)
    return first - slope, slope


def names(axes: np.ndarray) -> tuple[str, str, str]:
    """Return the rows of `axes` as names for [robot] imu_axes."""
    ahead, left, up = (("-" if row.sum() < 0 else "") + LETTERS[int(np.argmax(np.abs(row)))] for row in axes)
    return ahead, left, up


def _across(vector: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return `vector` (3,) with a zero in place of its component along the axis `up`."""
    return vector * (1.0 - np.abs(up))
