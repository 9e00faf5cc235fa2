"""From a command to the duty at the pins: latency, slew, reversal, dead zone, kick, dither, telemetry (R3, R7-R12)."""

import bisect
import itertools
import random

import pytest

from baqueano.robot.uno.frames import Config, DriveFlag, State, StateFlag, WheelCurve


def duties(uno, after_s=0.0):
    """Return (time, left, right) at each change of the pins, in per mille."""
    return [
        (out.t_s, *(1000 * out.terminal(k, uno.driver).duty for k in range(2)))
        for out in uno.outputs()
        if out.t_s >= after_s
    ]


def test_r3_a_command_changes_the_pins_within_5_ms(uno):
    """Worst case over the phase of the tick and of telemetry, measured from the first byte at the host."""
    chance = random.Random(1)
    uno.arm()
    took = []
    for n in range(200):
        uno.run(chance.uniform(0.01, 0.03))
        uno.forget_outputs()
        sent_s = uno.t_s
        uno.drive(200 + 50 * (n % 2), 0)
        uno.run(0.006)
        took.append(duties(uno, sent_s)[0][0] - sent_s)
    took.sort()
    assert took[197] <= 0.005, f"p99 {took[197] * 1e3:.2f} ms"
    assert took[-1] <= 0.005


@pytest.mark.parametrize("slew", [1, 7, 40, 250])
def test_r7_fw4_the_duty_follows_the_command_at_the_configured_slew(uno, slew):
    uno.run_until(uno.send(Config(slew_permille_per_ms=slew)))
    uno.arm()
    sent_s = uno.drive(600, -600)
    for _ in range(round(650 / slew / 20) + 2):
        uno.run(0.02)
        uno.drive(600, -600)
    steps = [row for row in duties(uno, sent_s - 1e-3) if row[1] or row[2]]
    left = [row[1] for row in steps if row[1]]
    rises = [b - a for a, b in zip([0.0, *left], left, strict=False)]
    assert max(rises) <= slew + 1, "the timer has a resolution of 1 / 1600"
    assert left[-1] == pytest.approx(600, abs=1)
    full = next(row[0] for row in steps if row[1] > 599)
    assert full - steps[0][0] == pytest.approx((600 / slew - 1) * 1e-3, abs=1.1e-3)


@pytest.mark.parametrize("pwm_hz", [50, 5000])
def test_r8_a_reversal_pauses_at_zero(uno, pwm_hz):
    uno.run_until(uno.send(Config(pwm_hz=pwm_hz, slew_permille_per_ms=1000)))
    uno.hold(900, 900, 0.1)
    uno.forget_outputs()
    for _ in range(5):
        uno.drive(-900, -900)
        uno.run(0.02)
    rows = uno.outputs()
    for before, after in itertools.pairwise(rows):
        for k in range(2):
            assert before.inputs[k] == after.inputs[k] or not (before.pwm[k] and after.pwm[k])
    stop_s = next(out.t_s for out in rows if not out.pwm[0])
    start_s = next(out.t_s for out in rows if out.t_s > stop_s and out.pwm[0])
    assert start_s - stop_s >= 2e-3 + 1 / pwm_hz - 1e-4
    assert uno.duty(0) == pytest.approx(-0.9, abs=1e-3)


WAYS = (WheelCurve(100, 500), WheelCurve(200, 700), WheelCurve(50, 1500), WheelCurve(0, 300))


@pytest.mark.parametrize(
    ("request_", "duty"), [((400, 400), (300, 650)), ((-400, -400), (-480, -120)), ((1, -1), (100, 0))]
)
def test_r9_dead_zone_and_slope_are_per_wheel_and_direction(uno, request_, duty):
    """By hand: 100 + 0.5·400 = 300; 50 + 1.5·400 = 650; 200 + 0.7·400 = 480; 0.3·400 = 120."""
    uno.store(curves=WAYS)
    uno.hold(*request_, 0.1)
    state = uno.state()
    assert (state.left_permille, state.right_permille) == duty
    for wheel in range(2):
        assert 1000 * uno.duty(wheel) == pytest.approx(duty[wheel], abs=1)


def test_r9_a_duty_above_full_is_saturated_and_flagged(uno):
    uno.store(curves=WAYS)
    uno.hold(0, 900, 0.1)
    assert uno.duty(1) == 1.0
    assert uno.state().flags & StateFlag.SATURATED
    uno.hold(0, 300, 0.1)
    uno.state()
    assert not uno.state().flags & StateFlag.SATURATED


def test_r10_a_starting_wheel_gets_a_kick_of_the_set_duration(uno):
    uno.store(
        kick_ms=15,
        curves=(
            WheelCurve(0, 1000, 700),
            WheelCurve(0, 1000, 400),
            WheelCurve(0, 1000, 0),
            WheelCurve(0, 1000, 150),
        ),
    )
    uno.run_until(uno.send(Config(slew_permille_per_ms=1000)))
    for sign, kicks in ((1, (700, 200)), (-1, (-400, -200))):
        uno.arm()
        uno.run(0.02)
        uno.forget_outputs()
        sent_s = uno.t_s
        uno.drive(200 * sign, 200 * sign)
        uno.run(0.05)
        rows = [row for row in duties(uno, sent_s) if row[1]]
        assert rows[0][1] == pytest.approx(kicks[0], abs=1)
        end_s = next(row[0] for row in rows if abs(row[1]) < 201)
        assert end_s - rows[0][0] == pytest.approx(0.015, abs=2e-4)
        assert {round(row[2]) for row in rows if row[2]} == {kicks[1]}, "a kick must exceed the duty"
        uno.drive(0, 0)
        uno.run(0.05)


def test_r11_dither_is_a_square_wave_around_nonzero_duty(uno):
    uno.store(dither_permille=60, dither_ms=4)
    uno.run_until(uno.send(Config(slew_permille_per_ms=1000)))
    uno.arm()
    uno.drive(300, 20)
    uno.run(0.02)
    uno.forget_outputs()
    start = uno.t_s
    uno.drive(300, 20)
    uno.run(0.2)
    rows = duties(uno, start)
    assert {round(row[1]) for row in rows} == {240, 360}
    assert {round(row[2]) for row in rows} == {0, 80}, "the duty must not cross zero"
    changes = [b[0] for a, b in itertools.pairwise(rows) if round(a[1]) != round(b[1])]
    gaps = [b - a for a, b in itertools.pairwise(changes)]
    assert gaps
    assert all(gap == pytest.approx(4e-3, abs=2e-4) for gap in gaps)
    uno.drive(0, 0)
    uno.run(0.02)
    uno.forget_outputs()
    uno.drive(0, 0)
    uno.run(0.05)
    assert not any(row[1] or row[2] for row in duties(uno, uno.t_s - 0.05))


def sums_of(rows):
    """Return the times and the integrals of left and right duty at the pins until these times."""
    times, sums = [rows[0][0]], [(0.0, 0.0)]
    for row, after in itertools.pairwise(rows):
        dt = after[0] - row[0]
        times.append(after[0])
        sums.append((sums[-1][0] + row[1] * dt, sums[-1][1] + row[2] * dt))
    return times, sums


def test_r12_telemetry_contains_the_duty_at_the_pins_and_its_sum(uno):
    """Random commands through slew, dead zone, kick and dither: telemetry reports the duty at the pins."""
    uno.store(kick_ms=12, dither_permille=40, dither_ms=3, curves=(WheelCurve(120, 800, 600),) * 4)
    chance = random.Random(2)
    uno.arm()
    uno.frames()
    uno.forget_outputs()
    first = len(uno.transcript)
    for _ in range(100):
        uno.drive(chance.randint(-1000, 1000), chance.randint(-1000, 1000))
        uno.run(chance.uniform(0.005, 0.04))
    uno.frames()
    states = [r.frame for _, r in uno.transcript[first:] if isinstance(r.frame, State)]
    rows = duties(uno)
    assert len(states) > 150
    times, sums = sums_of(rows)

    def row_at(t_s):
        """Return duty and integral of the pins at this time."""
        k = bisect.bisect_right(times, t_s) - 1
        return rows[k][1:], [sums[k][c] + rows[k][1 + c] * (t_s - times[k]) for c in range(2)]

    for state in states[1:-1]:
        duty, _ = row_at(state.t_us * 1e-6 + uno.clock_began_s)
        assert (state.left_permille, state.right_permille) == pytest.approx(duty, abs=1.0)
    for first_state, two in zip(states[1:], states[40:], strict=False):
        start, end = (s.t_us * 1e-6 + uno.clock_began_s for s in (first_state, two))
        before, after = row_at(start)[1], row_at(end)[1]
        for column, name in enumerate(("left_sum", "right_sum")):
            mean = (getattr(two, name) - getattr(first_state, name)) / ((end - start) * 1e3)
            assert mean == pytest.approx((after[column] - before[column]) / (end - start), abs=8.0)


def test_r12_telemetry_contains_number_and_age_of_the_last_executed_command(uno):
    uno.hold(300, 300, 0.1)
    uno.drive(301, 301)
    uno.run(0.1)
    state = uno.state()
    assert state.drive_seq == uno.seq
    assert state.drive_age_ms == pytest.approx(100, abs=15)


def test_a_new_pwm_frequency_while_driving_restores_the_duty(uno):
    uno.hold(500, -500, 0.1)
    uno.send(Config(pwm_hz=500))
    for _ in range(5):
        uno.run(0.02)
        uno.drive(500, -500)
    assert (uno.duty(0), uno.duty(1)) == pytest.approx((0.5, -0.5), abs=1e-3)


def test_braking_lasts_from_the_command_until_the_timeout(uno):
    uno.hold(500, 500, 0.1)
    uno.drive(0, 0, DriveFlag.ARM | DriveFlag.BRAKE)
    uno.run(0.05)
    assert uno.output().terminal(0, uno.driver).state == "brake"
    uno.run(0.4)
    assert uno.output().terminal(0, uno.driver).state == "coast", "the command timeout ends the braking"
