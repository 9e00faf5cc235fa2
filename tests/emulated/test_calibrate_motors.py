"""Wiring, dead zones and slopes, calibrated by gyro and accelerometer on the real firmware in a simulated body."""

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.diagnostics import StopReason
from baqueano.errors import AnswerNo, SafetyStop
from baqueano.robot.uno.frames import Settings, WheelCurve, Wiring
from baqueano.robot.uno.settings import apply_changes
from baqueano.robot.workshop import calibrate_motors
from baqueano.robot.workshop.calibrate_motors import Sweep, calibrate, fit_sweep, wheel_curves
from baqueano.robot.workshop.floor_tests import FloorTests
from tests.codes import refused
from tests.emulated.robot import EmulatedRobot

REVERSED_L, REVERSED_R, SWAPPED = (
    Wiring.LEFT_MOTOR_REVERSED, Wiring.RIGHT_MOTOR_REVERSED, Wiring.MOTORS_SWAPPED,
)  # fmt: skip


class MiswiredLink(EmulatedRobot):
    """A link with wrong wiring. `plugs` states the channel and the sign of each wheel."""

    plugs = ((0, 1.0), (1, 1.0))

    def _at_wheels(self):
        duties = self.board.duties()
        return np.array([sign * duties[channel] for channel, sign in self.plugs])


@pytest.fixture
def robot(new_robot):
    return new_robot(robot_class=MiswiredLink)


@pytest.fixture
def bench(robot):
    return FloorTests(robot.uno, robot.imu, robot.wait, lambda: robot.now_ns)


def test_swapped_and_reversed_motors_drive_straight_after_calibration(robot, bench, monkeypatch):
    monkeypatch.setattr(calibrate_motors, "LEVEL_COUNT", 5)  # of a body whose lags are known to be short
    monkeypatch.setattr(calibrate_motors, "SETTLE_S", 0.6)
    robot.plugs = ((1, -1.0), (0, 1.0))
    robot.uno.store_settings(Settings(battery_permille=3127, wiring=Wiring.ENCODERS_SWAPPED), robot.wait)
    motors = calibrate(bench)
    assert motors.settings.wiring == REVERSED_L | SWAPPED | Wiring.ENCODERS_SWAPPED
    truth = vehicle_file.load("small").vehicle.drivetrain
    zones = [
        truth.dead_zone_forward[0],
        truth.dead_zone_backward[0],
        truth.dead_zone_forward[1],
        truth.dead_zone_backward[1],
    ]
    np.testing.assert_allclose(
        [curve.dead_zone_permille / 1000 for curve in motors.settings.curves], zones, atol=0.02
    )
    assert motors.verdict == "BALANCED"
    assert max(map(abs, motors.wheel_differences)) < 0.02
    assert max(map(abs, motors.heading_errors_deg)) < 2.0
    settings = robot.uno.settings(robot.wait)
    assert settings == motors.settings
    assert settings.battery_permille == 3127
    robot.wait(0.5)
    assert not robot.board.moving
    before, x, y = robot.motion.eta[2], robot.motion.eta[0], robot.motion.eta[1]
    robot.uno.arm()
    bench.hold_duties(0.4, 0.4, 2.0)  # a request that differs from the trim
    path = np.array([robot.motion.eta[0] - x, robot.motion.eta[1] - y]) @ [np.cos(before), np.sin(before)]
    assert path > 0.3  # forwards
    assert abs(robot.motion.eta[2] - before) < np.radians(10.0) * path


@pytest.mark.parametrize(
    ("plugs", "expected"),
    [(((0, -1.0), (1, -1.0)), REVERSED_L | REVERSED_R), (((1, 1.0), (0, -1.0)), SWAPPED | REVERSED_R)],
)
def test_each_wiring_is_distinguished_from_the_others(robot, bench, plugs, expected):
    robot.plugs = plugs
    bench.uno.arm()
    assert calibrate_motors._wiring(bench, lambda text: None) == expected


def test_heading_control_reduces_the_remaining_heading_error(robot, bench):
    robot.plugs = ((0, 1.0), (1, 0.75))
    bench.uno.arm()
    for sign in (1.0, -1.0):
        before = robot.motion.eta[2]
        bench.hold_duties(0.5 * sign, 0.5 * sign, calibrate_motors.STRAIGHT_S)
        free, before = robot.motion.eta[2] - before, robot.motion.eta[2]
        turn = calibrate_motors._heading_error(bench, sign, 3.3)
        print(f"free {np.degrees(free):.1f}°, held {np.degrees(turn):.1f}°")
        assert abs(free) > np.radians(20.0)
        assert abs(turn) < 0.4 * abs(free)
        assert turn == pytest.approx(robot.motion.eta[2] - before, abs=np.radians(2.0))


def test_a_disconnected_motor_is_named_and_old_settings_are_restored(robot, bench):
    robot.plugs = ((0, 1.0), (1, 0.0))
    before = Settings(curves=(WheelCurve(100, 900, 0),) * 4, dither_permille=20)
    robot.uno.store_settings(before, robot.wait)
    with refused("calibrate.motor-does-not-turn", AnswerNo, side="right", direction="forwards"):
        calibrate(bench)
    assert robot.uno.settings(robot.wait) == before
    assert not robot.board.moving


def test_without_accelerometer_signal_the_forward_direction_is_unknown(robot, bench, monkeypatch):
    motion = robot.chip.motion
    robot.chip.motion = lambda t_ns: ((0.0, 0.0, 9.80665), motion(t_ns)[1])
    bench.uno.arm()
    with refused("calibrate.no-push", AnswerNo) as error_info:
        calibrate_motors._wiring(bench, lambda text: None)
    assert 0.0 <= error_info.value.diagnostic.figures["push_m_s"] < 1.0


def test_unknown_imu_axes_require_an_imu_calibration_first(robot, bench):
    robot.chip.motion = lambda t_ns: ((9.80665, 0.0, 0.0), (0.0, 0.0, 0.0))
    robot.wait(0.1)
    with refused("floor.gravity", AnswerNo) as error_info:
        calibrate(bench)
    reason = error_info.value.diagnostic
    assert (reason.figures["x_m_s2"], reason.figures["y_m_s2"]) == pytest.approx((9.8, 0.0), abs=0.5)
    assert reason.fix == "baqueano robot calibrate imu"


def test_a_vehicle_that_moves_with_motors_off_is_not_calibrated(robot, bench):
    motion = robot.chip.motion
    robot.chip.motion = lambda t_ns: (motion(t_ns)[0], (0.0, 0.0, np.sin(1e-8 * t_ns)))
    with refused("floor.not-still", AnswerNo):
        calibrate(bench)


@pytest.mark.parametrize("fault", ["imu", "uno"])
def test_a_hardware_failure_ends_the_calibration_with_motors_off(robot, bench, fault):
    bench.uno.arm()
    bench.hold_duties(0.6, -0.6, 0.2)
    if fault == "imu":
        robot.chip.is_frozen = True
    else:
        robot.board.reset()
    with refused(StopReason.IMU_SILENT if fault == "imu" else StopReason.UNO_RESET, SafetyStop):
        bench.hold_duties(0.6, -0.6, 5.0)
    robot.wait(0.05)
    assert not robot.board.moving


MINE = Settings(
    battery_permille=3127, wiring=REVERSED_R | Wiring.ENCODERS_SWAPPED, curves=(WheelCurve(110, 900,
    50), WheelCurve(120, 800, 60)) * 2,
    dither_permille=33,
)  # fmt: skip


@pytest.mark.parametrize("end_by", ["imu", "uno", "ctrl-c"])
def test_an_interrupted_calibration_restores_the_uno_settings(robot, bench, end_by):
    robot.uno.store_settings(MINE, robot.wait)
    texts = []

    def notify(text):
        texts.append(text)
        if len(texts) == 1:  # during the identification of the motors
            if end_by == "ctrl-c":
                raise KeyboardInterrupt
            robot.board.reset() if end_by == "uno" else setattr(robot.chip, "is_frozen", True)

    with pytest.raises(KeyboardInterrupt if end_by == "ctrl-c" else SafetyStop):
        calibrate(bench, notify)
    assert robot.uno.settings(robot.wait) == MINE
    assert texts[-1] == "the Uno keeps its old settings"
    assert not robot.board.moving


def test_disconnecting_the_uno_during_calibration_is_reported_with_a_remedy(robot, bench):
    robot.uno.store_settings(MINE, robot.wait)
    texts, line = [], (robot.write, robot.read)

    def unplug(data=b""):
        raise OSError(5, "Input/output error")

    def notify(text):
        texts.append(text)
        if len(texts) == 1:  # during the identification of the motors
            robot.write = robot.read = unplug

    with refused(StopReason.UNO_ABSENT, SafetyStop):
        calibrate(bench, notify)
    assert not robot.board.moving
    assert "keeps those of an unfinished calibration" in texts[-1]
    robot.write, robot.read = line
    assert robot.uno.settings(robot.wait) != MINE
    words = texts[-1].partition("baqueano robot settings --defaults ")[2].split()
    expected: dict[str, list[str]] = {}
    for word in words:
        name, _, text = word.removeprefix("--").partition("=")
        expected.setdefault(name, []).append(text)
    assert apply_changes(Settings(), expected) == MINE


def test_calibrated_slopes_equalise_the_wheels_to_the_weakest_wheel():
    way_list = wheel_curves(
        (
            Sweep(0.4, 0.3, 10.0, 0.0),
            Sweep(0.4, 0.3, 8.0, 0.0),
            Sweep(0.4, 0.2, 10.0, 0.0),
            Sweep(0.4, 0.2, 9.0, 0.0),
        )
    )
    reach = [s.slope_permille * gain for s, gain in zip(way_list, (10.0, 8.0, 10.0, 9.0), strict=True)]
    np.testing.assert_allclose(reach, 0.7 * 8.0 * 1000, rtol=1e-3)
    assert max(s.dead_zone_permille + s.slope_permille for s in way_list) == 1000


def test_a_sweep_without_motion_is_reported():
    bounds = {"low": pytest.approx(0.3), "high": pytest.approx(0.7)}
    with refused("calibrate.few-duties", AnswerNo, name="left forwards", duties=8, count=1, **bounds):
        fit_sweep(0.4, np.linspace(0.7, 0.3, 8), np.array([3.0, 0, 0, 0, 0, 0, 0, 0]), "left forwards")


def test_a_dead_zone_too_large_for_the_firmware_is_reported():
    duties = np.linspace(1.0, 0.8, 8)
    with refused("calibrate.dead-zone", AnswerNo, name="right backwards", dead_zone=pytest.approx(0.75)):
        fit_sweep(0.8, duties, 5.0 * (duties - 0.75), "right backwards")


def test_possible_causes_are_listed_if_a_vehicle_does_not_drive_straight():
    settings = Settings(curves=(WheelCurve(300, 700, 0),) * 4)
    motors = calibrate_motors.MotorCalibration(
        settings, (Sweep(0.5, 0.3, 5.0, 0.001),) * 4, (0.2, 0.0), (0.08, 0.01), (9.0, 1.0), (1.5, -0.2)
    )
    assert motors.verdict == "UNBALANCED"
    assert "does a wheel slip or rub" in motors.table()
    assert "(before the trim +20.0%); heading error by the gyro +1.5° after 1.5 s" in motors.table()
    assert motors.rows()[0]["wheel_differences"] == (0.08, 0.01)
    assert calibrate_motors.MotorCalibration.from_rows(motors.rows()).table() == motors.table()
