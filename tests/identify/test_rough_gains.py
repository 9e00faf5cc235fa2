"""Tests of the vehicle file with which the experiment after a first drive is planned."""

from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.design.vehicle_cloud import (
    planning_file,
    possible_vehicles,
    undetermined_damping,
    with_uncertain_gains,
)
from baqueano.diagnostics import Verdict
from baqueano.vehicle_file import ParameterCov, load


def test_a_fit_that_does_not_show_how_the_vehicle_stops_is_not_used_for_a_plan():
    """Of the parameters that slow a car, one is 0 at its bound with a large error, and one is not determined."""
    names = ("model.throttle_gain", "model.linear_drag", "model.coulomb_m_s2", "model.cornering_drag")
    blocks = SimpleNamespace(model=load("car").vehicle)
    estimate, poorly = np.array([5.0, 0.0, np.nan, 0.0]), np.array([True, True, False, True])
    fit = SimpleNamespace(
        names=names,
        estimate=estimate,
        poorly_identified=poorly,
        bound=np.array([0, -1, 0, -1]),
        vehicle_file=load("car"),
        blocks=blocks,
    )
    assert undetermined_damping(fit) == ["model.linear_drag", "model.coulomb_m_s2"]
    rough_file = load("car")
    assert len(planning_file(fit, rough_file).parameter_cov.names) == 2
    fit.estimate, fit.bound = np.array([5.0, 1.2, 0.3, 0.0]), np.array([0, 0, 0, -1])
    assert undetermined_damping(fit) == []
    fit.std = 0.1 * fit.estimate
    for verdict, expected in ((Verdict.REFUSED, rough_file), (Verdict.WARN, fit.vehicle_file)):
        fit.verdict = verdict
        assert planning_file(fit, rough_file) is expected


@pytest.mark.parametrize(
    ("friction", "std", "expected"), [(0.0, 0.04, 20.0), (0.1, 0.3, 20.0), (30.0, 3.0, 30.0)]
)
def test_a_sideways_friction_that_may_be_0_is_that_of_the_file(friction, std, expected):
    """Pulses on one spot hardly show it. Without it, a plan for 2 x 2 m expected the vehicle 8 m beyond the wall."""
    names = tuple(f"model.friction.linear[{k}]" for k in range(3))
    rough_file = load("small").with_values({"model.friction.linear": [5.0, 20.0, 0.02]})
    cov = ParameterCov(names, np.diag([1.0, std**2, 1e-4]))
    fitted_file = load("small").with_values({"model.friction.linear": [4.0, friction, 0.03]}, None, cov)
    fit = SimpleNamespace(
        names=names, estimate=np.array([4.0, friction, 0.03]), std=np.array([1.0, std, 0.01]), bound=np.zeros(3),
        poorly_identified=np.zeros(3, bool), vehicle_file=fitted_file, verdict=Verdict.WARN,
        blocks=SimpleNamespace(model=fitted_file.vehicle),
    )  # fmt: skip
    plan_file = planning_file(fit, rough_file)
    assert list(plan_file.value("model.friction.linear")) == [4.0, expected, 0.03]
    assert len(plan_file.parameter_cov.names) == (3 if friction == expected else 2)


@pytest.mark.parametrize(("name", "count"), [("car", 2), ("small", 0)])
def test_a_plan_with_rough_gains_takes_the_other_guesses_as_uncertain_by_a_half(name, count):
    rough_file = with_uncertain_gains(load(name))
    draws = possible_vehicles(rough_file, vehicle_count=200)
    std = np.std(np.log(draws.theta[1:, count:] / draws.theta[0, count:]), axis=0)
    assert len(rough_file.parameter_cov.names) == count
    assert np.median(std) == pytest.approx(0.5, rel=0.1)
