"""Find the axes of the IMU on the vehicle, and its biases, from gravity, a lift of the front, and half a turn.

    level     the mean force f̄₁ at rest: the chip's axis nearest to it points up                            (1)
    lifted    the front is lifted and kept up: specific force grows along the axis that points forward,
              f_forward ≈ g sin(lift); left = up × forward                                                  (2)
    turned    half a turn to the left by hand, put down: θ = ∫ (ω − ω̄₁) dt must be positive                (3)
    biases    from both positions, (a_x, a_y): f̄₁ = b + s, f̄₂ = b + R(−θ) s  ⇒  s, b                       (4)

s is the slope of the floor, which turns with the vehicle's heading while the bias does not: the floor may be
inclined. The gyro's bias is the mean of both rests. b contains the zero error of the accelerometer and the tilt of the
IMU. A fit identifies only their sum (sensors/imu.py), so [sensors.imu] tilt_rad stays unchanged, and the biases contain
the rest. The axes are found in steps of a right angle. A fit finds the remaining turn about z, [sensors.imu]
heading_rad.
"""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from baqueano.contracts.values import JsonObject, TableRow
from baqueano.errors import AnswerNo
from baqueano.messages.language import mark as N_, translate as _
from baqueano.robot.workshop.floor_tests import STILL_M_S2, STILL_RAD_S
from baqueano.signals import STANDARD_GRAVITY, Motion

if TYPE_CHECKING:
    from baqueano.vehicle_file.file import VehicleFile

REST_S = 8.0  # the mean of the gyro, with noise 0.04 °/s at 200 Hz and 44 Hz, is then known to 0.002 °/s
REST_WINDOW_S = 0.5
TIMEOUT_S = 60.0
HAND_FACTOR = 5.0  # factor on the scatter at rest: a hand moves more than a floor
MIN_UPRIGHT_COS = np.cos(np.radians(25.0))
MIN_LIFT = np.sin(np.radians(8.0))  # more than the slope of any floor
MAX_OBLIQUE_TAN = np.tan(np.radians(30.0))  # limit between a lift of the front and a lift of a corner
MIN_TURN_RAD = np.radians(90.0)
AXIS_LETTERS = ("x", "y", "z")
Notify = Callable[[str], object]


@dataclass
class ImuReader:
    """A reader of the IMU in the chip's axes, which integrates the rates. It has a function to wait, and a clock."""

    imu: Any
    wait: Callable[[float], object] = time.sleep
    now_ns: Callable[[], int] = time.monotonic_ns

    def __post_init__(self) -> None:
        self.bias = np.zeros(3)  # bias of the gyro, once it is known
        self.turned = np.zeros(3)  # ∫ (gyro − bias) dt [rad]
        self._last_ns = 0

    def samples(self, seconds: float) -> tuple[np.ndarray, np.ndarray]:
        """Return specific forces (n, 3) [m/s²] and rates (n, 3) [rad/s] that are measured in this time [s].

        Raise AnswerNo if no sample arrives.
        """
        end_ns, read = self.now_ns() + round(seconds * 1e9), []
        while self.now_ns() < end_ns:
            self.wait(0.01)
            for sample in self.imu.read():
                if self._last_ns:
                    self.turned = (
                        self.turned + (sample.gyro - self.bias) * (sample.t_ns - self._last_ns) * 1e-9
                    )
                self._last_ns = sample.t_ns
                read.append(sample)
        if not read:
            raise AnswerNo.of("calibrate.no-sample", "baqueano robot doctor", limit_s=seconds)
        return np.array([s.accel for s in read]), np.array([s.gyro for s in read])

    def wait_for_rest(self, seconds: float, quantity: str) -> tuple[np.ndarray, np.ndarray]:
        """Wait for rest, and return the means of force (3,) [m/s²] and rate (3,) [rad/s] over this time [s] at rest.

        Raise AnswerNo after a minute without rest.
        """
        end_ns = self.now_ns() + round(TIMEOUT_S * 1e9)
        while self.now_ns() < end_ns:
            if not _is_steady(*self.samples(REST_WINDOW_S)):
                continue
            accel, gyro = self.samples(seconds)
            if _is_steady(accel, gyro):
                return accel.mean(axis=0), gyro.mean(axis=0)
        raise AnswerNo.of("calibrate.not-still", step=quantity, limit_s=TIMEOUT_S)

    def wait_for_force(self, quantity: str, accepts: Callable[[np.ndarray], bool]) -> np.ndarray:
        """Return the mean force (3,) once the IMU is at rest and `accepts` returns True for the force.

        Raise AnswerNo if this has not happened after a minute.
        """
        end_ns = self.now_ns() + round(TIMEOUT_S * 1e9)
        while self.now_ns() < end_ns:
            accel, gyro = self.samples(REST_WINDOW_S)
            at_rest = np.abs(gyro.mean(axis=0) - self.bias).max() < HAND_FACTOR * STILL_RAD_S
            if at_rest and _is_steady(accel, gyro, HAND_FACTOR) and accepts(accel.mean(axis=0)):
                return accel.mean(axis=0)
        raise AnswerNo.of("calibrate.no-motion", step=quantity, limit_s=TIMEOUT_S)


def _is_steady(accel: np.ndarray, gyro: np.ndarray, factor: float = 1.0) -> bool:
    return bool(
        np.all(accel.std(axis=0) < factor * STILL_M_S2) and np.all(gyro.std(axis=0) < factor * STILL_RAD_S)
    )


@dataclass(frozen=True)
class ImuCalibration:
    """The result of `calibrate`.

    Biases (a_x, a_y) [m/s²] and ω [rad/s] are the sensor's means at rest; `slope_rad` is the slope of the floor.
    """

    axes: tuple[str, str, str]  # the chip's axes that point forward, left, up
    accel: np.ndarray
    gyro: float
    slope_rad: float
    lift_rad: float
    turn_rad: float
    oblique_rad: float  # angle between the chip's up axis and the vehicle's

    verdict = "FOUND"

    def rows(self) -> list[TableRow]:
        """Return the result as a list of one row."""
        return [asdict(self)]

    @classmethod
    def from_row(cls, row: TableRow) -> "ImuCalibration":
        """Return the result from a row in JSON, the inverse of `rows`."""
        return cls(**row | {"axes": tuple(row["axes"]), "accel": np.array(row["accel"])})

    def table(self) -> str:
        """Return axes, biases, slope and turn as text."""
        a_x, a_y = self.accel
        return _(
            "axes that point forward, left, up: {axes}; {oblique_rad:.1f}° from upright\nat rest: "
            "accelerometer ({a_x:+.3f}, {a_y:+.3f}) m/s² forward and left, gyro {gyro:+.3f} °/s\nthe "
            "floor slopes by {slope_rad:.1f}°; the turn was {turn_rad:.0f}°",
            axes=", ".join(self.axes),
            oblique_rad=np.degrees(self.oblique_rad),
            a_x=a_x,
            a_y=a_y,
            gyro=np.degrees(self.gyro),
            slope_rad=np.degrees(self.slope_rad),
            turn_rad=np.degrees(self.turn_rad),
        )

    def values(self, vehicle_file: "VehicleFile") -> JsonObject:
        """Return the changes of a vehicle file: the axes, and biases that agree with the file's tilt and scales."""
        values: JsonObject = {"robot.imu_axes": list(self.axes)}
        if "imu" in vehicle_file.sensors._fields:
            imu = vehicle_file.sensors.imu
            zero = np.zeros(3)
            expected_reading = np.asarray(imu.h(Motion(zero, zero, zero, zero)), dtype=float)
            values["sensors.imu.accel_bias"] = np.round(imu.accel_bias + self.accel - expected_reading[:2], 5)
            values["sensors.imu.gyro_bias"] = round(float(imu.gyro_bias + self.gyro - expected_reading[2]), 6)
        return values


def calibrate(reader: ImuReader, notify: Notify) -> ImuCalibration:
    """Guide the operator through rest, lift and turn, and return axes and biases. The IMU must use its chip's axes.
    Raise AnswerNo if a step is not executed within a minute, or if the axes cannot be determined.
    """
    notify(
        _(
            "put the vehicle on the floor, wheels down, and do not touch it for {steady_s:g} s",
            steady_s=REST_S + REST_WINDOW_S,
        )
    )
    first_force, gyro_1 = reader.wait_for_rest(REST_S, N_("at rest"))
    up_axis, reader.bias = find_up_axis(first_force), gyro_1
    notify(_("now lift its front by about 10 cm, straight up, and hold it there"))
    min_lift = MIN_LIFT * STANDARD_GRAVITY

    def is_tilted(accel: np.ndarray) -> bool:
        return bool(np.abs(_horizontal_part(accel - first_force, up_axis)).max() > min_lift)

    axes, lift = lift_axes(
        reader.wait_for_force(N_("the lift of the front"), is_tilted) - first_force, up_axis
    )
    notify(_("put it down and turn it on the floor by about half a turn to the left; then do not touch it"))
    start_angles = reader.turned
    reader.wait_for_force(
        N_("the turn"), lambda accel: _is_turned_left(reader, start_angles, up_axis) and not is_tilted(accel)
    )
    second_force, gyro_2 = reader.wait_for_rest(REST_S, N_("after the turn"))
    gyro = float(0.5 * up_axis @ (gyro_1 + gyro_2))
    turn = float(up_axis @ (reader.turned - start_angles))
    bias, slope_xy = biases((axes @ first_force)[:2], (axes @ second_force)[:2], turn)
    oblique = float(np.arccos(np.clip(axes[2] @ first_force / np.linalg.norm(first_force), -1.0, 1.0)))
    return ImuCalibration(
        axis_names(axes), bias, gyro, float(np.linalg.norm(slope_xy) / STANDARD_GRAVITY), lift, turn, oblique
    )


def _is_turned_left(reader: ImuReader, start_angles: np.ndarray, up_axis: np.ndarray) -> bool:
    """Return True if the vehicle was turned to the left. Raise AnswerNo if it was turned to the right.  (3)

    Return False for a turn of at most 90° in either direction.
    """
    turn = float(up_axis @ (reader.turned - start_angles))
    if turn < -MIN_TURN_RAD:
        raise AnswerNo.of("calibrate.turned-right", turn_deg=-np.degrees(turn))
    return turn > MIN_TURN_RAD


def find_up_axis(force: np.ndarray) -> np.ndarray:
    """Return the chip's axis (3,), with its sign, that points up. Raise AnswerNo if none points nearly up.  (1)"""
    axis = int(np.argmax(np.abs(force)))
    if abs(force[axis]) < MIN_UPRIGHT_COS * np.linalg.norm(force):
        x, y, z = force
        raise AnswerNo.of("calibrate.not-upright", x_m_s2=x, y_m_s2=y, z_m_s2=z)
    up_axis = np.zeros(3)
    up_axis[axis] = np.sign(force[axis])
    return up_axis


def lift_axes(change: np.ndarray, up_axis: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the axes (3, 3), with the rows forward, left, up in the chip's axes, and the lift [rad].  (2)

    Raise AnswerNo if the vehicle was lifted over a corner.
    """
    gains = _horizontal_part(change, up_axis)
    largest_axis, second_axis = np.argsort(-np.abs(gains))[:2]
    if abs(gains[second_axis]) > MAX_OBLIQUE_TAN * abs(gains[largest_axis]):
        raise AnswerNo.of(
            "calibrate.lifted-over-corner",
            first_m_s2=abs(gains[largest_axis]),
            second_m_s2=abs(gains[second_axis]),
            max_ratio=MAX_OBLIQUE_TAN,
        )
    front = np.zeros(3)
    front[largest_axis] = np.sign(gains[largest_axis])
    return np.stack([front, np.cross(up_axis, front), up_axis]), float(
        np.arcsin(min(1.0, abs(gains[largest_axis]) / STANDARD_GRAVITY))
    )


def biases(first_xy: np.ndarray, second_xy: np.ndarray, turn_rad: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the bias b (2,) and the slope s (2,) [m/s²] of (4), from the mean forces (2,) at both positions."""
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    slope_xy = np.linalg.solve(np.array([[c, s], [-s, c]]) - np.eye(2), second_xy - first_xy)
    return first_xy - slope_xy, slope_xy


def axis_names(axes: np.ndarray) -> tuple[str, str, str]:
    """Return the rows of `axes` as names for [robot] imu_axes."""
    forward, left, up = (
        ("-" if row.sum() < 0 else "") + AXIS_LETTERS[int(np.argmax(np.abs(row)))] for row in axes
    )
    return forward, left, up


def _horizontal_part(vector: np.ndarray, up_axis: np.ndarray) -> np.ndarray:
    """Return `vector` (3,) with 0 instead of its component along `up_axis`."""
    return vector * (1.0 - np.abs(up_axis))
