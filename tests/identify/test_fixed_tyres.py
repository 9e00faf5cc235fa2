"""A car identified from commands and IMU only, with parameters of its tyres that stay fixed or are free by role."""

from dataclasses import dataclass

import numpy as np
import pytest

from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.residuals.gyro_aided import gyro_aided_paths
from baqueano.parameter import parameter
from baqueano.vehicle_file import load
from baqueano.vehicles import Car
from tests.identify.test_imu_only import EXACT, LONGITUDINAL, YAW, drive_seed, fit_imu_only


def test_a_fixed_understeer_widens_the_errors_by_its_effect():
    """The error that the fit states is the change of the fit by the true understeer."""
    true_value, free = {"model.understeer": 0.015}, LONGITUDINAL + YAW
    file, run = drive_seed(3, changes=true_value)
    fit, exact = (fit_imu_only(run, car, free, EXACT) for car in (file, file.with_values(true_value)))
    k = fit.names.index("model.steering_gain")
    change = abs(fit.estimate[k] - exact.estimate[k])
    assert change > 2.0 * exact.std[k]
    assert np.sqrt(fit.unmodelled_cov[k, k]) == pytest.approx(change, rel=0.3)
    assert abs(fit.estimate[k] - file.value(fit.names[k])) < 1.96 * fit.std[k]


def test_the_role_of_a_parameter_states_that_it_is_free_without_an_encoder():
    @dataclass(frozen=True, slots=True, eq=False)
    class OwnCar(Car):
        softness: float = parameter("1", "softness of the tyres", default=0.0, role="tyre")

    own = OwnCar(wheelbase_m=0.26, throttle_gain=4.0, steering_gain=0.4)
    paths = gyro_aided_paths(FittedBlocks(own, load("car").sensors), None, "own")
    assert {"+model.softness", "+model.understeer"} <= set(paths)
