"""The push of a sloping floor is seen in the accelerometers, because it follows the heading."""

import numpy as np
import pytest

from baqueano.numerics.floor_push import AccelerometerResiduals, slope_speed_error

RATE_HZ, DECAY_RATE = 100.0, 5.0


def residuals(push_m_s2, seed=0, duration_s=60.0):
    """Return the residuals of a vehicle that turns left and right on a floor with this push, by Euler at 1 kHz."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(0.0, duration_s, 1e-3)
    yaw_rate = 2.0 * np.sin(0.7 * t_s) + 0.5
    psi = 0.3 + np.cumsum(yaw_rate) * 1e-3
    e, push = np.zeros(len(t_s)), push_m_s2 * np.array([0.6, -0.8])
    forward = push[0] * np.cos(psi) + push[1] * np.sin(psi)
    left = -push[0] * np.sin(psi) + push[1] * np.cos(psi)
    for k in range(1, len(t_s)):
        e[k] = e[k - 1] + 1e-3 * (forward[k - 1] - DECAY_RATE * e[k - 1])
    a = np.stack([-DECAY_RATE * e + 0.3, yaw_rate * e - left - 0.2], axis=1)[:: int(1000 / RATE_HZ)]
    return AccelerometerResiduals(
        t_s[:: int(1000 / RATE_HZ)],
        a + 0.15 * rng.standard_normal(a.shape),
        yaw_rate[:: int(1000 / RATE_HZ)] + 0.01,  # a bias of the gyro
    )


def test_the_error_of_the_speed_on_a_slope_is_found():
    expected = 0.17 / DECAY_RATE  # 1°
    assert slope_speed_error([residuals(0.17)], DECAY_RATE) == pytest.approx(expected, rel=0.1)


def test_a_level_floor_has_no_slope():
    errors = [slope_speed_error([residuals(0.0, seed)], DECAY_RATE) for seed in range(20)]
    assert np.max(errors) < 0.005
    assert np.mean(np.array(errors) == 0.0) >= 0.8


@pytest.mark.parametrize("duration_s", [0.0, 4.0, 15.0])
def test_a_short_run_does_not_decide(duration_s):
    assert (
        slope_speed_error([residuals(0.3, 0, 20.0)._replace(t_s=np.linspace(0.0, duration_s, 2000))], 5.0)
        == 0.0
    )


def test_a_vehicle_that_does_not_turn_does_not_show_a_slope():
    run = residuals(0.3)
    assert slope_speed_error([run._replace(yaw_rate=0.0 * run.yaw_rate)], DECAY_RATE) == 0.0
