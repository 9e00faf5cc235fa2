"""The first steps of a new user, from `make demo` to a drive, and the advised next steps."""

import sys
from inspect import signature
from pathlib import Path

import numpy as np
import pytest

from baqueano.cli import demo, options
from baqueano.cli.modelling.tune import command as tune
from baqueano.diagnostics import note
from baqueano.drive import experiment
from baqueano.messages import text
from baqueano.messages.notation import COMMAND_LINE, use_notation
from baqueano.messages.printable import shell_command
from baqueano.runs import read_run
from baqueano.runs.folder import find
from baqueano.vehicle_file import Provenance, garage_names, load, parse


def test_the_demo_prints_a_program_name_that_the_shell_can_run(tmp_path, monkeypatch):
    program = tmp_path / "baqueano"
    program.touch(mode=0o755)
    monkeypatch.setattr(sys, "argv", [str(program), "demo"])
    monkeypatch.setenv("PATH", "")
    assert demo.program_name() == str(program), "make installs it in .venv, which is not in the path"
    module = tmp_path / "__main__.py"
    module.touch()
    monkeypatch.setattr(sys, "argv", [str(module), "demo"])
    assert demo.program_name() == shell_command(sys.executable, "-m", "baqueano")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert demo.program_name() == "baqueano"


def test_a_second_demo_uses_a_new_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert demo.unused_folder() == Path("demo")
    for name in ("demo", "demo-2"):
        Path(name).mkdir()
    assert demo.unused_folder() == Path("demo-3")


def test_tune_reports_the_same_cost_in_python_and_on_the_command_line(baqueano):
    from baqueano.tune.objective import tuning_objective

    defaults = {param.name: param.default for param in tune.params}
    for name in ("jerk_m2", "offset_m"):
        assert defaults[name] == signature(tuning_objective).parameters[name].default == 0.1


def test_measuring_advice_for_a_new_vehicle_ends_with_its_first_fit(baqueano, tmp_path, monkeypatch):
    advice = "First identify the model: baqueano experiment, then baqueano identify last --update"
    assert "guesses" in baqueano("new", "mylab").err
    monkeypatch.chdir(tmp_path / "mylab")
    assert load("vehicle.toml").provenance["model"] == ("a guess", None, None, "GUESS")
    lesson = baqueano("teach", "lab", "--driver", "circle", "--size", "0.3", "--speed", "0.4")
    for end in (lesson, baqueano("repeat", "lab")):
        assert end.code == 0
        assert end.err.count(advice) == 1, "the advice is one sentence and not a refusal"
    for flags, times in ((["--json"], 1), ([], 0)):  # the table of a run lists its warnings
        end = baqueano("experiment", "--seconds", "20", *flags)
        (warning, *_rest) = [e.diagnostic for e in read_run(find("last")).events if e.level == "warning"]
        with use_notation(COMMAND_LINE):
            sentence = text(note("cli.warning", cause=warning))
        assert (end.code, end.err.count(sentence)) == (0, times)
    assert (
        baqueano("identify", "last", "--free", "model.actuator_matrix[0,0]", "--no-noise", "--update").code
        == 0
    )
    assert advice not in baqueano("repeat", "lab").err
    assert 'verdict = "GUESS"' in Path("vehicle.toml").read_text(encoding="utf-8"), (
        "a table without a fit is still a guess"
    )


def test_a_new_project_drives_a_vehicle_that_differs_from_its_file(baqueano, tmp_path, monkeypatch):
    for name in garage_names():
        baqueano("new", name, "--vehicle", name)
        guess = load(tmp_path / name / "vehicle.toml")
        assert guess.is_guess
        assert guess.truth.layers == (f"garage: {name}",)
        key = "model.friction.linear" if name != "car" else "model.linear_drag"
        guesses, truth = guess.value(key), guess.truth.value(key)
        assert np.all(np.abs(guesses - truth) > 0.1 * np.abs(truth)), f"{name}: a guess is off"
        sds = [origin.std for origin in guess.provenance.values() if origin.std is not None]
        assert sds, "a guess must state its possible error"
    guess, u = load(tmp_path / "small" / "vehicle.toml"), np.tile([0.6, 0.0, 0.1], (100, 1))
    assert experiment(guess, u) == experiment(guess, u, truth=load("small"))
    assert experiment(guess, u) != experiment(guess, u, truth=guess)
    monkeypatch.chdir(tmp_path / "small")
    assert "simulated vehicle: small (named in vehicle.toml" in baqueano("experiment", "--seconds", "1").err


def test_a_missing_truth_file_is_named(baqueano, tmp_path, monkeypatch):
    baqueano("new", "mylab")
    monkeypatch.chdir(tmp_path / "mylab")
    text = Path("vehicle.toml").read_text(encoding="utf-8")
    Path("vehicle.toml").write_text(text.replace('truth = "small"', 'truth = "body.toml"'), encoding="utf-8")
    assert baqueano("experiment", "--seconds", "1").reason.code == "vehicle.absent"
    load("small").save("body.toml")
    assert baqueano("experiment", "--seconds", "1").code == 0, "a file beside this one"


BARE = """
format = 1
name = "bare"
rate_hz = 100.0
[command]
names = ["u_x", "u_y", "u_psi"]
limit = [1.0, 0.0, 1.0]
[geometry]
radius_m = 0.07
track_m = 0.12
[model]
kind = "planar"
mass_kg = 0.6
actuator_matrix = [[3.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.2]]
[model.friction]
linear = [3.0, 30.0, 0.01]
[model.drivetrain]
mixing = "two_wheels"
[sensors.imu]
kind = "imu"
"""


@pytest.mark.parametrize("kind", ["augmented_ekf", "ekf", "unscented", "dead_reckoning", "complementary"])
def test_an_unfitted_vehicle_file_replays_a_run_with_any_estimator(baqueano, kind):
    """The file contains no noise, no covariances and no gains."""
    Path("bare.toml").write_text(BARE, encoding="utf-8")
    baqueano("experiment", "--vehicle", "small", "--seconds", "2")
    end = baqueano("replay", "1", "--vehicle", "bare.toml", "--estimator", kind)
    assert end.code == 0, end.err
    (event,) = [
        e.diagnostic for e in read_run(find("last")).events if e.level == "warning" and e.source == "drive"
    ]
    assert (event.code, event.figures["sensors"]) == ("drive.usual-noise", "imu")
    assert "noise of imu" in end.err


def test_noise_stated_in_the_file_is_used_unchanged():
    half = parse(BARE + "accel_noise_std = [0.2, 0.0]\ngyro_noise_std = 0.01\n", "half.toml")
    assert half.sensors_without_noise == ("imu",)
    np.testing.assert_allclose(np.diag(half.estimator().sensors.imu.cov), [0.04, 0.01, 0.0001])
    assert not half.sensors.imu.cov[1, 1], "the simulated vehicle equals the file"
    vehicle = parse(BARE + "accel_noise_std = [0.2, 0.1]\ngyro_noise_std = 0.01\n", "whole.toml")
    assert (vehicle.sensors_without_noise, vehicle.estimator().sensors is vehicle.sensors) == ((), True)


def test_measuring_advice_names_the_vehicle_and_its_path(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    load("small").save(tmp_path / "my vehicle.toml")
    options.advise_to_measure(load("my vehicle.toml"), "simulated:small")
    load("small").save(tmp_path / "vehicle.toml")  # in this case the user must name a garage vehicle
    options.advise_to_measure(load("small"), "pilot@rover.local")
    output = capsys.readouterr().err
    assert "baqueano experiment --vehicle 'my vehicle.toml' --robot simulated:small, then" in output
    assert "baqueano identify last --vehicle 'my vehicle.toml' --update" in output
    assert "small.toml: its model is a guess" in output
    assert "baqueano experiment --vehicle small --robot pilot@rover.local" in output


def test_no_measuring_advice_for_a_simulated_garage_vehicle(capsys):
    options.advise_to_measure(load("small"))
    options.advise_to_measure(load("small"), "emulated")
    assert not capsys.readouterr().err


def test_a_measured_vehicle_is_not_called_a_guess_in_a_project(baqueano, tmp_path):
    provenance = {"model.mass_kg": Provenance("0001-experiment", verdict="USABLE")}
    load("small").with_values({}, provenance).save(tmp_path / "mine.toml")
    assert "guess" not in baqueano("new", "mylab", "--vehicle", "mine.toml").err
    assert "model" not in load(tmp_path / "mylab" / "vehicle.toml").provenance


def test_the_simulated_truth_of_a_project_differs_from_its_guess(baqueano, tmp_path):
    real = load("small").with_values({"model.mass_kg": 0.7})
    real.save(tmp_path / "mine.toml")
    assert baqueano("new", "mylab", "--vehicle", "mine.toml").code == 0
    project = load(tmp_path / "mylab" / "vehicle.toml")
    key = "model.friction.linear"
    assert project.value(key).tolist() == real.value(key).tolist()
    ratio = project.truth.value(key) / project.value(key)
    assert ((ratio > 0.5) & (ratio < 2.0) & (abs(ratio - 1.0) > 1e-3)).all()
    assert project.truth.value("model.mass_kg") == 0.7, "a scale measures it"


def test_simulate_uses_the_project_truth_or_the_model_on_request(baqueano, tmp_path, monkeypatch):
    assert baqueano("new", "mylab").code == 0
    monkeypatch.chdir(tmp_path / "mylab")
    ends = [
        baqueano("simulate", "--seconds", "1", "-o", f"{k}.mcap", *options)
        for k, options in enumerate(((), ("--model",)))
    ]
    truth, model = (read_run(tmp_path / "mylab" / f"{k}.mcap") for k in range(2))
    assert "simulated vehicle: small" in ends[0].err
    assert "simulated vehicle: small" not in ends[1].err
    assert abs(truth.truth.nu[-1, 0] - model.truth.nu[-1, 0]) > 1e-4
    assert (
        truth.vehicle_text
        == model.vehicle_text
        == (tmp_path / "mylab" / "vehicle.toml").read_text(encoding="utf-8")
    )


def test_a_shape_too_fast_to_follow_is_refused_with_a_proposed_speed(baqueano, tmp_path):
    end = baqueano("teach", "r", "--vehicle", "small", "--driver", "circle", "--size", "0.3", "--speed", "3")
    assert end.code == 1
    assert (end.reason.code, end.reason.figures["speed_m_s"]) == ("cli.not-followed", 3.0)
    assert end.fix == "baqueano teach r --driver circle --speed 0.2"
    assert not (tmp_path / "routes").exists()


def test_comparing_a_run_without_an_estimate_advises_a_replay(baqueano):
    baqueano("simulate", "--vehicle", "small", "--seconds", "1")
    end = baqueano("compare", "1")
    assert end.code == 0
    line = "baqueano replay runs/0001-simulation.mcap"  # the run contains its vehicle file
    assert end.err.replace("\\", "/").endswith(f": {line}\n")
    second = baqueano(*line.split()[1:])
    assert second.code == 0, second.err
