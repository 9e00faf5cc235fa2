"""`baqueano study driving` on one robot: the controller is judged by the independent truth."""

import pytest

from baqueano.study import driving
from baqueano.study.driving import Driving, LapErrors


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
    good = LapErrors("pose", "eight", 0.2, 0, 0.01, 0.01, 0.0, 0.0, 0.003, 0.0)
    late = good._replace(seed=1, across_m=0.02, sign_changes=2.0)
    study = Driving((good, late), 2, ())
    assert study.verdict == "WARN"
    across, signs = study.reasons
    assert across.startswith("pose, eight at 0.2 m/s: across_m 19")
    assert across.endswith("at most 6 mm")
    assert signs == "pose, eight at 0.2 m/s: sign_changes 2, expected 0"
