"""The commands `runs noise` and `runs wear` on recorded runs."""

import numpy as np
import pytest

from baqueano.identify import random_steps
from baqueano.runs import write_run
from baqueano.simulate import simulate
from baqueano.vehicle_file import load
from tests.figure_files import width_mm

FIGURES = ("--figures", "f", "--format", "pdf", "--width", "column")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a run at rest of one minute and three drives."""
    path, small = tmp_path_factory.mktemp("runs"), load("small")
    write_run(simulate(small, np.zeros((6000, 3)), 0, name="still"), path / "still.mcap")
    for k in range(3):
        u = random_steps(small.command.limit, 15.0, small.rate_hz, k)
        write_run(simulate(small, u, k, name=f"drive{k}"), path / f"drive{k}.mcap")
    return path


def test_a_run_at_rest_gives_the_noise_and_updates_the_file(baqueano, folder, tmp_path):
    end = baqueano(
        "runs",
        "noise",
        str(folder / "still.mcap"),
        "--vehicle",
        "small",
        "--json",
        "--report",
        "rest.html",
        *FIGURES,
    )
    assert end.code == 0
    rows = end.reply["rows"]
    assert [row["name"] for row in rows] == ["imu[0]", "imu[1]", "imu[2]"]
    assert all(row["allan_1s"] > 0.0 for row in rows)
    assert "Allan deviation: imu" in (tmp_path / "rest.html").read_text(encoding="utf-8")
    assert "add --update" in end.err
    assert width_mm(tmp_path / "f" / "01-allan-deviation-imu.pdf") == pytest.approx(88.0, abs=0.1)


def test_the_wear_command_lists_changed_parameters(baqueano, folder, tmp_path):
    runs = [str(folder / f"drive{k}.mcap") for k in range(3)]
    end = baqueano("runs", "wear", *runs, "--vehicle", "small", "--json", "--report", "wear.html", *FIGURES)
    assert end.code == 0
    assert end.reply["verdict"] in ("USABLE", "WARN")
    assert len(end.reply["rows"]) <= 1
    assert "Run by run" in (tmp_path / "wear.html").read_text(encoding="utf-8")
    assert width_mm(tmp_path / "f" / "01-run-by-run.pdf") == pytest.approx(88.0, abs=0.1)
