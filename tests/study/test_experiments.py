"""The tables of experiments and first drives: their arithmetic, and what they hold against themselves."""

import json

import numpy as np
import pytest

from baqueano.study.experiments import Drawn, Experiments, _rows
from baqueano.study.first_drives import FirstDrives
from baqueano.study.first_drives import Row as First


def drawn(*errors, margin_m=0.1):
    return Drawn(np.array(errors), np.full(20, margin_m), 5.0)


def test_a_row_tells_how_many_times_better_and_where_another_is_better():
    found = {"designed": drawn(0.01, 0.02), "random_steps": drawn(0.02, 0.04), "prbs": drawn(0.03, 0.01)}
    rows = {row.signal: row for row in _rows("all", "", found)}
    assert rows["designed"].ratio == pytest.approx(2.0)
    assert rows["designed"].above_best == 1
    table = Experiments(tuple(rows.values()), 60.0)
    assert table.verdict == "WARN"
    assert table.reasons == ("of 1 vehicles another signal tells more",)
    assert "2.00×" in table.table()
    assert [row["signal"] for row in table.rows()] == ["designed", "random_steps", "prbs"]
    assert json.dumps(table.rows(), allow_nan=False)


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (drawn(0.019), "1.05 times better than random steps, not 1.5"),
        (drawn(0.01)._replace(seconds=11.0), "took 11.0 s, more than a sixth of 60 s"),
    ],
)
def test_what_a_design_does_not_reach_is_said(made, said):
    rows = _rows("all", "", {"designed": made, "random_steps": drawn(0.02)})
    assert said in Experiments(tuple(rows), 60.0).reasons[0]


@pytest.mark.parametrize("signal", ["designed", "random_steps", "prbs"])
def test_a_body_that_left_the_room_is_counted_under_every_signal(signal):
    found = {"designed": drawn(0.01), "random_steps": drawn(0.02), "prbs": drawn(0.03)}
    whole = _rows("all", "", found)
    rows = _rows("small", "2x2", {**found, signal: found[signal]._replace(margins=np.full(20, -0.01))})
    assert {row.signal: row.left for row in rows} == {**dict.fromkeys(found, 0), signal: 20}
    assert "in 20 drives the body left the room" in Experiments((*rows, *whole), 60.0).reasons


def test_a_touched_wall_refuses_the_first_drive():
    good = First("well", 10, 0, 0.5, 10, 1.2, 60.0)
    assert FirstDrives((good,)).verdict == "USABLE"
    assert FirstDrives((good,)).rows() == [good._asdict()]
    assert FirstDrives((good._replace(named=9),)).verdict == "WARN"
    assert FirstDrives((good._replace(touched=1),)).verdict == "REFUSED"
    assert "touched a wall" in FirstDrives((good._replace(touched=1),)).table()
