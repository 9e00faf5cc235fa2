"""Values are written back: comments are preserved, only changed values change, completely or not at all."""

import difflib
import os
import subprocess
import sys
from datetime import date

import numpy as np
import pytest

from baqueano.errors import FileError, UsageError
from baqueano.vehicle_file import ParameterCov, Provenance, load, parse
from tests.codes import refused

LINEAR = np.array([3.4123456789, 41.0, 0.0123])
SD = np.array([0.02, 0.5, 0.00004])
SOURCE = Provenance("runs/0001-experiment.mcap", date(2026, 11, 21), SD, "USABLE")


def difference(before, after):
    lines = difflib.unified_diff(before.text.splitlines(), after.text.splitlines(), lineterm="", n=0)
    return [line for line in lines if line[:1] in "+-" and line[:3] not in ("+++", "---")]


def test_only_lines_of_changed_values_change_and_comments_are_preserved():
    small = load("small")
    changed_file = small.with_values({"model.mass_kg": 0.62, "sensors.imu.gyro_bias": 0.01})
    assert difference(small, changed_file) == [
        "-mass_kg = 0.61 # by scale; inertia_kg_m2 is omitted: ½ m R² = 0.00149",
        "+mass_kg = 0.62 # by scale; inertia_kg_m2 is omitted: ½ m R² = 0.00149",
        "-gyro_bias = 0.015",
        "+gyro_bias = 0.01",
    ]
    assert (changed_file.vehicle.mass_kg, changed_file.sensors.imu.gyro_bias) == (0.62, 0.01)
    assert small.vehicle.mass_kg == 0.61


def test_comments_within_a_matrix_are_preserved():
    changed_file = load("small").with_values(
        {"model.actuator_matrix[0,0]": 3.5, "model.actuator_matrix[2][2]": 0.2}
    )
    assert "  [3.5, 0.0, 0.0], # both motors stalled: 2 · 0.055 N m / 0.0325 m" in changed_file.text
    assert np.diag(changed_file.vehicle.actuator_matrix).tolist() == [3.5, 0.0, 0.2]


def test_writing_the_same_values_does_not_change_the_text():
    small = load("small")
    keys = [
        "model.friction.linear",
        "model.actuator_matrix",
        "supervisor.max_speed_m_s",
        "sensors.imu.accel_noise_std",
    ]
    assert small.with_values({key: small.value(key) for key in keys}).text == small.text


def test_a_missing_key_is_added_to_its_table():
    changed_file = load("small").with_values({"model.friction.cornering": 0.2, "model.drivetrain.sag": 0.1})
    assert changed_file.vehicle.friction.cornering == 0.2
    assert difference(load("small"), changed_file) == ["+cornering = 0.2", "+sag = 0.1"]


def test_a_missing_table_is_added():
    text = load("small").text
    text = text[: text.index("[controller]")]
    changed_file = parse(text, "x.toml").with_values({"controller.k_x": 1.5, "controller.k_chi": 2.5})
    assert (changed_file.controller().k_x, changed_file.controller().k_chi) == (1.5, 2.5)


def test_a_model_is_a_guess_until_a_usable_fit_changes_it():
    small, key = load("small"), "model.friction.linear"
    assert small.is_guess
    assert not small.with_values({}, {key: SOURCE}).is_guess
    assert small.with_values({}, {key: SOURCE._replace(verdict="REFUSED")}).is_guess
    assert small.with_values({}, {"sensors.imu.gyro_bias": SOURCE, "controller.k_x": SOURCE}).is_guess


def test_after_a_partial_fit_a_table_retains_its_mark_as_a_guess():
    text = load("small").text + '\n[provenance.model]\nrun = "the data sheet of another"\nverdict = "GUESS"\n'
    guess = parse(text + '[provenance."model.friction"]\nrun = "a friend"\nverdict = "GUESS"\n', "mine.toml")
    assert guess.is_guess
    fitted_file = guess.with_values({"model.friction.linear": LINEAR}, {"model.friction.linear": SOURCE})
    assert not fitted_file.is_guess
    assert fitted_file.provenance["model"].verdict == "GUESS"
    assert parse(fitted_file.text, "mine.toml").provenance.keys() == fitted_file.provenance.keys()


def test_a_fitted_value_has_its_provenance():
    changed_file = load("small").with_values(
        {"model.friction.linear": LINEAR}, provenance={"model.friction.linear": SOURCE}
    )
    assert (
        '[provenance."model.friction.linear"]\nrun = "runs/0001-experiment.mcap"\ndate = 2026-11-21\n'
        in changed_file.text
    )
    provenance = changed_file.provenance["model.friction.linear"]
    assert (provenance.run, provenance.date, provenance.verdict) == (SOURCE.run, SOURCE.date, "USABLE")
    assert provenance.std.tolist() == SD.tolist()
    former_file = parse(changed_file.text.replace("\nstd = [", "\nsd = ["), "of an older run")
    assert former_file.provenance["model.friction.linear"].std.tolist() == SD.tolist()


def test_a_value_is_written_to_a_thousandth_of_its_standard_deviation():
    changed_file = load("small").with_values(
        {"model.friction.linear": LINEAR}, provenance={"model.friction.linear": SOURCE._asdict()}
    )
    assert "linear = [3.41235, 41.0, 0.0123] # back EMF" in changed_file.text
    assert np.all(np.abs(changed_file.vehicle.friction.linear - LINEAR) < 1e-3 * SD)


def test_without_a_standard_deviation_a_value_is_written_exactly():
    value = 0.1 + 0.2
    assert load("small").with_values({"controller.k_x": value}).controller().k_x == value


def test_a_changed_value_loses_its_provenance():
    fitted_file = load("small").with_values(
        {"model.friction.linear": LINEAR}, provenance={"model.friction.linear": SOURCE}
    )
    assert fitted_file.with_values({"model.friction.linear[0]": 3.0}).provenance == {}
    assert list(fitted_file.with_values({"model.mass_kg": 0.6}).provenance) == ["model.friction.linear"]


def test_the_covariance_of_the_last_fit_is_stored_in_the_file():
    rng = np.random.default_rng(3)
    A = rng.standard_normal((3, 3)) * [1e-2, 1.0, 1e-4]
    cov = A.T @ A
    names = ("model.friction.linear[0]", "model.actuator_matrix[0,0]", "model.mass_kg")
    changed_file = load("small").with_values({}, parameter_cov=ParameterCov(names, cov, "runs/0001.mcap"))
    assert "names = [" in changed_file.text
    assert "correlation = [[1.0], [" in changed_file.text
    assert changed_file.parameter_cov.names == names
    assert (
        np.max(np.abs(changed_file.parameter_cov.cov - cov) / np.sqrt(np.outer(np.diag(cov), np.diag(cov))))
        < 1e-7
    )
    refitted_file = changed_file.with_values(
        {}, parameter_cov=ParameterCov(names[:1], cov[:1, :1], "runs/0002.mcap")
    )
    assert refitted_file.parameter_cov.cov.shape == (1, 1)
    assert refitted_file.text.count("[parameter_cov]") == 1


def test_an_invalid_value_is_not_written():
    with refused("vehicle.out-of-range", FileError, value="-1"):
        load("small").with_values({"model.mass_kg": -1.0})


@pytest.mark.parametrize(
    ("key", "code", "figures"),
    [
        ("model.friction.liner", "name.near", {"match": "model.friction.linear"}),
        ("mass", "vehicle.unknown-key", {"file": "small", "value": "mass"}),
        ("model.friction.linear[7]", "vehicle.no-entry", {"shape": "(3,)", "entry": "[7]"}),
    ],
)
def test_an_unknown_key_is_not_written(key, code, figures):
    with refused(code, UsageError, **figures):
        load("small").with_values({key: 1.0})
    with refused("vehicle.unknown-key", UsageError, value="nothing"):
        load("small").with_values({}, provenance={"nothing": SOURCE})


def test_a_value_absent_from_the_file_has_its_default():
    small = load("small")
    assert small.value("model.friction.cornering") == 0.0
    assert small.value("model.inertia_kg_m2") == pytest.approx(0.0014945)
    assert small.value("estimator.gate_sigma") == 4.0
    assert small.value("sensors.imu.accel_bias[1]") == -0.08
    assert small.value("command.limit").tolist() == [1.0, 0.0, 1.0]
    assert small.value("controller.kind") == "pd_feedforward"
    assert small.value("rate_hz") == 100.0
    with refused("vehicle.unknown-key", UsageError):
        small.value("sensors.imu.acel_bias")


def test_saving_and_loading_gives_the_same_vehicle(tmp_path):
    path = load("small").with_values({"model.mass_kg": 0.7}).save(tmp_path / "José Núñez.toml")
    assert load(path).vehicle.mass_kg == 0.7
    assert os.listdir(tmp_path) == ["José Núñez.toml"]


def test_windows_line_ends_are_preserved(tmp_path):
    path = tmp_path / "my.toml"
    path.write_bytes(load("small").text.replace("\n", "\r\n").encode())
    load(path).with_values({"model.mass_kg": 0.7, "model.friction.linear": LINEAR}).save()
    content = path.read_bytes()
    assert content.count(b"\r\n") == content.count(b"\n") == load("small").text.count("\n")


def test_a_vehicle_of_the_garage_is_not_overwritten():
    with refused("vehicle.of-garage", UsageError, name="small"):
        load("small").save()


def test_a_file_changed_by_another_program_is_not_overwritten(tmp_path):
    path = load("small").save(tmp_path / "my.toml")
    edited_file = load(path).with_values({"model.mass_kg": 0.7})
    path.write_text(path.read_text(encoding="utf-8") + "# from the editor\n", encoding="utf-8")
    with refused("vehicle.changed-since", FileError):
        edited_file.save()
    assert "# from the editor" in path.read_text(encoding="utf-8")


def test_a_file_can_be_saved_twice(tmp_path):
    path = load("small").save(tmp_path / "my.toml")
    once = load(path).with_values({"model.mass_kg": 0.7})
    once.save()
    once.with_values({"model.mass_kg": 0.8}).save()
    assert load(path).vehicle.mass_kg == 0.8


def test_a_full_disk_leaves_the_old_file_intact(tmp_path, monkeypatch):
    path = load("small").save(tmp_path / "my.toml")
    before = path.read_bytes()

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with refused("vehicle.not-written", FileError):
        load(path).with_values({"model.mass_kg": 0.7}).save()
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["my.toml"]


def test_a_missing_folder_is_reported(tmp_path):
    with refused("vehicle.not-written", FileError):
        load("small").save(tmp_path / "nowhere" / "my.toml")


@pytest.mark.skipif(not hasattr(os, "symlink") or os.name == "nt", reason="no links")
def test_lg11_a_symbolic_link_is_preserved(tmp_path):
    real = load("small").save(tmp_path / "real.toml")
    (tmp_path / "vehicle.toml").symlink_to(real)
    load("small").with_values({"model.mass_kg": 0.7}).save(tmp_path / "vehicle.toml")
    assert (tmp_path / "vehicle.toml").is_symlink()
    assert load(real).vehicle.mass_kg == 0.7


def test_lg10_an_interruption_while_saving_leaves_a_complete_file(tmp_path):
    """Processes are killed while they save repeatedly; none leaves an incomplete file."""
    path = load("small").save(tmp_path / "my.toml")
    code = (
        "import sys, os, pathlib\n"
        "from baqueano.vehicle_file.text.edit import write_file_text\n"
        "text = pathlib.Path(sys.argv[1]).read_text(encoding='utf-8')\n"
        "class File: path = None; on_disk = None; name = 'x'\n"
        "print('go', flush=True)\n"
        "while True:\n"
        "    File.text = text; write_file_text(File, sys.argv[1])\n"
    )
    expected = path.read_bytes()
    for k in range(3):
        child = subprocess.Popen([sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE)
        child.stdout.readline()
        with pytest.raises(subprocess.TimeoutExpired):
            child.wait(0.02 + 0.007 * k)
        child.kill()
        child.wait()
        child.stdout.close()
        assert path.read_bytes() == expected


def test_a_missing_tomlkit_is_reported_at_writing(monkeypatch):
    monkeypatch.setitem(sys.modules, "tomlkit", None)
    assert load("small").vehicle.mass_kg == 0.61
    with refused("vehicle.no-tomlkit", UsageError):
        load("small").with_values({"model.mass_kg": 0.7})


def history(extra):
    return load("small").text + extra


@pytest.mark.parametrize(
    ("extra", "code", "figures"),
    [
        ('[provenance."model.friction.liner"]\nrun = ""', "name.near", {"match": "model.friction.linear"}),
        ('[provenance."model.fricton"]\nrun = ""', "vehicle.key-unknown", {"value": "model.fricton"}),
        ('[provenance]\n"model.mass_kg" = 3', "vehicle.provenance-not-table", {}),
        ('[provenance."model.mass_kg"]\nrn = ""', "name.near", {"match": "run"}),
        ('[provenance."model.mass_kg"]\nrun = 3', "vehicle.not-text", {"value": "3"}),
        ('[provenance."model.mass_kg"]\ndate = "x"', "vehicle.not-date", {"value": "'x'"}),
        ('[provenance."model.mass_kg"]\nsd = -1', "vehicle.not-std", {"value": "-1"}),
        ("[parameter_cov]\nnames = ['model.nothing']", "vehicle.cov-names", {}),
        (
            "[parameter_cov]\nnames = ['model.mass_kg']\nsd = [1]\ncorrelation = []",
            "vehicle.cov-size",
            {"expected": 1},
        ),
        ("[parameter_cov]\nname = []", "name.near", {"match": "names"}),
        (
            "[parameter_cov]\nnames = ['model.mass_kg', 'rate_hz', 'model.slope_rad']\nsd = [1, 1, 1]\n"
            "correlation = [[1], [0.9, 1], [0.9, -0.9, 1]]",
            "vehicle.correlation",
            {},
        ),
    ],
)
def test_an_invalid_provenance_is_refused(extra, code, figures):
    with refused(code, FileError, **figures):
        parse(history(extra), "my.toml")


def test_a_covariance_that_is_not_a_table_is_refused():
    with refused("vehicle.cov-not-table", FileError):
        parse(load("small").text.replace("format = 1", "format = 1\nparameter_cov = 3"), "my.toml")
