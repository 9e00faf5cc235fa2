"""Battery, encoders, mark, clock, telemetry: the firmware reports the true values (R20 to R25)."""

import itertools
import random

import pytest

from baqueano.robot.uno.frames import Config, EncoderKind, Ping, Pong, State, StateFlag, Wiring


def counts(uno):
    state = uno.state()
    return state.left_counts, state.right_counts


def firmware_s(uno, t_us):
    return t_us * 1e-6 + uno.clock_began_s


@pytest.mark.parametrize("volts", [3.0, 6.4, 7.4, 8.4, 12.6])
def test_r20_battery_is_reported_within_1_percent(uno, volts):
    uno.set_battery(volts)
    uno.run(0.2)
    assert uno.state().battery_mv == pytest.approx(1000 * volts, rel=0.01)


def test_r20_a_divider_with_other_resistors_can_be_calibrated(uno):
    uno.store(battery_permille=3300)
    uno.set_battery(7.4)
    uno.run(0.2)
    assert uno.state().battery_mv == pytest.approx(1.1 * 7400, rel=0.01)


def test_r20_fw8_two_seconds_of_low_battery_disarm_until_recovery(uno):
    uno.send(Config(least_battery_mv=6600))
    uno.hold(500, 500, 0.2)
    uno.set_battery(6.3)
    uno.hold(500, 500, 1.9)
    assert uno.moving, "a sag of less than 2 s is not an empty battery"
    uno.set_battery(7.0)
    uno.hold(500, 500, 0.5)
    uno.set_battery(6.3)
    low = uno.t_s
    uno.hold(500, 500, 2.3)
    assert not uno.moving
    assert 1.9 <= uno.off_since() - low <= 2.2
    assert uno.state().flags & StateFlag.BATTERY_LOW
    assert not uno.state().flags & StateFlag.ARMED
    uno.set_battery(6.7)
    uno.hold(500, 500, 0.5)
    assert not uno.moving, "less than 200 mV above the limit"
    uno.set_battery(6.9)
    uno.run(0.3)
    assert not uno.moving, "the motors must not start without a command"
    uno.hold(500, 500, 0.2)
    assert uno.moving


def test_r20_no_battery_is_needed_without_a_limit(uno):
    uno.set_battery(0.0)
    uno.hold(500, 500, 2.5)
    assert uno.moving


@pytest.mark.parametrize("rate", [100, 3500, 10_000])
def test_r21_quadrature_counts_every_edge_in_both_directions(uno, rate):
    uno.store(encoders=EncoderKind.QUADRATURE)
    zero = counts(uno)
    uno.hold(500, -500, 0.05)
    start, seconds = uno.t_s + 1e-3, 0.3
    uno.encoder(0, round(rate * seconds), start, start + seconds)
    uno.encoder(1, -round(rate * seconds), start + 13e-6, start + seconds + 13e-6)
    uno.run(0.3)
    uno.encoder(0, -40, uno.t_s + 5e-3, uno.t_s + 0.02)
    uno.run(0.05)
    left, right = counts(uno)
    assert left - zero[0] == round(rate * seconds) - 40
    assert right - zero[1] == -round(rate * seconds)


@pytest.mark.parametrize(
    ("wiring", "signs"),
    [
        (Wiring.LEFT_ENCODER_REVERSED, ((0, -1), (1, 1))),
        (Wiring.RIGHT_ENCODER_REVERSED, ((0, 1), (1, -1))),
        (Wiring.ENCODERS_SWAPPED, ((1, 1), (0, 1))),
        (Wiring.ENCODERS_SWAPPED | Wiring.LEFT_ENCODER_REVERSED, ((1, -1), (0, 1))),
    ],
)
def test_r14_swapped_or_reversed_encoders_are_corrected(uno, wiring, signs):
    uno.store(encoders=EncoderKind.QUADRATURE, wiring=wiring)
    zero = counts(uno)
    counts_turned = (120, 70)
    for plug in range(2):
        uno.encoder(plug, counts_turned[plug], uno.t_s, uno.t_s + 0.05)
    uno.run(0.06)
    now = counts(uno)
    assert [now[k] - zero[k] for k in range(2)] == [sign * counts_turned[plug] for plug, sign in signs]


def test_r22_one_channel_counts_both_edges_with_the_sign_of_the_duty(uno):
    uno.store(encoders=EncoderKind.SINGLE)
    zero = counts(uno)
    uno.hold(300, -300, 0.05)
    uno.slots(0, 60, uno.t_s, uno.t_s + 0.1)
    uno.slots(1, 45, uno.t_s, uno.t_s + 0.1)
    uno.run(0.12)
    assert [b - a for a, b in zip(zero, counts(uno), strict=True)] == [60, -45]
    uno.run(0.3)
    uno.slots(0, 7, uno.t_s, uno.t_s + 0.05)
    uno.run(0.06)
    assert counts(uno)[0] - zero[0] == 67, "a coasting wheel retains its sign"
    uno.hold(-300, -300, 0.05)
    uno.slots(0, 20, uno.t_s, uno.t_s + 0.05)
    uno.run(0.06)
    assert counts(uno)[0] - zero[0] == 47


def test_r22_a_silent_encoder_at_high_duty_is_a_fault(uno):
    uno.store(encoders=EncoderKind.SINGLE)
    start = uno.t_s
    for k in range(40):
        uno.slots(0, 2, start + 0.02 * k, start + 0.02 * k + 0.02)
    uno.hold(600, 600, 0.4)
    assert not uno.state().flags & StateFlag.ENCODER_FAULT
    uno.keep(600, 600, 0.3)
    assert uno.state().flags & StateFlag.ENCODER_FAULT, "the right encoder never counted"
    uno.hold(0, 0, 0.1)
    assert not uno.state().flags & StateFlag.ENCODER_FAULT


def test_r22_without_encoders_no_fault_and_no_count_is_reported(uno):
    uno.slots(0, 20, uno.t_s, uno.t_s + 0.1)
    uno.hold(600, 600, 0.7)
    state = uno.state()
    assert not state.flags & StateFlag.ENCODER_FAULT
    assert (state.left_counts, state.right_counts) == (0, 0)


def strip(uno, at_s, seconds, bounces=()):
    """Simulate a tape under the sensor, with bouncing edges."""
    for dt in bounces:
        uno.set_mark(True, at_s + dt)
        uno.set_mark(False, at_s + dt + 20e-6)
    uno.set_mark(True, at_s)
    uno.set_mark(False, at_s + seconds)


def test_r23_a_mark_is_counted_once_and_timestamped_at_its_edge(uno):
    chance = random.Random(7)
    uno.run(0.05)
    at_s = uno.t_s
    for k in range(12):
        at_s = uno.t_s + chance.uniform(0.03, 0.08)
        uno.set_mark(True, at_s)
        uno.run_until(at_s + 0.01)
        assert uno.state().flags & StateFlag.ON_MARK
        off_s = at_s + chance.uniform(0.02, 0.4)
        uno.set_mark(False, off_s)
        uno.run_until(off_s + 0.03)
        state = uno.state()
        assert state.mark_count == k + 1
        assert not state.flags & StateFlag.ON_MARK
        assert firmware_s(uno, state.mark_t_us) == pytest.approx(at_s, abs=50e-6)


def test_r23_bounces_at_both_edges_count_as_one_mark(uno):
    uno.run(0.05)
    at_s = uno.t_s + 0.0101
    for edge in (at_s, at_s + 0.05):
        for k in range(6):
            uno.set_mark(True, edge + 60e-6 * k)
            uno.set_mark(False, edge + 60e-6 * k + 30e-6)
    uno.set_mark(True, at_s + 400e-6)
    uno.set_mark(False, at_s + 0.0504)
    uno.run(0.2)
    state = uno.state()
    assert state.mark_count == 1
    assert firmware_s(uno, state.mark_t_us) == pytest.approx(at_s, abs=0.5e-3)


def test_r23_glitches_and_an_open_pin_give_no_marks(uno, new_uno):
    uno.run(0.05)
    for k in range(30):
        uno.set_mark(True, uno.t_s + 0.03 * k)
        uno.set_mark(False, uno.t_s + 0.03 * k + 0.9e-3)
    uno.run(1.0)
    assert uno.state().mark_count == 0
    second = new_uno()
    second.set_mark(True)
    second.power_cycle()
    second.run(0.5)
    assert second.state().mark_count == 0
    assert second.state().flags & StateFlag.ON_MARK


def test_r23_the_polarity_of_the_mark_sensor_is_configurable(uno):
    uno.set_mark(True)
    uno.store(wiring=Wiring.MARK_ACTIVE_LOW)
    before = uno.state().mark_count
    at_s = uno.t_s + 0.02
    uno.set_mark(False, at_s)
    uno.set_mark(True, at_s + 0.05)
    uno.run(0.1)
    state = uno.state()
    assert state.mark_count == before + 1
    assert firmware_s(uno, state.mark_t_us) == pytest.approx(at_s, abs=50e-6)


@pytest.mark.parametrize("ppm", [0, 2000, -5000])
def test_r24_pong_reveals_the_clock_error_of_the_resonator(new_uno, ppm):
    """Two pings are sent 2 s apart: the seconds of the firmware differ by exactly the clock error."""
    uno = new_uno(ppm=ppm)
    uno.run(0.05)
    clocks = []
    for token in (0xDEADBEEF, 1):
        uno.frames()
        sent_s = uno.send(Ping(token))
        pong = uno.next_frame(Pong)
        assert pong.token == token
        clocks.append((sent_s, pong.t_us * 1e-6))
        uno.run(2.0)
    (host, mcu), (host2, mcu2) = clocks
    assert (mcu2 - mcu) / (host2 - host) - 1 == pytest.approx(ppm * 1e-6, abs=150e-6)
    uno.hold(400, 400, 0.1)
    assert uno.moving
    assert uno.decoder.bad_crc == 0


@pytest.mark.parametrize("period_ms", [5, 10, 33, 250])
def test_r25_telemetry_has_the_configured_rate(uno, period_ms):
    uno.send(Config(telemetry_ms=period_ms))
    uno.run(0.6)
    uno.frames()
    before = len(uno.transcript)
    uno.run(20 * period_ms / 1000)
    uno.frames()
    states = [r.frame for _, r in uno.transcript[before:] if isinstance(r.frame, State)]
    gaps = [(b.t_us - a.t_us) / 1000 for a, b in itertools.pairwise(states)]
    assert len(gaps) >= 17
    assert all(gap == pytest.approx(period_ms, abs=1.0) for gap in gaps)


def test_r25_every_frame_is_intact_under_load(uno):
    """Commands and pings at 100 Hz, 10 000 edges a second on each wheel, requests for settings: no frame is lost."""
    uno.store(encoders=EncoderKind.QUADRATURE)
    zero = counts(uno)
    uno.arm()
    uno.frames()
    before, start = len(uno.transcript), uno.t_s
    uno.encoder(0, 10_000, start, start + 1.0)
    uno.encoder(1, 10_000, start, start + 1.0)
    pings = 0
    while uno.t_s < start + 1.0:
        uno.drive(500, 500)
        uno.send(Ping(pings))
        pings += 1
        uno.run(0.01)
    uno.run(0.05)
    uno.frames()
    frames = [r for _, r in uno.transcript[before:]]
    assert uno.decoder.bad_crc == uno.decoder.bad_shape == 0
    sequences = [r.seq for r in frames]
    assert all((b - a) % 256 == 1 for a, b in itertools.pairwise(sequences)), "one frame was lost"
    assert [r.frame.token for r in frames if isinstance(r.frame, Pong)] == list(range(pings))
    assert len([r for r in frames if isinstance(r.frame, State)]) >= 100
    info = uno.info()
    assert (info.bad_crc, info.bad_shape, info.old_sequence) == (0, 0, 0)
    assert uno.state().overruns == 0
    now = counts(uno)
    assert [now[k] - zero[k] for k in range(2)] == [10_000, 10_000]
