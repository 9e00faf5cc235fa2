"""The return to a mark identifies the gyro scale: simulated vehicles whose gyro and wheels differ from their file."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.drive import teach
from baqueano.drive.closure import closure
from baqueano.drive.observers import Observer
from baqueano.drive.session import mark_times_ns
from baqueano.errors import AnswerNo
from baqueano.geometry import map_from_body
from baqueano.guides import shapes
from baqueano.vehicle_file import override
from baqueano.worlds import SimulatedWorld
from baqueano.worlds.clock import simulated_ticks
from tests.codes import refused

SMALL = "small"
TRUE = 0.97
WHEELS = """
[sensors.wheels]
kind = "wheels"
rate_hz = 50.0
noise_std = 0.005
"""


@pytest.fixture(scope="module")
def file():
    return vehicle_file.load(SMALL)


class ByTruth(Observer):
    """Commands of a driver who sees the true pose: `turns` in place or `metres` ahead, then a rest."""

    def __init__(self, world, rate_hz, turns, speed):
        self.world, self.rate_hz, self.goals, self.ahead = world, rate_hz, turns, speed
        self.ticks, self.psi, self.turned, self.begun, self.new_marks, self.rest = 0, 0.0, 0.0, False, 0, 200

    def __call__(self):
        now = self.world.truth.eta[2]
        self.turned += np.angle(np.exp(1j * (now - self.psi)))
        self.psi = now
        if self.rest > 0:
            self.rest -= 1
            if self.rest == 0:
                self.new_marks += 1
            return np.zeros(3)
        if not self.goals:
            raise KeyboardInterrupt
        remaining = self.goals[0] - self.turned
        if abs(remaining) < 0.01 and abs(self.world.truth.nu[2]) < 0.05:
            self.goals, self.rest = self.goals[1:], 150
        turn = np.clip(1.2 * remaining, -0.7, 0.7)
        speed = self.ahead if abs(remaining) > 0.5 else 0.0
        return np.array([speed, 0.0, turn + np.sign(remaining) * 0.32 * (abs(remaining) > 0.01)])

    def pop_mark_count(self):
        marks, self.new_marks = self.new_marks, 0
        return marks


def drive_of_turns(file, turns, seed=3, speed=0.0, scale=TRUE):
    """Return a run of turns to these headings [rad], with a mark at each rest; the gyro measures `scale` times the
    turn."""
    truth = override(file, (f"sensors.imu.gyro_scale={scale}",))
    world = SimulatedWorld(truth.vehicle, truth.sensors, truth.rate_hz, seed)
    driver = ByTruth(world, file.rate_hz, list(turns), speed)
    return teach(
        file, driver, world=world, tick_times_ns=simulated_ticks(file.rate_hz, 120.0), observers=[driver]
    ).run


def test_whole_turns_on_a_mark_identify_the_gyro_scale(file):
    for seed in (11, 12, 13):
        run = drive_of_turns(file, [2.0 * np.pi, 6.0 * np.pi], seed)
        assert len(mark_times_ns(run)) == 3
        loop = closure(run, file)
        assert loop.turns == 3
        assert abs(loop.scale - TRUE) < 2.0 * loop.std < 0.01
        assert loop.values == {
            "sensors.imu.gyro_scale": pytest.approx(loop.scale, rel=1e-4),
            "sensors.imu.gyro_scale_std": pytest.approx(loop.std / loop.scale, rel=0.05),
        }
        assert f"--set sensors.imu.gyro_scale={loop.values['sensors.imu.gyro_scale']}" in loop.table()


def test_the_speed_keeps_the_error_of_the_old_gyro_scale(file):
    """The model was fitted with it. Another fit with the new scale removes the error."""
    fitted_file = file.with_values(
        {
            "estimator.speed_error_std": [0.01, 0.03],
            "estimator.speed_per_gyro_scale": -0.8,
            "sensors.imu.gyro_scale_std": 0.05,
        }
    )
    values = closure(drive_of_turns(file, [4.0 * np.pi]), fitted_file).values
    assert values["estimator.speed_error_std"] == pytest.approx([0.01, 0.05])
    assert values["estimator.speed_per_gyro_scale"] == 0.0


def test_right_turns_identify_the_same_gyro_scale(file):
    loop = closure(drive_of_turns(file, [-4.0 * np.pi]), file)
    assert loop.turns == -2
    assert abs(loop.scale - TRUE) < 2.0 * loop.std


def test_half_a_turn_is_refused(file):
    with refused("marks.no-whole-turn", AnswerNo):
        closure(drive_of_turns(file, [3.0 * np.pi]), file)


def test_a_drive_without_rest_is_refused(file):
    run = drive_of_turns(file, [2.0 * np.pi])
    commands = np.array(run.applied_commands)
    commands[commands == 0.0] = 1e-9
    with refused("marks.stood-too-short", AnswerNo):
        closure(replace(run, applied_commands=commands), file)


def test_a_closure_needs_two_marks_and_a_gyro(file):
    run = drive_of_turns(file, [2.0 * np.pi])
    with refused("marks.too-few", AnswerNo, marks=1):
        closure(replace(run, events=run.events[:1]), file)
    with refused("marks.no-gyro", AnswerNo):
        closure(replace(run, sensors={}), file)


def test_a_figure_eight_is_refused_as_a_closure(file):
    run = drive_of_turns(file, [2.0 * np.pi, 0.0], speed=0.45)
    first, middle, last = (e for e in run.events if e.source == "mark")
    for events in ((first, middle, last), (first, last)):
        with refused("marks.no-turn", AnswerNo):
            closure(replace(run, events=events), file)
    assert closure(replace(run, events=(first, middle)), file).scale == pytest.approx(TRUE, abs=0.01)


def test_a_closure_does_not_identify_the_wheel_scale(tmp_path):
    text = vehicle_file.load(SMALL).text.replace("[estimator]", WHEELS + "\n[estimator]", 1)
    path = tmp_path / "vehicle.toml"
    path.write_text(text, encoding="utf-8")
    file = vehicle_file.load(path)
    truth = override(file, ("sensors.wheels.radius_scale=[1.05,1.05]",))
    run = drive_of_turns(truth, [6.0 * np.pi], speed=0.7, scale=1.0)
    assert set(closure(run, file).values) == {"sensors.imu.gyro_scale", "sensors.imu.gyro_scale_std"}
    is_between = (run.truth.t_ns >= mark_times_ns(run)[0]) & (run.truth.t_ns <= mark_times_ns(run)[1])
    length_m = float(np.sum(run.truth.nu[is_between, 0]) / file.rate_hz)
    loop = closure(run, file, length_m)
    np.testing.assert_allclose(loop.values["sensors.wheels.radius_scale"], 1.05, rtol=0.005)
    assert f"of {length_m:g} m" in loop.table()


def test_scaling_the_velocities_of_a_loop_preserves_its_closure():
    shape = shapes.circle(1.0, 0.3)
    dt = np.diff(shape.t_s)
    for scale in (0.5, 1.0, 2.0):
        steps = [
            map_from_body(psi) @ (scale * nu) for psi, nu in zip(shape.eta[:-1, 2], shape.nu, strict=False)
        ]
        end = np.sum(np.array(steps)[:, :2] * dt[:, None], axis=0)
        assert np.hypot(*end) < 0.02
