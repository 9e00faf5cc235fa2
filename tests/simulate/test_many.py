"""Each of thousands of vehicles equals a separate simulation of this vehicle."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from baqueano.errors import UsageError
from baqueano.simulate import simulate, simulate_many
from baqueano.simulate.many import _chunks, draw_parameters
from baqueano.simulate.system import System
from baqueano.vehicle_file.provenance import ParameterCov
from tests.codes import refused

U = np.repeat(np.random.default_rng(3).uniform(-1, 1, (4, 3)) * [1.0, 0.0, 1.0], 25, axis=0)


def test_each_vehicle_equals_its_single_simulation(vehicle):
    mass, linear = np.array([0.5, 0.7, 0.9]), np.array([[1.0, 30, 0.01], [2, 40, 0.02], [0.5, 50, 0.005]])
    group = simulate_many(
        vehicle,
        U,
        vary={"model.mass_kg": mass, "model.friction.linear": linear},
        every_s=0.25,
        eta0=[1, 2, 3],
    )
    assert group.names == (
        "model.mass_kg",
        "model.friction.linear[0]",
        "model.friction.linear[1]",
        "model.friction.linear[2]",
    )
    np.testing.assert_allclose(group.t_s, [0.25, 0.5, 0.75, 1.0])
    model = vehicle.vehicle
    for l in range(3):
        friction = replace(model.friction, linear=linear[l])
        vehicle.vehicle = replace(model, mass_kg=mass[l], friction=friction)
        single = simulate(vehicle, U, eta0=[1, 2, 3], noise=False)
        np.testing.assert_allclose(group.eta[l], single.truth.eta[24::25], atol=1e-11)
        np.testing.assert_allclose(group.nu[l], single.truth.nu[24::25], atol=1e-11)


def test_a_vehicle_with_long_ticks_equals_its_single_simulation(vehicle):
    """A tick of 40 ms is divided into two rows, also with noise: each row has its own."""
    vehicle.rate_hz = 25.0
    mass = {"model.mass_kg": [vehicle.vehicle.mass_kg]}
    truth = simulate(vehicle, U, noise=False).truth
    group = simulate_many(vehicle, U, vary=mass)
    np.testing.assert_allclose(group.eta[0, -1], truth.eta[-1], atol=1e-11)
    noisy = simulate_many(vehicle, U, vary=mass, process_noise=True)
    assert not np.allclose(noisy.nu[0, -1], truth.nu[-1], atol=1e-3)


def test_the_number_of_chunks_does_not_change_the_result(vehicle, monkeypatch):
    mass = np.linspace(0.5, 0.9, 21)
    group = simulate_many(vehicle, U, vary={"model.mass_kg": mass}, process_noise=True)
    monkeypatch.setattr(import_module("baqueano.simulate.many"), "CHUNK_VEHICLES", 8)
    parts = simulate_many(vehicle, U, vary={"model.mass_kg": mass}, process_noise=True)
    np.testing.assert_array_equal(group.eta, parts.eta)


def test_the_scatter_of_vehicles_matches_the_process_noise(vehicle):
    """A free walk of ν_ψ has std σ √t except for friction. A deviation of 4 σ over 400 vehicles occurs once in 16
    000."""
    friction = replace(vehicle.vehicle.friction, linear=np.zeros(3), quadratic=np.zeros(3))
    vehicle.vehicle = replace(vehicle.vehicle, friction=friction)
    group = simulate_many(vehicle, 0 * U, 400, vary={}, process_noise=True, seed=3)
    std = np.std(group.nu[:, -1, 2])
    assert std == pytest.approx(0.1 * np.sqrt(1.0), rel=4 / np.sqrt(2 * 400))


def test_the_table_shows_mean_and_standard_deviation(vehicle):
    group = simulate_many(vehicle, U, vary={"model.mass_kg": np.linspace(0.5, 0.7, 5)})
    row = group.rows()[-1]
    assert row["vehicles"] == 5
    assert row["x_m_std"] > 0
    assert "model.mass_kg" in group.table()
    assert group.verdict == "DONE"


def test_a_diverged_vehicle_is_counted_separately(vehicle):
    linear = np.tile([1.5, 40.0, 0.01], (4, 1))
    linear[2] = -1e6  # a file would not permit this value
    group = simulate_many(vehicle, U, vary={"model.friction.linear": linear})
    assert [(reason.code, reason.figures["count"]) for reason in group.reasons] == [("simulate.lost", 1)]
    assert group.rows()[-1]["vehicles"] == 3


def test_drawn_parameters_have_the_fitted_covariance_and_respect_bounds(vehicle):
    """Bounds of 4.5 standard errors over 4000 draws."""
    names = (
        "model.mass_kg",
        "model.friction.linear[0]",
        "sensors.imu.gyro_bias",
        "model.friction.quadratic[1]",
    )
    cov = np.diag([1e-4, 0.04, 1e-6, 1e-4])
    cov[0, 1] = cov[1, 0] = 1e-3
    vehicle.parameter_cov = ParameterCov(names, cov)
    system = System(vehicle.vehicle, vehicle.sensors)
    paths, theta, clip_count = draw_parameters(vehicle, system, 4000, seed=1)
    assert paths == (names[0], names[1], names[3])
    np.testing.assert_allclose(theta[:, :2].mean(axis=0), [0.61, 1.5], atol=4.5 * 0.2 / 63)
    np.testing.assert_allclose(np.cov(theta[:, :2].T), cov[:2, :2], rtol=4.5 / 30)
    assert theta[:, 2].min() == 0.0  # friction is never negative: half of the draws about 0
    assert 1800 < clip_count < 2200


def test_vehicles_drawn_from_a_covariance_are_simulated(vehicle):
    vehicle.parameter_cov = ParameterCov(("model.friction.linear[0]",), np.array([[0.04]]))
    group = simulate_many(vehicle, U, 50, seed=2)
    assert group.theta.shape == (50, 1)
    assert np.corrcoef(group.theta[:, 0], np.abs(group.nu[:, 0, 0]))[0, 1] < -0.9


@pytest.mark.parametrize(
    ("cov", "vehicles", "words"),
    [
        (None, 5, ("simulate.no-covariance", {"name": "small"})),
        (ParameterCov(("sensors.imu.gyro_bias",), np.eye(1)), 5, ("simulate.no-covariance", {})),
        (ParameterCov(("model.mass_kg",), np.eye(1)), None, ("simulate.vehicles", {})),
    ],
)
def test_impossible_draws_are_refused_with_a_reason(vehicle, cov, vehicles, words):
    vehicle.parameter_cov = cov
    with refused(words[0], UsageError, **words[1]):
        simulate_many(vehicle, U, vehicles)


def test_the_chunk_size_limits_the_memory():
    parts = _chunks(10_000, True, 6_000)
    assert sum(p.stop - p.start for p in parts) == 10_000
    assert all((p.stop - p.start) * 6_000 * 24 <= 2**26 for p in parts)


@pytest.mark.parametrize(
    ("vary", "words"),
    [
        (
            {"model.mass_kg": np.zeros((3, 2))},
            ("simulate.vary-shape", {"value": "(3, 2)", "expected": "(L,)"}),
        ),
        ({"model.friction.linear": np.zeros(3)}, ("simulate.vary-shape", {"expected": "(L, 3)"})),
        ({"model.mass_kg": np.array([1.0, np.inf])}, ("simulate.vary-not-finite", {})),
        (
            {"model.mass_kg": np.ones(2), "model.inertia_kg_m2": np.ones(3)},
            ("simulate.vary-count", {"value": 3, "expected": 2}),
        ),
        ({"model.mas": np.ones(2)}, ("simulate.no-number", {"path": "model.mas"})),
        ({}, ("simulate.no-vehicles", {})),
    ],
)
def test_an_invalid_variation_is_refused_with_a_reason(vehicle, vary, words):
    with refused(words[0], UsageError, **words[1]):
        simulate_many(vehicle, U, vary=vary)
