"""A real car without its encoder: the stated accuracy. Skipped, by name, without the recordings."""

import json

import numpy as np
import pytest

from baqueano.cli import main
from baqueano.identify import FitOptions, identify
from baqueano.runs.importing import import_run
from baqueano.study.cross_validation_cpm import predict_run
from baqueano.study.imu_only import (
    BARE_VALUES,
    FREE,
    MAPS,
    MAX_WIDTHS,
    MIN_COVERAGE,
    QUANTITY_NAMES,
    fitted_drive,
    imu_only_study,
    interval_rows,
)
from baqueano.vehicle_file import load

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def study(cpm_recordings):
    return imu_only_study()


def test_speed_without_encoder_is_at_most_30_percent_worse_than_with_odometer(study):
    ratios = [row for row in study.rows() if row["quantity"].startswith("speed error, divided")]
    assert len(ratios) == 4
    for row in ratios:
        assert 0.0 < row["value"] <= 1.3, row


def test_imu_only_intervals_cover_the_odometer_fit_and_are_narrow(study):
    rows = {row["quantity"]: row for row in study.rows()}
    assert rows["intervals that contain the odometer's fit"]["ok"]
    for name, bar in zip(QUANTITY_NAMES[:-1], MAX_WIDTHS[:-1], strict=True):
        if np.isfinite(bar):
            assert rows[f"widest of {name}, ± parts"]["value"] <= bar, name


def test_the_imu_only_interval_of_the_steady_speed_is_narrow(study):
    rows = {row["quantity"]: row for row in study.rows()}
    assert rows[f"widest of {QUANTITY_NAMES[-1]}, ± parts"]["value"] <= MAX_WIDTHS[-1]
    assert study.verdict == "USABLE", study.reasons


def test_the_study_reports_the_unobservable_gyro_scale_and_an_envelope_exit(study):
    rows = {row["quantity"]: row for row in study.rows()}
    assert rows["the gyro's scale is reported as not identifiable"]["value"] is True
    assert rows["the run that leaves the envelope is flagged"]["value"] is True


@pytest.mark.parametrize(("run", "changes"), [
    ("a", {"model.drivetrain.delay_s": 0.0}),
    ("b", {"model.drivetrain.delay_s": 0.0}),
])  # fmt: skip
def test_a_fit_started_at_its_estimate_returns_the_same_estimate(cpm_recordings, run, changes):
    recorded_run, car = import_run(MAPS[run]).run, load("car").with_values(BARE_VALUES | changes)
    free = (*FREE, "model.drivetrain.delay_s")
    first = identify(recorded_run, car, free, use=("imu",))
    second = identify(recorded_run, first.vehicle_file, free, use=("imu",))
    assert np.nanmax(np.abs(second.estimate - first.estimate) / first.std) <= 0.3


@pytest.mark.parametrize(("run", "held_out"), [("a", "b"), ("b", "a")])
def test_the_innovations_cost_predicts_the_other_run_worse_without_an_encoder(cpm_recordings, run, held_out):
    """With only the IMU, their speed error on the other run is 2.9 and 1.9 times that of the simulation cost."""
    recorded_run, unseen_run = (import_run(MAPS[name]).run for name in (run, held_out))
    car, errors = load("car").with_values(BARE_VALUES), []
    for cost in ("simulation", "innovations"):
        fit = identify(recorded_run, car, FREE, use=("imu",), options=FitOptions(cost=cost))
        values = {name: float(fit.value(name)) for name in FREE if np.isfinite(fit.value(name))}
        errors.append(float(predict_run(car.with_values(values), unseen_run, "auto").rmse[0]))
        assert not any(note.code in ("cost.innovations", "cost.try-innovations") for note in fit.notes)
    assert errors[1] > 1.5 * errors[0]
    assert fit.verdict == "WARN"
    assert fit.reasons[0].code == "cost.neither"


def test_coverage_and_width_of_intervals_are_taken_over_all_cases():
    is_inside, width = np.ones((4, 5), bool), np.full((4, 5), 0.05)
    assert all(row["ok"] for row in interval_rows(is_inside, width))
    is_inside[:, 0], width[2, 1] = False, 0.41
    rows = {row["quantity"]: row for row in interval_rows(is_inside, width)}
    row = rows["intervals that contain the odometer's fit"]
    assert row["value"] == pytest.approx(0.8)
    assert not row["ok"]
    assert row["value"] < MIN_COVERAGE
    assert not rows["widest of viscous drag, ± parts"]["ok"]
    assert rows["widest of gain, ± parts"]["ok"]


def test_steady_speed_and_its_error_are_computed_from_gain_and_friction():
    from types import SimpleNamespace

    from baqueano.study.imu_only import DRIVE_PARAMETERS

    rng = np.random.default_rng(0)
    mean, root = np.array([7.4, 1.8, 0.6, 0.2]), 0.01 * rng.normal(size=(4, 4))
    cov = root @ root.T
    fit = SimpleNamespace(
        names=DRIVE_PARAMETERS, estimate=mean, cov=cov, std=np.sqrt(np.diag(cov)),
        value=lambda name: float(mean[DRIVE_PARAMETERS.index(name)]),
    )  # fmt: skip
    motion = fitted_drive(fit, load("car"))
    draws = rng.multivariate_normal(mean, cov, size=40_000)
    speeds = (draws[:, 0] * (0.4 - 0.03) - draws[:, 2]) / draws[:, 1]
    assert motion.value[4] == pytest.approx((7.4 * 0.37 - 0.6) / 1.8)
    assert motion.std[4] == pytest.approx(np.std(speeds), rel=0.03)


def test_the_command_prints_its_rows(study, capsys, monkeypatch):
    monkeypatch.setattr("baqueano.study.imu_only.imu_only_study", lambda *_: study)
    with pytest.raises(SystemExit) as end:
        main(["study", "without-encoders", "--json"])
    assert end.value.code == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert len(rows) == len(study.rows())
    assert set(rows[0]) == {"recording", "quantity", "value", "bar", "ok"}
