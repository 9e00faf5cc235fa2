"""The duty that a motor had in a tick, known before the telemetry of the tick's end has come.

    U(t) = ∫ d dτ       known from telemetry up to t_s, the time of the newest; t_s ≤ t by up to a period of it  (1)
    x → c, |ẋ| ≤ slew,  d = sign(x) (dead zone + slope |x|)       after t_s: as the firmware follows commands (2)
    u_k = (U(t_k) − Σ_{j<k} u_j δ_j) / δ_k                                                                (3)

The mean in telemetry is that of its own span, which ended up to a period before the tick: taken for the tick's,
a fit would find the motors quicker than they are, by 2 to 11 ms as the phases fall. (3) corrects
an error of (2) (a kick, dither, a late frame) one tick later, so nothing adds up.
"""

from collections import deque
from typing import NamedTuple

import numpy as np

NS = 1e-9
STEP_NS, MOST_STEPS = 1_000_000, 50  # the firmware looks at its wheels so often
ON_THE_WAY_NS = 1_000_000  # from a command of the loop to the wheels: by USB it is 1 to 2 ms


class AppliedWay(NamedTuple):
    """The line of a wheel in one direction: duty = dead_zone + slope · |request|."""

    dead_zone: float = 0.0
    slope: float = 1.0


class AppliedMotors(NamedTuple):
    """The conversion from request to duty in the firmware."""

    slew_per_s: float = 1000.0
    ways: tuple[AppliedWay, ...] = (
        AppliedWay(),
    ) * 4  # left forwards, left backwards, right forwards, right backwards

    def duty(self, wheel: int, request: float) -> float:
        """The duty at the pins for a request that the wheel follows.  (2)"""
        if request == 0.0:
            return 0.0
        way = self.ways[2 * wheel + (request < 0.0)]
        size = min(way.dead_zone + way.slope * abs(request), 1.0)
        return size if request > 0.0 else -size

    def request(self, wheel: int, duty: float) -> float:
        """The inverse."""
        if duty == 0.0:
            return 0.0
        way = self.ways[2 * wheel + (duty < 0.0)]
        size = max((abs(duty) - way.dead_zone) / way.slope, 1e-9)
        return size if duty > 0.0 else -size

    def step(self, request: float, goal: float, seconds: float) -> float:
        """The request that is followed, so much later: through zero, no faster than the slew."""
        if request * goal < 0.0:
            goal = 0.0
        most = self.slew_per_s * seconds
        return request + min(max(goal - request, -most), most)


AS_SENT = AppliedMotors()


class AppliedDuties:
    """Of two wheels. All times are those of the host [ns]."""

    def __init__(self, motors: AppliedMotors = AS_SENT) -> None:
        self._motors = motors
        self._commands: deque[tuple[int, tuple[float, float]]] = deque(maxlen=1000)
        self._command_ns, self._integral = -1, np.zeros(2)  # U of (1)
        self._duty, self._stopped = (0.0, 0.0), False
        self._until_ns, self._spent_duty = -1, np.zeros(2)  # what (3) has spent
        self._mean = np.zeros(2)

    def begin(self, now_ns: int) -> None:
        """The first tick begins now; what was heard and sent before counts as much as it still moves a motor."""
        self._commands.clear()
        self._until_ns, self._integral = now_ns, np.zeros(2)
        self._spent_duty = np.zeros(2) if self._command_ns < 0 else self._onward(now_ns)

    def sent(self, now_ns: int, left: float, right: float) -> None:
        """A command has left."""
        self._commands.append((now_ns + ON_THE_WAY_NS, (left, right)))

    def update(self, t_ns: int, mean: tuple[float, float], now: tuple[float, float], stopped: bool) -> None:
        """Telemetry: the mean duty (2,) since the one before, that of now, and whether nothing drives."""
        if self._command_ns >= 0:
            self._integral = self._integral + np.array(mean) * ((t_ns - self._command_ns) * NS)
        elif self._until_ns < 0:
            self._until_ns = t_ns
        self._command_ns, self._duty, self._stopped = t_ns, now, stopped
        while len(self._commands) > 1 and self._commands[1][0] <= t_ns:
            self._commands.popleft()

    def mean(self, t_ns: int) -> np.ndarray:
        """The mean duty (2,) from the last time that was asked for to `t_ns`.  (3)"""
        if self._command_ns < 0 or t_ns <= self._until_ns:
            return self._mean
        whole = self._integral + self._onward(t_ns)
        self._mean = (whole - self._spent_duty) / ((t_ns - self._until_ns) * NS)
        self._until_ns, self._spent_duty = t_ns, whole
        return self._mean

    def _onward(self, t_ns: int) -> np.ndarray:
        """The integral (2,) from the newest telemetry to `t_ns`.  (2)"""
        at_ns, total = self._command_ns, np.zeros(2)
        if t_ns <= at_ns or not self._commands:
            return np.array(self._duty) * ((t_ns - at_ns) * NS)
        step_ns = max(STEP_NS, (t_ns - at_ns) // MOST_STEPS)
        requests = [self._motors.request(k, self._duty[k]) for k in (0, 1)]
        while at_ns < t_ns:
            span = min(step_ns, t_ns - at_ns) * NS
            goal = self._goal(at_ns)
            requests = [self._motors.step(requests[k], goal[k], span) for k in (0, 1)]
            total += [self._motors.duty(k, requests[k]) * span for k in (0, 1)]
            at_ns += step_ns
        return total

    def _goal(self, t_ns: int) -> tuple[float, float]:
        """The command that is in force."""
        goal = (0.0, 0.0)
        if not self._stopped:
            for since_ns, duty in self._commands:
                if since_ns > t_ns:
                    break
                goal = duty
        return goal
