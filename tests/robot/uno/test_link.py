"""The messages of the host to the Uno and its reaction to answers, on a line that the test controls."""

import numpy as np
import pytest

from baqueano.diagnostics import StopReason
from baqueano.errors import RobotUnreachable
from baqueano.robot.uno.codec import Decoder, encode
from baqueano.robot.uno.frames import (
    AskInfo,
    Config,
    Drive,
    DriveFlag,
    Info,
    Ping,
    Pong,
    ResetCause,
    State,
    StateFlag,
    Stop,
)
from baqueano.robot.uno.link import Uno
from tests.codes import refused

MS = 1_000_000
CONFIG = Config()


class Line:
    """A serial port whose other end is the test, and a clock that only the test advances."""

    def __init__(self):
        self.coming, self.decoder, self.sent, self.now_ns, self.broken = b"", Decoder(), [], 0, False
        self.seq = 0

    def write(self, data):
        if self.broken:
            raise OSError("gone")
        self.sent += [(r.frame, r.seq) for r in self.decoder.feed(data)]

    def read(self):
        data, self.coming = self.coming, b""
        return data

    def send(self, frame, kind=None):
        self.seq += 1
        self.coming += encode(frame, self.seq, kind)

    def drives(self):
        return [frame for frame, _ in self.sent if isinstance(frame, Drive)]


def info(nonce=7, cause=0, config=CONFIG):
    return Info(1, nonce, cause, 1, 0, 0, 1, 0, 3, 900, 0, 0, 0, 0, 0, 0, config)


def state(t_ms, nonce=7, flags=0, left=0, sums=(0, 0), battery=7400, seq=0, age=3):
    return State(t_ms * 1000, 0, *sums, 0, 0, left, left, battery, age, nonce, seq, flags, 0, 0, 0, 0)


@pytest.fixture
def line():
    return Line()


@pytest.fixture
def uno(line):
    uno = Uno(line, lambda: line.now_ns)
    line.send(info())
    uno.pump()
    line.sent.clear()
    return uno


def test_no_command_is_sent_before_arming_and_arming_sends_zero_duty(line, uno):
    uno.drive(0.5, 0.5)
    assert not line.drives()
    assert uno.statistics.unsent_commands == 1
    uno.arm()
    uno.drive(0.25, -1.5)
    assert line.drives() == [Drive(7, 0, 0, DriveFlag.ARM), Drive(7, 250, -1000, DriveFlag.ARM)]


def test_sequence_numbers_continue_from_the_last_executed_command(line, uno):
    line.send(state(10, seq=200))
    uno.pump()
    uno.arm()
    uno.drive(0.1, 0.1)
    assert [seq for frame, seq in line.sent if isinstance(frame, Drive)] == [201, 202]


def test_sequence_numbers_of_commands_in_transit_are_not_reused(line, uno):
    uno.arm()
    for _ in range(30):  # 0.3 s of a loop, telemetry as rare as it can be set
        uno.drive(0.1, 0.1)
    line.send(state(10, flags=StateFlag.ARMED, seq=1))
    uno.pump()
    uno.drive(0.1, 0.1)
    assert line.sent[-1][1] == 32


def test_applied_duty_is_the_mean_between_frames_despite_a_lost_frame(line, uno):
    line.send(state(10))
    line.seq += 1  # a frame that never arrives
    line.send(state(30, sums=(20 * 400, -20 * 100)))
    measurements = uno.receive()
    np.testing.assert_allclose(measurements[-1].applied_duty, [0.4, -0.1])
    assert uno.statistics.lost_frames == 1


def test_an_overflow_of_the_duty_sum_causes_no_jump(line, uno):
    line.send(state(10, sums=((1 << 31) - 1000, 0)))
    line.send(state(20, sums=(-(1 << 31) + 2000, 0)))
    assert uno.receive()[-1].applied_duty[0] == pytest.approx(0.3)


def test_fw7_a_reset_disarms_with_its_cause_until_armed_again(line, uno):
    uno.arm()
    line.send(state(10, flags=StateFlag.ARMED))
    uno.pump()
    line.send(state(5, nonce=9))
    assert uno.receive()[-1].stop_reason.code == StopReason.UNO_RESET
    line.sent.clear()
    line.send(info(nonce=9, cause=ResetCause.BROWN_OUT))
    uno.pump()
    uno.drive(0.5, 0.5)
    assert not line.drives()
    uno.arm()
    uno.drive(0.5, 0.5)
    assert line.drives()[-1] == Drive(9, 500, 500, DriveFlag.ARM)
    assert uno.stop_cause is None


@pytest.mark.parametrize(
    ("flags", "code", "figures"),
    [
        (StateFlag.STOPPED, StopReason.UNO_LATCHED, {}),
        (StateFlag.BATTERY_LOW | StateFlag.ARMED, StopReason.UNO_BATTERY, {"battery_v": 7.4}),
        (StateFlag.ARMED | StateFlag.DEAD_MAN, StopReason.UNO_DEAD_MAN, {"silent_ms": 310}),
        (0, StopReason.UNO_DISARMED, {}),
    ],
)
def test_every_reason_of_the_firmware_is_reported(line, uno, flags, code, figures):
    uno.arm()
    uno.drive(0.5, 0.5)
    line.send(state(10, flags=StateFlag.ARMED))
    line.send(state(20, flags=flags, age=310))
    stop_reason = uno.receive()[-1].stop_reason
    assert (stop_reason.code, stop_reason.figures) == (code, figures)


def test_a_lost_arming_frame_is_sent_again_until_telemetry_confirms(line, uno):
    uno.arm()
    line.now_ns = 5 * MS
    line.send(state(5))  # made before the arming frame could arrive
    uno.pump()
    uno.drive(0.2, 0.2)
    line.now_ns = 15 * MS
    line.send(state(15))
    uno.pump()
    line.sent.clear()
    uno.drive(0.2, 0.2)
    assert line.drives() == [Drive(7, 0, 0, DriveFlag.ARM), Drive(7, 200, 200, DriveFlag.ARM)]
    line.now_ns = 25 * MS
    line.send(state(25, flags=StateFlag.ARMED))
    uno.pump()
    line.sent.clear()
    uno.drive(0.2, 0.2)
    assert line.drives() == [Drive(7, 200, 200, DriveFlag.ARM)]


def test_an_unconfirmed_arming_becomes_a_fault_after_0_6_s(line, uno):
    """On a noisy line the first telemetry may arrive long after arming was lost."""
    uno.arm()
    for t_ms, is_deaf in [(400, False), (590, False), (610, True)]:
        line.now_ns = t_ms * MS
        line.send(state(t_ms))
        stop_reason = uno.receive()[-1].stop_reason
        assert (stop_reason is not None and stop_reason.code == StopReason.UNO_DEAF) == is_deaf
    uno.arm()
    line.send(state(620))
    assert uno.receive()[-1].stop_reason is None, "arming is sent again, with a new timeout"


@pytest.mark.parametrize("duty", [float("nan"), float("inf"), -float("inf")])
def test_rt4_a_nan_duty_does_not_move_the_motors(line, uno, duty):
    uno.arm()
    uno.drive(duty, 0.5)
    uno.drive(0.5, np.float64(duty))
    assert line.drives()[1:] == [Drive(7, 0, 500, DriveFlag.ARM), Drive(7, 500, 0, DriveFlag.ARM)]


def test_a_stop_is_sent_immediately_and_later_commands_are_not_sent(line, uno):
    uno.arm()
    uno.stop()
    uno.drive(0.5, 0.5)
    assert isinstance(line.sent[-1][0], Stop)


def test_a_lost_serial_line_is_counted_without_an_exception(line, uno):
    uno.arm()
    line.broken = True
    uno.drive(0.5, 0.5)
    uno.stop()
    assert uno.statistics.unsent_commands == 1


def test_telemetry_timestamps_compensate_a_resonator_error_of_half_a_percent(line, uno):
    rng = np.random.default_rng(3)
    offset_us, rate = 123_456_789, 0.995
    errors = []
    device = lambda t_ns: offset_us + round(t_ns * rate / 1000)  # noqa: E731
    for k in range(1, 3000):
        line.now_ns = k * 10 * MS
        measured_ns = line.now_ns - round(rng.uniform(0.2, 1.2) * MS)
        line.send(state(0)._replace(t_us=device(measured_ns)))
        measurements = uno.receive()
        for ping in [frame for frame, _ in line.sent if isinstance(frame, Ping)]:
            forth_ns, return_ns = rng.uniform(0.2, 1.2, 2) * MS
            delay = 4 * MS if rng.random() < 0.15 else 0
            line.send(Pong(ping.token, device(line.now_ns + round(forth_ns))))
            line.now_ns += round(forth_ns + return_ns) + delay
            uno.pump()
        line.sent.clear()
        if k > 1000:
            errors.append(measurements[-1].t_ns - measured_ns)
    assert abs(uno.clock.skew - 1 / rate + 1) < 2e-4
    assert np.std(errors) < 0.5 * MS


@pytest.mark.parametrize("ticks", [8, 50])
def test_a_pause_of_the_host_does_not_move_the_timestamps(line, uno, ticks):
    """Otherwise two frames were 1 ns apart, and the counts between them a speed that no vehicle has."""
    times = []
    for k in range(1, 500):
        line.now_ns = k * 10 * MS
        line.send(state(10 * k))
        if 301 <= k < 301 + ticks:
            continue
        times += [measurement.t_ns for measurement in uno.receive()]
        for ping in [frame for frame, _ in line.sent if isinstance(frame, Ping)]:
            line.send(Pong(ping.token, 10_000 * k + 500))
            line.now_ns += MS
            if k != 300:
                uno.pump()
        line.sent.clear()
    assert np.abs(np.diff(times[50:]) - 10 * MS).max() < MS


def test_a_request_without_an_answer_ends_with_an_error(line, uno):
    def wait(s):
        line.now_ns += round(s * 1e9)

    with refused("uno.no-answer", RobotUnreachable):
        uno.settings(wait)
    assert line.now_ns < 1.1e9


def test_damaged_answers_to_a_request_are_reported_as_a_noisy_line(line, uno):
    def wait(s):
        line.now_ns += round(s * 1e9)
        line.coming += b"\0\x05damaged\0"

    with refused("uno.answer-not-whole", RobotUnreachable):
        uno.settings(wait)


def test_a_configuration_that_the_firmware_refused_is_an_error(line, uno):
    def wait(s):
        line.now_ns += round(s * 1e9)
        line.send(info(config=CONFIG._replace(dead_man_ms=250)))

    with refused("uno.refused-number", RobotUnreachable):
        uno.configure(CONFIG, wait)
    assert any(isinstance(frame, Config) for frame, _ in line.sent)


def test_a_reopened_line_requests_the_identity_of_the_uno(line, uno):
    uno.on_reopen()
    line.now_ns += 200 * MS
    uno.pump()
    assert any(isinstance(frame, AskInfo) for frame, _ in line.sent)


def test_reopening_the_line_resets_the_clock_estimate_of_the_uno(line, uno):
    """Opening the port resets an Uno: its clock begins at 0 again."""
    for k in range(1, 100):
        line.now_ns = k * 10 * MS
        line.send(state(60_000 + k * 10))
        for ping in [frame for frame, _ in line.sent if isinstance(frame, Ping)]:
            line.send(Pong(ping.token, 1000 * (60_000 + k * 10)))
        line.sent.clear()
        uno.pump()
    uno.on_reopen()
    line.seq = 0
    line.now_ns += 2000 * MS
    line.send(state(10, nonce=9))
    assert uno.receive()[-1].t_ns == line.now_ns
    assert uno.statistics.resets == 1
    line.now_ns += 10 * MS
    line.send(state(20, nonce=9))
    assert uno.receive()[-1].t_ns == line.now_ns
    assert uno.statistics.lost_frames == 0


def test_a_cleared_stop_does_not_block_the_next_drive(line, uno):
    uno.arm()
    line.send(info(nonce=9, cause=ResetCause.BROWN_OUT))
    line.send(state(5, nonce=9))
    assert uno.receive()[-1].stop_reason.figures == {"cause": "brown-out"}
    uno.clear_stop()
    line.send(state(15, nonce=9))
    assert uno.receive()[-1].stop_reason is None
    line.send(state(25, nonce=9, flags=StateFlag.STOPPED))
    uno.clear_stop()
    assert uno.receive()[-1].stop_reason.code == StopReason.UNO_LATCHED, (
        "a persistent fault is reported again"
    )


def test_repeated_or_out_of_order_telemetry_is_counted_and_discarded(line, uno):
    line.send(info())
    line.send(state(10, left=100))
    line.coming += line.coming
    first, late_frame = state(20, left=200), state(30, left=300)
    line.seq += 1
    line.send(late_frame)
    line.coming += encode(first, line.seq - 1)
    line.send(state(40, left=400))
    assert len(uno.receive()) == 3
    assert (uno.statistics.late_frames, uno.statistics.lost_frames) == (3, 1)


def test_telemetry_that_arrives_after_a_newer_answer_is_accepted(line, uno):
    line.send(state(10))
    line.seq += 1
    line.send(Pong(99, 12_000))
    line.coming += encode(state(20), line.seq - 1)
    line.send(state(30))
    assert len(uno.receive()) == 3
    assert (uno.statistics.late_frames, uno.statistics.lost_frames) == (1, 1)


def test_telemetry_with_any_sequence_number_is_accepted_after_a_long_silence(line, uno):
    line.send(state(10))
    line.seq += 200
    line.send(state(2010))
    assert len(uno.receive()) == 2
    assert uno.statistics.lost_frames == 200


def test_telemetry_timestamps_are_never_later_than_their_arrival(line, uno):
    """A damaged timestamp that passed the check must not hide the next silence."""
    line.send(state(10))
    line.now_ns = 200 * MS
    uno.pump()
    line.send(Pong(next(f.token for f, _ in line.sent if isinstance(f, Ping)), 10_000))
    uno.pump()
    line.send(state(60_000))
    assert uno.receive()[-1].t_ns <= line.now_ns + 1
