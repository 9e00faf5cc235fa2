"""Ranges to a beacon and to a wall, and a compass: hand calculations."""

import numpy as np
import pytest

from baqueano.block_checks import check_sensor
from baqueano.geometry import wrap
from baqueano.sensors import Beacon, Compass, Rangefinder
from baqueano.signals import Motion


def motion_at(x, y, psi=0.0):
    return Motion(np.array([x, y, psi]), np.zeros(3), np.zeros(3), np.zeros(2))


def reading_of(sensor, motion, noise=0.0):
    """Return (is_new, z) of the first tick; a sensor of 100 Hz without a delay answers at this tick."""
    _, slot = sensor.step(sensor.init(), motion, 0.01, np.array([noise]))
    return slot.is_new, slot.z[0]


WALL = {"wall_point_m": np.array([2.0, 0.0]), "wall_heading_rad": 0.0, "rate_hz": 100.0}


def test_a_beacon_measures_the_distance_plus_its_offset():
    assert Beacon(point_m=np.array([3.0, 4.0])).h(motion_at(0.0, 0.0)) == pytest.approx([5.0], abs=1e-6)
    assert Beacon(point_m=np.array([3.0, 4.0]), offset_m=0.2).h(motion_at(3.0, 0.0)) == pytest.approx(
        [4.2], abs=1e-6
    )
    high = Beacon(point_m=np.array([3.0, 0.0]), height_m=4.0)
    assert high.h(motion_at(0.0, 0.0)) == pytest.approx([5.0], abs=1e-6)


def test_a_receiver_ahead_of_the_origin_measures_a_shorter_range():
    """The receiver is 0.1 m ahead; the vehicle points north, and the beacon is 2 m north of it."""
    beacon = Beacon(point_m=np.array([1.0, 2.0]), lever_arm_m=np.array([0.1, 0.0]))
    assert beacon.h(motion_at(1.0, 0.0, np.pi / 2)) == pytest.approx([1.9], abs=1e-6)


def test_a_beacon_out_of_range_is_silent():
    beacon = Beacon(point_m=np.array([3.0, 0.0]), max_range_m=2.0, rate_hz=100.0)
    assert reading_of(beacon, motion_at(0.0, 0.0)) == (0.0, 0.0)
    assert reading_of(beacon, motion_at(2.0, 0.0))[0] == 1.0


def test_the_measured_distance_to_a_wall_increases_with_the_beam_angle():
    """At 0.3 rad the beam is 2 / cos 0.3 long."""
    wall = Rangefinder(**WALL)
    assert wall.h(motion_at(0.0, 0.0)) == pytest.approx([2.0])
    assert wall.h(motion_at(0.0, 7.0, 0.3)) == pytest.approx([2.0 / np.cos(0.3)])
    left = Rangefinder(
        wall_point_m=np.array([0.0, 1.5]), wall_heading_rad=np.pi / 2, heading_rad=np.pi / 2,
        lever_arm_m=np.array([0.0, 0.1]),
    )  # fmt: skip
    assert left.h(motion_at(9.0, 0.0)) == pytest.approx([1.4])


@pytest.mark.parametrize(
    ("pose", "is_new"),
    [
        ((0.0, 0.0, 0.0), 1.0),
        ((0.0, 0.0, 0.5), 0.0),  # the wall reflects the sound away
        ((0.0, 0.0, np.pi), 0.0),  # the beam points away from the wall
        ((3.0, 0.0, 0.0), 0.0),  # behind the wall
        ((-4.0, 0.0, 0.0), 0.0),  # too far
        ((0.0, 1.2, 0.0), 0.0),  # beside the end of the wall
        ((0.0, 1.2, -0.2), 1.0),  # slanting, the beam meets it: 1.2 − 2 tan 0.2 = 0.79
    ],
)
def test_a_rangefinder_answers_only_if_its_beam_meets_the_wall(pose, is_new):
    assert reading_of(Rangefinder(half_width_m=1.0, **WALL), motion_at(*pose))[0] == is_new


def test_a_compass_reads_the_heading_and_is_wrapped():
    compass = Compass(heading_rad=0.5, noise_std=0.1, rate_hz=100.0)
    assert compass.h(motion_at(0.0, 0.0, 0.3)) == pytest.approx([0.8])
    _, z = reading_of(compass, motion_at(0.0, 0.0, np.pi - 0.6), noise=2.0)
    assert z == pytest.approx(-np.pi + 0.1)
    assert compass.difference(np.array([3.1]), np.array([-3.1])) == pytest.approx([wrap(6.2)])


def test_iron_on_the_vehicle_deflects_the_compass():
    """Iron ahead adds half a field: the field is (0.5, −1) at a true heading of 90°, which reads atan2(1, 0.5)."""
    compass = Compass(iron=np.array([0.5, 0.0]))
    assert compass.h(motion_at(0.0, 0.0, np.pi / 2)) == pytest.approx([np.arctan2(1.0, 0.5)])
    assert compass.h(motion_at(0.0, 0.0)) == pytest.approx([0.0])
    left = Compass(iron=np.array([0.0, 0.5]))  # the field is (1, 0.5): north seems to lie to the left
    assert left.h(motion_at(0.0, 0.0)) == pytest.approx([-np.arctan(0.5)])


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_delayed_compass_is_interpolated_across_pi(side):
    compass = Compass(rate_hz=100.0, delay_s=0.025, delay_slots=3)
    state, readings = compass.init(), []
    for k in range(60):
        psi = side * (np.pi - 0.5 + 0.02 * k)
        state, slot = compass.step(state, motion_at(0.0, 0.0, wrap(psi)), 0.01, np.zeros(1))
        if slot.is_new:
            readings.append(wrap(psi - slot.z[0]))
    assert np.array(readings) == pytest.approx(np.full(57, side * 0.05), abs=1e-9)


@pytest.mark.parametrize(
    "sensor",
    [
        Beacon(point_m=np.array([3.0, 4.0])),
        Beacon(point_m=np.array([3.0, 4.0]), max_range_m=1.0),
        Rangefinder(**WALL),
        Compass(iron=np.array([0.2, 0.1])),
    ],
)
def test_beacon_rangefinder_and_compass_pass_the_sensor_check(sensor):
    assert check_sensor(sensor) == []


@pytest.mark.parametrize("sensor", [Beacon(point_m=np.zeros(2), rate_hz=100.0), Compass(rate_hz=100.0)])
def test_noise_is_its_std_times_the_unit_normal(sensor):
    (_, exact), (_, noisy) = (reading_of(sensor, motion_at(1.0, 0.0, 0.1), noise) for noise in (0.0, 2.0))
    assert noisy - exact == pytest.approx(0.2)
    assert sensor.cov == pytest.approx(0.01 * np.eye(1))
