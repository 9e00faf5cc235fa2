"""The study of controllers: the same robots, routes and noise for each, judged by pose, estimate and truth."""

import numpy as np
import pytest

from baqueano.diagnostics import Verdict
from baqueano.errors import BaqueanoError
from baqueano.estimators import TrueState
from baqueano.guides.shapes import rectangle
from baqueano.signals import Tick
from baqueano.study.controllers import controllers
from baqueano.study.controllers.drives import ComparedController, start_at_origin
from baqueano.study.controllers.result import EVALUATIONS, Controllers
from baqueano.study.counterpart import LoopWorld
from baqueano.study.truth import draw_robots
from baqueano.sweep.error_segments import ErrorSegments
from baqueano.sweep.result import SweepCombination, SweepDrive, SweepResult
from baqueano.vehicle_file import load


def test_the_ideal_estimator_returns_the_pose_of_the_world():
    world = LoopWorld(draw_robots(1, 0), 0, 100.0)
    estimator = TrueState(lambda: world.motion)
    (tick, *_), truths = world.read(10_000_000), world.new_truths()
    _, estimate = estimator.step(estimator.init(), tick)
    assert isinstance(tick, Tick)
    assert estimate.t_ns == truths[-1][0]
    np.testing.assert_array_equal(estimate.eta, truths[-1][1].eta)
    np.testing.assert_array_equal(estimate.cov, 0.0)


def test_moving_a_route_to_the_origin_preserves_its_shape():
    route = rectangle(1.2, 0.8, 0.2, 0.2)
    moved_route = start_at_origin(route)
    np.testing.assert_allclose(moved_route.eta[0], 0.0, atol=1e-12)
    lengths = [np.hypot(*np.diff(path.eta[:, :2], axis=0).T).sum() for path in (route, moved_route)]
    assert lengths[0] == pytest.approx(lengths[1])
    np.testing.assert_allclose(np.diff(moved_route.eta[:, 2]), np.diff(route.eta[:, 2]), atol=1e-12)


def result(best: float, bound: tuple[str, ...] = (), stop_code: str = "", drives: int = 10) -> Controllers:
    """Return ten drives of the paper's PD and of a controller with `best` times its error."""
    rng, drive_results = np.random.default_rng(0), []
    for label, part in (("pd", 1.0), ("mine", best)):
        for k in range(drives):
            e = part * 0.02 * np.exp(0.02 * rng.standard_normal())
            pieces = {"across_rms_m": ErrorSegments((1000.0 * e * e,), (1000.0,))}
            drive_results.append(
                SweepDrive(
                    SweepCombination(label, "", label, ""),
                    f"robot {k}",
                    {"across_rms_m": e},
                    pieces,
                    stop_code,
                )
            )
    result_of = SweepResult(tuple(drive_results), 0, "pd")
    controllers = (
        ComparedController("pd", "pd", {"alpha": 1.0}, ()),
        ComparedController("mine", "my.py:Mine", {"k": 1.0}, bound),
    )
    return Controllers(dict.fromkeys(EVALUATIONS, result_of), controllers, 10, ())


def test_the_verdict_lists_the_code_of_each_missed_requirement():
    assert (result(0.2).verdict, result(0.2).reasons) == (Verdict.USABLE, ())
    assert [reason.code for reason in result(0.5).reasons] == ["study.not-a-third"]
    assert [reason.code for reason in result(0.2, ("k",)).reasons] == ["study.gain-at-bound"]
    assert [reason.code for reason in result(0.2, stop_code="stop.room").reasons] == ["study.stopped"] * 2
    assert [reason.code for reason in result(0.2, drives=4).reasons] == ["study.no-interval"]
    assert result(0.2, drives=4).verdict == Verdict.CANNOT_TELL
    row = result(0.2).rows()[1]
    assert row["pose_low"] < 0.2 < row["pose_high"] < 0.21
    assert len(result(0.2).table().splitlines()) == 7


def test_the_gains_of_an_array_are_set_entry_by_entry():
    law = ComparedController("lqr", "lqr", {"e_max[1]": 0.01, "change_max[0]": 0.3}, ()).controller(
        load("small")
    )
    assert (law.e_max[1], law.change_max[0]) == (0.01, 0.3)
    assert (
        ComparedController("pd", "pd", {"alpha": 3.0, "beta": 1.0}, ()).controller(load("small")).alpha == 3.0
    )


def test_an_unknown_controller_is_refused_before_the_first_drive():
    with pytest.raises(BaqueanoError, match="nobody"):
        controllers(
            1,
            kinds=("pd",),
            user_blocks=("nobody.py:Mine",),
            starts=1,
            advance=lambda k: pytest.fail("a drive was done"),
        )


MINE = '''
from baqueano.controllers import Kanayama


class Mine(Kanayama):
    """Kanayama's, under a name of mine."""
'''


@pytest.mark.long
def test_the_paper_pd_and_a_custom_controller_drive_the_same_robot(tmp_path, monkeypatch):
    (tmp_path / "my.py").write_text(MINE, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    study = controllers(1, 3, kinds=("pd",), user_blocks=("my.py:Mine",), starts=1)
    rows = study.rows()
    assert [row["controller"] for row in rows] == ["pd", "pd, draws", "my.py:Mine"]
    assert rows[2]["pose_median_m"] < 0.5 * rows[1]["pose_median_m"]
    assert rows[2]["truth_median_m"] > rows[2]["estimate_median_m"]  # the drift hides the controller
    assert {d.name for d in study.drives["pose"].drives} == {"robot 3, sinuous", "robot 3, rectangle"}
