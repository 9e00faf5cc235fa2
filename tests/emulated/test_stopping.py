"""Every reason that turns the motors off, with its time, on the real firmware (R1, R2, R4, R5, R6)."""

import pytest

from baqueano.robot.uno.frames import Config, Drive, DriveFlag, Info, ResetCause, StateFlag, Stop

ARM, CLEAR = DriveFlag.ARM, DriveFlag.CLEAR_STOP


def test_r1_fw3_motors_are_off_from_the_first_instruction_and_stay_off(uno):
    uno.run(0.5)
    assert all(not out.terminal(k, uno.driver).duty for out in uno.outputs() for k in range(2))
    assert not uno.state().flags & StateFlag.ARMED


def test_r2_fw3_nothing_moves_before_it_is_armed_with_a_zero_command(uno):
    for _ in range(20):
        uno.drive(700, 700)
        uno.run(0.02)
    assert uno.first_time(lambda out: any(out.pwm)) is None
    assert uno.info().not_armed == 20
    uno.hold(700, 700, 0.1)
    assert uno.duty(0) == pytest.approx(0.7)


def test_r2_a_command_without_arm_disarms(uno):
    uno.hold(600, 600, 0.2)
    uno.run_until(uno.drive(600, 600, flags=0) + 2e-3)
    assert not uno.moving
    assert not uno.state().flags & StateFlag.ARMED
    uno.drive(600, 600)
    uno.run(0.1)
    assert not uno.moving


@pytest.mark.parametrize("slew", [1, 40, 1000])
@pytest.mark.parametrize("duty", [300, 1000])
def test_r4_fw1_motors_are_off_320_ms_after_the_last_command(uno, slew, duty):
    uno.send(Config(slew_permille_per_ms=1000))
    uno.hold(duty, -duty, 0.1)
    uno.run_until(uno.send(Config(slew_permille_per_ms=slew)))
    last = uno.drive(duty, -duty)
    uno.run_until(last + 0.298)
    assert uno.moving
    uno.run_until(last + 0.320)
    assert uno.off_since() - last <= 0.313
    state = uno.state()
    assert state.flags & StateFlag.DEAD_MAN
    assert state.drive_age_ms >= 320


@pytest.mark.parametrize("dead_man_ms", [50, 1000])
def test_r4_fw1_the_command_timeout_is_as_configured(uno, dead_man_ms):
    uno.send(Config(dead_man_ms=dead_man_ms))
    uno.hold(500, 500, 0.1)
    last = uno.drive(500, 500)
    uno.run_until(last + dead_man_ms / 1000 + 0.02)
    assert dead_man_ms - 2 <= 1000 * (uno.off_since() - last) <= dead_man_ms + 13


def test_r4_a_command_can_shorten_but_not_lengthen_its_timeout(uno):
    uno.hold(500, 500, 0.1)
    last = uno.drive(500, 500, ttl_10ms=8)
    uno.run_until(last + 0.1)
    assert 0.078 <= uno.off_since() - last <= 0.093
    uno.hold(500, 500, 0.1)
    last = uno.drive(500, 500, ttl_10ms=255)
    uno.run_until(last + 0.32)
    assert 0.298 <= uno.off_since() - last <= 0.313


def test_r4_a_new_command_after_the_timeout_is_executed(uno):
    uno.hold(500, 500, 0.1)
    uno.run(0.5)
    assert not uno.moving
    uno.drive(500, 500)
    uno.run(0.05)
    assert uno.duty(0) == pytest.approx(0.5)
    assert not uno.state().flags & StateFlag.DEAD_MAN


@pytest.mark.parametrize("pwm_hz", [50, 122, 123, 1000, 5000, 20_000])
def test_r5_rt15_stop_takes_3_ms_at_every_pwm_frequency(uno, pwm_hz):
    uno.send(Config(pwm_hz=pwm_hz, slew_permille_per_ms=1))
    uno.hold(900, -900, 1.0)
    assert uno.moving
    sent_s = uno.t_s
    uno.send(Stop())
    uno.run(0.003)
    assert uno.off_since() - sent_s <= 0.003
    assert uno.state().flags & StateFlag.STOPPED


def test_r5_stop_is_executed_with_any_sequence_number(uno):
    uno.hold(500, 500, 0.1)
    uno.send(Stop(), seq=uno.seq - 5)
    uno.run(0.003)
    assert not uno.moving


def test_r5_stop_is_latched_until_explicitly_cleared(uno):
    uno.hold(500, 500, 0.1)
    uno.run_until(uno.send(Stop()) + 2e-3)
    uno.forget_outputs()
    for left, flags in ((0, ARM), (500, ARM), (0, ARM | CLEAR), (500, CLEAR), (500, ARM | CLEAR)):
        uno.drive(left, left, flags)
        uno.run(0.01)
    uno.run(0.1)
    assert uno.state().flags & StateFlag.STOPPED
    assert uno.info().not_armed == 2
    assert uno.info().out_of_range == 3
    uno.drive(0, 0, CLEAR)
    uno.run(0.01)
    assert not uno.state().flags & (StateFlag.STOPPED | StateFlag.ARMED)
    uno.drive(500, 500)
    uno.run(0.1)
    assert uno.first_time(lambda out: any(out.pwm)) is None
    uno.hold(500, 500, 0.1)
    assert uno.moving


@pytest.mark.parametrize("interrupts", [True, False])
def test_r6_fw2_a_hang_turns_the_motors_off_within_150_ms(uno, interrupts):
    uno.hold(800, 800, 0.3)
    before = uno.info()
    hung = uno.t_s
    uno.hang(interrupts)
    uno.run(0.150)
    assert uno.resets == 1
    assert uno.off_since() - hung <= 0.150
    info = uno.next_frame(Info, 0.2) if not uno.frames() else uno.info()
    assert info.nonce != before.nonce
    assert info.reset_cause & ResetCause.WATCHDOG
    assert info.reset_cause & ResetCause.WARM
    assert bool(info.reset_cause & ResetCause.HUNG) == interrupts


def test_r6_a_hang_is_reported_without_the_watchdog_flag(uno):
    uno.hold(800, 800, 0.1)
    uno.hang()
    uno.run(0.110)
    uno.reset(ResetCause(0))
    uno.run(0.02)
    assert uno.info().reset_cause == ResetCause.WARM | ResetCause.HUNG


def test_r6_a_reset_by_the_host_is_not_a_hang(uno):
    uno.run(0.1)
    uno.reset(ResetCause.EXTERNAL)
    uno.run(0.02)
    assert uno.info().reset_cause == ResetCause.WARM | ResetCause.EXTERNAL
    uno.power_cycle()
    uno.run(0.02)
    assert uno.info().reset_cause == ResetCause.POWER


def test_r29_fw7_after_a_brown_out_old_commands_move_nothing(uno):
    uno.hold(800, 800, 0.2)
    old = uno.nonce()
    uno.reset(ResetCause.BROWN_OUT)
    assert not uno.moving
    uno.forget_outputs()
    for _ in range(30):
        uno.send(Drive(old, 800, 800, ARM))
        uno.run(0.01)
    assert uno.first_time(lambda out: any(out.pwm)) is None
    info = uno.info()
    assert 28 <= info.wrong_nonce <= 30  # the first bytes arrive before the receiver is enabled
    assert info.reset_cause & ResetCause.BROWN_OUT
    uno.frames()
    uno.hold(800, 800, 0.1)
    assert uno.duty(0) == pytest.approx(0.8)
