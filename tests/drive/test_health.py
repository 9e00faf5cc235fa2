"""The loop warns once if the model no longer fits, and never if the model is correct."""

import numpy as np
import pytest

from baqueano.drive import experiment, replay
from baqueano.drive.health import SENSORS_SOURCE, SOURCE, Health
from baqueano.drive.observers import Observer
from baqueano.drive.replay import replay_blocks
from baqueano.identify import excitation, random_steps
from baqueano.monitor import rejections_in
from baqueano.signals import Estimate
from baqueano.vehicle_file import load


def innovation_events(file, world=None, seconds=12.0, seed=1):
    u = random_steps(0.6 * np.asarray(file.command.limit), seconds, file.rate_hz, seed)
    run = experiment(file, u, seed=seed, **({} if world is None else {"world": world}))
    return [e for e in run.events if e.source == SOURCE]


def reasons_for(nis, seconds=20.0):
    """The warnings of a listener for innovations of this mean square, or of these (N,) in a cycle, at 100 Hz."""
    health, rng, out = Health(), np.random.default_rng(0), []
    for k in range(round(100 * seconds)):
        y = np.sqrt(np.ravel(nis)[k % np.size(nis)]) * rng.normal(size=3)
        estimate = Estimate(k, np.zeros(3), np.zeros(3), np.eye(6), y, np.eye(3))
        out.append(health.misfit_message(k * 10_000_000, estimate))
    return [reason for reason in out if reason]


def test_a_correct_model_never_gives_a_warning():
    assert reasons_for(1.0) == []
    assert reasons_for(1.5) == []


@pytest.mark.parametrize("start_s", [7.0, 7.3])
def test_a_push_gives_no_warning_and_a_misfit_in_each_bend_gives_one(start_s):
    """The innovations after a push are large for half a second."""
    t_s = 0.01 * np.arange(2000)
    push = np.where((t_s >= start_s) & (t_s < start_s + 0.5), 1000.0, 1.0)
    assert reasons_for(push) == []
    (reason,) = reasons_for(np.where(t_s % 2.0 < 0.5, 9.0, 1.0)[:200])
    assert reason.code == "model.fits-no-longer"


def test_a_wrong_model_gives_one_warning():
    (reason,) = reasons_for(6.0)
    assert (reason.code, reason.fix) == ("model.fits-no-longer", "baqueano identify last")
    assert reason.figures["ratio"] == pytest.approx(2.4, abs=0.05)


def test_a_few_outliers_give_no_warning():
    health, rng = Health(), np.random.default_rng(0)
    for k in range(2000):
        y = rng.normal(size=3) + (1000.0 if k % 100 == 0 else 0.0)
        estimate = Estimate(k, np.zeros(3), np.zeros(3), np.eye(6), y, np.eye(3))
        assert health.misfit_message(k * 10_000_000, estimate) is None


def test_estimates_without_innovations_give_no_warning():
    assert Health().misfit_message(0, Estimate(0, np.zeros(3), np.zeros(3), np.eye(6))) is None


@pytest.fixture(scope="module")
def small():
    return load("small")


def test_a_run_of_the_identified_vehicle_gives_no_warning(small):
    assert innovation_events(small) == []


@pytest.mark.parametrize("signal", ["random_steps", "multisine", "prbs", "ramps"])
@pytest.mark.parametrize("name", ["small", "case-study-1", "car"])
def test_a_sound_vehicle_gives_no_warning_under_any_excitation_signal(name, signal):
    file = load(name)
    run = experiment(file, excitation(signal, file.command.limit, 8.0, file.rate_hz, 4), seed=4)
    assert [e for e in run.events if e.source in (SOURCE, SENSORS_SOURCE)] == []


@pytest.mark.parametrize(("signal", "growth"), [("prbs", 1.1), ("random_steps", 1.3)])
def test_increased_friction_gives_one_warning(signal, growth):
    file = load("case-study-1")
    worn_file = file.with_values({"model.friction.linear": (growth * file.vehicle.friction.linear).tolist()})
    run = experiment(
        file, excitation(signal, file.command.limit, 20.0, file.rate_hz, 0), truth=worn_file, seed=3
    )
    (event,) = [e for e in run.events if e.source == SOURCE]
    assert event.level == "warning"


def test_a_loose_gyro_is_reported_without_advice_to_fit(small):
    small = small.with_values({"estimator.disturbance_std": [0.02, 0.05]})  # the model is identified
    wrong_file = small.with_values({"sensors.imu.gyro_scale": 0.3})
    u = random_steps(0.6 * np.asarray(small.command.limit), 15.0, small.rate_hz, 3)
    run = experiment(small, u, truth=wrong_file, seed=3)
    events = [e for e in run.events if e.source == SENSORS_SOURCE]
    assert events[0].level == "info"
    first = events[0].diagnostic
    assert (first.code, first.subject) == ("sensor.scaled", "imu[2]")
    (event,) = [e.diagnostic for e in events if e.level == "warning"]
    assert (event.code, event.subject) == ("sensor.degraded", "imu[2]")
    cause = event.figures["cause"]
    assert (cause.code, cause.figures["consequence"].code) == ("sensor.scaled", "sensor.error-in-sensor")
    assert cause.figures["ratio"] == pytest.approx(0.3, abs=0.005)
    assert [e for e in run.events if e.source == SOURCE] == []


def test_degraded_sensors_are_listed_at_each_tick(small):
    degraded_sensors = []

    class Watcher(Observer):
        def on_record(self, record):
            degraded_sensors.append(record.sensor_findings)

    wrong_file = small.with_values({"sensors.imu.gyro_scale": 0.1})
    u = np.tile([0.4, 0.0, 0.4], (500, 1))
    run = experiment(small, u, truth=wrong_file, seed=3, observers=[Watcher()])
    event = next(e for e in run.events if e.source == SENSORS_SOURCE and e.level == "warning")
    (finding,) = degraded_sensors[-1]
    assert finding.diagnostic == event.diagnostic
    assert finding.name == "imu[2]"
    assert [bool(count) for count in degraded_sensors] == [t >= event.t_ns for t in run.t_ns]


def test_the_run_contains_the_rejection_count_of_each_channel(small):
    run = experiment(small, np.tile([0.4, 0.0, 0.0], (100, 1)), seed=3)
    assert [(refusal.name, refusal.reading_count) for refusal in rejections_in(run.events)] == [
        ("imu[0]", 0),
        ("imu[1]", 0),
        ("imu[2]", 101),  # without `speed_from` an accelerometer does not correct
    ]
    uncounted_replay = replay_blocks(run, small)._replace(estimator=small.estimator("dead_reckoning"))
    replayed_run = replay(run, small, uncounted_replay)
    assert rejections_in(replayed_run.events) == ()
