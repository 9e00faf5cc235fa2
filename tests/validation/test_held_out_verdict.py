"""The verdict of validation runs, on a robot whose physics shares nothing with the models.

Logs of 200 Hz in volts: a quasi-static ramp and a step each way, 4 s each.
"""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.calibration.rest import begins_at_rest
from baqueano.identify import FitOptions, identify, random_steps
from baqueano.messages import text
from baqueano.runs.run import Channel, Run
from baqueano.selection.cross_validation import extremum_count, independent_motion_count
from baqueano.simulate.open_loop import tick_times
from baqueano.study.counterpart import drive_group
from baqueano.study.counterpart.world import ROBOT_STEP_S
from baqueano.study.truth import draw_robots
from baqueano.validation.held_out import validate
from baqueano.vehicle_file import load, override

RATE_HZ, VOLTS = 200.0, 12.0
FIT_RUNS = ("ramp +1", "ramp -1", "step +1")
FREE = ["model.actuator_matrix[2,2]", "model.friction.linear[2]", "model.drivetrain.lag_s"]


@pytest.fixture(scope="module")
def file():
    """A guess of the robot, its commands in volts."""
    return override(
        load("small"),
        [
            *("rate_hz=200", "sensors.imu.rate_hz=200", "command.unit=V", "command.limit=[12,0,12]"),
            *("model.drivetrain.limit=[12.0]", "model.drivetrain.gain=[1,1]"),
            "model.drivetrain.dead_zone_forward=[3.5,3.5]",
            "model.drivetrain.dead_zone_backward=[3.7,3.7]",
            "model.actuator_matrix=[[0.28,0,0],[0,0,0],[0,0,0.017]]",
        ],
    )


def drive_signals(signals):
    """Return the logs of one robot for each run, under the voltages (N, 3) of each name; all begin at rest."""
    ticks = max(map(len, signals.values()))
    u = np.stack([np.pad(signal, ((0, ticks - len(signal)), (0, 0))) for signal in signals.values()], axis=1)
    robots, t_ns = draw_robots(1, 3).subset([0] * len(signals)), tick_times(ticks, RATE_HZ)
    z = drive_group(robots, u / VOLTS, range(len(signals)), t_ns, ROBOT_STEP_S).readings
    return {
        name: Run(
            name, None, t_ns[: len(v)], v, sensors={"imu": Channel(*[t_ns[: len(v)]] * 2, z[: len(v), k])}
        )
        for k, (name, v) in enumerate(signals.items())
    }


def short(kind, sign):
    """Half a second of rest, then a ramp of 3 V/s or a step of 7 V."""
    t = np.arange(round(4.0 * RATE_HZ)) / RATE_HZ - 0.5
    volts = np.minimum(3.0 * t, VOLTS) if kind == "ramp" else np.full_like(t, 7.0)
    return np.where(t < 0.0, 0.0, sign * volts)[:, None] * [0.0, 0.0, 1.0]


@pytest.fixture(scope="module")
def logs():
    """The four short runs, a step that ends, and random steps."""
    signals = {f"{kind} {sign:+d}": short(kind, sign) for kind in ("ramp", "step") for sign in (1, -1)}
    signals["coasting"] = np.where(np.arange(len(signals["step +1"]))[:, None] < 400, signals["step +1"], 0.0)
    steps = random_steps([0.0, 0.0, 8.0], 10.0, RATE_HZ, 1, hold_s=0.7)
    return drive_signals({**signals, "random steps": np.concatenate([np.zeros((100, 3)), steps])})


@pytest.fixture(scope="module")
def fit(file, logs):
    """A fit to three of them."""
    return identify([logs[name] for name in FIT_RUNS], file, FREE, options=FitOptions(diagnose=False))


def test_one_short_run_is_not_enough_for_a_verdict(fit, logs):
    validation = validate(fit, logs["step -1"])
    assert validation.verdict == "CANNOT TELL"
    reason = validation.reasons[0]
    assert (reason.code, reason.subject) == ("validation.too-few", "u_psi")
    assert (reason.figures["pieces"], reason.figures["minimum"]) == (1.0, 5)


def test_the_verdict_states_horizon_and_initial_condition(fit, logs):
    basis = validate(fit, logs["step -1"]).basis.figures
    assert (basis["span_s"], basis["start"].code) == ("4", "validation.from-standstill")
    assert basis["pieces"] == 1.0


def test_runs_with_enough_motion_get_a_verdict(fit, logs):
    validation = validate(fit, logs["random steps"])
    assert validation.verdict != "CANNOT TELL"
    assert validation.basis.figures["span_s"] == "10.5"
    assert validation.sentence.endswith(text(validation.basis))


def test_a_channel_unexplained_in_fitted_and_unseen_runs_is_refused_by_name(file, logs):
    """The gain is inverted and the time constant is 2.6 s instead of 0.13 s: the error of the fitted runs is as
    large."""
    start = override(
        file, ["model.actuator_matrix=[[0.28,0,0],[0,0,0],[0,0,-0.017]]", "model.drivetrain.lag_s=2.6"]
    )
    fit = identify(
        [logs[name] for name in FIT_RUNS],
        start,
        ["model.friction.linear[0]"],
        options=FitOptions(diagnose=False),
    )
    validation = validate(replace(fit, verdict="USABLE"), logs["step -1"])
    assert validation.verdict == "REFUSED"
    assert (validation.reasons[0].code, validation.reasons[0].subject) == (
        "validation.worse-than-mean",
        "imu[2]",
    )
    assert validation.reasons[0].figures["variance_percent"] < 0.0


def test_a_run_that_coasts_does_not_begin_at_rest(file, logs):
    run = logs["step +1"]
    assert begins_at_rest(run, file.sensors)
    coasting = logs["coasting"].cut(2.0)
    assert not np.any(coasting.applied_commands[:2])
    assert not begins_at_rest(coasting, file.sensors)
    assert not begins_at_rest(run.cut(1.0), file.sensors)


def test_turning_points_are_counted_despite_noise():
    assert extremum_count(np.linspace(0.0, 1.0, 50), 0.1) == 0
    assert extremum_count(np.repeat([0.0, 1.0, 0.0, -1.0, 0.5], 10), 0.1) == 2
    noisy = np.repeat([0.0, 1.0], 50) + 0.04 * np.random.default_rng(0).uniform(-1.0, 1.0, 100)
    assert extremum_count(noisy, 0.1) == 0


def test_each_independent_step_counts_for_at_most_two_thirds_of_a_segment():
    """Of K independent steps, 2 (K − 2)/3 are turning points, without those of small amplitude; 4 std are 29."""
    u = random_steps([1.0, 0.0, 0.0], 600.0, 10.0, 0, hold_s=2.0)
    steps = Run("steps", None, np.arange(len(u)) * 100_000_000, u)
    assert 0.5 * 300 < independent_motion_count([steps], 0) < 200 + 29
    assert independent_motion_count([steps], 2) == 0.0
