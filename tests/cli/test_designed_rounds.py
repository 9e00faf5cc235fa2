"""`experiment --signal designed --rounds N --update` writes the last fit to the vehicle file."""

import tomllib

import pytest

from baqueano.design import plan as planning
from baqueano.identify.result import assemble as summary
from baqueano.runs import read_run
from baqueano.vehicle_file import load

NAME = "model.actuator_matrix[0,0]"


@pytest.fixture
def quick(monkeypatch):
    """Make the search smaller, because its result does not matter here."""
    for name, number in (
        ("FIRST_PRIMITIVES", 40),
        ("ROUNDS", 1),
        ("PRIMITIVES_PER_ROUND", 10),
        ("FINAL_PRIMITIVES", 30),
        ("VEHICLES", 32),
    ):
        monkeypatch.setattr(planning, name, number)


@pytest.fixture
def one_noise(monkeypatch):
    """Use error bars that assume the same noise along the whole run."""
    monkeypatch.setattr(summary, "with_larger_errors", lambda problem, cov, pieces, k, by_segment: cov)


def test_the_last_round_is_written_and_starts_the_next_fit(baqueano, quick, one_noise, tmp_path):
    arguments = ("--signal", "designed", "--trust-file", "--rounds", "2", "--seconds", "8", "--update")
    end = baqueano("experiment", "--vehicle", "small", "--robot", "simulated:small", *arguments, "--json")
    assert end.code == 0, end.err
    rows = {(row["round"], row["name"]): row for row in end.reply["rows"]}
    estimate = rows[2, NAME]["estimate"]
    text = (tmp_path / "vehicle.toml").read_text(encoding="utf-8")
    assert tomllib.loads(text)["model"]["actuator_matrix"][0][0] == pytest.approx(estimate, rel=1e-6)
    assert estimate != load("small").value(NAME)
    assert rows[2, NAME]["relative_std"] < rows[1, NAME]["relative_std"]
    paths = sorted((tmp_path / "runs").iterdir())
    assert len(paths) == 2
    assert all(read_run(path).duration_s == pytest.approx(8.0, abs=0.02) for path in paths)
    second = baqueano("identify", "1", "2", "--free", NAME, "--no-noise", "--json")
    assert second.code == 0, second.err
    (row,) = second.reply["rows"]
    assert row["estimate"] == pytest.approx(estimate, rel=0.02)


@pytest.mark.parametrize(("room", "code"), [("1.5,2", "room.unreadable"), ("0.1x0.1", "room.small")])
@pytest.mark.parametrize("signal", ["designed", "multisine"])
def test_the_room_is_checked_before_the_drive(baqueano, tmp_path, room, code, signal):
    load("small").save(tmp_path / "vehicle.toml")
    end = baqueano("experiment", "--signal", signal, "--room", room)
    assert (end.code, end.reason.code) == (2, code)
    assert not list(tmp_path.glob("runs/*.mcap"))
