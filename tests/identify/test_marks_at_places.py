"""A camera, a mark on the floor or a tape identifies the scales; without them the scales stay unknown.

Truths within 3.5 of their own standard errors, two seeds each. A tape that contradicts the model is reported.
"""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.calibration.hand_measurements import read_line
from baqueano.errors import UsageError
from baqueano.identify import FitOptions, identify, random_steps
from baqueano.identify.data.added_channels import drift_std
from baqueano.identify.noise.covariances import measure_noise
from baqueano.messages import text
from baqueano.runs.run import TruthLog
from baqueano.simulate import simulate
from baqueano.validation.held_out import validate
from baqueano.vehicle_file import load, override, parse
from tests.codes import of_code

SIGMAS = 3.5
USUAL = (
    "model.friction.linear[0]",
    "model.friction.linear[2]",
    "model.actuator_matrix[0,0]",
    "model.actuator_matrix[2,2]",
)
GYRO = "sensors.imu.gyro_scale"
RADII, TRACK = "sensors.wheels.radius_scale", "sensors.wheels.track_m"
MARK = """
[sensors.mark]
noise_std = 0.003
"""
WHEELS = """
[sensors.wheels]
rate_hz = 50.0
noise_std = 0.01
"""
OF_CAR = ("model.throttle_gain", "model.linear_drag", "model.coulomb_m_s2", "model.steering_gain")
STILL = "model.process_noise_std=[0, 0, 0]"


def with_sensor(text):
    return parse(load("small").text + text, "small")


def with_camera_poses(run, seed, late_s=0.0):
    """Return the run with 20 camera poses a second instead of its truth, on a clock that is `late_s` behind."""
    indices = np.arange(0, len(run.t_ns), 5)
    noise = np.random.default_rng(seed).normal(size=(len(indices), 3)) * [0.003, 0.003, 0.01]
    unknown = np.full((len(indices), 3), np.nan)
    t_ns = run.truth.t_ns[indices] - round(late_s * 1e9)
    return replace(run, truth=TruthLog(t_ns, run.truth.eta[indices] + noise, unknown, unknown))


def by_hand(run, seed):
    """Return the tape measurement at the end, accurate to a centimetre and two degrees."""
    rng = np.random.default_rng(seed)
    x, y, psi = run.truth.eta[-1]
    distance, turn_deg = np.hypot(x, y) + 0.01 * rng.normal(), np.degrees(psi) + 2.0 * rng.normal()
    return f"end: {100.0 * distance:.1f} cm, {turn_deg:.1f} deg"


def steps(file, seconds, seed):
    return random_steps(file.command.limit, seconds, file.rate_hz, seed, hold_s=0.5)


def laps(file, seconds):
    """Return endless commands forward and to the left, so that the vehicle passes the start mark repeatedly."""
    u = np.zeros((round(seconds * file.rate_hz), 3))
    u[100:, 0], u[100:, 2] = 0.55, 0.12 + 0.05 * np.sin(np.arange(len(u) - 100) / 40.0)
    return u


def of_car(seconds, seed):
    """Return throttle and servo commands that change every second."""
    rng = np.random.default_rng(seed)
    levels = np.column_stack(
        [rng.uniform(0.15, 0.45, round(seconds)), rng.uniform(-0.5, 0.5, round(seconds))]
    )
    return np.repeat(levels, 50, axis=0)


def error_of(truth, fit):
    errors = {
        n: (x - truth.value(n)) / std for n, x, std in zip(fit.names, fit.estimate, fit.std, strict=True)
    }
    return max(map(abs, errors.values())), errors


def test_a_camera_identifies_wheels_gyro_and_the_camera_clock():
    truth = override(with_sensor(WHEELS), [f"{RADII}=[1.03, 0.96]", f"{TRACK}=0.13", f"{GYRO}=0.966"])
    begin = override(truth, [f"{RADII}=[1, 1]", f"{TRACK}=0.12", f"{GYRO}=1"])
    for seed, late_s in ((1, 0.04), (2, -0.0325)):
        run = with_camera_poses(simulate(truth, steps(truth, 20.0, seed), seed), seed, late_s)
        fit = identify(
            run,
            begin,
            [*USUAL, RADII, TRACK, GYRO],
            use=("imu", "wheels", "truth"),
            options=FitOptions(clocks=("truth",)),
        )
        assert fit.verdict == "USABLE", fit.reasons
        worst, errors = error_of(truth, fit)
        assert worst < SIGMAS, errors
        clock = fit.run_entry_names.index("clock.truth")
        assert abs(fit.run_entries[0, clock] - late_s) < SIGMAS * fit.run_entry_std[0, clock] < 0.005


def with_mark_at(run, x, left, turned_rad):
    """Return the run whose truth is that of a mark beside the origin; a NaN `turned_rad` gives no heading, like a
    GPS."""
    eta = run.truth.eta.copy()
    c, s = np.cos(eta[:, 2]), np.sin(eta[:, 2])
    eta += np.column_stack([c * x - s * left, s * x + c * left, np.full(len(eta), turned_rad)])
    return replace(run, truth=run.truth._replace(eta=eta))


@pytest.mark.long
@pytest.mark.parametrize("turned_rad", [0.05, np.nan])
def test_the_position_of_a_mark_is_identified_but_not_written(turned_rad):
    small, mount = load("small"), {"lever_arm_m[0]": 0.06, "lever_arm_m[1]": -0.03, "heading_rad": turned_rad}
    names = [f"sensors.truth.{key}" for key, value in mount.items() if np.isfinite(value)]
    run = with_mark_at(
        with_camera_poses(simulate(small, steps(small, 20.0, 1), 1), 1, 0.04), 0.06, -0.03, turned_rad
    )
    fit = identify(run, small, [*USUAL, *names], use=("imu", "truth"), options=FitOptions(clocks=("truth",)))
    assert fit.verdict == "USABLE", fit.reasons
    for key, value in mount.items():
        if np.isfinite(value):
            k = fit.names.index(f"sensors.truth.{key}")
            assert abs(fit.estimate[k] - value) < SIGMAS * fit.std[k] < 0.01
    assert fit.notes[0].code == "truth.horizon-of-pieces"
    assert fit.notes[0].figures == {
        "span_s": pytest.approx(5.0, abs=0.05),
        "distance_m": pytest.approx(1.3, abs=0.05),
    }
    assert "truth" not in fit.vehicle_file.text
    assert (fit.notes[1].code, fit.notes[1].figures["keys"][:21]) == ("truth.mount", "lever_arm_m[0] = 0.06")
    moved_run = with_mark_at(
        with_camera_poses(simulate(small, steps(small, 20.0, 9), 9), 9), 0.02, 0.03, turned_rad
    )
    validation = validate(fit, replace(moved_run, name="unseen"))
    assert validation.verdict == "USABLE", validation.reasons


def test_the_position_of_a_mark_is_identified_from_its_velocity():
    small = load("small")
    run = simulate(small, steps(small, 20.0, 1), 1)
    w, nu = run.truth.nu[:, 2], run.truth.nu.copy()
    nu[:, :2] += (
        np.column_stack([0.03 * w, 0.06 * w]) + np.random.default_rng(0).normal(size=(len(w), 2)) * 0.01
    )
    with_velocity = replace(run, truth=run.truth._replace(nu=nu))
    fit = identify(
        with_velocity,
        small,
        [*USUAL, "sensors.truth.lever_arm_m"],
        use=("imu", "truth"),
        options=FitOptions(diagnose=False),
    )
    for key, value in (("lever_arm_m[0]", 0.06), ("lever_arm_m[1]", -0.03)):
        k = fit.names.index(f"sensors.truth.{key}")
        assert abs(fit.estimate[k] - value) < SIGMAS * fit.std[k] < 0.02
    assert fit.notes[0].code == "truth.horizon"
    assert fit.notes[0].figures == {
        "span_s": pytest.approx(20.0, abs=0.5),
        "distance_m": pytest.approx(5.5, abs=0.05),
    }


def test_an_imu_clock_offset_of_whole_ticks_is_identified():
    small = load("small")
    for seed, late_ns in ((1, 40_000_000), (2, -23_000_000)):
        run = simulate(small, steps(small, 20.0, seed), seed)
        channel = run.sensors["imu"]
        run = replace(run, sensors={"imu": channel._replace(t_ns=channel.t_ns - late_ns)})
        fit = identify(run, small, USUAL, options=FitOptions(clocks=("imu",)))
        assert fit.converged
        clock = fit.run_entry_names.index("clock.imu")
        assert abs(fit.run_entries[0, clock] - 1e-9 * late_ns) < SIGMAS * fit.run_entry_std[0, clock] < 1e-3
        assert error_of(small, fit)[0] < SIGMAS


def test_without_a_camera_the_imu_identifies_wheel_radii_and_track():
    truth = override(with_sensor(WHEELS), [f"{RADII}=[1.03, 0.96]", f"{TRACK}=0.13", STILL])
    begin = override(truth, [f"{RADII}=[1, 1]", f"{TRACK}=0.12"])
    for seed in (1, 2):
        fit = identify(simulate(truth, steps(truth, 20.0, seed), seed), begin, [*USUAL, RADII, TRACK])
        worst, errors = error_of(truth, fit)
        assert worst < SIGMAS, errors


def test_the_gyro_scale_of_a_car_is_unobservable_from_its_imu():
    car = load("car")
    fit = identify(
        simulate(car, of_car(60.0, 1), 1), override(car, [f"{GYRO}=1"]), [*OF_CAR, GYRO], use=("imu",)
    )
    assert np.isnan(fit.estimate[fit.names.index(GYRO)])
    assert fit.verdict == "WARN"
    (scale,) = (reason for reason in fit.unobservable if reason.code == "identifiability.scale")
    assert scale.subject == GYRO
    assert "turn it twice on its mark" in text(scale)


def test_a_tape_measurement_at_the_end_identifies_the_gyro_scale():
    """The same fit as before, with one additional measurement line."""
    car = override(load("car"), [STILL])
    begin = override(car, [f"{GYRO}=1"])
    for seed in (1, 2):
        run = simulate(car, of_car(60.0, seed), seed)
        fit = identify(
            run, begin, [*OF_CAR, GYRO], use=("imu",), options=FitOptions(measured=[by_hand(run, seed)])
        )
        worst, errors = error_of(car, fit)
        assert worst < SIGMAS, errors
        assert fit.std[fit.names.index(GYRO)] < 0.01


def test_the_error_of_a_tape_includes_the_floor_disturbance():
    """The floor pushes the car some 20 cm from its simulation in a minute."""
    car = load("car")
    for seed in (1, 2, 3):
        run = simulate(car, of_car(60.0, seed), seed)
        line = by_hand(run, seed)
        fit = identify(
            run,
            override(car, [f"{GYRO}=1"]),
            [*OF_CAR, GYRO],
            use=("imu",),
            options=FitOptions(measured=[line]),
        )
        worst, errors = error_of(car, fit)
        assert worst < SIGMAS, errors
        _, (length, angle) = read_line(line, [run])
        assert 0.05 < drift_std(car.vehicle, run, length) < 1.0
        assert 0.5 < np.degrees(drift_std(car.vehicle, run, angle)) < 5.0
        assert drift_std(override(car, [STILL]).vehicle, run, length) == 0.0


def test_a_camera_identifies_gyro_and_odometer_of_a_car():
    """The floor does not disturb the car, because the simulation error has another meaning on a disturbing floor."""
    car = override(load("car"), [STILL])
    free = [*OF_CAR, GYRO, "sensors.odometer.scale", "model.cornering_drag", "model.yaw_lag_s"]
    values = [f"{GYRO}=1", "sensors.odometer.scale=1", "model.cornering_drag=0", "model.yaw_lag_s=0.2"]
    for seed in (1, 2):
        run = with_camera_poses(simulate(car, of_car(60.0, seed), seed), seed)
        fit = identify(
            run,
            override(car, values),
            free,
            use=("imu", "odometer", "truth"),
            options=FitOptions(diagnose=False),
        )
        worst, errors = error_of(car, fit)
        assert worst < SIGMAS, errors


def test_a_mark_passed_each_lap_reduces_speed_and_gyro_errors():
    truth = override(with_sensor(MARK), [f"{GYRO}=0.966", STILL])
    begin = override(truth, [f"{GYRO}=1"])
    for seed in (1, 2):
        run = simulate(truth, laps(truth, 40.0), seed)
        assert len(run.sensors["mark"].z) > 5
        with_mark = identify(run, begin, [*USUAL, GYRO])
        fit = identify(run, begin, [*USUAL, GYRO], use=("imu",))
        worst, errors = error_of(truth, with_mark)
        assert worst < SIGMAS, errors
        k = with_mark.names.index(GYRO)
        assert not with_mark.std[k] > 0.5 * fit.std[k], "without the mark the value is unknown (NaN)"


class Ten:
    """The attributes of a run that a tape line needs."""

    def __init__(self, name):
        self.name, self.t_ns, self.duration_s = name, np.array([5]), 10.0


@pytest.mark.parametrize(
    ("line", "kind", "z", "std"),
    [
        ("4 s: 2.31 m", "tape", [2.31], 0.01),
        ("0s..4s: 231 cm", "tape", [2.31], 0.01),
        ("4 s: 2.31 ± 0.05 m", "tape", [2.31], 0.05),
        ("4 s: 90 deg", "turned", [0.0, 1.0], np.radians(2.0)),
        ("4 s: 2 turns", "turned", [1.0, 0.0], np.radians(2.0)),
        ("4 s: 0 m", "back_on_mark", [0.0, 0.0], 0.01),
        ("monday 4 s: 0 mm", "back_on_mark", [0.0, 0.0], 0.01),
    ],
)
def test_a_handwritten_measurement_line_is_parsed(line, kind, z, std):
    run, (place,) = read_line(line, [Ten("monday")])
    assert (run, place.kind, place.t_ns) == (0, kind, 5 + 4_000_000_000)
    assert place.z == pytest.approx(z, abs=1e-12)
    assert place.std == pytest.approx(std)


def test_a_line_may_contain_a_length_and_an_angle():
    _, places = read_line("end: 1.5 m, -90 °", [Ten("a")])
    assert [place.kind for place in places] == ["tape", "turned"]
    assert places[0].t_ns == 5 + 10_000_000_000
    assert places[1].z == pytest.approx([0.0, -1.0], abs=1e-12)


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("2.31 m", "tape.unreadable"),
        ("11 s: 2 m", "tape.after-the-end"),
        ("4 s: 2 miles", "tape.no-length"),
        ("4 s: -1 m", "tape.negative"),
        ("b 4 s: 1 m", "tape.of-another-run"),
    ],
)
def test_an_unreadable_measurement_line_is_refused(line, code):
    with pytest.raises(UsageError, check=of_code(code)):
        read_line(line, [Ten("a")])


def test_a_measurement_line_for_several_runs_must_name_its_run():
    with pytest.raises(UsageError, check=of_code("tape.run-missing", valid="a, b")):
        read_line("4 s: 1 m", [Ten("a"), Ten("b")])


def test_a_tape_measurement_and_segments_cannot_be_combined():
    small = load("small")
    run = simulate(small, steps(small, 5.0, 1), 1)
    with pytest.raises(UsageError, check=of_code("tape.cut")):
        identify(run, small, USUAL, options=FitOptions(segment_s=2.0, measured=["end: 1 m"]))


GAINS = ["model.actuator_matrix[2,2]", "model.actuator_matrix[0,0]"]


@pytest.fixture(scope="module")
def taped_runs(small):
    u = [random_steps(small.command.limit, 6.0, small.rate_hz, k) for k in (1, 2)]
    return [simulate(small, u[k], k, name=f"run {k}") for k in range(2)]


@pytest.fixture(scope="module")
def taped_fit(small, taped_runs):
    return identify(taped_runs, small, free=GAINS, options=FitOptions(measured=("run 1 end: 400 cm",)))


def test_a_wrong_tape_measurement_of_a_later_run_is_reported_in_metres(taped_fit):
    e = [reason for reason in taped_fit.reasons if reason.code == "residual.outlier"]
    assert len(e) == 1
    assert (e[0].subject, e[0].figures["measurement"], e[0].figures["unit"]) == ("tape[0]", 4.0, "m")


def test_the_identified_noise_has_units_and_excludes_the_tape_measurement(taped_fit, taped_runs):
    noise = measure_noise(taped_fit, taped_runs)
    units = {row["name"]: row["unit"] for row in noise.rows()}
    assert [units[f"imu[{k}]"] for k in range(3)] == ["m/s²", "m/s²", "rad/s"]
    assert units["velocity_walk_std[2]"] == "rad/s/√s"
    assert "tape[0]" not in units
    assert not any("tape" in note.subject for note in noise.notes)


def test_the_noise_of_each_channel_is_reported_with_its_unit(taped_fit):
    lines = taped_fit.table().splitlines()
    assert any(line.startswith("imu[2] of run 0: noise ") and " rad/s, the model" in line for line in lines)
