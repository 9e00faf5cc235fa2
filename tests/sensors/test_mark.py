"""A line on the floor: it gives a reading if it is passed in its direction and within its width."""

import numpy as np
import pytest

from baqueano.block_checks import check_sensor
from baqueano.sensors import Mark
from baqueano.signals import Motion


def motion_at(x, y, psi=0.0):
    return Motion(np.array([x, y, psi]), np.zeros(3), np.zeros(3), np.zeros(2))


def readings_of(mark, places, noise=0.0):
    state, readings = mark.init(), []
    for x, y in places:
        state, slot = mark.step(state, motion_at(x, y), 0.01, np.array([noise]))
        readings.append((float(slot.is_new), float(slot.z[0])))
    return readings


def test_passing_a_mark_gives_one_reading_of_the_distance_beyond_it():
    mark = Mark(point_m=np.array([1.0, 0.0]))
    assert readings_of(mark, [(0.9, 0.0), (0.98, 0.0), (1.02, 0.0), (1.1, 0.0)]) == [
        (0.0, 0.0),
        (0.0, 0.0),
        (1.0, pytest.approx(0.02)),
        (0.0, 0.0),
    ]


def test_a_mark_is_not_read_when_reversing_passing_beside_it_or_starting():
    mark = Mark(half_width_m=0.3)
    assert not any(is_new for is_new, _ in readings_of(mark, [(0.1, 0.0), (-0.1, 0.0)]))
    assert not any(is_new for is_new, _ in readings_of(mark, [(-0.1, 0.5), (0.1, 0.5)]))
    assert not any(is_new for is_new, _ in readings_of(mark, [(0.0, 0.0), (0.1, 0.0)]))
    assert [is_new for is_new, _ in readings_of(mark, [(-0.1, 0.2), (0.1, 0.2)])] == [0.0, 1.0]


def test_a_line_crossed_northward_measures_the_distance_to_the_north():
    """Through (1, 2), passed along y: 0.25 m beyond it at y = 2.25, wherever x is."""
    mark = Mark(point_m=np.array([1.0, 2.0]), heading_rad=np.pi / 2)
    assert mark.h(motion_at(5.0, 2.25)) == pytest.approx([0.25])


def test_mark_noise_is_its_std_times_the_unit_normal():
    assert readings_of(Mark(noise_std=0.01), [(-1.0, 0.0), (0.0, 0.0)], noise=2.0)[1] == (
        1.0,
        pytest.approx(0.02),
    )
    assert Mark(noise_std=0.01).cov == pytest.approx(1e-4 * np.eye(1))
    assert Mark(measurement_noise_cov=np.eye(1)).cov == pytest.approx(np.eye(1))


def test_a_mark_passes_the_sensor_check():
    assert check_sensor(Mark()) == []
