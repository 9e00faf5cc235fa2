"""A real car whose model is chosen on one run and judged on the other. Skipped, by name, without the recordings."""

import json
from types import SimpleNamespace

import pytest

from baqueano.study.recorded import cpm

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def rows(cpm_recordings):
    return cpm.rows()


def test_the_cpm_study_meets_all_ten_requirements(rows):
    assert len(rows) == 10
    assert [row["quantity"] for row in rows if not row["ok"]] == []


def test_the_model_explains_the_speed_of_the_other_run(rows):
    values = {row["quantity"]: row["value"] for row in rows}
    assert values["a → b: speed explained"] >= 0.94
    assert values["b → a: speed explained"] >= 0.98


def test_the_battery_term_is_rejected_with_a_reason(rows):
    verdicts = [row["value"] for row in rows if row["quantity"].endswith("battery voltage")]
    assert len(verdicts) == 2
    assert all("excluded" in text or "refused" in text for text in verdicts)


def test_rows_are_flat_and_serialisable_to_json(rows):
    assert {tuple(row) for row in rows} == {("recording", "quantity", "value", "bar", "ok")}
    assert json.dumps(rows, allow_nan=False)


@pytest.mark.parametrize(
    ("turn", "offset_s", "is_ok"),
    [(0.966, 0.045, [True, True]), (0.980, 0.045, [False, True]), (0.966, 0.060, [True, False])],
)
def test_a_calibration_outside_its_tolerance_is_not_ok(turn, offset_s, is_ok):
    values = {"sensors.imu.gyro_scale": 1.0 / turn, "clock.truth": offset_s}
    calibration = SimpleNamespace(value=values.__getitem__)
    assert [row["ok"] for row in cpm.calibration_rows(calibration, "a")] == is_ok
