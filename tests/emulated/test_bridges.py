"""Three motor bridges on the same pins, each compared with its truth table, and reversed motor plugs (R13, R14)."""

import pytest

from baqueano.robot.uno.frames import MAX_PWM_HZ, Config, DriveFlag, Driver, Wiring

HOLD = DriveFlag.ARM | DriveFlag.BRAKE


@pytest.mark.parametrize("driver", list(Driver))
def test_r13_each_bridge_drives_in_both_directions_brakes_and_coasts(new_uno, driver):
    uno = new_uno(driver=driver)
    uno.store(driver=driver)
    for sign in (1, -1):
        uno.hold(700 * sign, -400 * sign, 0.1)
        assert uno.duty(0) == pytest.approx(0.7 * sign, abs=1e-3)
        assert uno.duty(1) == pytest.approx(-0.4 * sign, abs=1e-3)
        uno.drive(0, 0, HOLD)
        uno.run(0.04)
        assert [uno.output().terminal(k, driver).state for k in range(2)] == ["brake", "brake"]
        uno.drive(0, 0)
        uno.run(0.01)
        assert [uno.output().terminal(k, driver).state for k in range(2)] == ["coast", "coast"]
    uno.run(0.4)
    assert [uno.output().terminal(k, driver).state for k in range(2)] == ["coast", "coast"]
    assert not uno.output().standby


@pytest.mark.parametrize("driver", list(Driver))
def test_r13_full_and_zero_duty_are_exact(new_uno, driver):
    uno = new_uno(driver=driver)
    uno.store(driver=driver)
    uno.hold(1000, -1000, 0.1)
    assert (uno.duty(0), uno.duty(1)) == (1.0, -1.0)
    uno.hold(0, 0, 0.1)
    assert uno.output().pwm == (0.0, 0.0)


@pytest.mark.parametrize("driver", list(Driver))
def test_r13_a_pwm_frequency_above_the_limit_of_the_bridge_is_refused(new_uno, driver):
    uno = new_uno(driver=driver)
    uno.store(driver=driver)
    limit = MAX_PWM_HZ[driver]
    uno.send(Config(pwm_hz=limit))
    assert uno.info().config.pwm_hz == limit
    if limit < 25_000:
        uno.send(Config(pwm_hz=limit + 1))
        info = uno.info()
        assert info.config.pwm_hz == limit
        assert info.out_of_range == 1


def test_r13_a_slower_bridge_lowers_the_pwm_frequency(uno):
    uno.send(Config(pwm_hz=20_000))
    uno.store(driver=Driver.L293D)
    assert uno.info().config.pwm_hz == 5000


@pytest.mark.parametrize("pwm_hz", [50, 122, 123, 1000, 20_000])
def test_r13_pwm_has_the_configured_frequency(uno, pwm_hz):
    """Mode 8: f = 16 MHz / (2 · prescaler · ICR1)."""
    uno.run_until(uno.send(Config(pwm_hz=pwm_hz)) + 5e-3)
    top = int.from_bytes(uno.ram(0x86, 2), "little")
    prescaler = {1: 1, 2: 8}[uno.ram(0x81, 1)[0] & 7]
    assert 16e6 / (2 * prescaler * top) == pytest.approx(pwm_hz, rel=2e-3)


@pytest.mark.parametrize(
    ("wiring", "channels"),
    [
        (Wiring(0), (0.6, 0.3)),
        (Wiring.LEFT_MOTOR_REVERSED, (-0.6, 0.3)),
        (Wiring.RIGHT_MOTOR_REVERSED, (0.6, -0.3)),
        (Wiring.MOTORS_SWAPPED, (0.3, 0.6)),
        (Wiring.MOTORS_SWAPPED | Wiring.LEFT_MOTOR_REVERSED, (0.3, -0.6)),
    ],
)
def test_r14_swapped_or_reversed_motors_are_corrected(uno, wiring, channels):
    uno.store(wiring=wiring)
    uno.hold(600, 300, 0.1)
    assert (uno.duty(0), uno.duty(1)) == pytest.approx(channels, abs=1e-3)
    assert (uno.state().left_permille, uno.state().right_permille) == (600, 300)
