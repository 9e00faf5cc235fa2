"""The battery voltage as an input: a run that contains it identifies its effect on the motors."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.errors import UsageError
from baqueano.identify import FitOptions, identify, random_steps
from baqueano.messages import texts
from baqueano.runs.run import Channel
from baqueano.simulate import simulate
from baqueano.validation.held_out import validate
from baqueano.vehicle_file import load, override, parse
from tests.codes import of_code

EFFECT = "model.drivetrain.battery_effect"
FREE = ("model.friction.linear[0]", "model.actuator_matrix[0,0]", "model.actuator_matrix[2,2]", EFFECT)
NOMINAL_V = 7.4
PLAIN = FitOptions(diagnose=False)


@pytest.fixture(scope="module")
def small():
    """Return the small vehicle without motor limits, because the battery effect acts after the limit."""
    return override(load("small"), ["model.drivetrain.limit=[inf]"])


def emptied(small, effect, seed, start_v=7.8, end_v=6.8, with_battery=True):
    """Return a run with a falling battery voltage: a vehicle at V₀ under u (1 + κ (V/V₀ − 1))."""
    u = random_steps(small.command.limit, 20.0, small.rate_hz, seed, hold_s=0.5)
    volts = np.linspace(start_v, end_v, len(u))
    run = simulate(small, u * (1.0 + effect * (volts / NOMINAL_V - 1.0))[:, None], seed)
    k = np.arange(0, len(u), 20)
    battery = {"battery": Channel(run.t_ns[k], run.t_ns[k], volts[k][:, None])} if with_battery else {}
    return replace(run, applied_commands=u, sensors={**run.sensors, **battery})


@pytest.mark.parametrize("effect", [1.0, 0.4])
def test_the_effect_of_the_battery_voltage_is_identified(small, effect):
    begin = override(small, [f"{EFFECT}=0.7"])
    for seed in (1, 2):
        fit = identify(emptied(small, effect, seed), begin, FREE)
        k = fit.names.index(EFFECT)
        assert fit.verdict == "USABLE", fit.reasons
        assert abs(fit.estimate[k] - effect) < 3.5 * fit.std[k] < 0.05


def test_a_constant_voltage_does_not_identify_its_effect(small):
    fit = identify(emptied(small, 1.0, 1, NOMINAL_V, NOMINAL_V), small, FREE)
    assert np.isnan(fit.estimate[fit.names.index(EFFECT)])
    assert any(
        "a voltage that changes: runs with a full and with an empty" in s for s in texts(fit.unobservable)
    )


def test_a_fit_with_voltage_is_written_and_used_in_the_next_fit(small):
    """The file contains battery = "logged"."""
    fit = identify(emptied(small, 0.4, 1), small, FREE, options=PLAIN)
    assert fit.vehicle_file.vehicle.drivetrain.battery == "logged"
    second = identify(emptied(small, 0.4, 2), fit.vehicle_file, FREE[:2])
    assert second.verdict == "USABLE"


def test_a_fit_of_the_voltage_effect_needs_a_logged_voltage(small):
    with pytest.raises(UsageError, check=of_code("battery.no-voltage")):
        identify(emptied(small, 1.0, 1, with_battery=False), small, FREE)


def test_a_voltage_that_contradicts_the_file_is_refused(small):
    run = emptied(small, 1.0, 1)
    channel = run.sensors["battery"]._replace(z=np.full_like(run.sensors["battery"].z, 30.0))
    run = replace(run, sensors={**run.sensors, "battery": channel})
    with pytest.raises(UsageError, check=of_code("battery.other-voltage", voltage_v=30.0, nominal_v=7.4)):
        identify(run, small, FREE)


@pytest.fixture(scope="module")
def file_without_effect(small):
    """Return the small vehicle without a voltage in its file."""
    text = "\n".join(line for line in small.text.splitlines() if not line.startswith("battery"))
    return override(parse(text, "small"), ["model.drivetrain.limit=[inf]"])


def test_a_default_fit_uses_a_logged_voltage_whose_effect_is_visible(file_without_effect):
    """The nominal voltage is that of the runs, so a drive without a voltage has a mean battery."""
    fit = identify(
        emptied(file_without_effect, 1.0, 3, 7.4, 6.6), file_without_effect, ["+model.drivetrain.delay_s"]
    )
    k, drivetrain = fit.names.index(EFFECT), fit.vehicle_file.vehicle.drivetrain
    assert abs(fit.estimate[k] - 1.0) < 3.5 * fit.std[k] < 0.2
    assert drivetrain.battery_nominal_v == drivetrain.battery_v == pytest.approx(7.0, abs=0.02)
    assert "battery.shown" in codes(fit)


def test_a_default_fit_states_that_the_motion_does_not_follow_a_logged_voltage(file_without_effect):
    fit = identify(emptied(file_without_effect, 0.0, 3, 7.4, 6.6), file_without_effect, options=PLAIN)
    assert EFFECT not in fit.names
    assert "battery.not-shown" in codes(fit)
    assert fit.vehicle_file.vehicle.drivetrain.battery == "steady"


@pytest.mark.parametrize(
    "options",
    [{"free": FREE[:3], "options": PLAIN}, {"options": FitOptions(fixed=(EFFECT,), diagnose=False)}],
)
def test_requested_parameters_and_a_fixed_effect_are_kept(file_without_effect, options):
    fit = identify(emptied(file_without_effect, 1.0, 3, 7.4, 6.6), file_without_effect, **options)
    assert EFFECT not in fit.names
    assert not any(code.startswith("battery.") for code in codes(fit))


def test_a_constant_voltage_costs_no_second_fit(file_without_effect):
    fit = identify(emptied(file_without_effect, 1.0, 3, 7.3, 7.25), file_without_effect, options=PLAIN)
    assert not any(code.startswith("battery.") for code in codes(fit))


def test_a_held_out_run_without_a_voltage_has_the_voltage_of_the_file(small):
    fit = identify(emptied(small, 1.0, 1), small, FREE)
    held_out = emptied(small, 0.0, 2, with_battery=False)
    assert max(figure.times for figure in validate(fit, held_out).figures) < 1.3


def codes(fit):
    return [message.code for message in fit.notes]
