"""The firmware behind the boot-loader of the Uno, which runs in the emulator; test_flash_verb.py writes it (R28)."""

from baqueano.robot.uno.frames import Info, ResetCause


def test_r6_a_hang_is_reported_although_the_boot_loader_clears_the_cause(new_uno, optiboot):
    """Optiboot of the Uno clears MCUSR; the count of ticks in RAM, which it preserves, shows the hang."""
    uno = new_uno(boot_loader=optiboot)
    first = uno.next_frame(Info, 3.0)
    assert not first.reset_cause & (ResetCause.HUNG | ResetCause.WATCHDOG)
    uno.hold(700, 700, 0.2)
    hung = uno.t_s
    uno.hang()
    uno.run(0.15)
    assert uno.off_since() - hung <= 0.15
    after = uno.info()
    assert after.reset_cause == ResetCause.WARM | ResetCause.HUNG
    assert after.nonce != first.nonce


def test_r1_motors_are_off_while_the_boot_loader_runs(new_uno, optiboot):
    uno = new_uno(boot_loader=optiboot)
    uno.next_frame(Info, 3.0)
    uno.hold(700, 700, 0.2)
    uno.reset()
    reset = uno.t_s
    uno.next_frame(Info, 3.0)
    assert uno.t_s - reset > 0.5, "the second that it waits for a programmer"
    assert uno.first_time(lambda out: any(out.pwm), after_s=reset + 1e-6) is None
