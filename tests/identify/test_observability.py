"""An unobservable parameter retains its start value, is reported as null, and is named with the missing motion."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.identify import FitOptions, excitation, identifiability, identify, random_steps
from baqueano.simulate import simulate
from baqueano.vehicle_file import load


def unobservable_names(fit):
    return {row["name"].removeprefix("model.") for row in fit.rows() if row["identifiable"] == "no"}


def test_id1_straight_driving_leaves_turning_parameters_unobservable_with_a_remedy(case, normalised_errors):
    u = random_steps([20.0, 0.0, 0.0], 30.0, 100.0, 0)
    fit = identify(simulate(case, u, 0), case)
    turning = {"friction.linear[2]", "friction.quadratic[2]"}
    assert turning <= unobservable_names(fit)
    assert "friction.linear[0]" not in unobservable_names(fit)
    assert np.max(np.abs(normalised_errors(fit, case))) < 4.5
    notes = {note.subject: note for note in fit.unobservable}
    note = notes["model.friction.linear[2]"]
    assert (note.code, note.figures["value"], note.figures["advice"].code) == (
        "identifiability.fixed",
        500.553,
        "identifiability.needs",
    )
    silent = [note for note in fit.unobservable if note.code == "identifiability.command-still"]
    (turns,) = (note for note in silent if note.figures["command"] == "u_psi")
    assert "actuator_matrix[2,2]" in turns.figures["names"]
    assert fit.verdict in ("WARN", "REFUSED")


def test_unobservable_parameters_retain_their_start_value_and_are_marked_unknown(case):
    u = random_steps([20.0, 0.0, 0.0], 30.0, 100.0, 0)
    fixed_names = ["model.friction.quadratic", "model.actuator_matrix[2,0]"]
    fit = identify(simulate(case, u, 0), case, options=FitOptions(fixed=fixed_names, diagnose=False))
    assert fit.blocks.model.friction.linear[2] == 500.553
    row = next(r for r in fit.rows() if r["name"] == "model.friction.linear[2]")
    assert row["estimate"] is None
    assert row["std"] is None
    assert "not identifiable" in fit.table()


def test_an_unobservable_mass_is_not_reported(case, case_run):
    names = (
        "mass_kg",
        "friction.linear[0]",
        "friction.linear[1]",
        "friction.quadratic[0]",
        "actuator_matrix[0,0]",
    )
    free = [f"model.{name}" for name in (*names, "friction.quadratic[1]")]
    options = FitOptions(start={"model.mass_kg": 1.6}, diagnose=False)
    fit = identify(case_run(0, 20.0), case, free, options=options)
    assert unobservable_names(fit) == {"mass_kg"}
    assert fit.start[0] == 1.6
    assert fit.value("model.actuator_matrix[0,0]") == pytest.approx(1.6 / 1.47, rel=5e-3)
    (collinear,) = fit.unobservable
    assert (collinear.code, collinear.subject) == ("identifiability.collinear", "model.mass_kg")
    assert "the scale" in collinear.figures["advice"].figures["tool"]


def test_id0_a_vehicle_at_rest_gives_no_fit(case):
    u = np.zeros((500, 3))
    u[0, 0] = 1e-6
    fit = identify(simulate(case, u, 0), case)
    assert fit.verdict == "REFUSED"
    assert "fit.explains-nothing" in [reason.code for reason in fit.reasons]
    assert [name for name in fit.names if name in fit.vehicle_file.provenance] == []  # none is written
    assert [fit.vehicle_file.value(name) for name in fit.names] == [case.value(name) for name in fit.names]
    assert len(fit.channels) == 3  # the measured data are shown nevertheless


def test_one_channel_far_from_the_model_is_refused_by_name():
    """Wheel counts were wrapped before they were scaled: a sawtooth of ± 26 mm/s instead of ± 2 m/s."""
    car = load("car")
    run = simulate(car, excitation("random_steps", [0.5, 0.6], 30.0, car.rate_hz, 1), 1)
    z = np.remainder(run.sensors["odometer"].z + 0.026, 0.052) - 0.026
    wrapped_run = replace(run, sensors=run.sensors | {"odometer": run.sensors["odometer"]._replace(z=z)})
    fit = identify(wrapped_run, car)
    assert fit.verdict == "REFUSED"
    assert (fit.reasons[0].code, fit.reasons[0].subject) == ("fit.channel-far-from-model", "odometer[0]")
    assert fit.reasons[0].figures["ratio"] > 3.0
    assert identify(run, car).verdict != "REFUSED"


def test_a_poorly_identified_parameter_remains_in_the_fit_with_a_warning(case):
    u = excitation("random_steps", [8.0, 0.0, 20.0], 12.0, 100.0, 1)
    fit = identify(simulate(case, u, 1), case)
    names = [name for name, w in zip(fit.names, fit.poorly_identified, strict=True) if w]
    assert "model.friction.quadratic[1]" in {*names, *(f"model.{n}" for n in unobservable_names(fit))}
    assert fit.verdict == "WARN"


def test_weakly_separable_parameters_are_named_with_an_informative_motion(case):
    fit = identify(simulate(case, excitation("multisine", case.command.limit, 30.0, 100.0, 1), 1), case)
    assert fit.verdict == "WARN"
    reasons = {reason.subject: reason for reason in fit.reasons}
    friction_reason = reasons["model.friction.quadratic[1]"]
    assert friction_reason.code == "identifiability.poor-pair"
    assert (
        friction_reason.figures["others"] == "friction.linear[0], friction.linear[1], friction.quadratic[0]"
    )
    motion = "sliding sideways both slowly and fast, as in turns at many speeds"
    assert friction_reason.figures["advice"].figures["motion"].startswith(motion)
    weak = reasons["model.actuator_matrix[1,2]"]
    assert (weak.code, weak.figures["reason"].code) == (
        "identifiability.poor",
        "identifiability.little-sideways",
    )


def test_sideways_friction_without_sideways_motion_is_reported_as_unobservable(case):
    u = random_steps([20.0, 0.0, 0.0], 30.0, 100.0, 1)
    fit = identify(simulate(case, u, 1), case)
    note = {reason.subject: reason for reason in fit.unobservable}["model.friction.linear[1]"]
    assert (note.code, note.figures["reason"].code) == (
        "identifiability.fixed",
        "identifiability.little-sideways",
    )


def test_never_observable_parameters_are_reported_once_without_a_warning(case, case_run):
    fit = identify(case_run(0, 30.0), case)
    assert fit.verdict == "USABLE"
    assert fit.unobservable == ()
    assert len(fit.always_unobservable) == 1
    assert fit.always_unobservable[0].code == "identifiability.no-sideways-command"
    assert (
        fit.always_unobservable[0].figures["names"]
        == "actuator_matrix[0,1], actuator_matrix[1,1], actuator_matrix[2,1]"
    )


def test_full_commands_do_not_separate_dead_zone_from_gain(small):
    fit = identify(simulate(small, excitation("prbs", small.command.limit, 20.0, 100.0, 1), 1), small)
    collinear = [reason for reason in fit.unobservable if reason.code == "identifiability.collinear"]
    labels = [f"{reason.subject}, {reason.figures['others']}" for reason in collinear]
    assert any("drivetrain.dead_zone_forward[0]" in names for names in labels)
    motion = "forward commands just above the dead zone of the first motor"
    assert any(
        str(figure).startswith(motion)
        for reason in collinear
        for figure in reason.figures["motion"].figures.values()
    )


def test_a_wrong_dry_friction_that_cannot_be_separated_does_not_bias_the_gain():
    """A car that only drives forward: the start of dry friction is larger than friction and dead zone together."""
    car, rng = load("car"), np.random.default_rng(0)
    u = np.c_[np.repeat(rng.uniform(0.15, 0.5, 15), 50), np.zeros(750)]
    run = simulate(car, u, 1)
    names = "throttle_gain", "linear_drag", "coulomb_m_s2", "drivetrain.dead_zone_forward[0]"
    start = car.with_values({"model.coulomb_m_s2": 1.0})
    fit = identify(run, start, [f"model.{name}" for name in names], use=("odometer",))
    error = [fit.value(f"model.{name}") - car.value(f"model.{name}") for name in names[:3]]
    assert np.all(np.abs(error) < 3.5 * fit.std[:3])
    assert np.isnan(fit.value(f"model.{names[3]}"))


@pytest.mark.parametrize("energy", [1e10, 1e32])
def test_a_channel_without_noise_does_not_overflow_at_a_parameter_without_effect(energy):
    """Before, the fit of wheels without noise printed a RuntimeWarning: energy / 1e-300 is beyond a float."""
    with np.errstate(all="raise"):
        scale = identifiability._signal_scale(np.array([[0.0, 4.0]]), np.array([energy]))
    assert scale[0] > 1e100
    assert scale[1] == pytest.approx(np.sqrt(energy / 4.0))
