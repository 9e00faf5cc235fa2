"""`experiment --signal designed --rounds N --update` writes the last fit to the vehicle file."""

import tomllib
from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.cli.driving.experiment import undetermined_damping, with_uncertain_gains
from baqueano.identify.design import plan as planning
from baqueano.identify.design.vehicle_cloud import possible_vehicles
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
    arguments = ("--signal", "designed", "--known", "--rounds", "2", "--seconds", "8", "--update", "--json")
    end = baqueano("experiment", "--vehicle", "small", "--robot", "simulated:small", *arguments)
    assert end.code == 0, end.err
    rows = {(row["round"], row["name"]): row for row in end.reply["rows"]}
    estimate = rows[2, NAME]["estimate"]
    text = (tmp_path / "vehicle.toml").read_text(encoding="utf-8")
    assert tomllib.loads(text)["model"]["actuator_matrix"][0][0] == pytest.approx(estimate, rel=1e-6)
    assert estimate != load("small").value(NAME)
    assert rows[2, NAME]["relative_sd"] < rows[1, NAME]["relative_sd"]
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


def test_a_fit_that_does_not_show_how_the_vehicle_stops_is_not_used_for_a_plan():
    """Of the parameters that slow a car, one is 0 at its bound with a large error, and one is not determined."""
    names = ("model.throttle_gain", "model.linear_drag", "model.coulomb_m_s2", "model.cornering_drag")
    blocks = SimpleNamespace(model=load("car").vehicle)
    estimate, poorly = np.array([5.0, 0.0, np.nan, 0.0]), np.array([True, True, False, True])
    fit = SimpleNamespace(
        names=names,
        estimate=estimate,
        poorly_identified=poorly,
        bound=np.array([0, -1, 0, -1]),
        blocks=blocks,
    )
    assert undetermined_damping(fit) == ["model.linear_drag", "model.coulomb_m_s2"]
    fit.estimate, fit.bound = np.array([5.0, 1.2, 0.3, 0.0]), np.array([0, 0, 0, -1])
    assert undetermined_damping(fit) == []


@pytest.mark.parametrize(("name", "count"), [("car", 2), ("small", 0)])
def test_a_plan_with_rough_gains_takes_the_other_guesses_as_uncertain_by_a_half(name, count):
    rough_file = with_uncertain_gains(load(name))
    draws = possible_vehicles(rough_file, vehicle_count=200)
    std = np.std(np.log(draws.theta[1:, count:] / draws.theta[0, count:]), axis=0)
    assert len(rough_file.parameter_cov.names) == count
    assert np.median(std) == pytest.approx(0.5, rel=0.1)
