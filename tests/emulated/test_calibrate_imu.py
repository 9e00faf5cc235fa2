"""The mounting and the biases of the IMU, calibrated by the real driver while a hand moves the emulated vehicle."""

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.errors import AnswerNo
from baqueano.robot.imu.settings import ImuSettings
from baqueano.robot.workshop import calibrate_imu
from baqueano.robot.workshop.calibrate_imu import ImuReader, biases, find_up_axis, lift_axes
from tests.codes import refused
from tests.emulated.hand import Hand, OnBus

ON_EDGE = ImuSettings(axes=("-y", "z", "-x"))  # a chip on its edge, turned the long way


@pytest.fixture
def robot(tmp_path, monkeypatch):
    monkeypatch.setattr(calibrate_imu, "TIMEOUT_S", 8.0)
    return OnBus(tmp_path, monkeypatch)


def follows(hand, lift=0.3, turn=np.pi, roll=0.0):
    """Simulate a person who follows the instructions."""

    def notify(text):
        if "lift" in text:
            hand.moves(lift=lift, roll=roll)
        elif "turn" in text:
            hand.moves(lift=0.0, roll=0.0, heading=hand.heading + turn)

    return notify


def calibration(robot, notify):
    return calibrate_imu.calibrate(ImuReader(robot.imu, robot.wait, lambda: robot.now_ns), notify)


def test_axes_and_biases_are_identified_on_a_sloping_floor(robot):
    axes = ON_EDGE.body_from_chip()
    hand = Hand(
        robot, axes, slope=(0.02, -0.03), accel_bias=axes.T @ [0.11, -0.07, 0.2], gyro_bias=axes.T @ [0.01, 0.02, 0.03]
    )  # fmt: skip
    mount = calibration(robot, follows(hand))
    assert mount.axes == ON_EDGE.axes
    assert mount.slope_rad == pytest.approx(np.hypot(0.02, 0.03), abs=0.001)
    assert mount.turn_rad == pytest.approx(np.pi, abs=0.02)
    assert mount.lift_rad == pytest.approx(0.3, abs=0.03)
    np.testing.assert_allclose(mount.accel, [0.11, -0.07], atol=0.01)
    assert mount.gyro == pytest.approx(0.03, abs=5e-4)


def test_the_calibrated_imu_measures_zero_at_rest(robot):
    file = vehicle_file.load("small")
    mount = calibration(robot, follows(Hand(robot, gyro_bias=(0.0, 0.0, -0.02), accel_bias=(0.3, 0.1, 0.0))))
    values = mount.values(file)
    assert values["robot.imu_axes"] == ["x", "y", "z"]
    imu = file.with_values(values).sensors.imu
    np.testing.assert_allclose(
        imu.accel_bias, [0.3 + 9.80665 * np.sin(-0.015), 0.1 - 9.80665 * 0.01], atol=0.01
    )
    assert imu.gyro_bias == pytest.approx(-0.02, abs=5e-4)


def test_a_right_turn_during_calibration_is_reported(robot):
    with refused("calibrate.turned-right", AnswerNo) as error_info:
        calibration(robot, follows(Hand(robot), turn=-np.pi))
    assert error_info.value.diagnostic.figures["turn_deg"] > 90.0


def test_a_vehicle_that_is_not_lifted_ends_the_calibration(robot):
    Hand(robot)
    with refused("calibrate.no-motion", AnswerNo, step="the lift of the front", limit_s=8.0):
        calibration(robot, lambda text: None)


def test_a_carried_vehicle_is_not_at_rest(robot):
    robot.chip.motion = lambda t_ns: ((0.0, 0.0, 9.8), (0.3 * np.sin(3e-9 * t_ns), 0.0, 0.0))
    with refused("calibrate.not-still", AnswerNo, step="at rest", limit_s=8.0):
        calibration(robot, lambda text: None)


def test_an_imu_without_samples_is_reported(robot):
    reader = ImuReader(type("Silent", (), {"read": lambda self: []})(), robot.wait, lambda: robot.now_ns)
    with refused("calibrate.no-sample", AnswerNo, limit_s=1.0) as error_info:
        reader.samples(1.0)
    assert error_info.value.diagnostic.fix == "baqueano robot doctor"


def test_an_imu_without_a_nearly_vertical_axis_is_refused():
    with refused("calibrate.not-upright", AnswerNo, x_m_s2=5.0, y_m_s2=0.0, z_m_s2=8.4):
        find_up_axis(np.array([5.0, 0.0, 8.4]))


def test_a_lift_over_a_corner_does_not_give_the_forward_direction():
    with refused("calibrate.lifted-over-corner", AnswerNo, first_m_s2=2.0, second_m_s2=1.5):
        lift_axes(np.array([2.0, -1.5, 0.1]), np.array([0.0, 0.0, 1.0]))


@pytest.mark.parametrize("turn", [1.7, 3.0, 4.2])
def test_a_quarter_to_three_quarter_turn_separates_bias_from_floor_slope(turn):
    bias, slope = np.array([0.1, -0.2]), np.array([0.3, 0.05])
    c, s = np.cos(turn), np.sin(turn)
    bias_estimate, slope_estimate = biases(bias + slope, bias + np.array([[c, s], [-s, c]]) @ slope, turn)
    np.testing.assert_allclose(bias_estimate, bias, atol=1e-12)
    np.testing.assert_allclose(slope_estimate, slope, atol=1e-12)
