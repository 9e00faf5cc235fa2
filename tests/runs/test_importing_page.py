"""The map, the vehicle file and the commands of docs/importing.md work on a recording made as described."""

import re
from pathlib import Path

import numpy as np
import pytest

from baqueano.compare import compare
from baqueano.drive import replay
from baqueano.runs import read_run
from baqueano.runs.maps.column_map import load_map
from baqueano.vehicle_file import load
from tests.runs.conftest import run_line

PAGE = (Path(__file__).parents[2] / "docs" / "importing.md").read_text(encoding="utf-8")
TRIALS, ROWS, DT_S = 6, 400, 0.02
RIVALS = None, "dead_reckoning"  # None: the estimator of the file
TRUE = {
    "model.actuator_matrix[0,0]": 4.0,
    "model.friction.linear": [3.0, 20.0, 0.05],
    "model.drivetrain.dead_zone_forward": [0.12, 0.09],
    "model.drivetrain.dead_zone_backward": [0.10, 0.14],
}


def of_page(kind, index=0):
    return re.findall(rf"```{kind}\n(.*?)```", PAGE, re.DOTALL)[index]


def trials(vehicle):
    """Return lines of trials.csv: both wheels change speed in random steps, from rest."""
    random, lines = np.random.default_rng(1), [of_page("text").strip()]
    for trial in range(1, TRIALS + 1):
        state, gyro = vehicle.init(), 0.0
        levels = random.integers(-255, 256, size=(ROWS // 20, 2))
        for k in range(ROWS):
            pwm = levels[k // 20]
            x, y, psi = state.eta
            v, r = state.nu[0], state.nu[2]
            rpm = (np.array([v - 0.1 * r, v + 0.1 * r]) / 0.03 + 0.2 * random.normal(size=2)) * 30.0 / np.pi
            if k % 2 == 0:
                gyro = np.degrees(r + 0.01 * random.normal())
            row = [trial, 20 * k, *pwm, *rpm, gyro, 1e3 * x, 1e3 * y, np.degrees(psi)]
            lines.append(",".join(f"{number:.9g}" for number in row))
            left, right = pwm / 255.0
            state, _ = vehicle.step(
                state, np.array([(left + right) / 2, 0.0, (right - left) / 2]), DT_S, np.zeros(3)
            )
    return "\n".join(lines) + "\n"


def ate_m(run, estimator):
    return compare([replay(run, load("rover.toml"), estimator=estimator)]).runs[0].ate_m


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("trials.toml").write_text(of_page("toml", 0), encoding="utf-8")
    Path("rover.toml").write_text(of_page("toml", 1), encoding="utf-8")
    Path("trials.csv").write_text(trials(load("rover.toml").with_values(TRUE).vehicle), encoding="utf-8")
    return tmp_path


def test_the_commands_of_the_importing_page_give_runs_and_a_model(folder, capsys):
    run_line(of_page("sh", 0))
    runs = [read_run(path) for path in sorted(Path("trials").glob("*.mcap"))]
    assert [run.name for run in runs] == [f"trials-00{k}" for k in range(1, TRIALS + 1)]
    assert runs[0].applied_commands.shape == (ROWS - 1, 3)  # no command comes before the first row
    assert len(runs[0].sensors["imu"].z) == ROWS // 2
    assert np.isnan(runs[0].sensors["imu"].z[:, :2]).all()
    assert np.max(np.abs(runs[0].sensors["imu"].z[:, 2])) < 20.0
    assert runs[0].truth is not None
    run_line(of_page("sh", 1))
    fitted_file = load("rover.toml")
    for name, index, truth in (
        ("model.actuator_matrix", (0, 0), 4.0),
        ("model.friction.linear", (0,), 3.0),
        ("model.drivetrain.dead_zone_forward", (0,), 0.12),
        ("model.drivetrain.dead_zone_backward", (1,), 0.14),
    ):
        estimate, std = (
            np.array(x)[index] for x in (fitted_file.value(name), fitted_file.provenance[name].std)
        )
        assert abs(estimate - truth) < 4.0 * std + 0.02 * truth, (name, estimate, std)
    output = capsys.readouterr()
    assert "held out" in output.out + output.err
    for line in of_page("sh", 2).splitlines():
        run_line(line)
    replayed_run, reckoned_run = (read_run(Path(f"{name}.mcap")) for name in ("replayed", "reckoned"))
    errors = [comparison.ate_m for comparison in compare([replayed_run, reckoned_run]).runs]
    assert max(errors) < 0.01
    squares = [np.mean(np.square([ate_m(run, estimator) for run in runs])) for estimator in RIVALS]
    assert squares[0] < squares[1], "the filter is better than dead reckoning over all trials"
    assert Path("replayed.html").is_file()


def test_the_counts_entry_of_the_importing_page_works_in_a_map(folder):
    (counts,) = re.findall(r"^# .*: (\{ column = \"left_counts\".*\})$", of_page("toml", 0), re.MULTILINE)
    text = Path("trials.toml").read_text(encoding="utf-8")
    rpm = '{ column = "left_rpm", unit = "rpm", radius_m = 0.03 }'
    assert rpm in text
    Path("trials.toml").write_text(text.replace(rpm, counts), encoding="utf-8")
    entry = load_map("trials.toml").sensors["wheels"].entries[0]
    assert (entry.si_factor, entry.wraps, entry.radius_m) == (pytest.approx(2.0 * np.pi / 600.0), 65536, 0.03)


def test_the_importing_page_lists_every_key_of_a_map():
    keys = ("path", "time_unit", "shift_s", "where", "new_when", "split_gap_s", "rate_hz", "repeats", "backwards",
            "topic", "delimiter", "decimal", "encoding", "header", "comment", "in_force", "wheels", "sample", "scale",
            "offset", "times", "derivative", "radius_m", "constant", "quaternion",
            "time_rest", "wraps", "backward", "counts_per_turn")  # fmt: skip
    assert [key for key in keys if key not in PAGE] == []
