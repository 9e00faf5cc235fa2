"""The whole mission on the real firmware and drivers, from experiment to repetition; two missions are equal bit by
bit.
"""

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.compare import compare
from baqueano.drive import experiment, repeat, teach
from baqueano.guides import shapes
from baqueano.identify import identify
from baqueano.simulate.excitation import excitation
from tests.emulated.robot import world_of


@pytest.fixture
def world(firmware):
    """Return the options of a drive on the emulated vehicle."""
    worlds = []

    def make(seed=0):
        worlds.append(world_of(firmware, vehicle_file.load("small"), seed=seed))
        return dict(zip(("world", "tick_times_ns"), worlds[-1], strict=True))

    yield make
    for world, _ in worlds:
        world.robot.close()


def test_a_vehicle_fitted_from_forty_seconds_repeats_a_taught_route(world):
    truth = vehicle_file.load("small")
    values = {
        "model.friction.linear": [5.0, 40.0, 0.02],
        "model.actuator_matrix": [[5.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.3]],
    }
    file = truth.with_values(values)
    run = experiment(file, excitation("random_steps", file.command.limit, 40.0, file.rate_hz, 3), **world())
    fit = identify([run], file)
    assert fit.verdict in ("USABLE", "WARN")
    fitted_file = fit.vehicle_file
    assert fitted_file.value("model.actuator_matrix[0,0]") == pytest.approx(3.38, rel=0.06)
    assert fitted_file.value("model.actuator_matrix[2,2]") == pytest.approx(0.203, rel=0.06)
    lesson = teach(fitted_file, shapes.circle(0.5, 0.25), closed=True, **world(1))
    (errors,) = compare(repeat(fitted_file, lesson.route, **world(2))).rows()
    assert errors["across_true_rms_m"] < 0.08


def test_the_same_mission_twice_gives_identical_bits(world):
    file = vehicle_file.load("small")
    u = excitation("random_steps", file.command.limit, 5.0, file.rate_hz, 0)
    first, second = (experiment(file, u, **world(7)) for _ in range(2))
    np.testing.assert_array_equal(first.applied_commands, second.applied_commands)
    np.testing.assert_array_equal(first.sensors["imu"].z, second.sensors["imu"].z)
    np.testing.assert_array_equal(first.estimate.eta, second.estimate.eta)
