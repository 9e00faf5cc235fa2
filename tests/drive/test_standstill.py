"""A vehicle with a gyro is at rest before its drive, so that the filter measures the bias of the gyro."""

from dataclasses import replace

import numpy as np
import pytest

import baqueano as bq
from baqueano.door.frames.descriptions import state_description
from baqueano.door.states import DoorState
from baqueano.drive.mission import Mission, perform
from baqueano.guides.shapes import circle, eight
from baqueano.loop import Record
from baqueano.runs import export_tum
from baqueano.signals import Command, Estimate, Reference, Tick
from baqueano.standstill import REST_S, usual_rest_s
from baqueano.web.feed import Feed
from baqueano.web.sentence import state_message
from tests.codes import refused

SMALL, LAP = bq.load("small"), eight(0.3, 0.2)
RAMP_S = 0.5 * 0.2 / 0.3  # half of the time between rest and 0.2 m/s, at the start and at the end


@pytest.fixture(scope="module")
def run():
    return bq.repeat(SMALL, LAP, laps=2, truth=SMALL.with_values({"sensors.imu.gyro_bias": 0.004}))


def test_the_command_is_exactly_zero_during_the_rest_and_then_the_guide_begins(run):
    resting = run.t_ns < run.t_ns[0] + 2_000_000_000
    assert not run.requested_commands[resting].any()
    assert run.requested_commands[~resting][:50, 0].max() > 0.1
    assert np.array_equal(run.reference.eta[resting], run.estimate.eta[resting])
    assert run.duration_s == pytest.approx(REST_S + 2.0 * (LAP.t_s[-1] + RAMP_S), abs=0.02)
    assert [e.diagnostic.code for e in run.events if e.source == "drive"] == ["drive.rest"]


def test_the_rest_measures_the_bias_of_the_gyro(run):
    """The bias of 0.004 rad/s turns the estimated heading by 0.07 rad; the scale of the gyro cancels on an eight."""
    result = bq.repeat(SMALL, LAP, 2, truth=SMALL.with_values({"sensors.imu.gyro_bias": 0.004}), rest_s=0.0)
    assert result.rest_s == 0.0
    at_rest, at_once = (bq.compare(r).runs[0] for r in (run, result))
    assert at_rest.ate_heading_rad < 0.2 * at_once.ate_heading_rad
    assert at_rest.corridor.heading_rad[-1] < 0.3 * at_once.corridor.heading_rad[-1]


def test_laps_and_errors_begin_after_the_rest(run):
    comparison = bq.compare(run).runs[0]
    assert comparison.duration_s == pytest.approx(2.0 * (LAP.t_s[-1] + RAMP_S), abs=0.02)
    assert [lap.duration_s for lap in comparison.laps] == pytest.approx([LAP.t_s[-1] + RAMP_S] * 2, abs=0.05)
    assert run.cut(1.0).rest_s == 1.0
    assert run.without_rest.rest_s == 0.0


def test_a_replay_repeats_the_rest_bit_by_bit(run):
    replayed_run = bq.replay(run)
    for log in ("requested_commands", "sent_commands"):
        assert np.array_equal(getattr(replayed_run, log), getattr(run, log))
    assert np.array_equal(replayed_run.reference.eta, run.reference.eta)
    commands_of_run = bq.replay(replace(run, metadata=run.metadata | {"kind": "teach"}))
    assert np.array_equal(commands_of_run.requested_commands, run.requested_commands)


def test_a_taught_route_begins_with_the_motion():
    car = bq.load("car")
    lesson = bq.teach(car, circle(1.5, 1.0), seed=1)
    assert lesson.run.rest_s == REST_S
    # with a start from rest, until the car, which is behind its reference, has passed the start
    lap_s = 2.0 * np.pi * 1.5 + 0.5 / 0.3 + car.controller().response_delay_s
    assert lesson.route.t_s[-1] == pytest.approx(lap_s, abs=0.1)


def test_a_forecast_begins_with_the_rest_of_the_drive(run):
    forecast = bq.forecast(SMALL, LAP, backend="python").rows()[0]
    corridor = bq.compare(run).runs[0].corridor
    assert forecast["t_s"] == pytest.approx(LAP.t_s[-1] + 2.0 * RAMP_S, abs=0.02)
    driven_rad = corridor.heading_rad[np.searchsorted(corridor.t_s, forecast["t_s"])]
    assert forecast["heading_rad"] == pytest.approx(driven_rad, rel=0.05)


class Counting:
    """A user's controller in plain Python, with a state that is not a number."""

    def init(self):
        return ["begins"]

    def step(self, state, reference, estimate):
        return [*state, "drives"][-2:], Command(
            estimate.t_ns, np.array([0.1 if "drives" in state else 0.2, 0.0, 0.0])
        )


def test_a_controller_in_plain_python_begins_after_the_rest():
    requested_u = bq.repeat(
        SMALL, LAP, controller=Counting(), duration_s=0.14, rest_s=0.1
    ).requested_commands[:, 0]
    assert requested_u.tolist() == [0.0] * 10 + [0.2] + [0.1] * 3


def test_only_a_vehicle_at_rest_with_a_gyro_has_a_rest():
    assert usual_rest_s(SMALL.sensors, np.zeros(3)) == REST_S
    assert usual_rest_s(SMALL.sensors, np.array([0.0, 0.0, 0.0, 0.2, 0.0, 0.0])) == 0.0
    assert usual_rest_s((), np.zeros(3)) == 0.0
    with refused("drive.duration", bq.errors.UsageError, name="rest_s"):
        bq.repeat(SMALL, LAP, rest_s=-1.0)


def test_a_mission_contains_its_rest():
    usual, none = (Mission("repeat", route=LAP, rest_s=rest_s) for rest_s in (None, 0.0))
    assert "rest_s" not in usual.to_json()
    assert Mission.from_json(none.to_json()).rest_s == 0.0
    assert perform(none, SMALL, duration_s=0.1).rest_s == 0.0
    assert perform(usual, SMALL, duration_s=0.1).rest_s == REST_S
    assert Mission("teach").with_durations(SMALL).rest_s == 0.0


def test_the_page_states_that_the_vehicle_rests():
    def state_at(t_s):
        t_ns, zero = round(1e9 * t_s), np.zeros(3)
        record = Record(
            Tick(t_ns, zero, ()), Command(t_ns, zero), Command(t_ns, zero),
            Estimate(t_ns, zero, zero, np.eye(6)), Reference(t_ns, zero, zero, 0.0),
        )  # fmt: skip
        mission = Mission("repeat", route=LAP, laps=1).with_durations(SMALL)
        return state_description("simulated", DoorState.MISSION, None, None, mission, record)

    resting, driving = state_at(1.0), state_at(2.0)
    assert (resting["rest_s"], "rest_s" in driving) == (2.0, False)
    # with both ramps
    assert resting["left_s"] == pytest.approx(1.0 + LAP.t_s[-1] + LAP.nu[0, 0] / 0.3, abs=0.01)
    common = {"state": "MISSION", "reason": None}
    sentences = [state_message(common | state, Feed(), None, [])["sentence"] for state in (resting, driving)]
    assert "2 s" in sentences[0]
    assert sentences[0] != sentences[1]


def test_the_exported_trajectories_give_the_error_of_a_comparison(run, tmp_path):
    """The formula of `evo_ape tum truth.tum estimate.tum` on both files: neither contains the rest."""
    true_path, estimated_path = (
        np.loadtxt(export_tum(run, tmp_path / name, name)) for name in ("truth", "estimate")
    )
    np.testing.assert_array_equal(true_path[:, 0], estimated_path[:, 0])
    ate_m = np.sqrt(np.mean(np.sum((true_path - estimated_path)[:, 1:3] ** 2, axis=1)))
    assert ate_m == pytest.approx(bq.compare(run).rows()[0]["ate_m"], rel=1e-9)


def test_drives_that_are_written_into_a_folder_are_numbered(tmp_path):
    runs = [bq.experiment(SMALL, np.zeros((5, 3)), path=tmp_path) for _ in range(2)]
    assert [run.path.name for run in runs] == ["0001-experiment.mcap", "0002-experiment.mcap"]
