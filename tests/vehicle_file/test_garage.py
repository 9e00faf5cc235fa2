"""The vehicles of the garage: they load and have the documented properties; the small vehicle drives like small
motors.
"""

import numpy as np
import pytest

from baqueano.errors import FileError
from baqueano.vehicle_file import garage_names, load
from tests.codes import includes, refused, within

DT_S = 0.01


def drive_vehicle(u, duration_s=2.0, vehicle=None):
    """Return ν (k, 3) of the small vehicle from rest under a constant command."""
    vehicle = load("small").vehicle if vehicle is None else vehicle
    state, nu = vehicle.init(), []
    for _ in range(round(duration_s / DT_S)):
        state, motion = vehicle.step(state, np.array(u), DT_S, np.zeros(3))
        nu.append(motion.nu)
    return np.array(nu)


def test_the_garage_contains_three_vehicles():
    assert garage_names() == ("car", "case-study-1", "small")
    assert [load(name).name for name in garage_names()] == [*garage_names()]


def test_case_study_1_has_the_numbers_of_the_paper():
    file = load("case-study-1")
    v = file.vehicle
    assert (v.mass_kg, v.inertia_kg_m2) == (1.47, 810.44)
    assert v.friction.linear.tolist() == [7.0, 7.0, 500.553]
    assert v.friction.quadratic.tolist() == [3.5, 3.5, 250.0]
    assert np.diag(v.actuator_matrix).tolist() == [1.0, 1.0, 29.99]
    assert np.count_nonzero(v.actuator_matrix) == 3
    assert file.command.limit.tolist() == [20.0, 0.0, 60.0]
    assert (file.sensors.imu.measurement_model, file.rate_hz) == ("paper", 100.0)
    assert np.sqrt(np.diag(file.sensors.imu.cov)) == pytest.approx([0.05, 0.05, 0.005])


def test_the_implausible_inertia_of_the_paper_gives_a_notice():
    (notice,) = load("case-study-1").notes
    assert (notice.code, notice.figures["value"]) == ("vehicle.inertia-unchecked", 810.44)
    assert notice.figures["gyration_m"] == pytest.approx(23.5, abs=0.05)
    assert load("small").notes == load("car").notes == ()


def test_the_small_vehicle_has_the_inertia_of_a_disc():
    assert load("small").vehicle.inertia_kg_m2 == pytest.approx(0.5 * 0.61 * 0.07**2, rel=1e-12)


def test_the_small_vehicle_has_a_realistic_top_speed():
    assert 0.45 < drive_vehicle([1.0, 0.0, 0.0])[-1, 0] < 0.68


def test_the_small_vehicle_has_a_realistic_full_yaw_rate():
    assert 8.0 < drive_vehicle([0.0, 0.0, 1.0])[-1, 2] < 11.5


def test_the_small_vehicle_starts_between_30_and_45_percent_command():
    assert np.hypot(*drive_vehicle([0.29, 0.0, 0.0])[-1, :2]) < 0.02
    assert drive_vehicle([0.45, 0.0, 0.0])[-1, 0] > 0.05


def test_the_small_vehicle_responds_within_50_to_300_ms():
    nu = drive_vehicle([0.8, 0.0, 0.0])[:, 0]
    rise_s = DT_S * np.argmax(nu > 0.63 * nu[-1])
    assert 0.05 < rise_s < 0.30


def test_the_left_and_right_motors_of_the_small_vehicle_are_not_equal():
    assert abs(drive_vehicle([0.6, 0.0, 0.0])[-1, 2]) > 0.02


def test_the_car_reaches_a_speed_and_turns_left_with_a_positive_servo():
    nu = drive_vehicle([0.4, 0.3], 3.0, load("car").vehicle)
    assert 0.5 < nu[-1, 0] < 2.5
    assert nu[-1, 2] > 0.5


def test_an_unknown_vehicle_is_refused_with_the_garage_names():
    with refused("vehicle.unknown", FileError, value="smal", absent_path="smal"):
        load("smal")


def test_a_name_without_its_ending_is_answered_with_the_file_in_the_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "vehicle.toml").write_text(load("small").text, encoding="utf-8")
    with refused("vehicle.unknown", FileError) as error:
        load("vehicle")
    assert includes(error.value.diagnostic, "name.near", match="vehicle.toml")


def test_only_vehicle_files_are_proposed_for_an_unknown_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "map.toml").write_text("[tags]\n", encoding="utf-8")
    (tmp_path / "mine.toml").write_text('[model]\nkind = "planar"\n', encoding="utf-8")
    with refused("vehicle.unknown", FileError) as error:
        load("smal")
    (proposal,) = (cause for cause in within(error.value.diagnostic) if cause.code == "name.near")
    assert (proposal.figures["match"], "mine.toml" in str(proposal.figures["valid"])) == ("small", True)
    assert "map.toml" not in str(proposal.figures["valid"])


def test_a_missing_file_is_reported_with_a_similar_name(tmp_path):
    (tmp_path / "grotz.toml").write_text(load("small").text, encoding="utf-8")
    with refused("vehicle.absent", FileError):
        load(tmp_path / "grots.toml")


def test_a_folder_does_not_hide_a_vehicle_of_the_same_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small").mkdir()
    assert load("small").layers == ("garage: small",)


def test_a_folder_is_refused_as_a_vehicle_file(tmp_path):
    with refused("vehicle.folder-empty", FileError):
        load(tmp_path)
    (tmp_path / "mine.toml").touch()
    with refused("vehicle.folder", FileError, files="mine.toml"):
        load(tmp_path)


def test_lg11_a_file_in_a_folder_with_accents_and_spaces_loads(tmp_path):
    folder = tmp_path / "José Núñez"
    folder.mkdir()
    (folder / "mío.toml").write_text(load("small").text, encoding="utf-8")
    assert load(folder / "mío.toml").layers == ("mío.toml",)
