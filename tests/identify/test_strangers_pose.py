"""A skid-steered vehicle that no file describes: its commands are wheel speeds, and a camera films it between the
ticks.

The separate simulator has wheels of two radii, an apparent track wider than the true one, outward slip in curves and
autocorrelated floor disturbance. Wheel speeds arrive at 20 Hz, camera poses at 10 Hz with 40 ms of delay, never on a
tick.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from baqueano.identify import FitOptions, identify
from baqueano.identify.noise.covariances import measure_noise
from baqueano.runs.run import Channel, Run, TruthLog
from baqueano.validation.held_out import validate
from baqueano.vehicle_file import parse

LEFT_M, RIGHT_M, TRACK_M, SLIDE_S, LATE_S = 0.118, 0.121, 0.62, 0.12, 0.04
FREE = ("model.drivetrain.gain", "model.velocity_matrix[2,2]", "model.slide_s")
TRUE = (LEFT_M / 0.12, RIGHT_M / 0.12, 2.0 * 0.12 / TRACK_M, SLIDE_S)
FILE = """
format = 1
name = "stranger"
rate_hz = 20.0
[command]
names = ["u_x", "u_y", "u_psi"]
unit = "rad/s of a wheel"
[geometry]
track_m = 0.5
wheel_radius_m = 0.12
[model]
kind = "kinematic"
velocity_matrix = [[0.12, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.48]]
slide_s = 0.05
[model.drivetrain]
mixing = "two_wheels"
gain = [1.0, 1.0]
"""


def drive(seed, seconds=60.0, tick_s=0.05, h=0.005):
    rng = np.random.default_rng(seed)
    count, fade = int(seconds / h), math.exp(-h / 0.5)
    kick = math.sqrt(1.0 - fade**2) * rng.standard_normal((count, 3)) * [0.02, 0.01, 0.03]
    pose, floor, wheels, wheel_target = np.zeros(3), np.zeros(3), np.zeros(2), np.zeros(2)
    poses, wheel_angles = np.zeros((count, 3)), np.zeros((count, 2))
    for k in range(count):
        if k % 400 == 0:
            wheel_target = rng.uniform(1.0, 6.0, 2)
        wheels = wheels + h / 0.3 * (wheel_target - wheels)
        v_l, v_r = LEFT_M * wheels[0], RIGHT_M * wheels[1]
        nu = np.array([0.5 * (v_l + v_r), 0.0, (v_r - v_l) / TRACK_M])
        nu[1] = -SLIDE_S * nu[0] * nu[2]
        floor = fade * floor + kick[k]
        nu = nu + floor
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        pose = pose + h * np.array([cos * nu[0] - sin * nu[1], sin * nu[0] + cos * nu[1], nu[2]])
        poses[k], wheel_angles[k] = pose, wheels
    step = round(tick_s / h)
    wheel_readings = wheel_angles.reshape(-1, step, 2).mean(axis=1) + 0.02 * rng.standard_normal(
        (count // step, 2)
    )
    u = np.stack(
        [
            wheel_readings.mean(axis=1),
            0.0 * wheel_readings[:, 0],
            0.5 * (wheel_readings[:, 1] - wheel_readings[:, 0]),
        ],
        axis=1,
    )
    t_ns = np.arange(1, count // step + 1, dtype=np.int64) * round(1e9 * tick_s)
    index = np.arange(20, count - 20, 20) + 3  # 15 ms after a tick
    eta = poses[index] + rng.standard_normal((len(index), 3)) * [5e-3, 5e-3, 7e-3]
    arrival_ns = np.rint((index + 1) * h * 1e9 + LATE_S * 1e9).astype(np.int64)
    none = np.full_like(eta, np.nan)
    return Run(f"stranger {seed}", None, t_ns, u, truth=TruthLog(arrival_ns, eta, none, none))


@pytest.fixture(scope="module")
def fit():
    file = parse(FILE, "stranger.toml")
    return identify([drive(1), drive(2)], file, FREE, use=("truth",), options=FitOptions(clocks=("truth",)))


def test_radii_track_and_slip_of_an_unknown_vehicle_are_identified(fit):
    assert fit.verdict != "REFUSED"
    assert np.max(np.abs(fit.estimate - TRUE) / fit.std) < 4.0
    assert np.max(fit.std / fit.estimate) < 0.1


def test_the_camera_delay_of_40_ms_is_identified(fit):
    clock = fit.run_entry_names.index("clock.truth")
    assert np.max(np.abs(fit.run_entries[:, clock] + LATE_S) / fit.run_entry_std[:, clock]) < 4.0
    assert np.max(fit.run_entry_std[:, clock]) < 0.05


def test_the_error_bars_include_the_autocorrelated_floor_disturbance():
    file, errors = parse(FILE, "stranger.toml"), []
    for seed in (11, 21, 31):
        runs = [drive(seed), drive(seed + 1)]
        fit = identify(
            runs, file, FREE, use=("truth",), options=FitOptions(clocks=("truth",), diagnose=False)
        )
        errors.append((fit.estimate - TRUE) / fit.std)
    assert 0.5 < float(np.sqrt(np.mean(np.square(errors)))) < 1.5


def test_unseen_runs_are_predicted_as_well_as_fitted_runs(fit):
    validation = validate(fit, [drive(3), drive(4)])
    assert validation.verdict == "USABLE"
    assert max(figure.times for figure in validation.figures) < 1.3
    assert min(figure.times for figure in validation.figures) > 0.7


def with_gyro(run):
    """Return the run with a gyro that measures the turns that the camera sees."""
    t_s, camera_s = (1e-9 * x for x in (run.t_ns, run.truth.t_ns - int(1e9 * LATE_S)))
    psi = np.interp(t_s, camera_s, np.unwrap(run.truth.eta[:, 2]))
    rate = np.convolve(np.gradient(psi, t_s), np.ones(5) / 5.0, "same")
    return replace(run, sensors={"imu": Channel(run.t_ns, run.t_ns, rate[:, None] * [np.nan, np.nan, 1.0])})


def test_the_disturbance_of_a_filter_with_a_gyro_alone_is_that_of_the_true_speed():
    """The floor disturbs the speed by 0.02 m/s with a time constant of 0.5 s; the default is 0.3 m/s and 1 s."""
    file = parse(FILE + '[sensors.imu]\nkind = "imu"\n', "stranger.toml")
    runs = [with_gyro(drive(seed)) for seed in (1, 2)]
    options = FitOptions(clocks=("truth",), diagnose=False)
    noise = measure_noise(identify(runs, file, FREE, use=("truth",), options=options), runs)
    assert 0.01 < noise.fields["disturbance_std"][0] < 0.03
    assert 0.3 <= noise.fields["disturbance_fade_s"][0] < 1.5
    units = {row["name"]: row["unit"] for row in noise.rows()}
    assert (units["disturbance_std[0]"], units["disturbance_std[1]"]) == ("m/s", "rad/s")
