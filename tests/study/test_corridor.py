"""`baqueano study corridor`: its requirements, and one vehicle of the independent truth from its experiment to its
drive.
"""

import numpy as np
import pytest

from baqueano.compare.corridor import MAX_HEADING_STD_RAD
from baqueano.study import corridor, driving
from baqueano.study.corridor import drives
from baqueano.study.corridor.result import Instant, drive_corridors
from baqueano.study.corridor.vehicles import BIAS_WALK, SCALE_TOLERANCE, vehicles
from baqueano.study.truth import TruthWorld


def cases(n, claim_m, rng, heading=0.1):
    """Return errors with deviations of 1 m and 0.1 rad, claimed to be `claim_m` times as large."""
    cov = claim_m**2 * np.diag([1.0, 1.0, heading**2])
    return [("10 s", Instant(rng.standard_normal(3) * [1.0, 1.0, heading], cov)) for _ in range(n)]


@pytest.mark.parametrize(("claim_m", "ok"), [(1.0, True), (0.8, False), (1.3, False)])
def test_the_study_passes_only_if_the_region_has_the_correct_size(claim_m, ok):
    study = drive_corridors(cases(500, claim_m, np.random.default_rng(0)), 500, ())
    assert [row["ok"] for row in study.rows()] == [ok, ok]
    assert (study.verdict == "USABLE") is ok
    assert all("at 10 s: coverage" in reason for reason in study.reasons)


def test_a_study_of_few_vehicles_seldom_fails_by_chance():
    misses = 0
    for seed in range(100):
        study = drive_corridors(cases(20, 1.0, np.random.default_rng(seed)), 20, ())
        misses += any(row["ok"] is False for row in study.rows())
    assert misses <= 10  # two rows of 5 % at most each


def test_a_lost_vehicle_is_counted_and_not_judged():
    rng = np.random.default_rng(1)
    lost_cases = [
        (name, case._replace(cov=np.eye(3) * MAX_HEADING_STD_RAD**2 * 1.01))
        for name, case in cases(5, 1.0, rng)
    ]
    (row, _) = drive_corridors([*cases(12, 1.0, rng), *lost_cases], 17, ()).rows()
    assert (row["cases"], row["lost_cases"]) == (12, 5)


def test_the_study_vehicles_have_the_imu_of_a_data_sheet():
    robots = vehicles(range(40))
    error = robots.imu.gyro_scale - 1.0
    assert np.all(np.abs(error) <= SCALE_TOLERANCE)
    assert np.std(error) == pytest.approx(SCALE_TOLERANCE / np.sqrt(3.0), rel=0.2)
    assert np.all(robots.imu.walk == [0.0, 0.0, BIAS_WALK])
    assert np.abs(np.diff(robots.wheel, axis=1)) == pytest.approx(np.full((40, 1), 0.02))


@pytest.mark.long
def test_an_identified_vehicle_drives_inside_its_corridor(monkeypatch):
    monkeypatch.setattr(driving, "EXPERIMENT_S", 30.0)
    monkeypatch.setattr(drives, "DRIVE_S", 12.0)
    study = corridor.corridor(1, 3)
    assert (study.vehicles, study.refused_robots) == (1, ())
    assert list(study.instants) == ["10 s"]
    assert [row["coverage"] for row in study.rows()] == [1.0, 1.0]
    assert "10 s" in study.table()


def test_a_fit_to_an_imu_gives_the_speed_straight_ahead_of_a_robot_with_drag_in_turns():
    """The speed is seen only in turns; without their drag the straight drive was 11 % too slow."""
    robots, commands = vehicles([9104]), np.array([0.52, 0.0, 0.0])
    assert robots.cornering[0] > 0.05
    (run,) = driving.simulate_experiments(robots, range(9104, 9105))
    model = driving.identify_by_advice(run, driving.initial_file()).vehicle_file.vehicle
    world, state = TruthWorld(robots, [1], np.zeros((1, 3))), model.init()
    for _ in range(200):
        world.tick(commands[None], 0.01)
        state = model.step(state, commands, 0.01, np.zeros(3))[0]
    speed = world.truth.nu[0, 0]
    assert 0.1 < speed < 0.3
    assert state.nu[0] == pytest.approx(speed, rel=0.07)
