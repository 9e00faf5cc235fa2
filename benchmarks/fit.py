"""15 parameters from 60 s of IMU at 100 Hz: identify() against SciPy's least_squares with Huber's loss.

Both begin where friction and forces are half of the truth and cross-talk is zero, both know the noise, and
both end at the same cost (checked). SciPy takes its Jacobian by finite differences over the NumPy loop, as
one does. With --quick its evaluations are counted on our simulation of the same model, and one of them is
timed on the loop.
"""

import time

import numpy as np

from baqueano.identify import identify
from baqueano.simulate import simulate
from baqueano.simulate.system import System, varied
from baqueano.symbolic import scan
from baqueano.vehicle_file import load
from benchmarks import paper, peers
from benchmarks.harness import Bench, Case, interleaved, row, timed

PATHS = ("model.friction.linear", "model.friction.quadratic", "model.actuator_matrix")
TITLE = "fit of 15 parameters over 60 s at 100 Hz"
SIGMA = np.array([0.05, 0.05, 0.005])


def benches(quick: bool) -> list[Bench]:
    """The whole fit, from the run to the estimates."""
    from scipy.optimize import least_squares

    file = load("case-study-1").with_values({"command.limit": [20.0, 20.0, 60.0]})
    u = paper.signal(60.0, sideways=20.0)
    run = simulate(file, u, seed=3)
    z = run.sensors["imu"].z
    truth, m, I = peers.parameters()
    first = 0.5 * truth
    begin = dict(zip(PATHS, (first[:3], first[3:6], first[6:].reshape(3, 3)), strict=True))

    def ours():
        return identify(run, file, PATHS, start=begin, sigma={"imu": SIGMA}, biases=False, at_rest=True)

    def loop(theta):
        return ((z - peers.measurements(u, theta, m, I)) / SIGMA).ravel()

    kernel = _kernel(file.vehicle)

    def compiled(theta):
        return ((z - kernel.run(u, theta)[1]) / SIGMA).ravel()

    np.testing.assert_allclose(compiled(first), loop(first), atol=1e-6)
    began = time.perf_counter()
    theirs = least_squares(compiled if quick else loop, first, loss="huber", f_scale=1.345, x_scale="jac")
    took = time.perf_counter() - began
    calls = theirs.nfev + 15 * theirs.njev
    theirs_s = calls * timed(lambda: loop(first)) if quick else took
    found = ours().estimate
    cost = [float(np.sum(_huber(compiled(theta)))) for theta in (found, theirs.x)]
    if cost[0] > cost[1] * (1.0 + 1e-6):
        raise AssertionError(f"identify ends at {cost[0]:.9g}, SciPy at {cost[1]:.9g}")
    (ours_s,) = interleaved([Case("ours", ours)])
    named = "SciPy least_squares, Huber, NumPy loop"
    how = f"{calls} simulations, {'extrapolated from one' if quick else 'one round'}; cost {cost[1]:.6g}"
    mine = "identify(), tracing included"
    notes = {named: how, mine: f"cost {cost[0]:.6g}"}
    pairs = ((mine, ours_s), (named, theirs_s))
    rows = tuple(row(name, s, ours_s, {named: 1000.0}, notes) for name, s in pairs)
    return [Bench(TITLE, rows)]


def _kernel(vehicle):
    """θ (15,) and the signal → what the paper's IMU shows."""
    still = np.zeros(3)

    def step(theta, state, uk):
        model = varied(System(vehicle, None), PATHS, theta).model
        state, motion = model.step(state, uk, peers.DT, still)
        return state, np.array([motion.nu_dot[0], motion.nu_dot[1], motion.nu[2]])

    return scan(step, vehicle.init(), np.zeros(3), np.zeros(15))


def _huber(r):
    return np.where(np.abs(r) <= 1.345, 0.5 * r * r, 1.345 * np.abs(r) - 0.5 * 1.345**2)
