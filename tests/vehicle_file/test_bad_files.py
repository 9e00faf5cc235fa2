"""Everything a hand can write wrong, and what is said to it: file, line, key, found, expected, remedy."""

import numpy as np
import pytest

from baqueano.errors import FileError
from baqueano.vehicle_file import load, parse
from tests.papers_pd import with_papers_pd

SMALL = load("small").text
PAPER_Q = [[2.852, -0.006, -0.018], [-0.006, 0.0, 0.0], [-0.018, 0.0, 0.008]]
PAPER_R = [
    [2.129, -0.004, -0.021, 0.882, 0.005, -0.05],
    [-0.004, 0.0, 0.0, -0.003, 0.0, 0.005],
    [-0.021, 0.0, 0.006, 0.006, 0.0, 0.115],
    [0.882, -0.003, 0.006, 7.099, -0.032, 0.357],
    [0.005, 0.0, 0.0, -0.032, 0.0, 0.001],
    [-0.058, 0.005, 0.115, 0.357, 0.001, 5.064],
]


def said(old, new, text=SMALL):
    """What is said to the small vehicle's file with `old` written as `new`."""
    assert old in text, f"the file has no {old!r}"
    with pytest.raises(FileError) as caught:
        parse(text.replace(old, new, 1), "my.toml")
    assert caught.value.exit_code == 3
    return str(caught.value)


CASES = {
    "unknown key": ("mass_kg", "masss_kg", ["[model] masss_kg is not a key", "Did you mean mass_kg?"]),
    "unknown table": ("[controller]", "[controler]", ["controler is not a key", "Did you mean controller?"]),
    "unknown key above the tables": ("rate_hz = 100.0\n", "rate = 100.0\n", ["rate is not a key", "rate_hz"]),
    "unknown key of friction": (
        "quadratic =",
        "quadrati =",
        ["[model.friction] quadrati", "Did you mean quadratic?"],
    ),
    "unknown key of geometry": ("track_m", "trak_m", ["[geometry] trak_m", "Did you mean track_m?"]),
    "unknown kind": (
        'kind = "planar"',
        'kind = "planr"',
        ['kind = "planr"', "kinematic, car", "Did you mean planar?"],
    ),
    "unknown sensor": ('kind = "imu"', 'kind = "imo"', ['no sensor "imo"', "Did you mean imu?"]),
    "kind is no text": ('kind = "planar"', "kind = 3", ["kind = 3: expected text in quotes"]),
    "kind is missing": (
        '[model]\nkind = "planar"\n',
        "[model]\n",
        ["[model]", 'lacks kind = "…": one of planar'],
    ),
    "mass is missing": ("mass_kg = 0.61", "", ["[model]", "lacks mass_kg", "no Planar"]),
    "negative mass": (
        "mass_kg = 0.61",
        "mass_kg = -0.61",
        ["mass_kg = -0.61: expected 0.001 to 100000 [kg], mass m"],
    ),
    "nan": ("mass_kg = 0.61", "mass_kg = nan", ["mass_kg = nan: expected finite numbers"]),
    "inf": ("mass_kg = 0.61", "mass_kg = inf", ["mass_kg = inf: expected finite numbers"]),
    "nan in a list": (
        "linear = [3.3,",
        "linear = [nan,",
        ["linear = [nan, 40, 0.0115]: expected finite numbers"],
    ),
    "text for a number": (
        "mass_kg = 0.61",
        'mass_kg = "0.61"',
        ["expected one number [kg]", "Take the quotes away"],
    ),
    "flag for a number": ("mass_kg = 0.61", "mass_kg = true", ["mass_kg = True: expected one number"]),
    "list for a number": ("mass_kg = 0.61", "mass_kg = [0.61]", ["mass_kg = [0.61]: expected one number"]),
    "number for a list": ("linear = [3.3, 40.0, 0.0115]", "linear = 3.3", ["expected 3 numbers"]),
    "text in a list": ("linear = [3.3,", 'linear = ["3.3",', ["expected 3 numbers"]),
    "too few numbers": (
        "linear = [3.3, 40.0,",
        "linear = [3.3,",
        ["linear has 2 numbers: expected 3 numbers"],
    ),
    "decimal commas in a list": (
        "[3.3, 40.0, 0.0115]",
        "[3,3, 40,0, 0,5]",
        ["6 numbers", "Decimal commas?"],
    ),
    "ragged matrix": ("[3.38, 0.0, 0.0]", "[3.38, 0.0]", ["expected 3 rows of 3 numbers"]),
    "wrong rows": ("  [0.0, 0.0, 0.0],", "", ["has 2 rows of 3 numbers: expected 3 rows of 3 numbers"]),
    "huge number": ("mass_kg = 0.61", f"mass_kg = {'9' * 400}", ["mass_kg = inf: expected finite"]),
    "friction that pushes": (
        "coulomb = [0.25",
        "coulomb = [-0.25",
        ["coulomb = [-0.25, 0, 0.01]: expected 0 to"],
    ),
    "unit g": ("mass_kg = 0.61", "mass_g = 610", ["mass_g", "in kg: 610 g is mass_kg = 0.61."]),
    "unit cm": ("radius_m = 0.07", "radius_cm = 7", ["radius_cm", "in m: 7 cm is radius_m = 0.07."]),
    "unit mm": ("wheel_radius_m = 0.0325", "wheel_radius_mm = 32.5", ["32.5 mm is wheel_radius_m = 0.0325."]),
    "unit ms": ("lag_s = 0.06", "lag_ms = 60", ["60 ms is lag_s = 0.06."]),
    "unit kHz": ("rate_hz = 100.0\nacc", "rate_khz = 0.1\nacc", ["0.1 kHz is rate_hz = 100."]),
    "unit deg": (
        "tilt_rad = [0.01, -0.015]",
        "tilt_deg = [1, -1]",
        ["is tilt_rad = [0.0174533, -0.0174533]"],
    ),
    "unit deg/s": ("gyro_bias = 0.015", "gyro_bias_deg_s = 1", ["1 degrees/s is gyro_bias = 0.0174533"]),
    "unit mg": ("accel_bias = [0.12, -0.08]", "accel_bias_mg = [10, 0]", ["is accel_bias = [0.0980665, 0]"]),
    "unit g mm²": ("mass_kg = 0.61", "mass_kg = 0.61\ninertia_g_cm2 = 14900", ["is inertia_kg_m2 = 0.00149"]),
    "no unit": ("mass_kg = 0.61", "mass = 0.61", ["Write the unit in the key: mass_kg = 0.61"]),
    "derived key": ("lag_s = 0.06", "lag_s = 0.06\nhas_lag = true", ["has_lag is worked out by itself"]),
    "kg as g": ("mass_kg = 0.61", "mass_kg = 610", ["3.96e+04 kg per m² of floor", "Is the mass in kg"]),
    "g as kg": ("mass_kg = 0.61", "mass_kg = 0.0061", ["less than a sheet of cardboard"]),
    "cm as m": (
        "radius_m = 0.07",
        "radius_m = 7.0",
        ["kg per m² of floor", "are the measures of [geometry] in m?"],
    ),
    "track in cm": (
        "track_m = 0.12",
        "track_m = 12.0",
        ["wider than the platform", "Is it in cm? 12 cm is 0.12 m."],
    ),
    "wheel in cm": ("wheel_radius_m = 0.0325", "wheel_radius_m = 3.25", ["a wheel larger", "Is it in cm?"]),
    "lever in cm": (
        "lever_arm_m = [0.02, 0.005]",
        "lever_arm_m = [2, 0.5]",
        ["2.06 m from the middle", "2.06 cm is 0.0206 m"],
    ),
    "mass ahead": ("centre_of_mass_x_m = 0.008", "centre_of_mass_x_m = 0.8", ["lies outside the platform"]),
    "both shapes": (
        "radius_m = 0.07",
        "radius_m = 0.07\nlength_m = 0.2",
        ["round or rectangular. Keep one."],
    ),
    "dead zone in percent": (
        "dead_zone_forward = [0.32, 0.27]",
        "dead_zone_forward = [32.0, 27.0]",
        ["never turn"],
    ),
    "friction too stiff": (
        "linear = [3.3,",
        "linear = [3300,",
        ["entry 0 stops the vehicle within 0.185 ms", "rate_hz"],
    ),
    "coulomb too stiff": ("coulomb = [0.25, 0.0, 0.01]", "coulomb = [0.25, 0.0, 1.0]", ["coulomb_speed"]),
    "wheel friction too stiff": (
        "coulomb = [0.25, 0.0, 0.01]",
        "coulomb_forward = [10.0, 10.0]",
        ["[model.friction] coulomb_forward = [10, 10]: entry 0 stops the vehicle within", "coulomb_speed"],
    ),
    "wheel friction without a track": (
        "coulomb = [0.25, 0.0, 0.01]",
        "coulomb_forward = [0.1, 0.1]\ntrack_m = 0.0",
        ["track_m = 0 with dry friction of a wheel"],
    ),
    "an unknown battery": (
        "battery_v = 7.4",
        'battery_v = 7.4\nbattery = "full"',
        ["battery = 'full': expected one of steady, logged"],
    ),
    "three names, two numbers": (
        "limit = [1.0, 0.0, 1.0]",
        "limit = [1.0, 1.0]",
        ["2 numbers, the command 3 entries"],
    ),
    "two names": (
        'names = ["u_x", "u_y", "u_psi"]',
        'names = ["a", "b"]',
        ["2 names", "Planar takes a command of 3"],
    ),
    "same name twice": ('names = ["u_x", "u_y"', 'names = ["u_x", "u_x"', ["two entries have the same name"]),
    "names are no names": (
        'names = ["u_x", "u_y", "u_psi"]',
        "names = [1, 2, 3]",
        ["expected a list of names"],
    ),
    "no names": ('names = ["u_x", "u_y", "u_psi"]', "", ["[command] names is missing"]),
    "rate of a snail": (
        "rate_hz = 100.0\n\n",
        "rate_hz = 0.1\n\n",
        ["rate_hz = 0.1: expected 1 to 2000 [Hz]"],
    ),
    "no name": ('name = "small"\n', "", ['name is missing: write name = "my vehicle"']),
    "name is a number": ('name = "small"', "name = 7", ['name = 7: expected text in quotes, "…"']),
    "no format": ("format = 1\n", "", ["format is missing: the first line", "Is this another file?"]),
    "newer format": ("format = 1\n", "format = 2\n", ["this baqueano reads format 1. Update baqueano"]),
    "strange format": ("format = 1\n", 'format = "one"\n', ["format = 'one'", "Write format = 1."]),
    "misspelt table": ("[model]", "[modell]", ["modell is not a key or table", "Did you mean model?"]),
    "no command": ("[command]", "[comand]", ["[command] is missing"]),
    "no model": (SMALL[SMALL.index("[model]") :], "", ["[model] is missing"]),
    "sensor name": ("[sensors.imu]", '[sensors."the imu"]', ["is no name for a sensor"]),
    "bad choice": (
        'mixing = "two_wheels"',
        'mixing = "tank"',
        ["Drivetrain.mixing = 'tank': expected one of none"],
    ),
    "bad measurement model": ('kind = "imu"', 'kind = "imu"\nmeasurement_model = "p"', ["physical, paper"]),
    "channels": (
        "gain = [1.04, 0.96]",
        "gain = [1.0, 1.0, 1.0]",
        ["[model.drivetrain] is refused by Drivetrain: Drivetrain.gain has shape (3,)"],
    ),
    "rectangle of an integer": (
        'kind = "repeat"',
        'kind = "repeat"\nlaps = 1.5',
        ["laps = 1.5: expected a whole number"],
    ),
    "negative gate": (
        'kind = "augmented_ekf"',
        'kind = "augmented_ekf"\ngate_sigma = -1',
        ["gate_sigma = -1: expected at least 1"],
    ),
    "unknown sensor in use": (
        'kind = "augmented_ekf"',
        'kind = "augmented_ekf"\nuse = ["gps"]',
        ["the vehicle has no such sensor", "imu"],
    ),
    "supervisor key": ("max_speed_m_s", "max_sped_m_s", ["Did you mean max_speed_m_s?"]),
}


@pytest.mark.parametrize("case", CASES)
def test_fi3_fi7_what_is_said(case):
    old, new, parts = CASES[case]
    message = said(old, new)
    assert message.startswith("my.toml")
    for part in parts:
        assert part in message


def test_the_line_is_named():
    line = SMALL.splitlines().index(next(x for x in SMALL.splitlines() if x.startswith("mass_kg"))) + 1
    assert said("mass_kg = 0.61", "mass_kg = -1").startswith(f"my.toml line {line}, [model] mass_kg = -1")


def test_all_that_is_wrong_is_told_at_once():
    message = said("mass_kg = 0.61 ", "mass_kg = -1\nslope = 3 ")
    assert len(message.splitlines()) == 2


def test_fi3_inertia_larger_than_the_vehicle_is_refused_with_the_arithmetic():
    message = said("mass_kg = 0.61", "mass_kg = 0.61\ninertia_kg_m2 = 669.12")
    assert (
        "inertia_kg_m2 = 669.12: with 0.61 kg this is a radius of gyration of 33.1 m, but radius_m = 0.07."
        in message
    )
    assert "A uniform disc has 0.00149. Was it computed in g or cm, or as m/r²?" in message


def test_inertia_of_a_point_is_refused():
    assert "all mass in a point" in said("mass_kg = 0.61", "mass_kg = 0.61\ninertia_kg_m2 = 1.49e-6")


def test_inertia_without_a_radius_asks_for_one():
    assert "Or give radius_m in [geometry]" in said("radius_m = 0.07\n", "")


def test_a_plate_has_the_inertia_of_a_plate():
    text = SMALL.replace("radius_m = 0.07\n", "length_m = 0.2\nwidth_m = 0.14\n", 1)
    assert parse(text, "x").vehicle.inertia_kg_m2 == pytest.approx(0.61 * (0.2**2 + 0.14**2) / 12)


def test_a_speed_that_no_such_vehicle_has_is_a_notice():
    (notice,) = parse(SMALL.replace("[3.38, 0.0", "[3380.0, 0.0"), "x").notices
    assert "the largest command would end at" in notice


@pytest.mark.parametrize(
    ("name", "matrix", "parts"),
    [
        ("measurement_noise_cov", PAPER_Q, ["eigenvalue -1.28e-05", "[0][1] = -0.006 is too large"]),
        ("process_noise_cov", PAPER_R, ["not symmetric: [0][5] = -0.05 but [5][0] = -0.058"]),
    ],
)
def test_es1_the_printed_matrices_of_the_paper_are_refused_and_mended(name, matrix, parts):
    table = "sensors.imu" if name == "measurement_noise_cov" else "estimator"
    text = SMALL[: SMALL.index("[estimator]")] if table == "estimator" else SMALL
    old = "[sensors.imu]\n" if table == "sensors.imu" else text
    new = (
        f"{old}{name} = {matrix}\n"
        if table == "sensors.imu"
        else f'{old}[estimator]\nkind = "ekf"\n{name} = {matrix}\n'
    )
    message = said(old, new, text)
    assert f"[{table}] {name}" in message
    for part in parts:
        assert part in message
    offered = message[message.index("nearest valid matrix is ") + len("nearest valid matrix is ") :]
    mended = np.array(eval(offered.rstrip(".")))
    assert np.linalg.eigvalsh(mended)[0] > -1e-6 * np.max(np.abs(mended))
    if name == "measurement_noise_cov":
        assert np.max(np.abs(mended - np.array(matrix))) < 1e-3


def test_what_a_block_lacks_is_told_when_it_is_asked_for():
    file = with_papers_pd(gains="beta = 2.0\ngamma = 0.3")
    with pytest.raises(FileError, match=r"small\.toml \[controller\] lacks alpha\. .*baqueano tune"):
        file.controller()
    assert file.controller(alpha=2.0).alpha == 2.0


def test_a_guide_without_its_route_says_so():
    from baqueano.errors import UsageError

    with pytest.raises(UsageError, match="Repeat repeats a route, and none was given"):
        load("small").guide()
