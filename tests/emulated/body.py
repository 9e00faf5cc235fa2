"""A simulated body on the motor pins of an emulated Uno: the duties move it, and its motion is the force on the chip.

The chip vibrates by VIBRATION times the noise of the IMU in the vehicle file, white at 1 kHz. Behind the chip filter
of 44 Hz (noise bandwidth 69 Hz of 500) this is the noise of the file. At rest only the noise of the chip remains.
"""

import threading
from typing import Any

import numpy as np

from baqueano.sensors.imu import STANDARD_GRAVITY
from baqueano.signals import Motion
from baqueano.symbolic import function
from baqueano.vehicle_file import override
from baqueano.vehicles.drivetrain import unmix
from baqueano.worlds.noise import random_stream

STEP_S = 1e-3
VIBRATION = (500.0 / 69.0) ** 0.5
STILL_M_S, STILL_RAD_S = 0.002, 0.01
PERIOD_S = 0.005  # of the body in real time: the sample period of the chip
KERNELS: dict[str, Any] = {}  # the step of the body of each text of a vehicle file


class Body:
    """The body of the vehicle in a vehicle file. `motion` is its true motion now, `force` what the chip feels:
    specific force (3,) [m/s²] and rate (3,) [rad/s]."""

    def __init__(self, truth: Any, seed: int = 0) -> None:
        quick = override(truth, ("rate_hz=1000",))
        vehicle, self._imu = quick.vehicle, quick.sensors.imu
        self._state = self._rest = vehicle.init()
        self.motion = Motion(self._state.eta, self._state.nu, self._state.nu_dot, vehicle.gravity(0.0))
        self.force = ((0.0, 0.0, STANDARD_GRAVITY), (0.0, 0.0, 0.0))
        self._noise, self._shake = random_stream(seed, "process"), random_stream(seed, "vibration")

        def step(state: Any, duties: np.ndarray, noise: np.ndarray) -> Any:
            state, motion = vehicle.step(state, unmix("two_wheels", duties), STEP_S, noise)
            return state, motion, quick.sensors.imu.h(motion)

        if truth.text not in KERNELS:
            KERNELS[truth.text] = function(step, self._state, np.zeros(2), np.zeros(3))
        self._step = KERNELS[truth.text]

    def put_back(self) -> None:
        """Put the body at rest at the origin."""
        self._state = self._rest

    def step(self, duties: np.ndarray) -> None:
        """Move for one millisecond under the duties (2,) of the left and the right wheel."""
        self._state, self.motion, z = self._step(self._state, duties, self._noise.standard_normal(3))
        x, y, w = z.tolist()
        nu = self.motion.nu
        if abs(nu[0]) > STILL_M_S or abs(nu[2]) > STILL_RAD_S:
            shake = self._shake.standard_normal(3) * VIBRATION
            x, y = x + self._imu.accel_noise_std[0] * shake[0], y + self._imu.accel_noise_std[1] * shake[1]
            w = w + self._imu.gyro_noise_std * shake[2]
        self.force = ((x, y, STANDARD_GRAVITY), (0.0, 0.0, w))


class RealTimeBody(threading.Thread):
    """A body on an emulated Uno that runs in real time; a chip in another process feels it each PERIOD_S.

    It advances by the time of the Uno, so a stall of the machine stops both.
    """

    def __init__(self, truth: Any, live: Any, machine: Any) -> None:
        super().__init__(daemon=True)
        self.body, self._live, self._machine = Body(truth), live, machine
        self._done = threading.Event()
        self.start()

    def close(self) -> None:
        self._done.set()
        self.join()

    def run(self) -> None:
        before_s = self._live.now_s()
        while not self._done.wait(PERIOD_S):
            with self._live.lock:
                uno = self._live.uno
                now_s, duties = uno.t_s, np.array(uno.duties())
            while before_s + STEP_S <= now_s:
                self.body.step(duties)
                before_s += STEP_S
            self._machine.order("feel", *self.body.force)
