"""A reader that passes over tags reads each tag once, at the nearest point, for any positions of the tags."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from baqueano.block_checks import check_sensor
from baqueano.sensors import Compass, Tags
from baqueano.sensors.sampling import mistake_corrections
from baqueano.signals import Motion
from tests.codes import refused

QUICK = settings(max_examples=50)
TWO = np.array([[1.0, 0.0], [2.0, 1.0]])


def pose(x, y, psi=0.0):
    return Motion(np.array([x, y, psi]), np.zeros(3), np.zeros(3), np.zeros(2))


def readings_of(tags, motions, noise=(0.0, 0.0)):
    """Return the readings (x, y) by the index of the motion."""
    state, readings = tags.init(), {}
    for k, motion in enumerate(motions):
        state, slot = tags.step(state, motion, 0.01, np.array(noise))
        if slot.is_new:
            readings[k] = slot.z
        else:
            assert not slot.z.any()
    return readings


def test_a_tag_is_read_once_at_the_nearest_point():
    tags = Tags(points_m=TWO, radius_m=0.1)
    readings = readings_of(tags, [pose(x, 0.04) for x in (0.8, 0.95, 0.99, 1.01, 1.05, 1.3)])
    assert list(readings) == [3]
    assert readings[3] == pytest.approx([1.01, 0.04])


def test_a_reader_without_offset_has_the_covariance_of_a_uniform_disc():
    """In a uniform disc of radius r, a coordinate has the variance r²/4."""
    tags = Tags(points_m=TWO, radius_m=0.1, measures_offset=False, noise_std=0.003)
    readings = readings_of(tags, [pose(x, 0.04) for x in (0.8, 0.99, 1.01)])
    assert readings[2] == pytest.approx([1.0, 0.0])
    rng = np.random.default_rng(0)
    disc = rng.uniform(-0.1, 0.1, (40_000, 2))
    disc = disc[np.hypot(*disc.T) < 0.1]
    assert np.diag(tags.cov) == pytest.approx(disc.var(axis=0) + 0.003**2, rel=0.02)


def test_a_tag_outside_the_radius_is_not_read():
    tags = Tags(points_m=TWO, radius_m=0.1)
    assert not readings_of(tags, [pose(0.0, 0.11), pose(3.0, 0.11)])
    assert list(readings_of(tags, [pose(0.0, 0.09), pose(1.5, 0.09)])) == [1]


def test_oscillating_over_a_tag_gives_only_one_reading():
    tags = Tags(points_m=TWO, radius_m=0.1)
    assert not readings_of(tags, [pose(1.0 + 0.01 * k, 0.0) for k in range(-3, 60)])
    trembling = [pose(0.8, 0.0), *(pose(1.0 + 0.02 * (-1) ** k, 0.0) for k in range(20))]
    assert len(readings_of(tags, trembling)) == 1
    assert len(readings_of(tags, [*trembling, pose(1.5, 0.0), pose(0.9, 0.0), pose(1.0, 0.0)])) == 2


def test_the_tag_reader_is_at_its_lever_arm_on_the_vehicle():
    """The reader is 0.1 m ahead and 0.02 m to the left of a vehicle that drives north through (1.02, y)."""
    tags = Tags(points_m=TWO, radius_m=0.05, lever_arm_m=np.array([0.1, 0.02]))
    readings = readings_of(tags, [pose(1.02, y, np.pi / 2) for y in (-0.3, -0.11, -0.09, 0.2)])
    assert list(readings) == [2]
    assert readings[2] == pytest.approx([1.0, 0.01])


@QUICK
@given(st.floats(-np.pi, np.pi), st.floats(0.005, 0.3), st.floats(-0.099, 0.099))
def test_a_straight_path_over_a_tag_gives_one_reading(psi, step_m, lateral_m):
    tags = Tags(points_m=np.array([[0.3, -0.2]]), radius_m=0.1)
    forward, left = np.array([np.cos(psi), np.sin(psi)]), np.array([-np.sin(psi), np.cos(psi)])
    ways = np.arange(-0.5, 0.5 + step_m, step_m)
    readings = readings_of(tags, [pose(*(tags.points_m[0] + s * forward + lateral_m * left)) for s in ways])
    assert len(readings) == 1
    (place,) = readings.values()
    assert abs((place - tags.points_m[0]) @ left - lateral_m) < 1e-9
    assert -1e-9 <= (place - tags.points_m[0]) @ forward < step_m + 1e-9


def test_possible_mistakes_are_the_vectors_to_all_other_tags():
    tags = Tags(points_m=np.array([[1.0, 0.0], [2.0, 1.0], [-1.0, 3.0]]))
    ways = tags.mistakes(np.array([1.95, 1.04]))
    assert ways == pytest.approx(np.array([[-1.0, -1.0], [0.0, 0.0], [-3.0, 2.0]]))
    assert mistake_corrections(tags, np.array([1.95, 1.04])) == pytest.approx(ways)
    assert mistake_corrections(Compass(), np.zeros(1)).shape == (0, 1)


def test_tag_noise_is_std_times_unit_normals_unless_a_covariance_is_given():
    tags = Tags(points_m=TWO, noise_std=0.01)
    readings = readings_of(tags, [pose(0.5, 0.0), pose(1.0, 0.0)], noise=(1.0, -2.0))
    assert readings[1] == pytest.approx([1.01, -0.02])
    assert tags.cov == pytest.approx(1e-4 * np.eye(2))
    assert Tags(points_m=TWO, measurement_noise_cov=np.eye(2)).cov == pytest.approx(np.eye(2))


def test_tags_pass_the_sensor_check_and_need_positions_in_rows():
    assert check_sensor(Tags(points_m=TWO)) == []
    with refused("tags.points", ValueError, value="(2,)"):
        Tags(points_m=np.zeros(2))
