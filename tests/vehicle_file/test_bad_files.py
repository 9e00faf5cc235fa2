"""Every mistake in a hand-written file, and its message: file, line, key, value, expected value, remedy."""

import numpy as np
import pytest

from baqueano.errors import FileError
from baqueano.messages import text
from baqueano.vehicle_file import load, parse
from tests.codes import refused, within
from tests.papers_noise import PAPER_Q, PAPER_R
from tests.papers_pd import with_papers_pd

SMALL = load("small").text


def refused_as(old, new, text=SMALL):
    """Return the diagnostic of the file of the small vehicle in which `new` replaces `old`."""
    assert old in text, f"the file has no {old!r}"
    with pytest.raises(FileError) as error_info:
        parse(text.replace(old, new, 1), "my.toml")
    assert error_info.value.exit_code == 3
    return error_info.value.diagnostic


CASES = {
    "unknown key": ("mass_kg", "masss_kg", "vehicle.key-unknown", {"match": "mass_kg", "value": "masss_kg"}),
    "unknown table": ("[controller]", "[controler]",
        "vehicle.table-unknown", {"match": "controller", "value": "controler"}),
    "unknown key above the tables": ("rate_hz = 100.0\n", "rate = 100.0\n",
        "vehicle.unit-missing", {"key": "rate_hz"}),
    "unknown key of friction": ("quadratic =", "quadrati =",
        "vehicle.key-unknown", {"match": "quadratic", "value": "quadrati"}),
    "unknown key of geometry": ("track_m", "trak_m",
        "vehicle.key-unknown", {"match": "track_m", "value": "trak_m"}),
    "unknown kind": ('kind = "planar"', 'kind = "planr"',
        "block.unknown", {"match": "planar", "value": "planr"}),
    "unknown sensor": ('kind = "imu"', 'kind = "imo"',
        "block.unknown", {"match": "imu", "role": "sensor", "value": "imo"}),
    "kind is a number": ('kind = "planar"', "kind = 3", "vehicle.kind-not-text", {"value": "3"}),
    "kind is missing": ('[model]\nkind = "planar"\n', "[model]\n", "vehicle.no-kind", {}),
    "mass is missing": ("mass_kg = 0.61", "", "vehicle.model-lacks", {"keys": "mass_kg", "model": "Planar"}),
    "negative mass": ("mass_kg = 0.61", "mass_kg = -0.61",
        "vehicle.out-of-range", {"value": "-0.61", "low": 0.001, "high": 1e5, "unit_name": "kg"}),
    "nan": ("mass_kg = 0.61", "mass_kg = nan", "vehicle.not-finite", {"value": "nan"}),
    "inf": ("mass_kg = 0.61", "mass_kg = inf", "vehicle.not-finite", {"value": "inf"}),
    "nan in a list": ("linear = [3.3,", "linear = [nan,",
        "vehicle.not-finite", {"value": "[nan, 40, 0.0115]"}),
    "text for a number": ("mass_kg = 0.61", 'mass_kg = "0.61"',
        "vehicle.number-in-quotes", {"unit_name": "kg"}),
    "flag for a number": ("mass_kg = 0.61", "mass_kg = true", "vehicle.not-number", {"value": "True"}),
    "list for a number": ("mass_kg = 0.61", "mass_kg = [0.61]", "vehicle.not-number", {"value": "[0.61]"}),
    "number for a list": ("linear = [3.3, 40.0, 0.0115]", "linear = 3.3", "vehicle.not-numbers", {}),
    "text in a list": ("linear = [3.3,", 'linear = ["3.3",', "vehicle.not-numbers", {}),
    "too few numbers": ("linear = [3.3, 40.0,", "linear = [3.3,", "vehicle.size", {}),
    "decimal commas in a list": ("[3.3, 40.0, 0.0115]", "[3,3, 40,0, 0,5]", "vehicle.size-with-commas", {}),
    "ragged matrix": ("[3.38, 0.0, 0.0]", "[3.38, 0.0]", "vehicle.not-numbers", {}),
    "wrong rows": ("  [0.0, 0.0, 0.0],", "", "vehicle.size", {}),
    "huge number": ("mass_kg = 0.61", f"mass_kg = {'9' * 400}", "vehicle.not-finite", {"value": "inf"}),
    "friction that pushes": ("coulomb = [0.25", "coulomb = [-0.25",
        "vehicle.out-of-range", {"value": "[-0.25, 0, 0.01]"}),
    "unit g": ("mass_kg = 0.61", "mass_g = 610",
        "vehicle.unit-other", {"unit_name": "kg", "value": "610", "given_unit": "g", "key": "mass_kg",
            "converted_value": "0.61"}),
    "unit cm": ("radius_m = 0.07", "radius_cm = 7",
        "vehicle.unit-other", {"unit_name": "m", "value": "7", "given_unit": "cm", "key": "radius_m",
            "converted_value": "0.07"}),
    "unit mm": ("wheel_radius_m = 0.0325", "wheel_radius_mm = 32.5",
        "vehicle.unit-other", {"value": "32.5", "given_unit": "mm", "key": "wheel_radius_m",
            "converted_value": "0.0325"}),
    "unit ms": ("lag_s = 0.06", "lag_ms = 60",
        "vehicle.unit-other", {"value": "60", "given_unit": "ms", "key": "lag_s", "converted_value": "0.06"}),
    "unit kHz": ("rate_hz = 100.0\nacc", "rate_khz = 0.1\nacc",
        "vehicle.unit-other", {"value": "0.1", "given_unit": "kHz", "key": "rate_hz", "converted_value": "100"}),
    "unit deg": ("tilt_rad = [0.01, -0.015]", "tilt_deg = [1, -1]",
        "vehicle.unit-other", {"key": "tilt_rad", "converted_value": "[0.0174533, -0.0174533]"}),
    "unit deg/s": ("gyro_bias = 0.015", "gyro_bias_deg_s = 1",
        "vehicle.unit-other", {"value": "1", "given_unit": "degrees/s", "key": "gyro_bias",
            "converted_value": "0.0174533"}),
    "unit mg": ("accel_bias = [0.12, -0.08]", "accel_bias_mg = [10, 0]",
        "vehicle.unit-other", {"key": "accel_bias", "converted_value": "[0.0980665, 0]"}),
    "unit g mm²": ("mass_kg = 0.61", "mass_kg = 0.61\ninertia_g_cm2 = 14900",
        "vehicle.unit-other", {"key": "inertia_kg_m2", "converted_value": "0.00149"}),
    "no unit": ("mass_kg = 0.61", "mass = 0.61", "vehicle.unit-missing", {"key": "mass_kg", "value": "0.61"}),
    "derived key": ("lag_s = 0.06", "lag_s = 0.06\nhas_lag = true", "vehicle.derived-key", {}),
    "kg as g": ("mass_kg = 0.61", "mass_kg = 610", "vehicle.too-heavy", {}),
    "g as kg": ("mass_kg = 0.61", "mass_kg = 0.0061", "vehicle.too-light", {}),
    "cm as m": ("radius_m = 0.07", "radius_m = 7.0", "vehicle.too-light", {}),
    "track in cm": ("track_m = 0.12", "track_m = 12.0", "vehicle.track", {"value": 12.0}),
    "wheel in cm": ("wheel_radius_m = 0.0325", "wheel_radius_m = 3.25", "vehicle.wheel", {}),
    "lever in cm": ("lever_arm_m = [0.02, 0.005]", "lever_arm_m = [2, 0.5]", "vehicle.lever-arm", {}),
    "mass ahead": ("centre_of_mass_x_m = 0.008", "centre_of_mass_x_m = 0.8", "vehicle.centre-of-mass", {}),
    "both shapes": ("radius_m = 0.07", "radius_m = 0.07\nlength_m = 0.2", "vehicle.two-shapes", {}),
    "dead zone in percent": ("dead_zone_forward = [0.32, 0.27]", "dead_zone_forward = [32.0, 27.0]",
        "vehicle.dead-zone", {}),
    "friction too stiff": ("linear = [3.3,", "linear = [3300,",
        "vehicle.entry-too-stiff", {"entry": "0", "keys": "rate_hz"}),
    "coulomb too stiff": ("coulomb = [0.25, 0.0, 0.01]", "coulomb = [0.25, 0.0, 1.0]",
        "vehicle.entry-too-stiff", {}),
    "wheel friction too stiff": ("coulomb = [0.25, 0.0, 0.01]", "coulomb_forward = [10.0, 10.0]",
        "vehicle.entry-too-stiff", {"value": "[10, 10]", "entry": "0", "step_ms": 10.0}),
    "wheel friction without a track": ("coulomb = [0.25, 0.0, 0.01]", "coulomb_forward = [0.1, 0.1]\ntrack_m = 0.0",
        "vehicle.refused", {}),
    "an unknown battery": ("battery_v = 7.4", 'battery_v = 7.4\nbattery = "full"', "vehicle.refused", {}),
    "three names, two numbers": ("limit = [1.0, 0.0, 1.0]", "limit = [1.0, 1.0]",
        "vehicle.command-limits", {"value": 2, "expected": 3}),
    "two names": ('names = ["u_x", "u_y", "u_psi"]', 'names = ["a", "b"]',
        "vehicle.command-names", {"value": 2, "model": "Planar", "expected": 3}),
    "same name twice": ('names = ["u_x", "u_y"', 'names = ["u_x", "u_x"', "vehicle.command-name-twice", {}),
    "names that are numbers": ('names = ["u_x", "u_y", "u_psi"]', "names = [1, 2, 3]", "vehicle.not-names", {}),
    "no names": ('names = ["u_x", "u_y", "u_psi"]', "", "vehicle.no-command-names", {}),
    "rate of a snail": ("rate_hz = 100.0\n\n", "rate_hz = 0.1\n\n",
        "vehicle.out-of-range", {"value": "0.1", "low": 1.0, "high": 2000.0, "unit_name": "Hz"}),
    "no name": ('name = "small"\n', "", "vehicle.no-top-key", {"example": 'name = "my vehicle"'}),
    "name is a number": ('name = "small"', "name = 7", "vehicle.not-text", {"value": "7"}),
    "no format": ("format = 1\n", "", "vehicle.no-format", {}),
    "newer format": ("format = 1\n", "format = 2\n", "vehicle.newer-format", {"expected": 1}),
    "strange format": ("format = 1\n", 'format = "one"\n',
        "vehicle.other-format", {"value": "'one'", "expected": 1}),
    "misspelt table": ("[model]", "[modell]", "vehicle.table-unknown", {"match": "model", "value": "modell"}),
    "no command": ("[command]", "[comand]", "vehicle.table-unknown", {"match": "command"}),
    "no model": (SMALL[SMALL.index("[model]") :], "", "vehicle.no-table", {}),
    "sensor name": ("[sensors.imu]", '[sensors."the imu"]', "vehicle.sensor-name", {}),
    "sensor named by a keyword": ("[sensors.imu]", "[sensors.and]", "vehicle.sensor-name", {}),
    "bad choice": ('mixing = "two_wheels"', 'mixing = "tank"', "vehicle.refused", {"block": "Drivetrain"}),
    "bad measurement model": ('kind = "imu"', 'kind = "imu"\nmeasurement_model = "p"', "vehicle.refused", {}),
    "channels": ("gain = [1.04, 0.96]", "gain = [1.0, 1.0, 1.0]", "vehicle.refused", {"block": "Drivetrain"}),
    "rectangle of an integer": ('kind = "repeat"', 'kind = "repeat"\nlaps = 1.5',
        "vehicle.not-whole", {"value": "1.5"}),
    "negative gate": ('kind = "augmented_ekf"', 'kind = "augmented_ekf"\ngate_sigma = -1',
        "vehicle.out-of-range", {"value": "-1", "low": 1.0, "unit_name": "1"}),
    "unknown sensor in use": ('kind = "augmented_ekf"', 'kind = "augmented_ekf"\nuse = ["gps"]',
        "vehicle.refused", {}),
    "supervisor key": ("max_speed_m_s", "max_sped_m_s", "vehicle.key-unknown", {"match": "max_speed_m_s"}),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_fi3_fi7_each_mistake_in_a_vehicle_file_is_reported_with_its_code(case):
    old, new, code, figures = CASES[case]
    cause = next(diagnostic for diagnostic in within(refused_as(old, new)) if diagnostic.code == code)
    figures_by_name = {
        name: figure for diagnostic in within(cause) for name, figure in diagnostic.figures.items()
    }
    assert {name: figures_by_name[name] for name in figures} == figures


def test_an_error_in_a_vehicle_file_names_its_line():
    line = SMALL.splitlines().index(next(x for x in SMALL.splitlines() if x.startswith("mass_kg"))) + 1
    place = refused_as("mass_kg = 0.61", "mass_kg = -1").figures["place"]
    assert dict(place.figures) == {"file": "my.toml", "line": line, "key": "[model] mass_kg"}


def test_all_mistakes_of_a_vehicle_file_are_reported_together():
    reason = refused_as("mass_kg = 0.61 ", "mass_kg = -1\nslope = 3 ")
    assert reason.figures["first"].code == "vehicle.out-of-range"
    assert reason.figures["rest"].code == "vehicle.key-unknown"
    assert len(text(reason).splitlines()) == 2


def test_fi3_an_inertia_too_large_for_the_vehicle_size_is_refused():
    reason = refused_as("mass_kg = 0.61", "mass_kg = 0.61\ninertia_kg_m2 = 669.12")
    assert (reason.code, reason.figures["value"], reason.figures["mass_kg"]) == (
        "vehicle.inertia-too-large", 669.12, 0.61,
    )  # fmt: skip
    assert reason.figures["gyration_m"] == pytest.approx(33.1, abs=0.05)
    assert reason.figures["measure"].figures["radius_m"] == 0.07
    assert reason.figures["measure"].figures["uniform_kg_m2"] == pytest.approx(0.00149, abs=5e-6)


def test_an_inertia_far_below_the_vehicle_size_is_refused():
    reason = refused_as("mass_kg = 0.61", "mass_kg = 0.61\ninertia_kg_m2 = 1.49e-6")
    assert "vehicle.inertia-of-point" in {diagnostic.code for diagnostic in within(reason)}


def test_a_missing_inertia_and_radius_are_reported():
    assert refused_as("radius_m = 0.07\n", "").code == "vehicle.model-lacks-inertia"


def test_the_default_inertia_of_a_rectangular_vehicle_equals_a_plate():
    text = SMALL.replace("radius_m = 0.07\n", "length_m = 0.2\nwidth_m = 0.14\n", 1)
    assert parse(text, "x").vehicle.inertia_kg_m2 == pytest.approx(0.61 * (0.2**2 + 0.14**2) / 12)


def test_an_implausible_maximum_speed_gives_a_notice():
    (notice,) = parse(SMALL.replace("[3.38, 0.0", "[3380.0, 0.0"), "x").notes
    assert notice.code == "vehicle.too-fast"


@pytest.mark.parametrize(
    ("name", "matrix", "parts"),
    [
        ("measurement_noise_cov", PAPER_Q, ["eigenvalue -1.28e-05", "[0][1] = -0.006 is too large"]),
        ("process_noise_cov", PAPER_R, ["not symmetric: [0][5] = -0.05 but [5][0] = -0.058"]),
    ],
)
def test_es1_the_printed_matrices_of_the_paper_are_refused_with_a_correction(name, matrix, parts):
    table = "sensors.imu" if name == "measurement_noise_cov" else "estimator"
    text = SMALL[: SMALL.index("[estimator]")] if table == "estimator" else SMALL
    old = "[sensors.imu]\n" if table == "sensors.imu" else text
    new = (
        f"{old}{name} = {matrix}\n"
        if table == "sensors.imu"
        else f'{old}[estimator]\nkind = "ekf"\n{name} = {matrix}\n'
    )
    reason = refused_as(old, new, text)
    assert (reason.code, reason.figures["place"].figures["key"]) == (
        "vehicle.not-covariance",
        f"[{table}] {name}",
    )
    message = str(reason.figures["error"])
    for part in parts:
        assert part in message
    proposal = message[message.index("nearest valid matrix is ") + len("nearest valid matrix is ") :]
    proposed_matrix = np.array(eval(proposal.rstrip(".")))
    assert np.linalg.eigvalsh(proposed_matrix)[0] > -1e-6 * np.max(np.abs(proposed_matrix))
    if name == "measurement_noise_cov":
        assert np.max(np.abs(proposed_matrix - np.array(matrix))) < 1e-3


def test_a_missing_block_parameter_is_reported_at_construction():
    file = with_papers_pd(gains="beta = 2.0\ngamma = 0.3")
    with refused("vehicle.lacks-estimates", FileError, file="small.toml", role="controller", keys="alpha"):
        file.controller()
    assert file.controller(alpha=2.0).alpha == 2.0


def test_the_advice_for_missing_gains_names_the_requested_controller():
    with pytest.raises(FileError) as error_info:
        parse(SMALL, "small.toml").controller("pd")
    assert error_info.value.diagnostic.fix == "baqueano tune --controller pd --out pd.toml"


def test_a_guide_without_a_route_is_refused():
    from baqueano.errors import UsageError

    with refused("vehicle.no-route", UsageError, guide="Repeat"):
        load("small").guide()
