"""Tags on the floor and a wrong filter: one contradicting reading is an outlier, two are not."""

from functools import cache

import numpy as np
import pytest

from baqueano.estimators import AugmentedEkf
from baqueano.estimators.augmented.state import BIAS_INDEX, SCALE_INDEX
from baqueano.estimators.readings.place_gate import REPEAT_S, TURN_STD, squared_distance
from baqueano.sensors import Imu, Pose, Tags
from baqueano.signals import Slot, Tick, sensor_slots
from baqueano.symbolic import compile_block
from baqueano.vehicles import Friction, Planar

FRICTION = Friction(linear=np.array([3.0, 40.0, 0.012]))
SMALL = Planar(
    mass_kg=0.61, inertia_kg_m2=0.0015, actuator_matrix=np.diag([3.0, 0.0, 0.1]), friction=FRICTION
)
IMU = Imu(accel_noise_std=np.array([0.05, 0.05]), gyro_noise_std=0.005)
TAGS = Tags(points_m=np.array([[0.0, 0.0], [1.0, 0.0]]), noise_std=0.01)
BOTH = sensor_slots(("imu", "tags"))
SOON, LATER = 0.05, 1.5  # s
OTHER = np.array([1.0, 0.0])  # the vector from the first tag to the second


@cache
def ekf():
    return compile_block(AugmentedEkf(SMALL, BOTH(IMU, TAGS), use=("imu", "tags")), "c")


def after(belief, seconds, place=None, u=(0.3, 0.0, 0.0)):
    """Return the belief after a drive of `seconds`; at its end a tag is read `place` away from the estimate."""
    for k in range(round(100 * seconds)):
        last = k == round(100 * seconds) - 1 and place is not None
        t_ns = int(belief.t_ns) + 10_000_000 if belief.t_ns >= 0 else 10_000_000
        tag = Slot(1.0, position(belief, t_ns, u)[:2] + place) if last else Slot(0.0, np.zeros(2))
        belief, _ = ekf().step(belief, Tick(t_ns, np.array(u), BOTH(Slot(1.0, np.zeros(3)), tag)))
    return belief


def position(belief, t_ns, u):
    """Return the estimated position one tick later."""
    silence = BOTH(Slot(1.0, np.zeros(3)), Slot(0.0, np.zeros(2)))
    return ekf().step(belief, Tick(t_ns, np.array(u), silence))[0].mean


def moved_by(belief, seconds, place):
    """Return the correction (2,) that a reading causes, and the belief after it."""
    posterior = after(belief, seconds, place)
    return posterior.mean[:2] - after(belief, seconds).mean[:2], posterior


@pytest.fixture(scope="module")
def driving():
    return after(ekf().init(), 2.0)


def test_a_consistent_tag_is_accepted(driving):
    correction_m, posterior = moved_by(driving, LATER, np.array([0.02, 0.0]))
    assert correction_m == pytest.approx([0.02, 0.0], abs=1e-3)
    assert np.sqrt(posterior.cov[0, 0]) == pytest.approx(0.01, rel=0.1)


def test_a_confused_tag_does_not_move_the_estimate_if_one_coordinate_agrees(driving):
    correction_m, posterior = moved_by(driving, LATER, np.array([2.0, 0.005]))
    assert correction_m == pytest.approx(np.zeros(2), abs=1e-3)
    assert posterior.cov == pytest.approx(after(driving, LATER).cov, rel=0.01, abs=1e-6)


def test_two_confused_tags_are_rejected_and_the_next_correct_tag_is_accepted(driving):
    """The same tag is confused with the same other tag twice, as if the vehicle had been carried."""
    first_belief, twice = after(driving, LATER, OTHER), after(after(driving, LATER, OTHER), LATER, OTHER)
    silent = after(after(driving, LATER), LATER)
    for x in (twice, after(first_belief, LATER, -OTHER)):
        assert x.mean[:2] == pytest.approx(silent.mean[:2], abs=2e-3)
        assert x.cov == pytest.approx(silent.cov, rel=0.02, abs=1e-6)
    correction_m, _ = moved_by(twice, LATER, np.array([0.02, 0.0]))
    assert correction_m == pytest.approx([0.02, 0.0], abs=2e-3)


def test_a_confused_tag_read_twice_counts_once(driving):
    belief = driving
    for _ in range(2):
        belief = after(after(belief, LATER, OTHER), SOON, OTHER)
    assert belief.memory.pose.history.mistake_count == pytest.approx([2.0])
    assert belief.memory.pose.history.confirmation == pytest.approx([0.0])


def test_four_equal_tag_readings_relocate_a_carried_vehicle(driving):
    belief = driving
    for _ in range(3):
        correction_m, belief = moved_by(belief, LATER, OTHER)
        assert correction_m == pytest.approx(np.zeros(2), abs=2e-3)
    correction_m, _ = moved_by(belief, LATER, OTHER)
    assert correction_m == pytest.approx(OTHER, abs=0.05)


def test_an_uncertain_estimate_accepts_the_likelier_tag():
    """With 0.3 m of standard deviation the other tag is 3.3 deviations away, within the gate."""
    start = after(ekf().init(), 1.0, u=(0.0, 0.0, 0.0))
    uncertain = start._replace(cov=start.cov + np.diag([0.09, 0.09, *np.zeros(len(start.mean) - 2)]))
    correction_m, _ = moved_by(uncertain, SOON, np.array([0.01, 0.02]) + OTHER)
    assert np.hypot(*correction_m) < 0.1
    correction_m, _ = moved_by(uncertain, SOON, np.array([0.25, -0.3]))
    assert correction_m == pytest.approx([0.25, -0.3], abs=0.02)


def test_the_second_consistent_tag_relocates_a_carried_vehicle(driving):
    carried_m = np.array([0.6, -0.5])
    correction_m, doubting = moved_by(driving, LATER, carried_m)
    assert correction_m == pytest.approx(np.zeros(2), abs=1e-3)
    correction_m, posterior = moved_by(doubting, LATER, carried_m + 0.01)
    assert correction_m == pytest.approx(carried_m, abs=0.05)
    assert posterior.cov[2, 2] > 10.0 * doubting.cov[2, 2], "the heading may be wrong too"
    correction_m, _ = moved_by(posterior, LATER, np.array([0.01, 0.02]))
    assert np.all(np.abs(correction_m) > 0.005)


def test_a_repeated_reading_is_not_a_second_confirmation(driving):
    offset = np.array([1.0, 0.3])
    doubting = after(driving, LATER, offset)
    correction_m, second_m = moved_by(doubting, SOON, offset)
    assert correction_m == pytest.approx(np.zeros(2), abs=1e-3)
    correction_m, _ = moved_by(second_m, REPEAT_S + 0.1, offset)
    assert correction_m == pytest.approx(offset, abs=0.05)


def test_two_contradicting_tags_widen_the_region_and_the_third_decides(driving):
    doubting = after(driving, LATER, np.array([2.0, 0.0]))
    correction_m, second_m = moved_by(doubting, LATER, np.array([-2.0, 0.0]))
    assert correction_m == pytest.approx(np.zeros(2), abs=0.02)
    assert np.sqrt(second_m.cov[0, 0]) > 0.4
    correction_m, _ = moved_by(second_m, LATER, np.array([0.3, 0.1]))
    assert correction_m == pytest.approx([0.3, 0.1], abs=0.03)


def test_contradicting_tags_do_not_widen_scales_or_biases_beyond_their_prior(driving):
    belief = after(after(driving, LATER, np.array([50.0, 0.0])), LATER, np.array([-50.0, 0.0]))
    start = np.sqrt(np.diag(ekf().init().cov))
    std = np.sqrt(np.diag(belief.cov))
    assert np.all(std[SCALE_INDEX:] <= start[SCALE_INDEX:] * (1.0 + 1e-9))
    assert std[2] <= TURN_STD * 1.01
    assert len(std) == BIAS_INDEX + 3
    assert np.linalg.eigvalsh(belief.cov)[0] > 0.0


def test_an_accepted_tag_resets_an_earlier_contradiction(driving):
    offset, origin = np.array([1.0, 0.3]), np.zeros(2)
    calm = after(after(driving, LATER, offset), LATER, origin)
    correction_m, _ = moved_by(calm, LATER, offset)
    assert correction_m == pytest.approx(np.zeros(2), abs=1e-3)


def test_a_permanent_camera_jump_is_followed_after_one_second():
    """At 25 poses a second, the measured position jumps by 1 m and stays there."""
    sensors = sensor_slots(("imu", "pose"))
    block = compile_block(
        AugmentedEkf(SMALL, sensors(IMU, Pose(noise_std=np.full(3, 0.01))), use=("imu", "pose")), "c"
    )
    belief, results = block.init(), {}
    for k in range(1, 600):
        slot = Slot(float(k % 4 == 0), np.array([1.0 if k > 200 else 0.0, 0.0, 0.0]))
        belief, estimate = block.step(
            belief, Tick(k * 10_000_000, np.zeros(3), sensors(Slot(1.0, np.zeros(3)), slot))
        )
        results[k] = estimate.eta[0]
    assert abs(results[295]) < 0.05
    assert results[330] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("m", [1, 2, 3])
def test_the_normalised_square_equals_the_result_with_the_inverse_matrix(m):
    rng = np.random.default_rng(m)
    L, y = rng.normal(size=(m, m)), rng.normal(size=m)
    S = L @ L.T + np.eye(m)
    assert squared_distance(S, y) == pytest.approx(y @ np.linalg.inv(S) @ y)
