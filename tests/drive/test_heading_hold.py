"""Straight driving by the gyro: the gains, the remaining error, and the conditions that disable the control."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.controllers.heading_hold import (
    BANDWIDTH_MARGIN,
    MAX_TURN_SHARE,
    Gyro,
    HeadingHold,
    pole_placement_gains,
)
from baqueano.drive import replay
from baqueano.drive.manual.heading_gains import LINK_DELAY_S, heading_hold_gains, with_heading_hold
from baqueano.drive.mission import Mission, perform
from baqueano.drive.tasks import drive_with_driver
from baqueano.signals import Command, Estimate, Reference
from baqueano.vehicle_file import override
from tests.drive.straight import as_fitted, body, hand_for, random_vehicle, straight

TICK_NS = 10_000_000
GAINS = pole_placement_gains(6.0, 0.1, 0.1)


class FixedCommand:
    """A driver whose command the test sets."""

    u = (0.5, 0.0, 0.0)

    def init(self):
        return None

    def step(self, state, reference, estimate):
        return None, Command(estimate.t_ns, np.array(self.u))


class Drive:
    """Heading control that receives one estimate at each tick."""

    def __init__(self, **options):
        self.hand, self.k = FixedCommand(), 0
        self.hold = HeadingHold(self.hand, GAINS, 1.0, **options)
        self.state = self.hold.init()

    def tick(self, u=None, psi=0.0, r=0.0, v=0.3, innovation=None):
        self.hand.u = self.hand.u if u is None else u
        correction = (None, None) if innovation is None else (np.array(innovation), 1e-4 * np.eye(3))
        estimate = Estimate(
            self.k * TICK_NS, np.array([0.0, 0.0, psi]), np.array([v, 0.0, r]), np.eye(6), *correction
        )
        reference = Reference(estimate.t_ns, estimate.eta, np.zeros(3), 0.0)
        self.k += 1
        self.state, command = self.hold.step(self.state, reference, estimate)
        return command.u


@pytest.mark.parametrize("tau_s", [0.01, 0.1, 0.5, 2.0])
def test_the_closed_loop_has_the_placed_poles_and_nonnegative_gains(tau_s):
    k, late_s = 6.0, 0.1
    gains, omega = pole_placement_gains(k, tau_s, late_s), 1.0 / (BANDWIDTH_MARGIN * late_s)
    poles = np.roots([tau_s, 1.0 + k * gains.rate, k * gains.psi, k * gains.integral])
    third = max(omega, 1.0 / tau_s - 2.0 * omega)
    np.testing.assert_allclose(np.sort(-poles.real), np.sort([omega, omega, third]), rtol=1e-3)
    assert min(gains[:3]) >= 0.0


@pytest.mark.parametrize("tau_s", [0.0, 0.03, 0.1, 0.3, 0.5, 1.6, 5.0])
@pytest.mark.parametrize("late_s", [0.03, 0.1, 0.3])
def test_the_gain_margin_tolerates_a_yaw_gain_three_times_larger(tau_s, late_s):
    gains = pole_placement_gains(1.0, tau_s, late_s)
    s = 1j * np.logspace(-2, 4, 60000)
    loop = np.exp(-s * late_s) / (tau_s * s + 1.0) / s * (gains.psi + gains.integral / s + gains.rate * s)
    phase = np.unwrap(np.angle(loop))
    crossings = np.flatnonzero((phase[:-1] + np.pi) * (phase[1:] + np.pi) < 0.0)
    margins = 1.0 / np.abs(loop[crossings])
    assert margins.min() > 3.3, "a larger gain; all of T taken as a pure delay"
    assert np.all(margins > 1.0), "no smaller gain makes the loop unstable"


def test_controller_gains_follow_from_the_yaw_gain_and_time_of_the_model():
    small = vehicle_file.load("small")
    values = {
        "model.friction.coulomb": [0.0, 0.0, 0.0], "model.friction.quadratic": [0.0, 0.0, 0.0],
        "model.drivetrain.gain": [0.9, 0.9],
    }  # fmt: skip
    file = as_fitted(small.with_values(values))
    late_s = 0.06 + 0.01 + 0.015 + LINK_DELAY_S
    np.testing.assert_allclose(
        heading_hold_gains(file)[:4],
        pole_placement_gains(0.9 * 0.203 / 0.0115, 0.001494 / 0.0115, late_s)[:4],
        rtol=0.05,
    )
    np.testing.assert_allclose(
        heading_hold_gains(file)[0], 2.0 * heading_hold_gains(small.with_values(values))[0], rtol=1e-9
    )


def test_the_yaw_gain_of_a_car_depends_on_its_speed():
    file = vehicle_file.load("car").with_values({"model.drivetrain.lag_s": 0.1})  # of its motor
    file = as_fitted(file, "model.steering_gain")
    gains, car = heading_hold_gains(file), file.vehicle
    k = gains.speed_m_s * car.steering_gain / car.wheelbase_m
    late_s = car.drivetrain.delay_s + 1.5 / file.rate_hz + LINK_DELAY_S
    np.testing.assert_allclose(gains[:4], pole_placement_gains(k, car.yaw_lag_s, late_s)[:4], rtol=0.05)


@pytest.mark.parametrize("name", ["no gyro", "no turn"])
def test_heading_control_is_inactive_without_turning_or_gyro(name):
    small, hand = vehicle_file.load("small"), FixedCommand()
    if name == "no turn":
        assert with_heading_hold(hand, override(small, ("command.limit=[1.0,0.0,0.0]",))) is hand
    else:
        assert with_heading_hold(hand, replace(small, sensors=type("Sensors", (), {"_fields": ()})())) is hand


VEHICLES = {
    "small": (lambda: vehicle_file.load("small"), 0.5, 0.125),
    "small, full speed": (lambda: vehicle_file.load("small"), 1.0, 0.5),
    "case-study-1": (lambda: vehicle_file.load("case-study-1"), 10.0, 0.9),
    "random 1": (lambda: random_vehicle(1), 0.5, 0.25),
    "random 2": (lambda: random_vehicle(2), 0.5, 0.25),
}
EACH_VEHICLE = [
    pytest.param(name, marks=[pytest.mark.long] if name.startswith("random") else []) for name in VEHICLES
]


@pytest.mark.parametrize("yaw_gain", [1.0, 2.0, 0.5])
@pytest.mark.parametrize("name", EACH_VEHICLE)
def test_heading_control_drives_straight_with_wheels_differing_by_15_percent(name, yaw_gain):
    """One fitted file has the correct yaw gain; in the others the yaw gain is twice or half the true value."""
    kind, speed, speed_m_s = VEHICLES[name]
    file = as_fitted(kind())
    truth = body(file, yaw_gain)
    free, holding = (straight(file, truth, speed, speed_m_s, hold) for hold in (False, True))
    print(f"{name}, yaw gain {yaw_gain}: free {free.text()}; held {holding.text()}")
    assert abs(holding.psi_deg) < 2.5
    assert holding.most_deg < 6.5
    assert abs(holding.beside_m) < 0.2
    assert abs(free.psi_deg) > 5.0 * abs(holding.psi_deg)
    limit = MAX_TURN_SHARE * file.command.limit[2]
    assert np.all(np.abs(holding.run.applied_commands[:, 2]) <= limit)
    turn = np.convolve(
        holding.run.applied_commands[len(holding.run.t_s) // 2 :, 2], np.full(30, 1.0 / 30.0), "valid"
    )
    assert np.ptp(turn) < 0.05 * file.command.limit[2], "the heading must not oscillate"


@pytest.mark.parametrize("yaw_gain", [1.0, 2.0])
@pytest.mark.parametrize("name", EACH_VEHICLE)
def test_heading_control_works_with_an_unfitted_model(name, yaw_gain):
    kind, speed, speed_m_s = VEHICLES[name]
    file = kind()
    holding = straight(file, body(file, yaw_gain), speed, speed_m_s, True)
    print(f"{name}, yaw gain {yaw_gain}, not fitted: {holding.text()}")
    assert abs(holding.psi_deg) < 5.0
    assert holding.most_deg < 12.0
    assert abs(holding.beside_m) < 0.3


def test_heading_control_works_backwards():
    file = as_fitted(vehicle_file.load("small"))
    holding = straight(file, body(file), -0.5, 0.1, True)
    assert abs(holding.psi_deg) < 1.5
    assert abs(holding.beside_m) < 0.1


@pytest.mark.parametrize("speed", [0.5, -0.5])
def test_a_car_with_a_steering_offset_drives_straight_both_ways(speed):
    file = as_fitted(vehicle_file.load("car"), "model.steering_gain")
    truth = override(file, ("model.steering_offset_rad=0.035",))
    free, holding = (
        straight(file, truth, speed * file.command.limit[0], 1.0, hold) for hold in (False, True)
    )
    print(f"car: free {free.text()}; held {holding.text()}")
    assert abs(free.psi_deg) > 60.0
    assert abs(holding.psi_deg) < 4.0
    assert abs(holding.beside_m) < 0.5


def test_applied_commands_are_recorded_and_a_replay_is_identical():
    file = vehicle_file.load("small")
    run = straight(file, body(file), 1.0, 0.5, True).run
    assert np.any(run.requested_commands[:, 2] != 0.0)
    np.testing.assert_array_equal(run.applied_commands[1:], run.sent_commands[:-1])
    replayed_run = replay(run, file)
    assert np.array_equal(replayed_run.requested_commands, run.requested_commands)
    assert np.array_equal(replayed_run.estimate.eta, run.estimate.eta)


def test_a_commanded_turn_disables_heading_control_at_once():
    drive = Drive()
    for _ in range(50):
        assert drive.tick(psi=0.1 * (drive.k > 0))[2] <= 0.0
    assert drive.tick(psi=0.1)[2] < 0.0
    assert drive.tick((0.5, 0.0, 0.2), psi=0.1).tolist() == [0.5, 0.0, 0.2]
    assert drive.state.integral == 0.0


@pytest.mark.parametrize("u", [(0.0, 0.0, 0.0), (-0.5, 0.0, 0.0)])
def test_heading_control_resets_at_rest_and_on_reversal(u):
    drive = Drive()
    drive.tick()
    for _ in range(50):
        drive.tick(psi=0.1)
    assert drive.tick(u, psi=0.1).tolist() == list(u)
    assert drive.tick((0.5, 0.0, 0.0), psi=0.1)[2] == 0.0, "the present heading is the reference"


def test_the_reference_heading_is_set_after_the_turn_has_decayed():
    drive = Drive()
    drive.tick((0.5, 0.0, 0.5), r=1.0)
    psi, r = 1.0, 1.0
    while r > 0.06:
        psi, r = psi + 0.01 * r, 0.9 * r
        turn = drive.tick((0.5, 0.0, 0.0), psi=psi, r=r)[2]
        assert turn == pytest.approx(-GAINS.rate * r)
    drive.tick(psi=psi, r=0.04)
    assert drive.state.psi == psi
    assert drive.tick(psi=psi - 0.1)[2] > 0.0


def test_the_reference_heading_is_set_after_a_timeout():
    drive = Drive()
    while np.isnan(drive.state.psi):
        drive.tick(psi=0.01 * drive.k, r=1.0)
        assert drive.k < 1000
    assert drive.k * 0.01 == pytest.approx(GAINS.wait_s, abs=0.03)


def test_heading_control_is_limited_with_anti_windup():
    drive = Drive(speed_scale=0.3)
    drive.tick()
    turns = [drive.tick(psi=-2.0)[2] for _ in range(500)]
    assert max(turns) == pytest.approx(0.15), "0.3 of 0.5 ahead"
    assert Drive().hold.limit * MAX_TURN_SHARE == 0.25
    outputs = [drive.tick(psi=0.3)[2] for _ in range(200)]
    assert outputs[0] < 0.0, "the integrator must not wind up"


def test_heading_control_works_across_pi():
    drive = Drive()
    drive.tick(psi=np.pi - 0.01)
    assert drive.tick(psi=-np.pi + 0.01)[2] == pytest.approx(-0.02 * GAINS.psi, rel=0.05)


def test_a_nan_estimate_is_passed_to_the_supervisor():
    drive = Drive()
    drive.tick()
    assert drive.tick(psi=np.nan).tolist() == [0.5, 0.0, 0.0]


def test_heading_control_uses_a_gyro_that_the_estimator_ignores():
    drive = Drive(gyro=Gyro(slice(0, 3), 0.5, 20.0))
    drive.tick()
    for _ in range(5):
        assert drive.tick(innovation=[0.0, 0.0, 0.1])[2] == 0.0, "a spike is not a turn"
    for _ in range(50):
        turn = drive.tick(innovation=[0.0, 0.0, 0.1])[2]
    assert drive.state.missing_angle == pytest.approx(50 * 0.01 * 0.2, abs=0.005)
    assert turn < -0.05 * GAINS.psi
    drive.tick(innovation=[0.0, 0.0, 0.001])
    assert drive.state.rejected_s == 0.0


def test_a_mission_uses_heading_control_by_default():
    small = vehicle_file.load("small")
    for hold in (True, False):
        mission = Mission.from_json(Mission("teach", hold=hold).to_json())
        run = perform(mission, small, hand_for(3.0, [0.6, 0.0, 0.0], 100.0), truth=body(small))
        assert np.any(run.requested_commands[:, 2] != 0.0) == hold


def test_heading_control_is_disabled_for_a_driver_function():
    small = vehicle_file.load("small")
    run = drive_with_driver(small, hand_for(1.0, [0.6, 0.0, 0.0], 100.0), truth=body(small))
    assert not np.any(run.requested_commands[:, 2])
