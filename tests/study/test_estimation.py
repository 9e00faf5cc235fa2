"""The judge of estimators: its references are right by hand, and it tells a better estimate from a worse one."""

import json

import numpy as np
import pytest

from baqueano.cli import main
from baqueano.geometry import wrap
from baqueano.runs.run import Channel, Run, TruthLog
from baqueano.simulate import simulate
from baqueano.study import estimation as room
from baqueano.study.estimation.errors import (
    QUANTITIES,
    SPEED,
    WHOLE,
    Beside,
    Path,
    beside,
    joined,
    true_speed,
)
from baqueano.study.estimation.judging import Judged
from baqueano.study.estimation.references import integrated, open_loop
from baqueano.study.estimation.result import Estimated
from baqueano.study.estimation.subjects import BOTH, IMU, SETUPS, with_sensors
from baqueano.vehicle_file import load

V, R, RATE_HZ = 0.8, 0.5, 50.0


def circle(seconds=60.0):
    """A car on a circle, its gyro and odometer without noise, as the garage's file says that they read."""
    car = load("car")
    t_ns = np.arange(int(seconds * RATE_HZ)) * 20_000_000
    psi = R * t_ns * 1e-9
    arm = car.vehicle.rear_axle_m
    rear = V / R * np.stack([np.sin(psi), 1.0 - np.cos(psi)], axis=1)
    eta = np.column_stack([rear + arm * np.stack([np.cos(psi), np.sin(psi)], axis=1), wrap(psi)])
    imu, odometer = car.sensors.imu, car.sensors.odometer
    rows = np.ones((len(t_ns), 1))
    z = np.hstack([rows, rows, (imu.gyro_scale * R + imu.gyro_bias) * rows])
    sensors = {"imu": Channel(t_ns, t_ns, z), "odometer": Channel(t_ns, t_ns, odometer.scale * V * rows)}
    unknown = np.full((len(t_ns), 3), np.nan)
    truth = TruthLog(t_ns, eta, unknown, unknown)
    return car, Run("circle", None, t_ns, np.zeros((len(t_ns), 2)), sensors=sensors, truth=truth)


def test_plain_integration_of_perfect_readings_drives_the_circle():
    car, run = circle()
    eta = integrated(car, run, np.zeros((len(run.t_ns), 3)), run.truth.eta[0])
    assert np.max(np.hypot(*(eta - run.truth.eta)[:, :2].T)) < 1e-3
    alone = with_sensors(car, SETUPS[IMU])
    nu = np.tile([V, 0.0, R], (len(run.t_ns), 1))
    assert np.allclose(integrated(alone, run, nu, run.truth.eta[0]), eta, atol=1e-12)


def test_open_loop_is_the_simulation_under_the_commands():
    car = load("car")
    u = np.repeat(np.random.default_rng(0).uniform([0.2, -0.5], [0.6, 0.5], (8, 2)), 50, axis=0)
    quiet = car.with_values({"model.process_noise_std": [0.0, 0.0, 0.0]})
    run = simulate(quiet, u)
    start = np.concatenate([run.truth.eta[0], run.truth.nu[0]])
    nu = open_loop(quiet, run, start)
    after = run.t_s > 3.0  # the beginning is forgotten
    assert np.max(np.abs(nu - run.truth.nu)[after]) < 0.02


def test_speed_of_a_camera_is_that_along_the_heading():
    _, run = circle(5.0)
    speed = true_speed(run.t_ns, run.truth)
    known = np.isfinite(speed)
    assert known[20:-20].all()
    assert np.max(np.abs(speed[known] - V)) < 2e-3  # (R · 0.15 s)² / 10 of it


def test_a_path_with_half_the_error_has_half_the_ratio():
    _, run = circle()
    eta = run.truth.eta.copy()
    off = 0.01 * run.t_s[:, None] * [1.0, 0.0, 0.0]
    speed = np.full(len(run.t_ns), V)
    found = beside(run.t_ns, Path(eta + 0.5 * off, speed + 0.05), Path(eta + off, speed + 0.1), run.truth)
    assert list(found) == list(QUANTITIES)
    assert found[SPEED].ratio[0] == pytest.approx(0.5, abs=0.01)
    for name in QUANTITIES[1:]:
        assert found[name].ratio[0] == pytest.approx(0.5, abs=1e-6)
    assert found[WHOLE].rms[1] == pytest.approx(0.6 / np.sqrt(3), rel=0.01)
    assert found[QUANTITIES[2]].rms[1] == pytest.approx(
        0.1 / np.sqrt(3), rel=0.01
    )  # begins afresh after 10 s
    assert len(found[QUANTITIES[2]].samples) == 6
    assert np.isnan(found[WHOLE].ratio[1])  # one block tells no interval


def test_the_interval_of_a_ratio_holds_as_often_as_it_should():
    """40 blocks, 200 trials: with true coverage 0.95 fewer than 178 inside are 1 in 500; small samples take 2 %."""
    inside = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        common = rng.standard_normal(40)
        ours, other = (
            (common + 0.5 * rng.standard_normal(40)) ** 2,
            (common + 0.5 * rng.standard_normal(40)) ** 2,
        )
        _, low, high = Beside(ours, other, np.ones(40)).ratio
        inside += low <= 1.0 <= high
    assert inside >= 174


def made(ratio):
    """Ten blocks in which the estimate is `ratio` times as far off as the reference."""
    blocks = np.random.default_rng(1).uniform(0.9, 1.1, 10)
    one = Beside(ratio**2 * blocks, blocks, np.ones(10))
    return Judged(f"here, {BOTH}", BOTH, "ekf", dict.fromkeys(QUANTITIES, one), "")


def test_an_estimator_that_is_worse_misses_its_bars_and_one_that_is_better_meets_them():
    assert Estimated((made(0.6),)).verdict == "USABLE"
    worse = Estimated((made(0.6), made(1.2)._replace(recording="there")))
    assert any(reason.startswith("there, ekf: speed") for reason in worse.reasons)
    assert [row["ok"] for row in worse.rows() if row["recording"].startswith("here")] == [True] * len(
        QUANTITIES
    )
    assert not Estimated((made(0.8),)).pooled()[0][
        "ok"
    ]  # with an odometer the speed is to be 0.7 of the model's
    assert joined([made(0.6).errors[SPEED], made(0.6).errors[SPEED]]).samples.sum() == 20


def test_the_verb_says_the_same_to_a_machine(monkeypatch, capsys):
    study = Estimated((made(1.2),))
    monkeypatch.setattr(room, "estimation", lambda *_: study)
    with pytest.raises(SystemExit) as end:
        main(["study", "estimation", "--json"])
    assert end.value.code == 0
    said = json.loads(capsys.readouterr().out)
    assert {"recording", "estimator", "quantity", "value", "reference", "ok"} <= set(said["rows"][0])
    assert said["verdict"] == "WARN"
    with pytest.raises(SystemExit) as end:
        main(["study", "estimation", "--case", "cmp"])
    assert end.value.code == 2


def test_a_recording_is_fitted_and_judged_by_its_odometer_too(cpm_recordings):
    subject = room.SUBJECTS["cpm"][0]()[0]
    short = subject._replace(fitted=subject.fitted.cut(0.0, 30.0), judged=subject.judged.cut(0.0, 30.0))
    (one,) = room.judged(short, BOTH)
    assert one.errors[SPEED].ratio[0] < 0.9
    assert one.stopped == ""
