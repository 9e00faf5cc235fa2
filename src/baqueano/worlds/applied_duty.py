"""Estimate the duty that a motor had in a tick, before the telemetry of the end of the tick has arrived.

  U(t) = ∫ d dτ       from telemetry until t_s, the time of the newest frame; t − t_s is at most its period     (1)
  x → c, |ẋ| ≤ slew,  d = sign(x) (dead zone + slope |x|)       after t_s: as the firmware follows commands (2)
  u_k = (U(t_k) − Σ_{j<k} u_j δ_j) / δ_k                                                                (3)

d is the duty and U its integral; x is the request that follows the command c. u_k is the mean duty of tick k, whose
length is δ_k. Telemetry contains the mean over a time span that ended up to a period before the tick. If a fit used
this mean for the tick, its motors would be 2 to 11 ms too fast, depending on the phase. (3) corrects an error of (2) (a
kick, dither, a delayed frame) one tick later, so errors do not accumulate.
"""

from collections import deque
from typing import NamedTuple

import numpy as np

SECONDS_PER_NS = 1e-9
STEP_NS, MAX_STEPS = 1_000_000, 50  # the period at which the firmware checks its wheels
COMMAND_DELAY_NS = 1_000_000  # from a command of the loop to the wheels: by USB it is 1 to 2 ms


class MotorCharacteristic(NamedTuple):
    """The characteristic of a wheel in one direction: duty = dead_zone + slope · |request|."""

    dead_zone: float = 0.0
    slope: float = 1.0


class AppliedMotors(NamedTuple):
    """The conversion from request to duty in the firmware, for both wheels and both directions."""

    slew_per_s: float = 1000.0
    characteristics: tuple[MotorCharacteristic, ...] = (
        MotorCharacteristic(),
    ) * 4  # left forward, left backward, right forward, right backward

    def duty(self, wheel: int, request: float) -> float:
        """Return the duty at the pins, in [-1, 1], for a `request` to a wheel (0 left, 1 right).  (2)"""
        if request == 0.0:
            return 0.0
        characteristic = self.characteristics[2 * wheel + (request < 0.0)]
        magnitude = min(characteristic.dead_zone + characteristic.slope * abs(request), 1.0)
        return magnitude if request > 0.0 else -magnitude

    def request(self, wheel: int, duty: float) -> float:
        """Return the request for a duty at the pins, the inverse of `duty`."""
        if duty == 0.0:
            return 0.0
        characteristic = self.characteristics[2 * wheel + (duty < 0.0)]
        magnitude = max((abs(duty) - characteristic.dead_zone) / characteristic.slope, 1e-9)
        return magnitude if duty > 0.0 else -magnitude

    def step(self, request: float, target: float, seconds: float) -> float:
        """Return the request `seconds` later: it moves towards `target` with limited slew, and does not cross zero."""
        if request * target < 0.0:
            target = 0.0
        max_change = self.slew_per_s * seconds
        return request + min(max(target - request, -max_change), max_change)


IDEAL_MOTORS = AppliedMotors()


class AppliedDuties:
    """An estimator of the applied duties of two wheels. All times are times of the host's clock [ns]."""

    def __init__(self, motors: AppliedMotors = IDEAL_MOTORS) -> None:
        self._motors = motors
        self._commands: deque[tuple[int, tuple[float, float]]] = deque(maxlen=1000)
        self._command_ns, self._integral = -1, np.zeros(2)  # U of (1)
        self._duty, self._stopped = (0.0, 0.0), False
        self._until_ns, self._spent_duty = -1, np.zeros(2)  # the integral that earlier ticks have used in (3)
        self._mean = np.zeros(2)

    def begin(self, now_ns: int) -> None:
        """Begin the first tick at `now_ns`: remove earlier commands, and exclude earlier duty from the mean."""
        self._commands.clear()
        self._until_ns, self._integral = now_ns, np.zeros(2)
        self._spent_duty = np.zeros(2) if self._command_ns < 0 else self._integral_since_telemetry(now_ns)

    def record_command(self, now_ns: int, left: float, right: float) -> None:
        """Record a command (duties of the left and the right wheel) that was sent at `now_ns`."""
        self._commands.append((now_ns + COMMAND_DELAY_NS, (left, right)))

    def update(
        self, t_ns: int, mean: tuple[float, float], duty: tuple[float, float], is_stopped: bool
    ) -> None:
        """Record telemetry of the time `t_ns`.

        `mean` is the mean duty of both wheels since the previous telemetry, and `duty` the present duty. `is_stopped`
        is True if the firmware has stopped the motors.
        """
        if self._command_ns >= 0:
            self._integral = self._integral + np.array(mean) * ((t_ns - self._command_ns) * SECONDS_PER_NS)
        elif self._until_ns < 0:
            self._until_ns = t_ns
        self._command_ns, self._duty, self._stopped = t_ns, duty, is_stopped
        while len(self._commands) > 1 and self._commands[1][0] <= t_ns:
            self._commands.popleft()

    def mean(self, t_ns: int) -> np.ndarray:
        """Return the mean duty (2,) between the time of the last call and `t_ns`.  (3)"""
        if self._command_ns < 0 or t_ns <= self._until_ns:
            return self._mean
        integral = self._integral + self._integral_since_telemetry(t_ns)
        self._mean = (integral - self._spent_duty) / ((t_ns - self._until_ns) * SECONDS_PER_NS)
        self._until_ns, self._spent_duty = t_ns, integral
        return self._mean

    def _integral_since_telemetry(self, t_ns: int) -> np.ndarray:
        """Return the integral (2,) of the duty from the newest telemetry to `t_ns`.  (2)"""
        time_ns, total = self._command_ns, np.zeros(2)
        if t_ns <= time_ns or not self._commands:
            return np.array(self._duty) * ((t_ns - time_ns) * SECONDS_PER_NS)
        step_ns = max(STEP_NS, (t_ns - time_ns) // MAX_STEPS)
        requests = [self._motors.request(k, self._duty[k]) for k in (0, 1)]
        while time_ns < t_ns:
            span = min(step_ns, t_ns - time_ns) * SECONDS_PER_NS
            target = self._target(time_ns)
            requests = [self._motors.step(requests[k], target[k], span) for k in (0, 1)]
            total += [self._motors.duty(k, requests[k]) * span for k in (0, 1)]
            time_ns += step_ns
        return total

    def _target(self, t_ns: int) -> tuple[float, float]:
        """Return the command (left, right) that acts at `t_ns`; zero if the firmware has stopped the motors."""
        target = (0.0, 0.0)
        if not self._stopped:
            for since_ns, duty in self._commands:
                if since_ns > t_ns:
                    break
                target = duty
        return target
