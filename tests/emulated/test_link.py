"""The link and the world of the loop with the real firmware, in lock-step."""

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.drive import experiment
from baqueano.robot.uno.frames import EncoderKind, ResetCause, Settings
from tests.emulated.robot import EmulatedWorld


def hold(robot, left, right, seconds, step_s=0.01):
    """Send commands for this duration, as a loop computes them."""
    for _ in range(round(seconds / step_s)):
        robot.uno.drive(left, right)
        robot.wait(step_s)


@pytest.mark.parametrize("first_lost", [100, 127, 200, 255])
def test_the_next_command_after_lost_commands_moves_the_motors(robot, first_lost):
    """The firmware treats a number that is 128 to 255 ahead as old; telemetry gives the number to continue from."""
    robot.uno.arm()
    hold(robot, 0.4, 0.4, 0.2)
    robot.write = lambda data: None
    hold(robot, 0.4, 0.4, 0.01 * first_lost)
    assert not robot.board.moving
    del robot.write
    robot.uno.drive(0.4, 0.4)
    robot.wait(0.02)
    assert robot.board.moving
    hold(robot, 0.4, 0.4, 0.5)
    assert robot.board.moving
    assert robot.board.info().old_sequence == 0


def drive_robot(robot, file, u, act, path=None):
    """Return the run of an experiment; `act(t_s)` is called at its start with the time of the board."""
    world = EmulatedWorld(robot, file)

    def tick_times_ns():
        for k, due in enumerate(world.ticks(file.rate_hz)):
            if k == 0:
                act(robot.board.t_s - due * 1e-9)
            yield due

    return experiment(file, u, world=world, tick_times_ns=tick_times_ns(), path=path)


def hardware(run):
    return [e.diagnostic.code for e in run.events if e.source == "hardware"]


def test_each_silence_of_an_encoder_is_logged_once(robot):
    file = vehicle_file.load("small")
    robot.uno.store_settings(Settings(encoders=EncoderKind.QUADRATURE), robot.wait)
    forward, pause = np.tile([0.8, 0.0, 0.0], (110, 1)), np.zeros((30, 3))

    def left_alone(start_s):
        robot.board.encoder(0, 1500, start_s, start_s + 2.8)

    run = drive_robot(robot, file, np.concatenate([forward, pause, forward]), left_alone)
    events = [e for e in run.events if e.source == "hardware"]
    assert len(events) == 2
    assert {e.diagnostic.code for e in events} == {"encoders.right-silent"}
    assert events[0].t_ns * 1e-9 == pytest.approx(0.52, abs=0.04)  # 0.5 s at half of full duty
    assert events[1].t_ns * 1e-9 == pytest.approx(1.4 + 0.52, abs=0.04)


def test_a_reset_causes_no_false_wheel_speed_or_mark(robot):
    text = vehicle_file.load("small").text + (
        '\n[sensors.wheels]\nkind = "wheels"\n\n[sensors.mark]\nkind = "mark"\n\n[robot]\ncounts_per_turn = 600\n'
    )
    file = vehicle_file.parse(text, "with encoders and a mark")
    robot.uno.store_settings(Settings(encoders=EncoderKind.QUADRATURE), robot.wait)
    world = EmulatedWorld(robot, file)

    def tick_times_ns():
        for k, due in enumerate(world.ticks(file.rate_hz)):
            if k == 0:
                start_s = robot.board.t_s - due * 1e-9
                for plug in range(2):
                    robot.board.encoder(plug, 3000, start_s, start_s + 1.5)
                robot.board.set_mark(True, start_s + 0.2)
                robot.board.set_mark(False, start_s + 0.25)
            elif k == 75:
                robot.board.reset(ResetCause.BROWN_OUT)
            yield due

    u = np.tile([0.8, 0.0, 0.0], (150, 1))
    run = experiment(file, u, world=world, tick_times_ns=tick_times_ns())
    wheels = run.sensors["wheels"]
    radius, t_s = file.geometry.wheel_radius_m, 1e-9 * wheels.t_ns
    assert np.sum(t_s < 0.75) > 70
    assert np.sum(t_s > 0.8) > 40, "the encoder is measured again"
    np.testing.assert_allclose(
        np.mean(wheels.z[t_s < 0.75], axis=0), 2 * np.pi * radius * 2000 / 600, rtol=0.1
    )
    assert np.all(wheels.z > -0.1)
    assert np.max(wheels.z) < 1.5 * 2 * np.pi * radius * 2000 / 600
    assert len(run.sensors["mark"].z) == 1, "the strip, and not the counter that began anew"


def test_two_unwired_encoders_are_reported_in_one_sentence(robot):
    file = vehicle_file.load("small")
    robot.uno.store_settings(Settings(encoders=EncoderKind.SINGLE), robot.wait)
    run = drive_robot(robot, file, np.tile([0.8, 0.0, 0.0], (80, 1)), lambda start_s: None)
    assert hardware(run) == ["encoders.both-silent"]


@pytest.mark.parametrize("path", [None, "run.mcap"])
def test_a_mark_is_timestamped_with_its_edge_at_the_firmware(robot, tmp_path, path):
    """Telemetry of 50 Hz reports it up to 20 ms late: 8 mm at 0.4 m/s. The error of the Uno's clock is 1 or 2 ms."""
    text = vehicle_file.load("small").text + '\n[sensors.mark]\nkind = "mark"\n'
    file = vehicle_file.override(vehicle_file.parse(text, "with a mark"), ["robot.telemetry_hz=50"])
    edges = 0.3 + 0.1137 * np.arange(12)

    def strips(start_s):
        for edge in edges:
            robot.board.set_mark(True, start_s + edge)
            robot.board.set_mark(False, start_s + edge + 0.03)

    u = np.tile([0.4, 0.0, 0.0], (180, 1))
    mark = drive_robot(robot, file, u, strips, path and tmp_path / path).sensors["mark"]
    np.testing.assert_allclose(1e-9 * mark.t_ns, edges, atol=2e-3)
    late_s = 1e-9 * (mark.arrival_ns - mark.t_ns)
    assert late_s.min() > 0.0
    assert late_s.max() > 0.015
