"""The applied duty of each tick is exact for any telemetry phase, without delay or loss."""

import numpy as np
import pytest

from baqueano.worlds.applied_duty import COMMAND_DELAY_NS, AppliedDuties, AppliedMotors, MotorCharacteristic

MS = 1_000_000
UNEQUAL = AppliedMotors(
    20.0,
    (
        MotorCharacteristic(0.3, 0.7),
        MotorCharacteristic(0.32, 0.68),
        MotorCharacteristic(0.25, 0.75),
        MotorCharacteristic(0.27, 0.7),
    ),
)


class Firmware:
    """The duty of the wheels, millisecond by millisecond, and its telemetry `phase_ms` after each tick."""

    def __init__(self, motors, phase_ms, on_the_way_ms=1):
        self.motors, self.phase_ms, self.late_ms = motors, phase_ms, on_the_way_ms
        self.requests, self.ms, self.duties = [0.0, 0.0], 0, []
        self.goals = [(0, (0.0, 0.0))]

    def command(self, goal):
        self.goals.append((self.ms + self.late_ms, goal))

    def until(self, ms, duties):
        while self.ms < ms:
            goal = next(g for since, g in reversed(self.goals) if since <= self.ms)
            self.requests = [self.motors.step(x, g, 1e-3) for x, g in zip(self.requests, goal, strict=True)]
            self.duties.append([self.motors.duty(k, x) for k, x in enumerate(self.requests)])
            self.ms += 1
            if self.ms % 10 == self.phase_ms:
                self.report(duties)

    def report(self, duties):
        duties.update(self.ms * MS, tuple(np.mean(self.duties[-10:], axis=0)), tuple(self.duties[-1]), False)


def drive_motors(motors, phase_ms, ticks=300, on_the_way_ms=1, seed=0):
    """Return reported (ticks, 2) and true mean duties of each tick."""
    rng = np.random.default_rng(seed)
    duties = AppliedDuties(motors)
    firmware = Firmware(motors, phase_ms, on_the_way_ms)
    firmware.until(20, duties)
    duties.begin(20 * MS)
    means, truth = [], []
    for k in range(ticks):
        if k % 20 == 0:
            goal = tuple(rng.uniform(-1.0, 1.0, 2))
        firmware.command(goal)
        duties.record_command(firmware.ms * MS, *goal)
        firmware.until(firmware.ms + 10, duties)
        means.append(duties.mean(firmware.ms * MS))
        truth.append(np.mean(firmware.duties[-10:], axis=0))
    return np.array(means), np.array(truth)


@pytest.mark.parametrize("phase_ms", range(10))
def test_the_mean_duty_of_a_tick_is_exact_for_every_telemetry_phase(phase_ms):
    means, truth = drive_motors(UNEQUAL, phase_ms)
    np.testing.assert_allclose(means, truth, atol=1e-9)


@pytest.mark.parametrize("phase_ms", [1, 2])
def test_errors_of_the_predicted_duty_do_not_accumulate(phase_ms):
    means, truth = drive_motors(UNEQUAL, phase_ms, on_the_way_ms=4)  # 3 ms more delay
    behind = 0.01 * np.cumsum(means - truth, axis=0)
    assert np.max(np.abs(means - truth)) > 0.1
    assert np.max(np.abs(behind)) < 0.006, "the duty of three milliseconds, twice as large where it reverses"
    assert np.max(np.abs(behind[18::20])) < 1e-9, "no error after a constant command"


def test_no_duty_is_predicted_for_a_stopped_vehicle():
    duties = AppliedDuties()
    duties.update(0, (0.0, 0.0), (0.0, 0.0), False)
    duties.begin(0)
    duties.record_command(0, 0.5, 0.5)
    np.testing.assert_allclose(duties.mean(10 * MS), 0.5 * (1.0 - COMMAND_DELAY_NS / (10 * MS)))
    duties.update(12 * MS, (0.0, 0.0), (0.0, 0.0), True)
    assert np.all(duties.mean(20 * MS) < 0.0), "subtracts the excess of the previous tick"
    duties.update(22 * MS, (0.0, 0.0), (0.0, 0.0), True)
    np.testing.assert_allclose(duties.mean(30 * MS), 0.0, atol=1e-12)


def test_conversion_from_duty_to_request_inverts_the_reverse_conversion():
    for wheel in (0, 1):
        for x in (-1.0, -0.4, 0.0, 0.2, 1.0):
            assert UNEQUAL.request(wheel, UNEQUAL.duty(wheel, x)) == pytest.approx(x, abs=1e-8)
    assert UNEQUAL.step(0.5, -0.5, 0.1) == 0.0, "a wheel reverses through zero"
    assert UNEQUAL.step(0.0, 1.0, 0.01) == pytest.approx(0.2)
