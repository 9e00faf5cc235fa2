"""No reading is accepted by force after long rejection: a broken sensor moves no estimate, and a wrong model is
reported at once.

The small vehicle rests for 6 s, drives in turns, and rests again. The fault lasts from 8 s to 11 s.
"""

from typing import Any, NamedTuple

import numpy as np
import pytest

from baqueano.drive.health import WINDOW_S, Health
from baqueano.drive.session import sensor_monitor
from baqueano.estimators.readings.gate import gate_limit
from baqueano.runs import Run
from baqueano.signals import Estimate, Slot, Tick
from baqueano.simulate import simulate
from baqueano.symbolic import scan
from baqueano.vehicle_file import load

REST_S, BROKEN_S, END_S, STILL_S = WINDOW_S + 1.0, (8.0, 11.0), 16.0, 2.0
REPORT_S = 0.53  # an event is 0.5 s of disagreement, which begins up to 3 ticks after the first refusal
SMALL = load("small").with_values(  # the model equals the vehicle, and the floor is without noise
    {"estimator.velocity_walk_std": [0.005, 0.002, 0.005], "estimator.disturbance_std": [0.02, 0.05]}
)
t_s = 0.01 * np.arange(round(100 * END_S))
DRIVING = (t_s >= REST_S) & (t_s < END_S - STILL_S)
U = np.outer(DRIVING, [0.5, 0.0, 0.0]) + np.outer(DRIVING * np.sign(np.sin(2.0 * t_s)), [0.0, 0.0, 0.45])


class Consequence(NamedTuple):
    """The results of a filter over one run."""

    error: np.ndarray  # (N, 3) of ν
    is_refused: np.ndarray  # (N,) bool
    refused_at_s: float  # the first time
    reported_at_s: float  # reported by Health; NaN: never


def turning(factor: float) -> Run:
    """Return the run of a vehicle whose turning gain is this many times that of the filter model."""
    gain = factor * SMALL.vehicle.actuator_matrix[2, 2]
    return simulate(SMALL.with_values({"model.actuator_matrix[2,2]": gain}), U, 0)


@pytest.fixture(scope="module")
def run() -> Run:
    """Return the run of a vehicle that equals the filter model."""
    return simulate(SMALL, U, 0)


@pytest.fixture(scope="module")
def kernel():
    ekf = SMALL.estimator()
    example = Tick(10_000_000, np.zeros(3), SMALL.sensors._replace(imu=Slot(1.0, np.zeros(3))))
    return scan(ekf.step, ekf.init(), example)


def consequence(kernel, run: Run, z: np.ndarray | None = None) -> Consequence:
    """Run the filter over the commands of `run`, with z (N, 3) in place of the IMU readings if given."""
    imu, t_ns = run.sensors["imu"], run.t_ns
    is_new: Any = np.ones(len(t_ns))
    ticks: Any = t_ns
    z = imu.z if z is None else z
    assert run.truth is not None
    assert np.array_equal(imu.t_ns, t_ns)
    slot = Slot(is_new, z, 0.0 * is_new)
    _, out = kernel.run(Tick(ticks, run.applied_commands, SMALL.sensors._replace(imu=slot)))
    y, S = out.innovation, out.innovation_cov
    refusals = np.einsum("ki,ki->k", y, np.linalg.solve(S, y[..., None])[..., 0]) > gate_limit(4.0, 3)
    ekf = SMALL.estimator()
    monitor, _ = sensor_monitor(SMALL, ekf, ekf.step)
    health = Health(sensors=monitor)
    sensors = SMALL.sensors
    reasons = [
        bool(health.events(Tick(int(t), u, sensors._replace(imu=Slot(1.0, y))), Estimate(*row)))
        for t, u, y, *row in zip(t_ns, run.applied_commands, z, *out, strict=True)
    ]
    k = [float(1e-9 * t_ns[np.argmax(flags)]) if np.any(flags) else np.nan for flags in (refusals, reasons)]
    return Consequence(out.nu - run.truth.nu, refusals, *k)


def broken_readings(run: Run, fault: str) -> np.ndarray:
    """The IMU readings of the run, broken from 8 s to 11 s."""
    z, random = run.sensors["imu"].z.copy(), np.random.default_rng(6)
    mask = (t_s >= BROKEN_S[0]) & (t_s < BROKEN_S[1])
    if fault == "stuck":
        z[mask] = z[np.argmax(mask)]
    elif fault == "shaken":
        z[mask] += random.normal(size=(int(np.sum(mask)), 3)) * [3.0, 3.0, 1.0]
    else:
        z[mask] += {"gyro": [0.0, 0.0, 2.0], "ramp of 6 degrees": [1.0, 0.0, 0.0]}[fault]
    return z


@pytest.mark.parametrize("fault", ["stuck", "shaken", "gyro", "ramp of 6 degrees"])
def test_es7_a_sensor_broken_for_seconds_does_not_move_the_estimate(kernel, run, fault):
    """The limits are twice the largest errors with an intact IMU. The gyro gate is wide, because real cars turn
    differently from any model: 200 σ of vibration may change the yaw rate by 4."""
    reference, s = consequence(kernel, run), consequence(kernel, run, broken_readings(run, fault))
    mask = (t_s >= BROKEN_S[0]) & (t_s < BROKEN_S[1])
    assert np.mean(s.is_refused[mask]) > 0.5
    assert not np.any(s.is_refused[~mask])
    times = np.array([2.0, 2.0, 4.0 if fault == "shaken" else 2.0])
    assert np.all(np.max(np.abs(s.error), axis=0) < times * np.max(np.abs(reference.error), axis=0))
    assert BROKEN_S[0] < s.reported_at_s < s.refused_at_s + REPORT_S


def test_es6_a_sound_sensor_is_never_rejected_or_reported(kernel, run):
    s = consequence(kernel, run)
    assert not np.any(s.is_refused)
    assert np.isnan(s.reported_at_s)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_wrong_turning_gain_is_reported_and_the_estimate_recovers_at_rest(kernel, factor):
    s = consequence(kernel, turning(factor))
    moving, is_late = DRIVING & (t_s > REST_S + REPORT_S), t_s > END_S - 0.5 * STILL_S
    assert np.mean(s.is_refused[moving]) > 0.9
    assert REST_S < s.reported_at_s < s.refused_at_s + REPORT_S
    assert not np.any(s.is_refused[is_late])
    assert np.max(np.abs(s.error[is_late, 2])) < 0.03


def test_es5_ten_percent_outliers_increase_the_error_by_at_most_a_tenth(kernel, run):
    random = np.random.default_rng(5)
    z, sigma = run.sensors["imu"].z.copy(), np.sqrt(np.diag(SMALL.sensors.imu.cov))
    mask = random.uniform(size=len(z)) < 0.1
    z[mask] += 20.0 * sigma * random.choice([-1.0, 1.0], size=(int(np.sum(mask)), 3))
    reference, s = consequence(kernel, run), consequence(kernel, run, z)
    assert np.mean(s.is_refused) > 0.09
    rms, before = (np.sqrt(np.mean(x.error**2, axis=0)) for x in (s, reference))
    assert np.all(rms < 1.1 * before)
