"""Drive the vehicle on the floor with given duties, and record its IMU for a calibration."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baqueano.diagnostics import Severity, StopReason, note, stop
from baqueano.errors import AnswerNo, SafetyStop
from baqueano.signals import STANDARD_GRAVITY

if TYPE_CHECKING:
    from baqueano.robot.uno.frames import Settings
    from baqueano.worlds.robot import Sample

STEP_S = 0.01
MAX_SILENCE_S = 0.2  # silence of the IMU or the Uno that ends a test
MIN_TILT_COS = 0.9  # cosine of the largest tilt of the axis that should point up: 26°
STILL_RAD_S, STILL_M_S2 = 0.02, 0.15  # scatter at rest: ten times the noise of the chip with its 44 Hz filter


class ImuSamples(NamedTuple):
    """Samples of the IMU in the axes forward, left, up."""

    t_s: np.ndarray  # (n,) from the first command on
    accel: np.ndarray  # (n, 3) specific force [m/s²]
    gyro: np.ndarray  # (n, 3) [rad/s]

    def after(self, t_s: float) -> "ImuSamples":
        """Return the samples from the time `t_s` [s] on."""
        is_later = self.t_s >= t_s
        return ImuSamples(self.t_s[is_later], self.accel[is_later], self.gyro[is_later])

    @property
    def is_still(self) -> bool:
        """Return True if forces and rates scatter as little as at rest."""
        return bool(
            np.all(self.gyro.std(axis=0) < STILL_RAD_S) and np.all(self.accel.std(axis=0) < STILL_M_S2)
        )


@dataclass
class FloorTests:
    """Uno and IMU (axes forward, left, up), with a function to wait and a clock."""

    uno: Any
    imu: Any
    wait: Callable[[float], object] = time.sleep
    now_ns: Callable[[], int] = time.monotonic_ns

    def hold_duties(self, left: float, right: float, seconds: float) -> ImuSamples:
        """Send these duties every 10 ms for this time, and return the IMU's samples.

        Raise SafetyStop if the link or the IMU fails.
        """
        return self.follow_duties(lambda t_s: (left, right), seconds)

    def follow_duties(
        self, duties: Callable[[float], tuple[float, float]], seconds: float,
        is_over: Callable[["Sample"], bool] = lambda sample: False,
    ) -> ImuSamples:  # fmt: skip
        """Send `duties`, a function of time [s], every 10 ms for this time, and return the IMU's samples.

        End earlier if `is_over` returns True for a sample. Raise SafetyStop if the link or the IMU fails.
        """
        start_ns = imu_ns = uno_ns = self.now_ns()
        samples, is_finished = [], False
        self.imu.read()
        while not is_finished and (t_s := (self.now_ns() - start_ns) * 1e-9) < seconds:
            self.uno.drive(*duties(t_s))
            self.wait(STEP_S)
            uno_ns = self.now_ns() if self.uno.receive() else uno_ns
            new_samples = self.imu.read()
            samples += new_samples
            is_finished = any(is_over(sample) for sample in new_samples)
            imu_ns = self.now_ns() if new_samples else imu_ns
            self._check(uno_ns, imu_ns)
        return ImuSamples(
            np.array([(s.t_ns - start_ns) * 1e-9 for s in samples]),
            np.array([s.accel for s in samples]).reshape(-1, 3),
            np.array([s.gyro for s in samples]).reshape(-1, 3),
        )

    def rest_samples(self, seconds: float) -> ImuSamples:
        """Return the IMU's samples at rest, with the motors at zero.

        Raise AnswerNo if the vehicle moves in each of ten attempts.
        """
        scatter = 0.0
        for _ in range(10):
            self.hold_duties(0.0, 0.0, 0.3)
            samples = self.hold_duties(0.0, 0.0, seconds)
            if samples.is_still:
                return samples
            scatter = float(samples.gyro.std(axis=0).max())
        raise AnswerNo.of("floor.not-still", scatter_deg_s=np.degrees(scatter))

    def check_upright(self) -> None:
        """Raise AnswerNo if the IMU's up axis deviates from the vertical by more than 26°, or if the vehicle moves."""
        accel = self.rest_samples(0.3).accel.mean(axis=0)
        if accel[2] < MIN_TILT_COS * STANDARD_GRAVITY:
            x, y, z = accel
            raise AnswerNo.of("floor.gravity", "baqueano robot calibrate imu", x_m_s2=x, y_m_s2=y, z_m_s2=z)

    def store(self, settings: "Settings") -> None:
        """Disarm, write `settings` into the Uno's EEPROM, and arm again."""
        self.uno.disarm()
        self.wait(0.05)
        self.uno.store_settings(settings, self.wait)
        self.uno.arm()

    def _check(self, uno_ns: int, imu_ns: int) -> None:
        reason, silent_ns = self.uno.stop_cause, self.now_ns() - round(MAX_SILENCE_S * 1e9)
        if imu_ns < silent_ns:
            reason = stop(StopReason.IMU_SILENT)
        if uno_ns < silent_ns:
            reason = stop(StopReason.UNO_ABSENT)
        if reason is not None:
            self.uno.stop()
            raise SafetyStop(note("calibration.stopped", Severity.ERROR, cause=reason))
