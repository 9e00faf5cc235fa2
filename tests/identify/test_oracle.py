"""SciPy's least_squares with the Huber loss, over the same model in plain NumPy, ends at the same cost."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from baqueano.identify import FitOptions, identify
from baqueano.identify.residuals.simulation import HUBER
from baqueano.signals import Motion
from baqueano.symbolic import with_value

FREE = [f"model.{x}" for x in ("friction.linear[0]", "friction.linear[2]", "actuator_matrix[0,0]")]
SIGMA = np.array([0.05, 0.05, 0.005])


def residuals(case, run, theta):
    """Return (z − h)/σ (3 N,) by the step of the vehicle, tick by tick."""
    vehicle = case.vehicle
    for path, x in zip(FREE, theta, strict=True):
        vehicle = with_value(vehicle, path.removeprefix("model."), x)
    state, out = vehicle.init(), []
    for u, z in zip(run.applied, run.sensors["imu"].z, strict=True):
        state, motion = vehicle.step(state, u, 0.01, np.zeros(3))
        assert isinstance(motion, Motion)
        out.append((z - case.sensors.imu.h(motion)) / SIGMA)
    return np.concatenate(out)


def test_scipy_reaches_the_same_cost_and_parameters(case, case_run):
    run = case_run(11, 1.0)
    start = {path: 2.0 * case.value(path) for path in FREE}
    fit = identify(
        run, case, FREE, options=FitOptions(start=start, biases=False, at_rest=True, sigma={"imu": SIGMA})
    )
    first = np.array([start[path] for path in FREE])
    peer = least_squares(
        lambda x: residuals(case, run, x * first),
        np.ones(3),
        loss="huber",
        f_scale=HUBER,
        xtol=1e-9,
        ftol=1e-10,
    )
    assert fit.cost == pytest.approx(peer.cost, rel=1e-8)
    assert np.max(np.abs(fit.estimate - peer.x * first) / fit.sd) < 1e-2
