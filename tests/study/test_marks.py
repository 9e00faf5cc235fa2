"""`baqueano study marks`: tags that the truth reads, and laps over them that stay bounded and as claimed."""

import numpy as np
import pytest

from baqueano.study import driving, marks
from baqueano.study.corridor.vehicles import vehicles
from baqueano.study.marks.drives import STEP_S, Laps
from baqueano.study.marks.result import Marks, laps_of
from baqueano.study.truth import Floor, TagFaults, TruthWorld, draw_robots
from baqueano.symbolic import function

TWO = np.array([[1.0, 0.0], [2.0, 1.0]])


def readings_of(floor, way):
    """The readings of one vehicle along a way (T, 2), by the index of its step."""
    readings = [floor.read(0.01 * (k + 1), xy[None])[0] for k, xy in enumerate(way)]
    return {k: z for k, z in enumerate(readings) if not np.isnan(z[0])}


def floor(seed=0, faults=TagFaults(), noise=0.0):  # noqa: B008 a tuple
    return Floor(TWO, 0.1, noise, [seed], np.array([[0.0, 0.05]]), faults)


def line(y, n=300):
    return np.column_stack([np.linspace(0.01, 3.0, n), np.full(n, y)])


def test_a_tag_is_read_once_at_the_nearest_point():
    readings = readings_of(floor(), line(0.05))
    ((k, z),) = readings.items()
    assert z == pytest.approx([1.0, 0.05], abs=0.02)
    assert 99 <= k <= 101
    assert readings_of(floor(), line(0.11)) == {}


def test_tag_faults_occur_at_the_specified_rate():
    ways = [readings_of(floor(seed, TagFaults(0.2, 0.1, 0.05)), line(0.05)) for seed in range(400)]
    counts = np.bincount([len(way) for way in ways], minlength=3)
    assert counts[0] / 400 == pytest.approx(0.2, abs=0.06)
    assert counts[2] / 400 == pytest.approx(0.08, abs=0.05)
    mistaken = [way for way in ways if way and abs(next(iter(way.values()))[0] - 2.0) < 0.05]
    assert len(mistaken) / 400 == pytest.approx(0.04, abs=0.03)


def test_longer_compiled_steps_of_the_truth_give_the_same_path():
    robots = draw_robots(1, 4)
    robots = robots.changed(floor=0.0 * robots.floor)
    worlds = [
        TruthWorld(robots, [1], step_s=step_s, fast=fast)
        for step_s, fast in ((1e-3, slow), (STEP_S, function))
    ]
    rng = np.random.default_rng(0)
    for _ in range(20):
        u = np.array([[rng.uniform(0.3, 0.8), 0.0, rng.uniform(-0.3, 0.3)]])
        for world in worlds:
            for _ in range(50):
                world.tick(u, 0.01)
    assert worlds[0].truth.eta[0] == pytest.approx(worlds[1].truth.eta[0], abs=2e-3)


def test_the_compiled_truth_equals_the_truth():
    robots, u = vehicles(range(3)), np.array([[0.6, 0.0, 0.1], [0.5, 0.0, -0.3], [-0.7, 0.0, 0.0]])
    plain, compiled = (TruthWorld(robots, [1, 2, 3], fast=fast) for fast in (slow, function))
    for _ in range(100):
        z = plain.tick(u, 0.01), compiled.tick(u, 0.01)
        assert z[0] == pytest.approx(z[1], abs=1e-12)
    assert plain.truth.eta == pytest.approx(compiled.truth.eta, abs=1e-12)


def slow(f, *examples):
    return f


@pytest.mark.long
def test_laps_over_two_tags_have_bounded_errors_within_their_covariance(monkeypatch):
    """A gyro known to 3 % alone turns the heading by up to 43° in four laps."""
    monkeypatch.setattr(driving, "EXPERIMENT_S", 40.0)
    monkeypatch.setattr(marks, "LEARNED", 3)
    study = marks.marks(1, 40, 4, shapes=("rectangle",), read=("all read",))
    assert (study.verdict, study.refused) == ("USABLE", ())
    later = study.rows()[-1]
    assert later["lap"] == "4-4"
    assert later["position_worst_m"] < 0.05
    assert np.degrees(later["heading_worst_rad"]) < 3.0
    assert later["within"] > 0.95
    assert later["claimed_m"] < 0.10


def marks_of(error_m, sd_m, laps=5, across_m=0.02, reading_mode="all read"):
    """Laps of two robots that are always so far off in x, and so far beside the route."""
    error = np.tile([error_m, 0.0, 0.0], (10 * laps, 2, 1))
    cov = np.tile(np.diag([sd_m**2, sd_m**2, 1e-4]), (10 * laps, 2, 1, 1))
    across = np.tile([across_m, -0.01], (10 * laps, 1))
    laps_per_run = Laps(error, cov, across, np.zeros(2, bool), ())
    return Marks(tuple(laps_of(laps_per_run, "eight", reading_mode, [3, 4], laps)), 2, laps, ())


def test_a_robot_beside_its_route_fails_the_study_despite_faults():
    study = marks_of(0.02, 0.02, across_m=-0.12, reading_mode="faults")
    assert study.rows()[-1]["kept"] == 0.5
    assert "eight, faults: 50% of the robots keep the route, 90 % expected" in study.reasons
    assert marks_of(0.02, 0.02).rows()[-1]["kept"] == 1.0
    assert "eight, all read, lap 3: 19 cm beside the route, 10 cm expected" in marks_of(0, 1, 3, 0.2).reasons


def test_a_too_small_covariance_is_named_by_the_study():
    assert marks_of(0.02, 0.02).verdict == "USABLE"
    sure = marks_of(0.05, 0.01)
    assert sure.verdict == "WARN"
    assert "eight, all read: 0% within the 95 % region" in sure.reasons[0]
    assert "NEES 8.33" in sure.reasons[1]
    assert "the estimate is 20 cm off, 10 cm expected" in marks_of(0.2, 0.2).reasons[0]
    assert [row["lap"] for row in marks_of(0.02, 0.02).rows()] == ["1", "2", "3", "5", "4-5"]
    assert "all bounds are kept" in marks_of(0.02, 0.02).table()
