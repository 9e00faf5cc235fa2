"""The table of a fit as LaTeX and as CSV."""

import csv
import io
import re

import numpy as np
import pandas
import pytest

from baqueano.errors import UsageError
from baqueano.identify.data.record import FittedBlocks
from baqueano.parameter import all_parameters
from baqueano.report.tables import csv_text, format_estimate, latex_text, save_table, symbol
from baqueano.runs import export_csv
from baqueano.sensors import Imu
from baqueano.signals import sensor_slots
from baqueano.vehicle_file import load
from baqueano.vehicles import Kinematic
from tests.codes import refused
from tests.report import test_results

results = test_results.results
NAMES = [name for name in test_results.NAMES if name not in ("check", "first drive")]  # these two lack rows
IMU = sensor_slots(("imu",))(Imu())
VEHICLES = {"planar": load("small").vehicle, "kinematic": Kinematic(np.eye(3)), "car": load("car").vehicle}
VALID = {kind: FittedBlocks(vehicle, IMU) for kind, vehicle in VEHICLES.items()}

ROWS = [
    {"name": "model.friction.linear[0]", "estimate": 7.0012, "std": 0.0098, "unit": "N s/m", "weak": False},
    {
        "name": "model.actuator_matrix[2,2]",
        "estimate": 29.99,
        "std": 0.0042,
        "unit": "N m per unit of u",
        "weak": False,
    },
    {"name": "model.actuator_matrix[1,1]", "estimate": None, "std": None, "unit": "N", "weak": False},
    {"name": "sensors.imu.gyro_scale", "estimate": 1.0, "std": float("nan"), "unit": "1", "weak": True},
]


def test_a_csv_table_is_read_back_unchanged():
    rows = list(csv.DictReader(io.StringIO(csv_text(ROWS))))
    assert [row["name"] for row in rows] == [row["name"] for row in ROWS]
    assert float(rows[0]["estimate"]) == 7.0012
    assert rows[2]["estimate"] == ""
    assert rows[3]["std"] == ""


def test_a_csv_table_for_a_spreadsheet_has_decimal_commas_and_accents():
    data = csv_text([{"v": 0.5, "unit": "m/s²"}, {"v": float("nan"), "unit": "°", "n": 3}], ",").encode()
    assert data.decode("utf-8-sig").splitlines() == ["v;unit;n", "0,5;m/s²;", ";°;3"]
    assert data.startswith(b"\xef\xbb\xbf"), "without it a spreadsheet guesses another encoding"


def test_a_latex_table_with_more_columns_than_rows_is_transposed():
    rows = [
        {"run": "a_1", "ate_m": 0.5, "nis": 1.0, "loss_s": None},
        {"run": "b", "ate_m": 1e-9, "nis": None},
    ]
    lines = latex_text(rows).splitlines()
    assert r"    run & a\_1 & b \\" in lines
    assert r"    ate\_m & $0.5$ & $1 \cdot 10^{-9}$ \\" in lines
    assert r"    nis & $1$ & -- \\" in lines
    assert not any("loss" in line for line in lines), "no run has this value"
    tall = latex_text([{"lap": k, "across_m": 0.1} for k in range(4)]).splitlines()
    assert r"    lap & across\_m \\" in tall


def test_the_latex_table_of_a_comparison_has_the_titles_and_units_of_its_printed_table(results, tmp_path):
    comparison = results["comparison"]
    text = comparison.save_table(tmp_path / "t.tex").read_text(encoding="utf-8")
    names = [run.name for run in comparison.runs]
    assert f"     &  & {' & '.join(names)} \\\\" in text
    ate = " & ".join(f"${run.ate_m:.3g}$" for run in comparison.runs)
    assert rf"\quad position (ATE) & m & {ate} \\" in text
    assert r"\quad heading & $^\circ$ & " in text
    assert not re.search(r"ate\\_m|not reported|[−°]", text)
    assert text.count(r"\\") == len(comparison.table().partition("\n\n")[0].splitlines())


def test_latex_uses_the_symbols_of_the_paper_and_significant_digits():
    text = latex_text(ROWS, "Fit of 50 % & more", VALID["planar"])
    assert r"$d_{l,x}$ & $7.0012$ & $0.0098$ & N s/m \\" in text
    assert r"$T_{33}$ & $29.9900$ & $0.0042$" in text
    assert r"$T_{22}$ & \multicolumn{2}{c}{not identifiable} & N \\" in text
    assert r"$s_{\omega}$ & $1$ & --" in text
    assert r"% $s_{\omega}$: sensors.imu.gyro_scale" in text
    assert r"\caption{Fit of 50 \% \& more}" in text
    assert text.count(r"\\") == 5
    assert text.count("{") == text.count("}")


@pytest.mark.parametrize(
    ("path", "letter"),
    [
        ("model.friction.coulomb[2]", r"$d_{k,\psi}$"),
        ("model.velocity_matrix[0,2]", "$V_{13}$"),
        ("model.throttle_gain", "$k_t$"),
        ("model.mass_kg", "$m$"),
        ("model.drivetrain.dead_zone_forward[0]", "$z_{f,1}$"),
        ("model.drivetrain.dead_zone_backward[1]", "$z_{b,2}$"),
        ("model.friction.coulomb_forward[1]", "$c_{f,2}$"),
        ("model.coulomb_forward_m_s2", "$d_f$"),
        ("model.coulomb_backward_m_s2", "$d_b$"),
        ("model.drivetrain.lag_s", r"$\tau$"),
        ("model.drivetrain.delay_s", r"$\Delta t$"),
        ("sensors.imu.lever_arm_m[0]", "$r_{x}$"),
        ("sensors.imu.accel_scale[1]", "$s_{a,y}$"),
        ("model.a_block_of_mine", r"\texttt{model.a\_block\_of\_mine}"),
    ],
)
def test_parameters_have_the_symbols_of_fossen(path, letter):
    kind = (
        "car"
        if path.endswith("_gain") or path.endswith("_m_s2")
        else "kinematic"
        if "velocity" in path
        else "planar"
    )
    assert symbol(path, VALID[kind]) == letter


@pytest.mark.parametrize(
    ("value", "std", "cells"),
    [
        (1234.5, 20.0, ("$1234$", "$20$")),
        (0.5, 0.031, ("$0.500$", "$0.031$")),
        (3.2e-9, 1e-10, (r"$3.2 \cdot 10^{-9}$", r"$1 \cdot 10^{-10}$")),
    ],
)
def test_the_number_of_printed_digits_depends_on_the_standard_error(value, std, cells):
    assert format_estimate(value, std) == cells


def test_the_file_format_follows_the_file_extension(tmp_path):
    assert save_table(ROWS, tmp_path / "t.csv").read_text(encoding="utf-8").startswith("name,estimate")
    assert r"\toprule" in save_table(ROWS, tmp_path / "deep" / "t.tex").read_text(encoding="utf-8")
    with refused("report.table-ending", UsageError):
        save_table(ROWS, tmp_path / "t.xlsx")
    with refused("runs.decimal", UsageError):
        save_table(ROWS, tmp_path / "t.csv", decimal=";")


@pytest.mark.parametrize("kind", VALID)
def test_each_fitted_drivetrain_parameter_has_a_symbol(kind):
    drivetrain = VALID[kind].model.drivetrain
    paths = [path for path, _ in all_parameters(drivetrain, "model.drivetrain")]
    raw = {path for path in paths if "texttt" in symbol(path, VALID[kind])}
    assert raw <= {"model.drivetrain.battery_v", "model.drivetrain.battery_nominal_v"}


@pytest.mark.parametrize("kind", VALID)
def test_each_parameter_free_by_default_has_a_unique_symbol(kind):
    by_path = all_parameters(VALID[kind].model, "model")
    paths = [path for path, p in by_path if p.role in ("free", "gain", "offset", "term")]
    letters = [symbol(path, VALID[kind]) for path in paths]
    assert len(letters) > 5
    assert not any("texttt" in letter for letter in letters)
    assert len(set(letters)) == len(letters)


@pytest.mark.parametrize("name", NAMES)
def test_each_result_is_saved_as_a_table_for_a_spreadsheet(results, name, tmp_path):
    result, path = results[name], tmp_path / "t.csv"
    table = pandas.read_csv(result.save_table(path, decimal=","), sep=";", decimal=",").select_dtypes(
        "number"
    )
    expected = pandas.DataFrame(result.rows())[table.columns].apply(pandas.to_numeric, errors="coerce")
    pandas.testing.assert_frame_equal(table.astype(float), expected.astype(float), check_exact=True)
    assert r"\toprule" in result.save_table(tmp_path / "t.tex").read_text(encoding="utf-8")


def test_the_data_frame_of_a_run_is_the_table_of_its_csv_file(results, tmp_path):
    read_back = pandas.read_csv(export_csv(results["run"], tmp_path / "run.csv"), index_col="t_s")
    pandas.testing.assert_frame_equal(results["run"].to_pandas(), read_back, check_exact=True)
