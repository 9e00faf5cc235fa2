"""The real vehicle as a world: sent duties, applied duties, the axes of the body, reported silence."""

import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.diagnostics import StopReason, note, stop
from baqueano.errors import UsageError
from baqueano.sensors import Encoders, Imu, Mark, Wheels
from baqueano.sensors.imu_filter import low_pass_hz
from baqueano.sensors.sampling import low_pass_s
from baqueano.signals import Command, measured_ns, sensor_slots
from baqueano.worlds.robot import Body, Robot, Sample, Telemetry
from tests.codes import refused
from tests.memory import memory_trace

MS = 1_000_000


class Line:
    """A link whose telemetry the test writes."""

    def __init__(self, *messages):
        self.waiting, self.sent, self.noise_ns = list(messages), [], -(1 << 62)

    def drive(self, left, right):
        self.sent.append((left, right))

    def receive(self):
        messages, self.waiting = self.waiting, []
        return messages


class Chip:
    """An IMU whose samples the test writes."""

    delay_s = (0.0049, 0.0048)

    def __init__(self, *samples):
        self.waiting, self.happened = list(samples), []

    def read(self):
        samples, self.waiting = self.waiting, []
        return samples

    def events(self):
        return self.happened


def telemetry(t_ms, applied=(0.0, 0.0), counts=(0, 0), marks=0, stop_code=None, mark_ms=0, silent=False):
    return Telemetry(t_ms * MS, applied, counts, 7.4, marks, mark_ms * MS, stop_code, silent)


def sensors(**sensors_by_name):
    return sensor_slots(tuple(sensors_by_name))(*sensors_by_name.values())


def test_a_command_is_converted_to_limited_duties_of_two_wheels():
    line = Line()
    robot = Robot(vehicle_file.load("small").sensors, line, None, Body())
    robot.write(Command(0, np.array([0.5, 0.0, 0.2])))
    robot.write(Command(0, np.array([1.0, 0.0, 1.0])))
    assert line.sent == [(0.3, 0.7), (0.0, 1.0)]


def test_a_tick_without_telemetry_repeats_the_last_applied_command():
    line = Line(telemetry(5, (0.2, 0.4)), telemetry(10, (0.4, 0.6)))
    robot = Robot(vehicle_file.load("small").sensors, line, None, Body())
    np.testing.assert_allclose(robot.read(10 * MS)[0].u, [0.5, 0.0, 0.1])
    np.testing.assert_allclose(robot.read(20 * MS)[0].u, [0.5, 0.0, 0.1])


def test_samples_since_the_last_tick_are_averaged():
    chip = Chip(
        Sample(4 * MS, np.array([1.0, 2.0, 9.0]), np.array([0.0, 0.0, 0.5]), 30.0),
        Sample(8 * MS, np.array([3.0, 4.0, 9.0]), np.array([0.0, 0.0, 0.7]), 31.0),
    )
    robot = Robot(sensors(imu=Imu()), Line(), chip, Body())
    slot = robot.read(10 * MS)[0].sensors.imu
    np.testing.assert_allclose(slot.z, [2.0, 3.0, 0.6])
    assert slot.is_new == 1.0
    assert slot.age_s == pytest.approx(0.004 + 0.0048), (
        "from the middle of the samples, and the filter's delay"
    )
    assert robot.read(20 * MS)[0].sensors.imu.is_new == 0.0
    assert ("imu_temperature", 10 * MS) in [(name, t_ns) for name, t_ns, _ in robot.new_channels()]


def test_the_modelled_low_pass_delay_is_not_counted_twice_in_timestamps():
    """The estimators use the sum of both delays as the age, and a fit has the filter in h."""
    total_s = []
    for imu in (Imu(), Imu(low_pass_hz=low_pass_hz(3)), Imu(low_pass_hz=100.0)):
        chip = Chip(Sample(8 * MS, np.array([0.0, 0.0, 9.8]), np.zeros(3), 30.0))
        slot = Robot(sensors(imu=imu), Line(), chip, Body()).read(10 * MS)[0].sensors.imu
        total_s.append(slot.age_s + low_pass_s(imu))
    assert total_s == pytest.approx([0.0068] * 3)
    assert 0.5 / (np.pi * low_pass_hz(3)) == pytest.approx(Chip.delay_s[1])


def test_data_of_an_ended_drive_are_not_part_of_the_next_drive():
    robot = Robot(sensors(imu=Imu()), Line(telemetry(5)), None, Body())
    robot.read(10 * MS)
    robot.begin(20 * MS)
    assert robot.new_channels() == []


def test_without_recording_each_event_is_reported_once_and_memory_is_constant():
    line, chip = Line(), Chip()
    robot = Robot(sensors(), line, chip, Body())
    events = []
    with memory_trace():
        for k in range(3000):
            line.waiting = [telemetry(50 * k, (0.6, 0.6), (0, k), silent=k >= 100)]
            chip.waiting = [Sample(50 * k * MS, np.array([0.0, 0.0, 9.8]), np.zeros(3), 30.0)]
            chip.happened = [SimpleNamespace(message=note("imu.started"))] if k == 1500 else []
            events += robot.pop_events(50 * k * MS)
            if k == 1500:
                memory_before = tracemalloc.get_traced_memory()[0]
        growth_bytes = tracemalloc.get_traced_memory()[0] - memory_before
    assert [event.code for event in events] == ["encoders.left-silent", "imu.started"]
    assert robot.new_channels() == robot.new_events() == []
    assert growth_bytes < 10_000, "418 bytes a look were kept"
    assert robot.battery_v == 7.4


def test_wheel_speeds_follow_their_counts_and_a_mark_is_received_once():
    line = Line(telemetry(10))
    body = Body(wheel_radius_m=0.03, counts_per_turn=60.0)
    robot = Robot(sensors(wheels=Wheels(track_m=0.1), mark=Mark()), line, None, body)
    assert robot.read(10 * MS)[0].sensors.wheels.is_new == 0.0
    line.waiting = [telemetry(110, counts=(6, -12), marks=1)]
    slots = robot.read(110 * MS)[0].sensors
    np.testing.assert_allclose(slots.wheels.z, [2 * np.pi * 0.03, -4 * np.pi * 0.03])
    assert slots.mark.is_new == 1.0
    line.waiting = [telemetry(120, counts=(6, -12), marks=1)]
    assert robot.read(120 * MS)[0].sensors.mark.is_new == 0.0


def test_the_age_of_an_encoder_speed_includes_half_its_interval():
    line = Line(telemetry(10))
    encoders = sensors(encoders=Encoders(track_m=0.1, count_m=0.00314))
    robot = Robot(encoders, line, None, Body(wheel_radius_m=0.03, counts_per_turn=60.0))
    robot.read(10 * MS)
    line.waiting = [telemetry(30, counts=(6, -12))]
    slot = robot.read(34 * MS)[0].sensors.encoders
    np.testing.assert_allclose(slot.z, [0.3 * np.pi, -0.6 * np.pi])
    assert measured_ns(34 * MS, slot) == 20 * MS


def test_a_counter_overflow_causes_no_jump_of_the_speed():
    line = Line(telemetry(10, counts=((1 << 31) - 2, 3 - (1 << 31))))
    robot = Robot(sensors(wheels=Wheels(track_m=0.1)), line, None, Body("two_wheels", 0.03, 60.0))
    robot.read(10 * MS)
    line.waiting = [telemetry(110, counts=(4 - (1 << 31), (1 << 31) - 9))]
    slots = robot.read(110 * MS)[0].sensors
    np.testing.assert_allclose(slots.wheels.z, [2 * np.pi * 0.03, -4 * np.pi * 0.03])


def test_a_restart_of_the_uno_causes_no_false_motion_or_mark():
    """Its counts begin at 0 again, and measurement continues from there."""
    line = Line(telemetry(10, counts=(5000, 5000), marks=3))
    robot = Robot(
        sensors(wheels=Wheels(track_m=0.1), mark=Mark()), line, None, Body("two_wheels", 0.03, 60.0)
    )
    robot.read(10 * MS)
    line.waiting = [telemetry(20)._replace(boot=1)]
    slots = robot.read(20 * MS)[0].sensors
    assert (slots.wheels.is_new, slots.mark.is_new) == (0.0, 0.0)
    line.waiting = [telemetry(120, counts=(6, 6), marks=1)._replace(boot=1)]
    slots = robot.read(120 * MS)[0].sensors
    np.testing.assert_allclose(slots.wheels.z, 2 * np.pi * 0.03)
    assert slots.mark.is_new == 1.0


def test_a_mark_timestamp_is_within_the_run_and_not_after_its_tick():
    line = Line(telemetry(1000))
    robot = Robot(sensors(mark=Mark()), line, None, Body())
    robot.begin(1000 * MS)
    passed_ms = []
    for k, mark_ms in enumerate((1004, 998, 1033), 1):
        line.waiting = [telemetry(1000 + 10 * k, marks=k, mark_ms=mark_ms)]
        tick = robot.read(10 * k * MS)[0]
        passed_ms.append(measured_ns(tick.t_ns, tick.sensors.mark) / MS)
    assert passed_ms == [4, 0, 30]


def test_a_silent_encoder_is_named_once_until_new_counts_arrive():
    line = Line()
    robot = Robot(sensors(), line, None, Body())
    for k in range(300):
        silent = 60 <= k < 150 or k >= 210
        counts = (0, k) if k < 150 else (k, 150)
        line.waiting = [telemetry(10 * k, (0.6, -0.6), counts, silent=silent)]
        robot.read(10 * k * MS)
    events = robot.new_events()
    assert [(t_ns // MS, event.code) for t_ns, event in events] == [
        (600, "encoders.left-silent"), (2100, "encoders.right-silent"),
    ]  # fmt: skip
    assert robot.new_events() == []


def test_a_silent_link_and_a_stopped_firmware_are_reported():
    line = Line(telemetry(10))
    robot = Robot(vehicle_file.load("small").sensors, line, None, Body())
    robot.read(10 * MS)
    assert robot.stop_reason(50 * MS) is None
    silent = robot.stop_reason(300 * MS)
    assert (silent.code, silent.figures["silent_ms"]) == (StopReason.UNO_SILENT, pytest.approx(290.0))
    latch_stop = stop(StopReason.UNO_LATCHED)
    line.waiting = [telemetry(310, stop_code=latch_stop)]
    robot.read(310 * MS)
    assert robot.stop_reason(310 * MS) == latch_stop


def test_a_noisy_line_has_a_longer_timeout_than_a_silent_line():
    line = Line(telemetry(10))
    robot = Robot(vehicle_file.load("small").sensors, line, None, Body())
    robot.read(10 * MS)
    line.noise_ns = 905 * MS
    assert robot.stop_reason(910 * MS) is None
    line.noise_ns = 1015 * MS
    assert robot.stop_reason(1020 * MS).code == StopReason.LINE_NOISY
    line.noise_ns = 105 * MS
    silent = robot.stop_reason(300 * MS)
    assert (silent.code, silent.figures["silent_ms"]) == (StopReason.UNO_SILENT, pytest.approx(290.0))


def test_tipping_over_is_detected_within_a_second_but_shaking_is_not():
    chip, t_ns = Chip(), 0
    robot = Robot(sensors(imu=Imu()), Line(), chip, Body())
    for k in range(100):
        chip.waiting = [Sample(t_ns, np.array([9.0 * (-1) ** k, 0.0, 9.8]), np.zeros(3), 30.0)]
        robot.read(t_ns := t_ns + 10 * MS)
    assert robot.tilt_rad < 0.2
    for _ in range(100):
        chip.waiting = [Sample(t_ns, np.array([9.8, 0.0, 0.5]), np.zeros(3), 30.0)]
        robot.read(t_ns := t_ns + 10 * MS)
    assert robot.tilt_rad > 1.0


def test_a_vehicle_without_two_wheels_is_refused():
    with refused("robot.mixing", UsageError):
        Body(mixing="none")
