"""The delay of the command from any start of the search: on a whole tick, where the cost has a kink, and between two
ticks.
"""

import numpy as np
import pytest

from baqueano.identify import FitOptions, identifiability, identify, random_steps
from baqueano.identify.identifiability import larger_bound
from baqueano.identify.residuals.simulation import Residuals
from baqueano.simulate import simulate
from baqueano.vehicle_file import load, override

DELAY_PATH = "model.drivetrain.delay_s"
FREE = ("model.friction.linear[0]", "model.actuator_matrix[0,0]", "model.actuator_matrix[2,2]", DELAY_PATH)
SIGMAS = 3.5
small = load("small")


def fit_delay(delay_s, start_s, seed):
    truth = override(small, [f"{DELAY_PATH}={delay_s}"])
    run = simulate(truth, random_steps(truth.command.limit, 10.0, 100.0, seed, hold_s=0.5), seed)
    fit = identify(run, small, FREE, options=FitOptions(start={DELAY_PATH: start_s}))
    k = fit.names.index(DELAY_PATH)
    return fit, fit.estimate[k], fit.std[k], fit.bound[k]


@pytest.mark.parametrize(
    ("delay_s", "start_s"),
    [(0.05, 0.0), (0.05, 0.25), (0.05, 0.05), (0.001, 0.1), (0.0734, 0.25), (0.2, 0.0)],
)
def test_id8_a_delay_is_identified_within_its_error_from_any_start(delay_s, start_s):
    """0.05 and 0.2 s are whole ticks, 0.001 s is a tenth of one."""
    for seed in (1, 2):
        fit, estimate, std, bound = fit_delay(delay_s, start_s, seed)
        assert fit.converged
        assert fit.verdict == "USABLE", fit.reasons
        assert abs(estimate - delay_s) < SIGMAS * std < 1e-3, "the error must be at most a tenth of a tick"
        assert bound == 0


def test_a_delay_of_zero_is_identified_as_zero():
    """Zero is the end of the search range, and the fit reports this bound."""
    fit, estimate, _, bound = fit_delay(0.0, 0.1, 1)
    assert fit.converged
    assert abs(estimate) < 2e-4
    assert bound in (-1, 0)


def drive_late(delay_s, seconds):
    """Return a short run of a vehicle with a delay."""
    truth = override(small, [f"{DELAY_PATH}={delay_s}"])
    return simulate(truth, random_steps(truth.command.limit, seconds, 100.0, 1, hold_s=0.5), 1)


def test_a_delay_at_its_default_bound_is_reported_with_the_larger_bound():
    option, run = f"--bound {DELAY_PATH}=0,0.5", drive_late(0.4, 4.0)
    fit = identify(run, small, FREE)
    (message,) = (m for m in (*fit.reasons, *fit.notes) if m.subject == DELAY_PATH and m.code[:5] == "bound")
    assert (message.code, message.fix) == ("bound.high-default", option)
    bounds = {DELAY_PATH: tuple(map(float, option.partition("=")[2].split(",")))}
    fit = identify(run, small, FREE, options=FitOptions(bounds=bounds))
    assert abs(fit.value(DELAY_PATH) - 0.4) < 1e-3


def test_a_free_delay_that_is_not_identifiable_is_not_advised_to_be_free(monkeypatch):
    """It is fixed at its start, so the residuals show a delay. The advice was to free it."""
    assess = identifiability.assess_identifiability

    def without_delay(info, energy, theta, free, *others):
        result = assess(info, energy, theta, free, *others)
        is_delay = [parameter.path == DELAY_PATH for parameter in free]
        return result._replace(mask=result.mask & ~np.array(is_delay + [False] * (len(theta) - len(free))))

    monkeypatch.setattr(identifiability, "assess_identifiability", without_delay)
    fit = identify(drive_late(0.04, 6.0), small, FREE)
    (delay_note,) = (m for m in fit.unobservable if m.subject == DELAY_PATH)
    assert delay_note.figures["advice"].fix == f"--bound {DELAY_PATH}=0,0.5"
    fixes = {m.fix for m in fit.reasons if m.fix}
    assert f"--bound {DELAY_PATH}=0,0.5" in fixes
    assert not any(f"+{DELAY_PATH}" in fix for fix in fixes)


def test_a_delay_at_the_bound_of_its_field_has_no_larger_bound():
    assert larger_bound(DELAY_PATH, 1.5) == f"--bound {DELAY_PATH}=0,2.0"
    assert larger_bound(DELAY_PATH, 2.0) == larger_bound(LAG_PATH, 1.0) == ""


LAG_PATH = "model.drivetrain.lag_s"
SEEDS = range(300, 320)  # these values were not used to develop the search


def test_delay_and_lag_of_the_motors_are_identified_together():
    """A delay and a lag look alike, and a dead zone gives the cost a local minimum at every tick."""
    errors = []
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        delay_s, lag_s = rng.uniform(0.0, 0.06), rng.uniform(0.02, 0.12)
        truth = override(small, [f"{DELAY_PATH}={delay_s}", f"{LAG_PATH}={lag_s}"])
        run = simulate(truth, random_steps(truth.command.limit, 10.0, 100.0, seed, hold_s=0.5), seed)
        fit = identify(run, small, (*FREE, LAG_PATH), options=FitOptions(diagnose=False))
        indices = [fit.names.index(path) for path in (DELAY_PATH, LAG_PATH)]
        assert fit.converged
        errors += [(fit.estimate[indices] - [delay_s, lag_s]) / fit.std[indices]]
        assert np.all(fit.std[indices] < [1e-3, 3e-3])
    assert np.max(np.abs(errors)) < 3.0
    assert 0.6 < np.sqrt(np.mean(np.square(errors))) < 1.4


def test_an_unmodelled_delay_is_reported_until_the_delay_is_a_free_parameter():
    truth = override(small, [f"{DELAY_PATH}=0.04"])
    run = simulate(truth, random_steps(truth.command.limit, 20.0, 100.0, 7, hold_s=0.5), 7)
    fit = identify(run, small)
    reasons = [reason for reason in fit.reasons if reason.code == "residual.missing-free"]
    assert ("term.delay", f"--free +{DELAY_PATH}") in [
        (reason.figures["effect"].code, reason.fix) for reason in reasons
    ]
    delay_fit = identify(run, small, [f"+{DELAY_PATH}"])
    assert delay_fit.names == (*fit.names, DELAY_PATH)
    assert delay_fit.value(DELAY_PATH) == pytest.approx(0.04, abs=1e-3)
    assert not any(reason.figures.get("term") == "delay" for reason in delay_fit.reasons)


def test_the_reported_number_of_evaluations_is_correct(monkeypatch):
    evaluations, evaluate = [], Residuals.evaluate
    monkeypatch.setattr(
        Residuals, "evaluate", lambda self, theta: evaluations.append(1) or evaluate(self, theta)
    )
    truth = override(small, [f"{DELAY_PATH}=0.04"])
    run = simulate(truth, random_steps(truth.command.limit, 10.0, 100.0, 7, hold_s=0.5), 7)
    assert identify(run, small, FREE, options=FitOptions(diagnose=False)).evaluations == len(evaluations) > 0
