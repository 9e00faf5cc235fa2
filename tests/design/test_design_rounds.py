"""An unknown vehicle is identified step by step: a careful first drive, then rounds of design, drive and fit."""

import numpy as np
import pytest
from scipy.stats import binom

from baqueano.cli.driving.iterate import drive_in_rounds
from baqueano.cli.driving.targets import LocalTarget
from baqueano.design import plan as planning
from baqueano.design.plan import design_plan
from baqueano.drive import first_drive, with_rough_gains
from baqueano.errors import UsageError
from baqueano.identify import FitOptions, identify
from baqueano.identify.result import assemble as summary
from baqueano.routes.room import vehicle_room

SURE = ("model.friction.linear[0]", "model.actuator_matrix[0,0]", "model.actuator_matrix[2,2]")


@pytest.fixture(scope="module")
def truth(small):
    return small.with_values(
        {
            "model.actuator_matrix": (small.vehicle.actuator_matrix * 1.2).tolist(),
            "model.friction.linear": (small.vehicle.friction.linear * np.array([0.8, 1.0, 1.25])).tolist(),
        }
    )


@pytest.fixture(scope="module")
def careful_drive(small, truth):
    """Return the first drive of an unknown vehicle, and its fit."""
    first = first_drive(small, truth=truth, seed=0)
    return first.run, identify([first.run], with_rough_gains(first, small))


@pytest.fixture(scope="module")
def rounds_of_design(small, truth, careful_drive, tmp_path_factory):
    folder, size = tmp_path_factory.mktemp("runs"), "2x2"
    with pytest.MonkeyPatch.context() as patch:
        for name, number in (
            ("FIRST_PRIMITIVES", 60),
            ("ROUNDS", 2),
            ("PRIMITIVES_PER_ROUND", 20),
            ("FINAL_PRIMITIVES", 40),
        ):
            patch.setattr(planning, name, number)
        file, runs = careful_drive[1].vehicle_file, [careful_drive[0]]
        design = lambda now, seed: design_plan(now, vehicle_room(now, size), 10.0, seed=seed).u  # noqa: E731
        place = LocalTarget(lambda: {"truth": truth})
        rounds = drive_in_rounds(
            file, place, runs, 2, design, 0, "auto", lambda label: folder / f"{label}.mcap"
        )
    return rounds, runs, vehicle_room(small, size)


def test_error_bars_shrink_from_round_to_round(rounds_of_design, small, truth):
    """These error bars assume the same noise along the run: the design reduces them."""
    _, runs, _ = rounds_of_design
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(summary, "with_larger_errors", lambda problem, cov, pieces, k, by_segment: cov)
        fits = [identify(runs[:k], small, options=FitOptions(diagnose=False)) for k in (2, 3)]
    for name in SURE:
        first, second = (fit.std[fit.names.index(name)] / fit.value(name) for fit in fits)
        assert 0.0 < second < first < 0.1, name


def test_reported_error_bars_after_the_rounds_are_smaller_than_after_the_careful_drive(
    rounds_of_design, careful_drive
):
    """Between two rounds a bar may grow: it contains the scatter between parts of the runs."""
    last, careful = rounds_of_design[0].rounds[-1], careful_drive[1]
    for name in SURE:
        before = careful.std[careful.names.index(name)] / abs(careful.value(name))
        assert 0.0 < last.relative_std(name) < 0.6 * before, name


def test_id14_error_bars_of_each_round_cover_the_true_parameters(rounds_of_design, truth):
    """Five or more of 19 independent intervals of 95 % miss the truth in 2 of 1,000 fits."""
    rounds, _, _ = rounds_of_design
    for design_round in rounds.rounds:
        true_values = np.array([truth.value(name) for name in design_round.fit.names])
        is_inside = np.abs(design_round.fit.estimate - true_values) < 1.96 * design_round.fit.std
        finite = np.isfinite(design_round.fit.std)
        assert np.mean(is_inside[finite]) > 0.75
        assert np.sum(~is_inside[finite]) <= binom.isf(0.005, np.sum(finite), 0.05)
        for name in SURE:
            assert 0.0 < design_round.relative_std(name) < 0.1, name


def test_the_last_round_identifies_the_driven_vehicle(rounds_of_design, truth):
    fit = rounds_of_design[0].rounds[-1].fit
    for name, x in (
        ("[0,0]", truth.vehicle.actuator_matrix[0, 0]),
        ("[2,2]", truth.vehicle.actuator_matrix[2, 2]),
    ):
        name = f"model.actuator_matrix{name}"
        assert abs(fit.value(name) - x) < 4.0 * fit.std[fit.names.index(name)]


def test_no_design_round_touches_a_wall(rounds_of_design):
    _, runs, room = rounds_of_design
    assert len(runs) == 3
    for run in runs:
        assert np.all(np.abs(run.truth.eta[:, :2]) <= room.free_half_width_m)


def test_the_table_lists_every_round(rounds_of_design):
    rounds, _, _ = rounds_of_design
    assert {row["round"] for row in rounds.rows()} == {1, 2}
    assert "round 2" in rounds.table().splitlines()[0]
    assert rounds.verdict in ("USABLE", "WARN")


@pytest.mark.parametrize(
    ("options", "expected"),
    [({"signal": "prbs", "rounds": 2, "update": False}, "Type: --signal designed"),
     ({"signal": "designed", "rounds": None, "update": True}, "without a fit there is nothing to write")],
)  # fmt: skip
def test_contradicting_options_are_refused(options, expected):
    from baqueano.cli.driving.experiment import _check_options

    with pytest.raises(UsageError, match=expected):
        _check_options(**options)
