"""A fit never ends in values for which the vehicle file would be refused."""

import pytest

import baqueano as bq
from baqueano.diagnostics import Verdict
from baqueano.identify import FitOptions, identify
from baqueano.identify.parameters.free import MAX_DECAY_PER_ROW
from baqueano.vehicle_file import load
from baqueano.vehicles.freedoms import decay_rates, slowing_bounds

DRY, SIGN_SPEED = "model.friction.coulomb[0]", "model.friction.coulomb_speed[0]"
ARM = "sensors.imu.lever_arm_m"
DRIVE_S = 4.0
NO_DEAD_ZONE = {
    f"model.drivetrain.dead_zone_{direction}": [0.0, 0.0] for direction in ("forward", "backward")
}


def test_friction_of_a_sharp_sign_ends_in_a_file_that_is_accepted() -> None:
    stiff = load("small").with_values({"model.friction.coulomb": [0.8, 0.0, 0.01], **NO_DEAD_ZONE})
    sharp = stiff.with_values({"rate_hz": 1000.0, "model.friction.coulomb_speed": [0.001, 0.05, 0.5]})
    u = bq.excitation("random_steps", [1.0, 0.0, 1.0], DRIVE_S, 100.0, seed=3)
    run = bq.simulate(sharp, u.repeat(10, axis=0))
    fit = identify(run, stiff, [DRY, SIGN_SPEED], use=["truth"], options=FitOptions(diagnose=False))
    assert decay_rates(fit.blocks.model)[0] <= 1.05 * MAX_DECAY_PER_ROW * stiff.rate_hz
    assert fit.bound[fit.names.index(SIGN_SPEED)] == -1
    assert "bound.integrable" in [message.code for message in fit.notes]
    assert fit.updated_file().vehicle.friction.coulomb_speed[0] > 0.001


def test_bound_of_a_sign_speed_makes_the_decay_as_fast_as_permitted() -> None:
    model = load("small").with_values({"model.friction.coulomb_speed": [0.005, 0.05, 0.5]}).vehicle
    max_rate = 0.8 * decay_rates(model)[0]
    ((path, (low, high)),) = slowing_bounds(model, {"model.mass_kg": 1e3, SIGN_SPEED: 1.0}, max_rate).items()
    assert (path, high) == (SIGN_SPEED, 1.0)
    slower = load("small").with_values({"model.friction.coulomb_speed": [low, 0.05, 0.5]}).vehicle
    assert decay_rates(slower)[0] == pytest.approx(max_rate, rel=1e-6)


def test_fit_of_a_lever_arm_outside_the_platform_is_refused() -> None:
    inertia = load("small").vehicle.inertia_kg_m2
    changes = {"geometry.radius_m": 0.1, "model.inertia_kg_m2": inertia, ARM: [0.12, 0.005]}
    large = load("small").with_values(changes)
    run = bq.simulate(large, bq.excitation("random_steps", [1.0, 0.0, 1.0], DRIVE_S, 100.0, seed=3))
    fit = identify(run, load("small"), [ARM], options=FitOptions(diagnose=False))
    assert fit.verdict == Verdict.REFUSED
    assert "vehicle.lever-arm" in [message.code for message in fit.reasons]
