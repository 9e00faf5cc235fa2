"""Tests of the vehicle file with which the experiment after a first drive is planned."""

from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.design.plan import design_plan
from baqueano.design.vehicle_cloud import planning_file
from baqueano.diagnostics import Verdict
from baqueano.drive import first_drive, with_rough_gains
from baqueano.identify import identify
from baqueano.routes.room import vehicle_room
from baqueano.simulate import simulate
from baqueano.vehicle_file import ParameterCov, load

GUESS = {
    "model.mass_kg": 1.2, "model.actuator_matrix": [[2.0, 0.0, 0.0], [0.0] * 3, [0.0, 0.0, 0.12]],
    "model.friction.linear": [5.0, 30.0, 0.02], "model.friction.quadratic": [0.3, 0.0, 0.0001],
    "model.friction.coulomb": [0.1, 0.0, 0.005],
    "model.drivetrain.dead_zone_forward": [0.2, 0.2], "model.drivetrain.dead_zone_backward": [0.2, 0.2],
}  # fmt: skip
DEAD_ZONE = [0.3, 0.34]


@pytest.fixture(scope="module")
def slow_drive():
    """Return the file of a stranger's robot, its first drive and the fit of it: the drive does not show the drag."""
    guess = load("small").with_values(GUESS)
    truth = guess.with_values({
        "model.mass_kg": 1.2, "model.actuator_matrix": [[4.6, 0.0, 0.0], [0.0] * 3, [0.0, 0.0, 0.25]],
        "model.friction.linear": [4.4, 30.0, 0.015], "model.friction.coulomb": [0.25, 0.3, 0.01],
        "model.drivetrain.dead_zone_forward": DEAD_ZONE, "model.drivetrain.dead_zone_backward": DEAD_ZONE,
        "model.drivetrain.lag_s": 0.06, "model.drivetrain.delay_s": 0.04, "sensors.imu.lever_arm_m": [0.03, -0.01],
        "sensors.imu.accel_noise_std": [0.25, 0.25],
    })  # fmt: skip
    drive = first_drive(guess, truth=truth, seed=0)
    rough_file = with_rough_gains(drive, guess)
    return truth, rough_file, identify([drive.run], rough_file)


def test_a_friction_that_the_data_do_not_show_keeps_the_value_of_the_file(slow_drive):
    """The estimate was 0 at the bound, with a standard error of several times the guess, and was usable."""
    _, rough_file, fit = slow_drive
    assert np.isnan(fit.value("model.friction.linear[0]"))
    assert fit.verdict == Verdict.WARN
    (reason,) = [reason for reason in fit.reasons if reason.code == "fit.speed-unknown"]
    assert reason.fix.split()[:2] == ["baqueano", "experiment"]
    assert (
        planning_file(fit, rough_file).value("model.friction.linear")[0] == GUESS["model.friction.linear"][0]
    )


def test_a_plan_after_a_slow_first_drive_moves_the_vehicle(slow_drive):
    """With dead zones uncertain by a half, the vehicle moved in a tenth of the minute."""
    truth, rough_file, fit = slow_drive
    plan_file = planning_file(fit, rough_file)
    room = vehicle_room(plan_file, "2.5x2.5")
    motion = simulate(truth, design_plan(plan_file, room, 20.0).u).truth
    assert np.mean(np.abs(motion.nu[:, 0]) > 0.02) > 0.5
    assert np.all(np.abs(motion.eta[:, :2]) < room.free_half_width_m)


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
        poorly_identified=np.zeros(3, bool), vehicle_file=fitted_file, verdict=Verdict.WARN, reasons=(),
        blocks=SimpleNamespace(model=fitted_file.vehicle),
    )  # fmt: skip
    plan_file = planning_file(fit, rough_file)
    assert list(plan_file.value("model.friction.linear")) == [4.0, expected, 0.03]
    assert len(plan_file.parameter_cov.names) == (3 if friction == expected else 2)
    fit.verdict = Verdict.REFUSED
    assert planning_file(fit, rough_file) is rough_file
