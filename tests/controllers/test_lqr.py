"""The regulator's gain against the Riccati solution of SciPy."""

import numpy as np
from scipy.linalg import solve_discrete_are

from baqueano.controllers import Tracking
from baqueano.controllers.lqr import MIN_SPEED_M_S
from baqueano.symbolic import function
from baqueano.vehicle_file import load

SMALL = load("small")


def test_the_regulator_gain_equals_the_riccati_solution_of_scipy():
    """At a steady speed the forward iteration of the equation converges to the solution of the algebraic equation."""
    law, v, w, dt = SMALL.controller("lqr"), 0.25, 0.4, 0.01
    now = Tracking(np.zeros(3), 0.0, np.array([v, 0.0, w]), w / v, 1.0, dt)
    step = function(law.velocity_law, law.memory(), now)
    P = law.memory()
    for _ in range(3000):
        P, _ = step(P, now)
    # The error of a unicycle behind a steady reference, by hand; on any curve the errors are those beside it.
    A = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, v * dt], [0.0, 0.0, 1.0]])
    B = -np.array([[dt, 0.0], [0.0, 0.5 * v * dt * dt], [0.0, dt]])
    want = solve_discrete_are(A, B, np.diag(1.0 / law.e_max**2), np.diag(1.0 / law.change_max**2))
    np.testing.assert_allclose(P, want, rtol=0.02, atol=0.01 * np.abs(want).max())
    K = np.linalg.solve(np.diag(1.0 / law.change_max**2) + B.T @ want @ B, B.T @ want @ A)
    _, (x, turn) = step(P, now._replace(e=np.array([0.01, 0.02, 0.0]), e_chi=0.03))
    np.testing.assert_allclose(np.array([v, w]) - [x, turn], K @ [0.01, 0.02, 0.03], rtol=0.02, atol=3e-4)


def test_the_regulator_starts_with_the_riccati_solution_of_scipy_for_a_slow_vehicle():
    law, dt, v = SMALL.controller("lqr"), 1.0 / SMALL.rate_hz, MIN_SPEED_M_S
    A = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, v * dt], [0.0, 0.0, 1.0]])
    B = -np.array([[dt, 0.0], [0.0, 0.5 * v * dt * dt], [0.0, dt]])
    want = solve_discrete_are(A, B, np.diag(1.0 / law.e_max**2), np.diag(1.0 / law.change_max**2))
    np.testing.assert_allclose(law.memory(), want, rtol=0.02, atol=1e-6 * np.abs(want).max())


def test_a_vehicle_at_rest_beside_its_path_does_not_turn_away_from_its_course():
    """Before, it turned: a vehicle that was pushed near the end of its route stopped 37° off its course."""
    law, offset_pose = SMALL.controller("lqr"), np.array([0.0, 0.1, 0.0])
    _, velocity = law.velocity_law(law.memory(), Tracking(offset_pose, 0.0, np.zeros(3), 0.0, 0.0, 0.01))
    np.testing.assert_allclose(velocity, 0.0, atol=1e-9)
