"""`baqueano study driving` on one robot: the controller is judged by the independent truth."""

import numpy as np
import pytest

from baqueano.guides import Repeat
from baqueano.guides.shapes import circle, line
from baqueano.study import driving
from baqueano.study.driving import Driving, LapErrors
from baqueano.study.truth import draw_robots, merge
from baqueano.study.truth_drives import Loop, simulate_drives


@pytest.mark.long
def test_an_identified_robot_drives_evenly_on_independent_physics(monkeypatch):
    monkeypatch.setattr(driving, "EXPERIMENT_S", 40.0)
    monkeypatch.setattr(driving, "SHAPES", {"rectangle": driving.SHAPES["rectangle"]})
    study = driving.driving(1, 40, cases=("imu", "pose", "breakaway"), speeds=(0.3,))
    assert [row["case"] for row in study.rows()] == ["imu", "pose", "breakaway"]
    assert (study.verdict, study.refused_robots) == ("USABLE", ())
    assert all(row["unevenness_worst"] < 0.02 for row in study.rows())
    assert "all limits are met" in study.table()


def test_a_lap_beyond_a_limit_is_reported_with_its_figure():
    figures = LapErrors("pose", "eight", 0.2, 0, 0.01, 0.01, 0.0, 0.0, 0.003, 0.0)
    second = figures._replace(seed=1, across_m=0.02, sign_changes=2.0)
    study = Driving((figures, second), 2, ())
    assert study.verdict == "WARN"
    distance, signs = study.reasons
    assert distance.startswith("pose, eight at 0.2 m/s: across_m 19")
    assert distance.endswith("at most 6 mm")
    assert signs == "pose, eight at 0.2 m/s: sign_changes 2, expected 0"


@pytest.fixture(scope="module")
def fitted_robots():
    """Return two robots of the independent truth, and their vehicle files fitted to 40 s."""
    robots = merge([draw_robots(1, seed) for seed in (40, 42)])
    runs = [run.cut(0.0, 40.0) for run in driving.simulate_experiments(robots, range(40, 42))]
    return robots, [driving.identify_by_advice(run, driving.initial_file()).vehicle_file for run in runs]


@pytest.mark.parametrize("perfect", [True, False])
def test_a_drawn_line_ends_at_rest_on_independent_physics(fitted_robots, perfect):
    """Without braking the robots pass the end at 0.2 m/s: the last tick is 26 mm before it with a known pose."""
    robots, files = fitted_robots
    loops = [Loop(file, perfect, "auto") for file in files]
    guide = Repeat.along(line(1.0, 0.2))
    drives = simulate_drives(loops, robots, guide, guide.duration_s, [41, 43])
    x, _, _, speed = drives.truth[-1].T
    assert np.all(speed < 0.05)
    assert np.all(np.abs(1.0 - x) < (0.01 if perfect else 0.04))


@pytest.mark.parametrize("perfect", [True, False])
def test_a_drawn_circle_begins_at_rest_on_independent_physics(fitted_robots, perfect):
    """At full speed from the first tick, the robots were 6 mm beside the circle and up to 0.021 m/s too fast."""
    robots, files = fitted_robots
    loops = [Loop(file, perfect, "auto") for file in files]
    radius_m, speed = 0.4, 0.3
    drives = simulate_drives(loops, robots, Repeat.along(circle(radius_m, speed)), 3.0, [41, 43])
    x, y, _, v = np.moveaxis(drives.truth, 2, 0)
    v_r = np.array([reference.nu[0] for reference in drives.references])
    assert np.all(np.abs(v - v_r[:, None]) < 0.06)
    assert np.all(v - speed < 0.006)
    assert np.all(np.abs(np.hypot(x, y - radius_m) - radius_m) < (0.001 if perfect else 0.004))
