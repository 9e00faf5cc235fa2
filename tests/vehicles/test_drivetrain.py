"""From the sent command to the effort: each effect separately, compared with its definition."""

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from baqueano.vehicles import Car, Drivetrain, Kinematic, Planar
from baqueano.vehicles.drivetrain import mix, unmix
from tests.codes import refused

QUICK = settings(max_examples=30)

commands = arrays(float, 3, elements=st.floats(-1.0, 1.0))


def efforts(drivetrain, u, dt_s=0.01):
    state, means = drivetrain.init(), []
    for row in u:
        state, effort = drivetrain.step(state, row, dt_s)
        means.append(effort.mean)
    return np.array(means)


@QUICK
@given(commands)
def test_an_ideal_drivetrain_passes_the_command_unchanged(u):
    assert np.array_equal(efforts(Drivetrain(), [u])[0], u)


@QUICK
@given(commands)
def test_unmixing_a_mixed_command_returns_the_command_without_u_y(u):
    assert unmix("two_wheels", mix("two_wheels", u)) == pytest.approx([u[0], 0.0, u[2]])
    assert unmix("none", mix("none", u)) is u
    d = Drivetrain(mixing="two_wheels")
    assert d.unmix(d.mix(u)) == pytest.approx([u[0], 0.0, u[2]])


@QUICK
@given(arrays(float, 2, elements=st.floats(-1.0, 1.0)))
def test_mixing_inverts_unmixing(w):
    assert mix("two_wheels", unmix("two_wheels", w)) == pytest.approx(w)


def test_a_left_turn_drives_the_right_wheel_forward():
    left, right = mix("two_wheels", np.array([0.0, 0.0, 0.3]))
    assert (left, right) == (-0.3, 0.3)


def test_a_saturated_wheel_reduces_the_turning_effort():
    d = Drivetrain(mixing="two_wheels", limit=np.array([1.0, 1.0]))
    # wheels 0.2 and 1, not 1.4
    assert efforts(d, [np.array([0.8, 0.0, 0.6])])[0] == pytest.approx([0.6, 0.0, 0.4])


def test_a_dead_zone_is_subtracted_in_each_direction():
    d = Drivetrain(
        commands=2, dead_zone_forward=np.array([0.1, 0.2]), dead_zone_backward=np.array([0.3, 0.4])
    )
    assert efforts(d, [np.array([0.5, 0.5])])[0] == pytest.approx([0.4, 0.3])
    assert efforts(d, [np.array([-0.5, -0.5])])[0] == pytest.approx([-0.2, -0.1])
    assert efforts(d, [np.array([0.1, -0.4])])[0] == pytest.approx([0.0, 0.0])
    assert efforts(d, [np.array([-0.3, 0.2])])[0] == pytest.approx([0.0, 0.0])


@QUICK
@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_a_larger_command_never_gives_a_smaller_effort(a, b):
    d = Drivetrain(commands=1, dead_zone_forward=np.array([0.2]), dead_zone_backward=np.array([0.3]), sag=0.4)
    low, high = efforts(d, [np.array([min(a, b)])])[0], efforts(d, [np.array([max(a, b)])])[0]
    assert low <= high


def test_unequal_motors_turn_the_vehicle_under_a_straight_command():
    d = Drivetrain(mixing="two_wheels", gain=np.array([0.9, 1.1]))
    assert efforts(d, [np.array([0.5, 0.0, 0.0])])[0] == pytest.approx([0.5, 0.0, 0.05])


def test_a_low_battery_scales_the_effort_and_sags_under_load():
    half = Drivetrain(battery_v=3.0, battery_nominal_v=6.0)
    assert efforts(half, [np.array([0.6, 0.0, -0.6])])[0] == pytest.approx([0.3, 0.0, -0.3])
    sagging = Drivetrain(mixing="two_wheels", sag=0.2)
    assert efforts(sagging, [np.array([1.0, 0.0, 0.0])])[0] == pytest.approx([0.8, 0.0, 0.0])
    assert efforts(sagging, [np.array([0.5, 0.0, 0.0])])[0] == pytest.approx([0.45, 0.0, 0.0])


def test_the_battery_effect_scales_the_influence_of_the_voltage():
    for effect, effort in ((0.0, 0.6), (0.5, 0.45), (1.0, 0.3)):
        half = Drivetrain(battery_v=3.0, battery_nominal_v=6.0, battery_effect=effect)
        assert efforts(half, [np.array([0.6, 0.0, 0.0])])[0] == pytest.approx([effort, 0.0, 0.0])


@pytest.mark.parametrize("ticks", [1, 3])
def test_a_delay_of_whole_ticks_shifts_the_command(ticks):
    u = np.random.default_rng(1).normal(size=(20, 3))
    effort_means = efforts(Drivetrain(delay_s=0.01 * ticks, delay_slots=3), u)
    assert effort_means[ticks:] == pytest.approx(u[:-ticks], abs=1e-12)
    assert effort_means[:ticks] == pytest.approx(np.zeros((ticks, 3)))


def test_a_fractional_delay_averages_the_command_over_the_tick():
    """With 13 ms of delay and ticks of 10 ms: 3 ms of the tick before the last, 7 ms of the last tick."""
    effort_means = efforts(
        Drivetrain(delay_s=0.013, delay_slots=2), np.array([[1.0, 0, 0], [2.0, 0, 0], [5.0, 0, 0]])
    )
    assert effort_means[:, 0] == pytest.approx([0.0, 0.7, 0.3 * 1.0 + 0.7 * 2.0])


def test_a_delay_preserves_the_total_impulse():
    u = np.vstack([np.random.default_rng(2).normal(size=(20, 3)), np.zeros((4, 3))])
    for delay_s in (0.004, 0.01, 0.0277):
        assert efforts(Drivetrain(delay_s=delay_s, delay_slots=3), u).sum(0) == pytest.approx(u.sum(0))


def test_the_delay_is_limited_by_the_number_of_stored_commands():
    u = np.random.default_rng(3).normal(size=(9, 3))
    assert efforts(Drivetrain(delay_s=0.5, delay_slots=2), u)[2:] == pytest.approx(u[:-2])


def test_a_lag_reaches_63_percent_after_its_time_constant():
    d = Drivetrain(lag_s=0.05)
    state = d.init()
    for _ in range(5):
        state, _ = d.step(state, np.array([1.0, 0.0, 0.0]), 0.01)
    assert state.lag_state[0] == pytest.approx(1.0 - np.exp(-1.0), abs=1e-14)


@QUICK
@given(st.floats(1e-3, 1.0), st.floats(1e-4, 0.1), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_a_lag_over_one_tick_equals_the_lag_over_two_half_ticks(lag_s, dt_s, start, target):
    d = Drivetrain(commands=1, lag_s=lag_s)
    state, u = d.init()._replace(lag_state=np.array([start])), np.array([target])
    once, one_step = d.step(state, u, 2.0 * dt_s)
    half, first = d.step(state, u, dt_s)
    twice, second = d.step(half, u, dt_s)
    assert twice.lag_state == pytest.approx(once.lag_state, abs=1e-12)
    assert 0.5 * (first.mean + second.mean) == pytest.approx(one_step.mean, abs=1e-10)


def test_the_mean_effort_of_a_tick_integrates_the_lag_response():
    lag_s, dt_s = 0.03, 0.01
    _, effort = Drivetrain(commands=1, lag_s=lag_s).step(Drivetrain(commands=1).init(), np.array([1.0]), dt_s)
    t = (np.arange(2000) + 0.5) * dt_s / 2000
    assert effort.mean[0] == pytest.approx(np.mean(1.0 - np.exp(-t / lag_s)), rel=1e-6)


def test_a_tick_of_zero_duration_does_not_change_the_lag():
    d = Drivetrain(mixing="two_wheels", lag_s=0.05, delay_s=0.01, delay_slots=1)
    state, _ = d.step(d.init(), np.array([1.0, 0.0, 0.0]), 0.01)
    after, effort = d.step(state, np.array([1.0, 0.0, 0.0]), 0.0)
    assert after.lag_state == pytest.approx(state.lag_state, abs=1e-6)
    assert np.all(np.isfinite(effort))


ERRORS = [
    (
        "drivetrain.battery",
        {"value": "'full'", "valid": "steady, logged"},
        lambda: Drivetrain(battery="full"),
    ),
    (
        "drivetrain.mixing",
        {"value": "'three_wheels'", "valid": "none, two_wheels"},
        lambda: Drivetrain(mixing="three_wheels"),
    ),
    ("drivetrain.commands", {"commands": 2}, lambda: Drivetrain(mixing="two_wheels", commands=2)),
    ("delay.no-slots", {"delay_s": 0.02, "slots": 2}, lambda: Drivetrain(delay_s=0.02)),
    ("delay.slots", {"value": "-1"}, lambda: Drivetrain(delay_slots=-1)),
    (
        "drivetrain.shape",
        {"name": "gain", "value": "(3,)", "channels": 2, "commands": 3},
        lambda: Drivetrain(mixing="two_wheels", gain=np.ones(3)),
    ),
    ("drivetrain.lag", {}, lambda: Drivetrain(has_lag=True)),
    (
        "field.range",
        {"field": "Drivetrain.sag", "value": "1.5", "low": 0.0, "high": 0.9, "unit_name": "1"},
        lambda: Drivetrain(sag=1.5),
    ),
    (
        "vehicle.commands",
        {"model": "Planar", "commands": 3, "rows": 2},
        lambda: Planar(1.0, 1.0, np.eye(3), drivetrain=Drivetrain(commands=2)),
    ),
    (
        "vehicle.commands",
        {"model": "Kinematic", "commands": 3, "rows": 2},
        lambda: Kinematic(np.eye(3), drivetrain=Drivetrain(commands=2)),
    ),
    (
        "vehicle.commands",
        {"model": "Car", "commands": 2, "rows": 3},
        lambda: Car(0.15, 4.0, 0.3, drivetrain=Drivetrain()),
    ),
]


@pytest.mark.parametrize(("code", "figures", "make"), ERRORS)
def test_impossible_drivetrain_parameters_are_refused(code, figures, make):
    with refused(code, ValueError, **figures):
        make()


def test_a_drivetrain_has_a_lag_only_if_the_lag_is_positive():
    assert Drivetrain(lag_s=0.05).has_lag
    assert not Drivetrain().has_lag


@QUICK
@given(
    arrays(float, 2, elements=st.floats(0.03, 0.6)),
    arrays(float, 2, elements=st.sampled_from([-1.0, 1.0])),
    st.floats(0.0, 1.0),
    st.floats(0.0, 0.3),
    st.floats(6.5, 8.4),
)
def test_the_inverse_drivetrain_returns_the_command_for_an_effort(size, sign, coast, sag, battery_v):
    drivetrain = Drivetrain(
        mixing="two_wheels",
        gain=np.array([1.1, 0.9]),
        dead_zone_forward=np.array([0.3, 0.25]),
        dead_zone_backward=np.array([0.2, 0.35]),
        coast=np.array([coast]),
        sag=sag,
        battery_v=battery_v,
        battery_nominal_v=7.4,
    )
    effort = drivetrain.unmix(size * sign)
    wheels = drivetrain.mix(drivetrain.inverse(effort))
    assume(np.abs(wheels).max() < 1.0)  # a low battery does not reach each effort
    np.testing.assert_allclose(drivetrain.unmix(drivetrain.static_response(wheels)), effort, atol=1e-9)


def test_the_inverse_drivetrain_is_continuous_at_zero():
    drivetrain = Drivetrain(commands=1, dead_zone_forward=np.array([0.3]), dead_zone_backward=np.array([0.3]))
    commands = [drivetrain.inverse(np.array([e]))[0] for e in (-1e-6, 0.0, 1e-6)]
    np.testing.assert_allclose(commands, [-1.6e-5, 0.0, 1.6e-5], atol=1e-7)


def test_the_battery_voltage_affects_motors_and_no_servo():
    car = Car(0.2, 5.0, 0.4, drivetrain=Drivetrain(commands=2, battery_v=5.0, battery_nominal_v=10.0))
    assert car.drivetrain.servos == 1
    np.testing.assert_allclose(car.drivetrain.static_response(np.array([0.4, 0.4])), [0.2, 0.4])
    np.testing.assert_allclose(car.drivetrain.inverse(np.array([0.2, 0.4])), [0.4, 0.4])


def test_the_lag_of_a_motor_does_not_delay_a_servo():
    dt_s, u = 0.01, np.array([0.4, 0.4])
    car = Car(0.2, 5.0, 0.4, drivetrain=Drivetrain(commands=2, lag_s=0.08, delay_s=0.004, delay_slots=1))
    state, effort = car.drivetrain.step(car.drivetrain.init(), u, dt_s)
    np.testing.assert_allclose(effort.last, [0.4 * (1.0 - np.exp(-0.006 / 0.08)), 0.4])
    assert effort.mean[1] == pytest.approx(0.6 * 0.4)  # 6 of 10 ms
    _, effort = car.drivetrain.step(state, 0.0 * u, dt_s)
    np.testing.assert_allclose(effort.last[1], 0.0, atol=1e-12)


def test_a_time_constant_beyond_floating_point_range_is_refused():
    with refused("drivetrain.lag-tiny"):
        Drivetrain(lag_s=5e-324)
    assert Drivetrain(lag_s=1e-3).has_lag
