"""The recommended controller on the real firmware and drivers: it drives evenly, from an identified model."""

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.compare.evenness import is_driving, limits_of, share_at_limit, sign_changes, speed_errors
from baqueano.drive import experiment, repeat
from baqueano.guides.shapes import rectangle, sinuous_circle
from baqueano.identify import identify
from baqueano.simulate.excitation import excitation
from tests.emulated.robot import world_of


@pytest.fixture(scope="module")
def fitted_file(firmware):
    """Return the vehicle file identified from 40 s of commands and IMU data."""
    file = vehicle_file.load("small")
    u = excitation("random_steps", file.command.limit, 40.0, file.rate_hz, 3)
    world, tick_times_ns = world_of(firmware, file)
    run = experiment(file, u, world=world, tick_times_ns=tick_times_ns)
    world.robot.close()
    return identify([run], file).vehicle_file


@pytest.mark.parametrize("route", [sinuous_circle(0.5, 0.05, 5, 0.2), rectangle(1.0, 0.6, 0.2, 0.3)])
def test_the_emulated_robot_drives_at_an_even_speed(firmware, fitted_file, route):
    world, tick_times_ns = world_of(firmware, vehicle_file.load("small"), seed=5)
    run = repeat(fitted_file, route, world=world, tick_times_ns=tick_times_ns).without_rest
    world.robot.close()
    going = run.reference.at_end < 1.0
    truth = np.interp(run.reference.t_ns[going], run.truth.t_ns, run.truth.nu[:, 0])
    evenness = speed_errors(run.reference.t_ns[going], truth, run.reference.nu[going, 0])
    assert evenness.error < 0.05
    assert evenness.unevenness < 0.03
    assert share_at_limit(run.sent_commands[going], limits_of(fitted_file.text)) == 0.0
    # at most one, to brake
    assert sign_changes(run.t_ns[going], run.sent_commands[going, 0]) * run.duration_s < 1.5
    going &= is_driving(run.t_ns, run.reference.nu[:, 0], 0.0)
    assert sign_changes(run.t_ns[going], run.sent_commands[going, 0]) == 0.0
