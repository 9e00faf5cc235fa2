"""`identify --held-out` reports its verdict as text, in --json, in the exit code and in the file."""

import re
from dataclasses import replace

import pytest

from baqueano.identify import random_steps
from baqueano.runs import read_run, write_run
from baqueano.simulate import simulate
from baqueano.vehicle_file import load


@pytest.fixture
def identify_against(baqueano, tmp_path):
    """Run `identify` on a run of the small vehicle, with another run for validation."""
    small = load("small")
    small.save(tmp_path / "my.toml")
    turned_file = small.with_values({"model.actuator_matrix": [[3.38, 0, 0], [0, 0, 0], [0, 0, -0.203]]})
    for seed, (name, file, seconds) in enumerate(
        (("own", small, 12.0), ("turned", turned_file, 12.0), ("short", small, 3.0))
    ):
        u = random_steps(small.command.limit, seconds, small.rate_hz, seed, hold_s=0.5)
        write_run(simulate(file, u, seed), tmp_path / f"{name}.mcap")
    words = ("--vehicle", "my.toml", "--free", "model.mass_kg", "--no-noise", "--update")
    return lambda *held_out: baqueano("identify", "own.mcap", *words, "--held-out", *held_out)


def test_a_fit_refused_by_validation_does_not_change_the_file(identify_against, tmp_path):
    before = (tmp_path / "my.toml").read_text()
    end = identify_against("turned.mcap")
    assert end.code == 1
    assert end.reason.code == "cli.fit-refused-held-out"
    reason, _, _ = str(end.reason.figures["reasons"]).partition("; ")
    assert re.search(r"\bturned\b.* -\d+.* imu\[\d\]", reason), "it explains less than the mean value does"
    first, _, _ = reason.partition(" (")  # the paragraph names the other channels in brackets
    assert f"REFUSED: {first}" in end.out
    assert (tmp_path / "my.toml").read_text() == before


def test_an_imu_upside_down_in_all_runs_is_not_validated_and_not_written(baqueano, tmp_path):
    """Gyro and a_y are inverted together, so the mirrored model explains every run of this log."""
    small = load("small")
    small.save(tmp_path / "my.toml")
    for seed in (1, 2):
        run = simulate(small, random_steps(small.command.limit, 12.0, small.rate_hz, seed), seed)
        imu = run.sensors["imu"]
        turned_run = replace(run, sensors={"imu": imu._replace(z=imu.z * [1.0, -1.0, -1.0])})
        write_run(turned_run, tmp_path / f"{seed}.mcap")
    before = (tmp_path / "my.toml").read_text()
    end = baqueano(
        "identify",
        "1.mcap",
        "--vehicle",
        "my.toml",
        "--held-out",
        "2.mcap",
        "--no-noise",
        "--update",
        "--json",
    )
    assert (end.code, end.reason.code) == (1, "cli.fit-mirrored")
    verdict = end.reply["rows"][-1]
    assert verdict["verdict"] == "WARN"
    assert "validation.shared-fault" in [reason["code"] for reason in verdict["reasons"]]
    assert (tmp_path / "my.toml").read_text() == before


def test_too_little_motion_does_not_validate_a_fit(identify_against, tmp_path):
    end = identify_against("short.mcap", "--json")
    assert end.code == 0
    verdict = end.reply["rows"][-1]
    assert (verdict["name"], verdict["verdict"]) == ("held_out_verdict", "CANNOT TELL")
    assert "checked over 2.99 s in open loop" in verdict["sentence"]
    assert load(tmp_path / "my.toml").envelope.run == "own"


def test_a_replay_reports_that_the_run_leaves_the_envelope(identify_against, baqueano, tmp_path):
    identify_against("short.mcap")
    file = load("my.toml")
    slow = file.envelope._replace(low=0.3 * file.envelope.low, high=0.3 * file.envelope.high)
    file.with_values({}, envelope=slow).save(tmp_path / "slow.toml")
    end = baqueano("replay", "own.mcap", "--vehicle", "slow.toml", "-o", "again.mcap")
    assert end.code == 0, end.err
    assert "warning: the run leaves the envelope of the fit: u_x goes from" in end.err
    assert any(event.source == "model" for event in read_run(tmp_path / "again.mcap").events)
