"""The whole mission on the real firmware and drivers, from experiment to repetition: it drives evenly, and two missions
are equal bit by bit.
"""

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.compare import compare
from baqueano.compare.evenness import is_driving, read_limits, share_at_limit, sign_changes, speed_errors
from baqueano.drive import experiment, repeat, teach
from baqueano.guides import shapes
from baqueano.identify import identify
from baqueano.simulate.excitation import excitation
from tests.emulated.robot import make_world


@pytest.fixture
def world(firmware, until_end):
    """Return the options of a drive on the emulated vehicle."""

    def make(seed=0):
        world, tick_times_ns = make_world(firmware, vehicle_file.load("small"), seed=seed)
        until_end(world.robot)
        return {"world": world, "tick_times_ns": tick_times_ns}

    return make


@pytest.fixture(scope="module")
def fit(firmware):
    """Return a fit to 40 s of commands and IMU data, from a guess."""
    truth = vehicle_file.load("small")
    values = {
        "model.friction.linear": [5.0, 40.0, 0.02],
        "model.actuator_matrix": [[5.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.3]],
    }
    file = truth.with_values(values)
    world, tick_times_ns = make_world(firmware, truth)
    u = excitation("random_steps", file.command.limit, 40.0, file.rate_hz, 3)
    run = experiment(file, u, world=world, tick_times_ns=tick_times_ns)
    world.robot.close()
    return identify([run], file)


def test_a_vehicle_fitted_from_forty_seconds_repeats_a_taught_route(world, fit):
    assert fit.verdict in ("USABLE", "WARN")
    fitted_file = fit.vehicle_file
    assert fitted_file.value("model.actuator_matrix[0,0]") == pytest.approx(3.38, rel=0.06)
    assert fitted_file.value("model.actuator_matrix[2,2]") == pytest.approx(0.203, rel=0.06)
    lesson = teach(fitted_file, shapes.circle(0.5, 0.25), closed=True, **world(1))
    (errors,) = compare(repeat(fitted_file, lesson.route, **world(2))).rows()
    assert errors["across_true_rms_m"] < 0.08


@pytest.mark.parametrize(
    "route", [shapes.sinuous_circle(0.5, 0.05, 5, 0.2), shapes.rectangle(1.0, 0.6, 0.2, 0.3)]
)
def test_the_emulated_robot_drives_at_an_even_speed(world, fit, route):
    file = fit.vehicle_file
    run = repeat(file, route, **world(5)).without_rest
    going = run.reference.at_end < 1.0
    truth = np.interp(run.reference.t_ns[going], run.truth.t_ns, run.truth.nu[:, 0])
    evenness = speed_errors(run.reference.t_ns[going], truth, run.reference.nu[going, 0])
    assert evenness.error < 0.05
    assert evenness.unevenness < 0.03
    assert share_at_limit(run.sent_commands[going], read_limits(file.text)) == 0.0
    # at most one, to brake
    assert sign_changes(run.t_ns[going], run.sent_commands[going, 0]) * run.duration_s < 1.5
    going &= is_driving(run.t_ns, run.reference.nu[:, 0], 0.0)
    assert sign_changes(run.t_ns[going], run.sent_commands[going, 0]) == 0.0


def test_the_same_mission_twice_gives_identical_bits(world):
    file = vehicle_file.load("small")
    u = excitation("random_steps", file.command.limit, 5.0, file.rate_hz, 0)
    first, second = (experiment(file, u, **world(7)) for _ in range(2))
    np.testing.assert_array_equal(first.applied_commands, second.applied_commands)
    np.testing.assert_array_equal(first.sensors["imu"].z, second.sensors["imu"].z)
    np.testing.assert_array_equal(first.estimate.eta, second.estimate.eta)
