"""Fit 15 parameters from 60 s of IMU at 100 Hz: identify() against SciPy's least_squares with Huber's loss, and JAX.

All begin with friction and forces at half of the truth and zero cross-talk, and use the known noise. All must end at
the same cost (checked). SciPy computes its Jacobian by finite differences over the NumPy loop, as is usual. With
--smallest its evaluations are counted on our simulation of the same model, and one evaluation is timed on the loop.
JAX, of the extra `bench`, is omitted if it is not installed. It is measured twice. Its fit with error bars is compared
with identify(), which also reads, checks and reports a run. Its function for the optimiser is compared with our kernel.
identify() also diagnoses the model here, as by default; a separate row shows the time without diagnosis. The other
benches omit the diagnosis.

Two more benches fit a run of ten times the length, and several runs on one processor and on all processors.
"""

import os
import sys
import time
from collections.abc import Callable
from importlib.util import find_spec
from unittest.mock import patch

import numpy as np

from baqueano.identify import FitOptions, identify
from baqueano.identify.estimation.search import FINE_DECREMENT
from baqueano.numerics import parallel
from baqueano.numerics.least_squares import minimise
from baqueano.numerics.normal_equations import Evaluation
from baqueano.runs import Run
from baqueano.simulate import simulate
from baqueano.simulate.system import System, with_parameters
from baqueano.symbolic import scan
from baqueano.vehicle_file import load
from benchmarks import paper, peers
from benchmarks.harness import Bench, Case, LeftOut, interleaved, measured, row, timed

PATHS = ("model.friction.linear", "model.friction.quadratic", "model.actuator_matrix")
SIGMA = np.array([0.05, 0.05, 0.005])
FILE = load("case-study-1").with_values({"command.limit": [20.0, 20.0, 60.0]})


def benches(smallest: bool) -> list[Bench | LeftOut]:
    """Return the benches against peers, with a longer run, and on several processors."""
    one_s, several_s = (10.0, 20.0) if smallest else (60.0, 1440.0)
    jax = against_jax(one_s) if find_spec("jax") else LeftOut("fit in JAX", "pip install jax")
    benches = [] if _processors() < 2 else [several_runs(several_s)]
    return [against_peers(one_s, extrapolated=smallest), jax, ten_times(one_s), *benches]


def against_peers(duration_s: float, extrapolated: bool) -> Bench:
    """Return the bench of the whole fit, from the run to the estimates and their errors."""
    from scipy.optimize import least_squares

    run, u = _record_run(duration_s, 3)
    z = run.sensors["imu"].z
    truth, m, I = peers.parameters()
    first = 0.5 * truth

    def loop(theta):
        return ((z - peers.measurements(u, theta, m, I)) / SIGMA).ravel()

    kernel = _kernel(FILE.vehicle)

    def compiled(theta):
        return ((z - kernel.run(u, theta)[1]) / SIGMA).ravel()

    np.testing.assert_allclose(compiled(first), loop(first), atol=1e-6)
    start_s = time.process_time()
    reference = least_squares(
        compiled if extrapolated else loop, first, loss="huber", f_scale=1.345, x_scale="jac"
    )
    took = time.process_time() - start_s
    calls = reference.nfev + 15 * reference.njev
    theirs_s = calls * timed(lambda: loop(first), clock=time.process_time) if extrapolated else took
    fit = _fit_runs(run)
    cost = [float(np.sum(_huber(compiled(theta)))) for theta in (fit.estimate, reference.x)]
    if cost[0] > cost[1] * (1.0 + 1e-6):
        raise AssertionError(f"identify ends at {cost[0]:.9g}, SciPy at {cost[1]:.9g}")
    own_name, scipy_name = "identify()", "SciPy least_squares, Huber, NumPy loop"
    reference_text = (
        f"{calls} simulations, {'extrapolated from one' if extrapolated else 'one round'}; cost {cost[1]:.6g}"
    )
    notes = {scipy_name: reference_text, own_name: f"cost {cost[0]:.6g}, {fit.evaluations} evaluations"}
    cases = [Case(own_name, lambda: _fit_runs(run, True)), Case("without doubts", lambda: _fit_runs(run))]
    if find_spec("jax") is not None:
        _, in_jax = _in_jax(u, z, fit.estimate, fit.std)
        cases.append(Case("JAX, our optimiser, error bars", lambda: in_jax(first)))
    seconds = interleaved(cases, time.process_time)  # of all threads: the wall clock also measures other work
    rows = [row(case.name, s, seconds[0], {}, notes) for case, s in zip(cases, seconds, strict=True)]
    return Bench(
        _title(duration_s), (*rows, row(scipy_name, theirs_s, seconds[0], {scipy_name: 3000.0}, notes))
    )


def against_jax(duration_s: float) -> Bench:
    """Return the bench of the same search by the same optimiser, with our kernel and with JAX's."""
    run, u = _record_run(duration_s, 3)
    z, first = run.sensors["imu"].z, 0.5 * peers.parameters()[0]
    kernel, low = _kernel(FILE.vehicle, whitened=True), np.array([0.0] * 6 + [-np.inf] * 9)

    def by_baqueano():
        return minimise(
            lambda theta: Evaluation(*kernel.normal_equations((u, z), theta, 1.345)),
            first, low, np.full(15, np.inf), tolerance=FINE_DECREMENT,
        )  # fmt: skip

    fit = by_baqueano()
    search, _ = _in_jax(u, z, fit.theta, None)
    title = f"{_title(duration_s)}: the search alone, {fit.evaluations} evaluations"
    cases = [Case("our kernel", by_baqueano), Case("JAX", lambda: search(first))]
    return measured(title, cases, {"JAX": 8.0}, {"JAX": "compiling is not counted"})


def _in_jax(
    u: np.ndarray, z: np.ndarray, estimate: np.ndarray, std: np.ndarray | None
) -> tuple[Callable, Callable]:
    """Return the search in JAX, and the fit with error bars, both compiled and checked against our results."""
    from benchmarks import jax_peer

    truth, m, I = peers.parameters()
    search, fit = jax_peer.of(u, z, SIGMA, m, I)
    fit_result, errors = fit(0.5 * truth)
    np.testing.assert_allclose(fit_result.theta, estimate, atol=1e-3 * np.min(errors))
    if std is not None:
        np.testing.assert_allclose(errors, std, rtol=1e-4)
    return search, fit


def ten_times(duration_s: float) -> Bench:
    """Return the bench of a run, and of a run of ten times its length."""
    runs = [_record_run(duration_s * k, 3)[0] for k in (1, 10)]
    cases = [Case(f"{run.duration_s:.0f} s", lambda run=run: _fit_runs(run)) for run in runs]
    return measured(
        "fit of 15 parameters over a run of ten times the length", cases, {}, limits={cases[1].name: 11.0}
    )


def several_runs(duration_s: float) -> Bench:
    """Return the bench of four runs on all processors, and on one processor with one worker."""
    runs = [_record_run(duration_s / 4.0, seed)[0] for seed in range(4)]
    everywhere = os.sched_getaffinity(0)

    def one_process():
        _confine({min(everywhere)})
        try:
            with patch.object(
                parallel, "MIN_ROWS", sys.maxsize
            ):  # least number of rows for which threads are used
                _fit_runs(runs)
        finally:
            _confine(everywhere)

    cases = [Case("all processors", lambda: _fit_runs(runs)), Case("one processor", one_process)]
    title = f"fit of 15 parameters over four runs, {duration_s:g} s in all"
    return measured(title, cases, {"one processor": 1.8} if len(everywhere) == 2 else {})


def _title(duration_s: float) -> str:
    return f"fit of 15 parameters over {duration_s:g} s at 100 Hz"


def _record_run(duration_s: float, seed: int) -> tuple[Run, np.ndarray]:
    """Return a run of the vehicle with a sideways actuator, and its command."""
    u = paper.signal(duration_s, sideways=20.0)
    return simulate(FILE, u, seed=seed), u


def _fit_runs(runs, doubts=False):
    first = 0.5 * peers.parameters()[0]
    begin = dict(zip(PATHS, (first[:3], first[3:6], first[6:].reshape(3, 3)), strict=True))
    return identify(
        runs,
        FILE,
        PATHS,
        options=FitOptions(start=begin, sigma={"imu": SIGMA}, biases=False, at_rest=True, diagnose=doubts),
    )


def _confine(processors: set[int]) -> None:
    """Move all threads of this process to these processors."""
    for thread in os.listdir("/proc/self/task"):
        os.sched_setaffinity(int(thread), processors)


def _processors() -> int:
    """Return the number of processors that this process can choose."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else 1


def _kernel(vehicle, whitened=False):
    """Return a scan from θ (15,) and the signal to the readings h of the paper's IMU; if `whitened`, to (z − h)/σ."""
    zero = np.zeros(3)

    def step(theta, state, row):
        uk, z = row if whitened else (row, None)
        model = with_parameters(System(vehicle, None), PATHS, theta).model
        state, motion = model.step(state, uk, peers.DT, zero)
        h = np.array([motion.nu_dot[0], motion.nu_dot[1], motion.nu[2]])
        return state, (z - h) / SIGMA if whitened else h

    return scan(step, vehicle.init(), (zero, zero) if whitened else zero, np.zeros(15))


def _huber(r):
    return np.where(np.abs(r) <= 1.345, 0.5 * r * r, 1.345 * np.abs(r) - 0.5 * 1.345**2)
