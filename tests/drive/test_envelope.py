"""Every function reports that a vehicle leaves the range of its fit. One table in the file states this range."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.diagnostics import Verdict
from baqueano.drive import experiment, repeat, replay
from baqueano.errors import FileError, UsageError
from baqueano.guides.shapes import circle
from baqueano.identify import FitOptions, identify, random_steps
from baqueano.simulate import simulate, simulate_loops, simulate_many
from baqueano.vehicle_file import load, parse
from baqueano.vehicle_file.envelope import Envelope
from tests.codes import refused


@pytest.fixture(scope="module")
def small():
    """The small vehicle, fitted to slow driving."""
    envelope = Envelope(
        ("u_x", "u_y", "u_psi", "imu[2]"), np.array([-0.5, 0, -0.2, -3]), np.array([0.5, 0, 0.2, 3]), "slow"
    )
    return load("small").with_values({}, envelope=envelope)


def range_warnings(run):
    """Return the notes of a run that the vehicle left the envelope."""
    events = [event.diagnostic for event in run.events if event.source == "model"]
    return [event for event in events if event.code == "envelope.left"]


SLOW, FAST = np.tile([0.5, 0.0, 0.1], (150, 1)), np.tile([0.9, 0.0, 0.1], (150, 1))


def test_a_fit_writes_the_range_of_its_motion(small):
    u = random_steps([0.8, 0.0, 0.4], 10.0, small.rate_hz, 0)
    fit = identify(
        simulate(load("small"), u, name="first"),
        load("small"),
        ["model.mass_kg"],
        options=FitOptions(diagnose=False),
    )
    envelope = fit.vehicle_file.envelope
    assert envelope.names == ("u_x", "u_y", "u_psi", "imu[2]")
    assert envelope.run == "first"
    np.testing.assert_allclose(envelope.high[:3], u.max(axis=0), rtol=1e-3)
    assert 1.0 < envelope.high[3] < 12.0


def test_a_drive_within_the_envelope_is_not_flagged(small):
    assert range_warnings(experiment(small, SLOW)) == []
    assert range_warnings(simulate(small, SLOW)) == []


def test_a_drive_beyond_the_envelope_is_flagged(small):
    events = range_warnings(experiment(small, FAST))
    assert len(events) == 1
    assert (events[0].code, events[0].subject) == ("envelope.left", "u_x")
    assert events[0].figures["maximum"] == 0.9
    assert events[0].figures["percent"] == pytest.approx(99.0, abs=0.5)


def test_a_replay_beyond_the_envelope_is_flagged(small):
    run = experiment(load("small"), FAST)
    assert range_warnings(run) == []
    assert len(range_warnings(replay(run, small))) == 1


def test_a_yaw_rate_beyond_the_envelope_is_flagged_without_commands(small):
    slow_file = small.with_values({}, envelope=small.envelope._replace(high=np.array([1.0, 0, 1, 0.1])))
    assert range_warnings(experiment(slow_file, SLOW))[0].subject == "imu[2]"


def test_a_repetition_beyond_the_envelope_is_flagged(small):
    assert any(event.subject == "u_x" for event in range_warnings(repeat(small, circle(0.3, 0.4))))
    assert any(
        event.subject == "u_x"
        for event in range_warnings(next(iter(simulate_loops(small, circle(0.3, 0.4), seeds=[0]))))
    )


def test_a_simulation_beyond_the_envelope_is_flagged_for_one_or_many_vehicles(small):
    assert len(range_warnings(simulate(small, FAST))) == 1
    group = simulate_many(small, FAST, vary={"model.mass_kg": np.linspace(0.5, 0.7, 4)})
    assert (group.verdict, group.reasons) == (Verdict.WARN, group.envelope_warnings)


def test_the_envelope_refuses_a_run_with_other_commands(small):
    run = simulate(small, SLOW)
    with refused("vehicle.commands-differ", UsageError):
        small.envelope.range_warnings(replace(run, applied_commands=run.applied_commands[:, :2]))


@pytest.mark.parametrize(
    "line", ["low = [1.0]", 'low = ["a", 2, 3]', "low = [3.0, 0.0, 0.0]", "low = [nan, 0.0, 0.0]"]
)
def test_an_envelope_without_a_range_for_each_name_is_refused(line):
    table = f'\n[envelope]\nnames = ["u_x", "u_y", "u_psi"]\n{line}\nhigh = [1.0, 1.0, 1.0]\n'
    with refused("vehicle.envelope-ranges", FileError):
        parse(load("small").text + table, "my.toml")


@pytest.mark.parametrize(
    "names", ['["u_x"]', '["u_x", "u_y", "u_psi", "imu[3]"]', '["u_x", "u_y", "u_psi", "imu"]', "3"]
)
def test_unknown_names_in_an_envelope_are_refused_at_load(names):
    table = f"\n[envelope]\nnames = {names}\nlow = [0.0]\nhigh = [1.0]\n"
    with refused("vehicle.envelope-names", FileError, commands="u_x, u_y, u_psi"):
        parse(load("small").text + table, "my.toml")
