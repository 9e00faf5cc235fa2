"""A gyro in another unit is detected by wheels, by speed and sideways acceleration, or by commands; a sound gyro is
not.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.diagnostics import note
from baqueano.identify import FitOptions, identify, random_steps
from baqueano.runs.diagnostics import physical_units
from baqueano.runs.importing import import_run
from baqueano.runs.maps.column_map import data_folders
from baqueano.runs.run import Channel
from baqueano.sensors import Wheels
from baqueano.signals import NANOSECONDS, STANDARD_GRAVITY
from baqueano.simulate import simulate
from baqueano.vehicle_file import load, override, parse

DEGREES = 180.0 / np.pi
car = load("car")


def with_gyro(run, factor):
    c = run.sensors["imu"]
    return replace(run, sensors={**run.sensors, "imu": c._replace(z=c.z * [1.0, 1.0, factor])})


@pytest.fixture(scope="module")
def at_ten_hertz():
    """A car whose log has 10 rows a second."""
    file = override(car, ["rate_hz=10.0", "sensors.imu.rate_hz=10.0", "sensors.odometer.rate_hz=10.0"])
    u = random_steps(file.command.limit, 20.0, 10.0, 3)
    # because a vehicle moves meanwhile
    fine = simulate(override(car, ["rate_hz=100.0"]), np.repeat(u, 10, axis=0), 3)
    tenth = {name: Channel(*(x[9::10] for x in channel[:3])) for name, channel in fine.sensors.items()}
    return file, replace(fine, t_ns=fine.t_ns[9::10], applied_commands=u, sensors=tenth, truth=None)


def accused(fit):
    """Return the reasons that concern the gyro unit, with or without the accelerometer."""
    readings = [reason.figures["gyro"] for reason in fit.reasons if reason.code == physical_units.CURVE_CODE]
    return [*readings, *(reason for reason in fit.reasons if reason.code == "gyro.unit")]


@pytest.mark.parametrize(
    ("factor", "unit", "first_unit"), [(DEGREES, "deg/s", "rad/s"), (1.0 / DEGREES, "rad/s", "deg/s")]
)
def test_the_gyro_unit_of_a_slow_car_is_reported(at_ten_hertz, factor, unit, first_unit):
    file, run = at_ten_hertz
    for use, free in ((None, None), (("imu",), ["model.throttle_gain"])):  # more would diverge for seconds
        fit = identify(with_gyro(run, factor), file, free, use=use)
        assert fit.verdict == "REFUSED"
        (finding,) = (gyro for gyro in accused(fit) if gyro.figures["source"].code == "gyro.as-curve")
        assert (finding.figures["true_unit"], finding.figures["assumed_unit"]) == (unit, first_unit)


def test_commands_reveal_the_gyro_unit_without_wheels(small):
    run = simulate(small, random_steps([1.0, 0.0, 1.0], 20.0, 100.0, 0), 0)
    fit = identify(with_gyro(run, 1.0 / DEGREES), small)
    assert fit.verdict == "REFUSED"
    assert "gyro.as-commands" in [reason.figures["source"].code for reason in accused(fit)]


@pytest.mark.parametrize("part", [30.0, 57.0])
def test_a_wrong_start_of_the_search_causes_no_report_about_the_gyro(small, part):
    path = "model.actuator_matrix[2,2]"
    run = simulate(small, random_steps([1.0, 0.0, 1.0], 20.0, 100.0, 0), 0)
    fit = identify(run, small, options=FitOptions(start={path: small.value(path) / part}))
    assert fit.value(path) == pytest.approx(small.value(path), rel=0.02)
    assert fit.value(path.removeprefix("model.")) == fit.value(path), "the name in the table"
    assert fit.verdict == "USABLE", fit.reasons


FRICTION = "model.friction.linear"


@pytest.fixture(scope="module")
def guessed_sticky(small):
    """Return a run of a vehicle that turns easily, and a file with 84 times its friction."""
    linear = small.vehicle.friction.linear
    rough_file = small.with_values({"model.friction.coulomb": [0.25, 0.0, 0.003]})
    free = rough_file.with_values({FRICTION: [*linear[:2], linear[2] / 3.0]})
    guess = rough_file.with_values({FRICTION: [*linear[:2], linear[2] * 28.0]})
    return simulate(free, random_steps([1.0, 0.0, 1.0], 20.0, 100.0, 0), 0), guess


def test_wrongly_guessed_friction_causes_no_report_about_the_gyro(guessed_sticky):
    run, file = guessed_sticky
    fit = identify(run, file)
    assert fit.value("model.actuator_matrix[2,2]") == pytest.approx(0.203, rel=0.02)
    assert fit.verdict == "USABLE", fit.reasons


def test_a_gyro_unit_compensated_by_the_wheelbase_is_still_reported(at_ten_hertz):
    """A vehicle of 9 m turns as slowly as a gyro in rad/s that is read as deg/s."""
    file, run = at_ten_hertz
    c = run.sensors["imu"]
    gyro_alone = replace(
        run, sensors={**run.sensors, "imu": c._replace(z=c.z * [np.nan, np.nan, 1.0 / DEGREES])}
    )
    free = ["model.wheelbase_m", "model.throttle_gain", "model.linear_drag"]
    fit = identify(gyro_alone, file, free, options=FitOptions(start={"model.wheelbase_m": 6.0}))
    assert fit.converged
    assert fit.value("model.wheelbase_m") > 5.0
    assert "gyro.as-commands" in [reason.figures["source"].code for reason in accused(fit)]


@pytest.mark.parametrize("guess", [0.5, 1.0, 2.0])
def test_a_wrong_steering_gain_causes_no_report_about_the_gyro(at_ten_hertz, guess):
    file, run = at_ten_hertz
    gain = guess * file.vehicle.steering_gain
    fit = identify(run, override(file, [f"model.steering_gain={gain}"]))
    assert not accused(fit)


def beside_wheels(imu, wheels, rate_hz):
    """Return the findings on the gyro rows `imu` (n, 3) from `wheels` (n, 2), 0.2 m apart, at the same times."""
    t_ns = (np.arange(len(imu)) * NANOSECONDS / rate_hz).astype(np.int64)
    sensors = {"imu": Channel(t_ns, t_ns, imu), "wheels": Channel(t_ns, t_ns, wheels)}
    file = SimpleNamespace(sensors=SimpleNamespace(_asdict=lambda: {"wheels": Wheels(track_m=0.2)}))
    return physical_units.check_gyro_unit(SimpleNamespace(sensors=sensors), file, "imu")


def test_skidding_wheels_still_reveal_the_gyro_unit():
    rng, n = np.random.default_rng(0), 600
    omega = np.repeat(rng.normal(size=n // 20), 20)
    # the wheels skid: 1.6 times
    wheels = 0.5 + np.column_stack([-omega, omega]) * 1.6 * 0.1 + 0.02 * rng.normal(size=(n, 2))
    imu = np.column_stack([rng.normal(size=(n, 2)), omega + 0.02 * rng.normal(size=n)])
    assert beside_wheels(imu, wheels, 20.0) == []
    (finding,) = beside_wheels(imu * [1.0, 1.0, DEGREES], wheels, 20.0)
    assert finding.figures["source"] == note("gyro.as-wheels", subject="wheels")
    assert beside_wheels(imu * [1.0, 1.0, 9.8], wheels, 20.0) == []


@pytest.mark.parametrize("seed", range(5))
def test_an_accelerometer_axis_that_points_up_causes_no_report_about_the_gyro(seed):
    """Such an axis measures only 2 % of a sideways acceleration, as data sheets allow."""
    rng, n = np.random.default_rng(seed), 6000
    omega, v = np.repeat(rng.normal(size=60), 100), np.repeat(rng.uniform(0.5, 1.5, 60), 100)
    wheels = np.column_stack([v - 0.1 * omega, v + 0.1 * omega]) + 0.02 * rng.normal(size=(n, 2))
    up = 0.02 * v * omega + 9.81 + 0.05 * rng.normal(size=n)
    imu = np.column_stack([0.05 * rng.normal(size=n), up, omega + 0.005 * rng.normal(size=n)])
    assert beside_wheels(imu, wheels, 100.0) == []


def test_without_wheels_a_curve_shows_that_gyro_and_accelerometer_disagree(at_ten_hertz):
    file, run = at_ten_hertz
    (finding,) = physical_units.check_gyro_unit(with_gyro(run, DEGREES), file, "imu")
    assert finding.figures["gyro"].figures["true_unit"] == "deg/s"
    assert (finding.code, finding.subject) == (physical_units.CURVE_CODE, "imu[1]")
    assert finding.figures["ratio"] < 0.1


@pytest.mark.parametrize("seed", [0, 3])
@pytest.mark.parametrize("use", [None, ("imu",)])
def test_an_accelerometer_in_mg_causes_no_report_about_the_gyro(seed, use):
    run = simulate(car, random_steps(car.command.limit, 10.0, car.rate_hz, seed), seed)
    c, milli_g = run.sensors["imu"], 1000.0 / STANDARD_GRAVITY
    run = replace(run, sensors={**run.sensors, "imu": c._replace(z=c.z * [milli_g, milli_g, 1.0])})
    assert physical_units.check_gyro_unit(run, car, "imu")
    fit = identify(run, car, use=use)
    assert fit.verdict == "REFUSED"
    assert fit.reasons[0].code == "accelerometer.unit"
    assert not accused(fit)


def test_with_wheels_a_wrong_gain_causes_no_report_about_the_gyro(small):
    """The fitted gain shows that the file assumed a motor 30 times too weak."""
    file = parse(small.text + "[sensors.wheels]\nrate_hz = 50.0\nnoise_std = 0.01\n", "small")
    run = simulate(file, random_steps([1.0, 0.0, 1.0], 20.0, 100.0, 0), 0)
    matrix = file.vehicle.actuator_matrix * [1.0, 1.0, 1.0 / 30.0]
    fit = identify(run, file.with_values({"model.actuator_matrix": matrix.tolist()}))
    assert "model.actuator_matrix[2,2]" in [
        reason.subject for reason in fit.reasons if reason.code == "file.far-gain"
    ]
    assert not accused(fit)


@pytest.mark.skipif(
    not any((folder / "cpm_mucar").is_dir() for folder in data_folders()),
    reason="the recordings of the CPM Lab are not here",
)
def test_a_wrong_gyro_unit_of_a_recorded_car_is_named():
    run = import_run("cpm_run_a").run
    assert physical_units.check_gyro_unit(run, car, "imu") == []
    for factor, unit in ((DEGREES, "deg/s"), (1.0 / DEGREES, "rad/s")):
        (finding,) = physical_units.check_gyro_unit(with_gyro(run, factor), car, "imu")
        assert finding.figures.get("gyro", finding).figures["true_unit"] == unit


def test_a_gyro_unit_that_makes_the_model_diverge_is_refused(at_ten_hertz):
    """No value of such a fit is used, and no error is computed."""
    file, run = at_ten_hertz
    fit = identify(with_gyro(run, 10.0 * DEGREES), file, use=("imu",))
    assert fit.verdict == "REFUSED"
