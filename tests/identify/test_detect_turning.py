"""A gyro in another unit is named by wheels, by speed and sideways acceleration, by the commands; a sound one never."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.identify import identify, random_steps
from baqueano.identify.doubts import turning
from baqueano.runs.column_map import data_folders
from baqueano.runs.importing import import_run
from baqueano.signals import NANOSECONDS
from baqueano.simulate import simulate
from baqueano.vehicle_file import load
from baqueano.vehicle_file.edit import override

DEGREES = 180.0 / np.pi
car = load("car")


def with_gyro(run, factor):
    c = run.sensors["imu"]
    return replace(run, sensors={**run.sensors, "imu": c._replace(z=c.z * [1.0, 1.0, factor])})


@pytest.fixture(scope="module")
def at_ten_hertz():
    """A car whose log has 10 rows a second."""
    file = override(car, ["rate_hz=10.0", "sensors.imu.rate_hz=10.0", "sensors.odometer.rate_hz=10.0"])
    return file, simulate(file, random_steps(file.command.limit, 30.0, 10.0, 3), 3)


@pytest.mark.parametrize(
    ("factor", "unit", "was"), [(DEGREES, "deg/s", "rad/s"), (1.0 / DEGREES, "rad/s", "deg/s")]
)
def test_a_slow_car_is_told_which_unit_its_gyro_has(at_ten_hertz, factor, unit, was):
    file, run = at_ten_hertz
    for use in (None, ("imu",)):
        fit = identify(with_gyro(run, factor), file, use=use)
        assert fit.verdict == "REFUSED"
        (said,) = [
            one for one in fit.reasons if "times the turning that imu[1] at the speed of odometer" in one
        ]
        assert (
            f'it is in {unit} and was read as {was}. Write in the map, for its third number: unit = "{unit}"'
            in said
        )


def test_without_wheels_the_commands_tell(small):
    run = simulate(small, random_steps([1.0, 0.0, 1.0], 20.0, 100.0, 0), 0)
    fit = identify(with_gyro(run, 1.0 / DEGREES), small)
    assert fit.verdict == "REFUSED"
    assert "times the turning that the commands make by the vehicle file" in "; ".join(fit.reasons)


@pytest.mark.parametrize("part", [30.0, 57.0])
def test_where_a_search_begins_says_nothing_of_the_gyro(small, part):
    path = "model.actuator_matrix[2,2]"
    run = simulate(small, random_steps([1.0, 0.0, 1.0], 20.0, 100.0, 0), 0)
    fit = identify(run, small, start={path: small.value(path) / part})
    assert fit.value(path) == pytest.approx(small.value(path), rel=0.02)
    assert fit.verdict == "USABLE", fit.reasons


FRICTION = "model.friction.linear"


@pytest.fixture(scope="module")
def guessed_sticky(small):
    """A run of a vehicle that turns freely, and the file that tells 84 times its friction."""
    linear = small.vehicle.friction.linear
    quiet = small.with_values({"model.friction.coulomb": [0.25, 0.0, 0.003]})
    free = quiet.with_values({FRICTION: [*linear[:2], linear[2] / 3.0]})
    guessed = quiet.with_values({FRICTION: [*linear[:2], linear[2] * 28.0]})
    return simulate(free, random_steps([1.0, 0.0, 1.0], 20.0, 100.0, 0), 0), guessed


def test_a_fit_that_keeps_the_gains_of_the_file_clears_the_gyro_of_a_guessed_friction(guessed_sticky):
    run, file = guessed_sticky
    fit = identify(run, file)
    assert fit.value("model.actuator_matrix[2,2]") == pytest.approx(0.203, rel=0.02)
    assert fit.verdict == "USABLE", fit.reasons


def test_a_wheelbase_that_makes_up_for_the_unit_clears_nothing(at_ten_hertz):
    """A vehicle of 9 m turns as slowly as a gyro in rad/s that was read as deg/s says."""
    file, run = at_ten_hertz
    c = run.sensors["imu"]
    gyro_alone = replace(
        run, sensors={**run.sensors, "imu": c._replace(z=c.z * [np.nan, np.nan, 1.0 / DEGREES])}
    )
    fit = identify(gyro_alone, file, ["model.wheelbase_m", "model.throttle_gain", "model.linear_drag"])
    assert fit.converged
    assert fit.value("model.wheelbase_m") > 5.0
    assert "times the turning that the commands make by the vehicle file" in "; ".join(fit.reasons)


@pytest.mark.parametrize("guess", [0.5, 1.0, 2.0])
def test_a_sound_gyro_of_a_car_that_was_guessed_to_a_factor_of_two_has_no_doubt(at_ten_hertz, guess):
    file, run = at_ten_hertz
    gain = guess * file.vehicle.steering_gain
    fit = identify(run, override(file, [f"model.steering_gain={gain}"]))
    assert not any("times the turning" in one for one in fit.reasons)


def test_two_wheels_tell_though_they_skid():
    from types import SimpleNamespace

    from baqueano.runs.run import Channel
    from baqueano.sensors import Wheels

    rng, n = np.random.default_rng(0), 600
    t_ns = (np.arange(n) * NANOSECONDS // 20).astype(np.int64)
    omega = np.repeat(rng.normal(size=n // 20), 20)
    wheels = (
        0.5 + np.column_stack([-omega, omega]) * 1.6 * 0.1 + 0.02 * rng.normal(size=(n, 2))
    )  # skid: 1.6 times
    imu = np.column_stack([rng.normal(size=(n, 2)), omega + 0.02 * rng.normal(size=n)])
    known = SimpleNamespace(_asdict=lambda: {"wheels": Wheels(track_m=0.2)})
    file = SimpleNamespace(sensors=known)

    def said(factor):
        sensors = {
            "imu": Channel(t_ns, t_ns, imu * [1.0, 1.0, factor]),
            "wheels": Channel(t_ns, t_ns, wheels),
        }
        return turning.checked(SimpleNamespace(sensors=sensors), file, "imu")

    assert said(1.0) == []
    (found,) = said(DEGREES)
    assert "times the turning that wheels tells" in found.text
    assert said(9.8) == []


@pytest.mark.skipif(
    not any((folder / "cpm_mucar").is_dir() for folder in data_folders()),
    reason="the recordings of the CPM Lab are not here",
)
def test_a_recorded_car_is_named_in_either_unit_and_not_where_it_is_right():
    run = import_run("cpm_run_a").run
    assert turning.checked(run, car, "imu") == []
    for factor, unit in ((DEGREES, "deg/s"), (1.0 / DEGREES, "rad/s")):
        (found,) = turning.checked(with_gyro(run, factor), car, "imu")
        assert f'unit = "{unit}"' in found.text


def test_a_gyro_that_makes_the_model_run_away_ends_in_a_verdict(at_ten_hertz):
    """Nothing of such a fit is kept, and no error is worked out of nothing."""
    file, run = at_ten_hertz
    fit = identify(with_gyro(run, 10.0 * DEGREES), file, use=("imu",))
    assert fit.verdict == "REFUSED"
