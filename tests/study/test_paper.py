"""Case study I at seed 0, which was not selected: the table, its signs, unobservable parameters, and the errors.

Three of the fifteen parameters are unobservable. One of the other twelve estimates deviates by more than 4.5
standard errors with probability 8e-5.
"""

import numpy as np
import pytest

from baqueano.report import Headline
from baqueano.study.paper import dynamic_vs_kinematic
from baqueano.study.paper.case_study import (
    PRINTED_VALUES,
    CaseStudy,
    ImpliedParameters,
    case_study,
    simulate_seed,
)
from baqueano.study.paper.page import paper_page

NAMES = [f"d_{a}{b}" for a in "lc" for b in ("x", "y", "psi")] + [
    f"T_{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)
]


@pytest.fixture(scope="module")
def study():
    return case_study(0)


def test_rows_have_the_order_and_values_of_the_paper(study):
    rows = study.rows()
    assert [row["name"] for row in rows] == NAMES
    assert all(set(row) == {"name", "truth", "paper", "estimate", "std"} for row in rows)
    assert {row["name"]: row["paper"] for row in rows} == PRINTED_VALUES


def test_friction_is_negative_as_in_the_paper(study):
    for row in study.rows()[:6]:
        assert row["truth"] < 0
        assert row["estimate"] < 0
        assert row["std"] > 0


def test_the_truth_has_the_parameters_of_the_paper(study):
    truth = {row["name"]: row["truth"] for row in study.rows()}
    assert truth["d_lx"] == -7.0
    assert truth["d_cx"] == -3.5
    assert truth["T_11"] == 1.0
    assert truth["T_33"] == pytest.approx(29.99)


def test_gains_of_the_absent_sideways_actuator_have_no_estimate(study):
    unobservable_names = {row["name"] for row in study.rows() if row["estimate"] is None}
    assert unobservable_names == {"T_12", "T_22", "T_32"}
    assert all(row["std"] is None for row in study.rows() if row["estimate"] is None)


def test_no_parameter_error_exceeds_4_5_standard_errors(study):
    assert len(study.normalised_errors) == 12
    assert np.abs(study.normalised_errors).max() < 4.5
    assert study.verdict == "USABLE"


def test_all_standard_errors_except_d_cy_are_below_one_percent(study):
    for row in study.rows():
        if row["truth"] and row["estimate"] is not None and row["name"] != "d_cy":
            assert row["std"] < 0.01 * abs(row["truth"]), row


def test_the_table_shows_both_errors_and_unobservable_parameters(study):
    table = study.table()
    assert table.count("not identifiable") == 3
    assert "-7.30 %" in table  # d_lx of the paper
    assert table.endswith("verdict: USABLE")


def test_a_fit_with_large_errors_is_not_called_usable(study, monkeypatch):
    monkeypatch.setattr(CaseStudy, "normalised_errors", property(lambda self: np.array([0.1, 5.0])))
    assert study.verdict == "WARN"


def test_the_dynamic_model_predicts_accelerations_better_than_the_kinematic_model(study):
    run, unseen_run = simulate_seed(0)[1], simulate_seed(1_000)[1]
    models = dynamic_vs_kinematic.compare_models(study.fits[0], run, unseen_run)
    dynamic, kinematic = dynamic_vs_kinematic.rows(models)
    assert dynamic["R: ν̇_x [m/s²]"] < kinematic["R: ν̇_x [m/s²]"]
    assert "kinematic" in dynamic_vs_kinematic.table(models)
    page = paper_page(study, models)
    assert [type(h) for h in page.headlines] == [Headline, Headline]
    text = page.html()
    assert "http-equiv" not in text
    assert "fig. acceleracion_simulacion" in text
    assert "fig. evaluacion_real" in text


def test_case_study_two_is_printed_with_its_physical_consequences():
    rows = ImpliedParameters().rows()
    assert "33.1 m" in rows[0]["implies"]
    assert "51 ms" in rows[1]["implies"]
    assert all(set(row) == {"printed", "implies", "expected"} for row in rows)
    assert "0.00149" in ImpliedParameters().table()
