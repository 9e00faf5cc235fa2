"""Compare a step of the predictive controller with the call of its solver, to measure the cost of the other code.

Any such controller must pay for the call of the solver: new P and q, factors, iterations, solution. The call is timed
within the step: repeated alone, with its data in the cache, it would take less time.
"""

from statistics import median
from time import process_time
from typing import Any

import numpy as np

from baqueano.controllers import Mpc
from baqueano.guides.shapes import sinuous_circle
from baqueano.signals import Estimate, Reference
from baqueano.vehicle_file import load
from benchmarks.harness import Bench, LeftOut, row

HZ = 50.0
TICKS, WARM_UP = 1000, 50
HALF = 0.5  # the solver must use at least this share of a step's time


def benches(smallest: bool) -> list[Bench] | list[LeftOut]:
    """Return the benches of a robot and a car, or an entry for the missing solver."""
    try:
        import osqp  # noqa: F401
    except ImportError:
        return [LeftOut("predictive control", "pip install osqp")]
    return [predictive(name, speed) for name, speed in (("small", 0.2), ("car", 0.8))]


def predictive(name: str, speed_m_s: float) -> Bench:
    """Return the bench: the steps of a drive beside a route, and the calls of the solver in these steps."""
    law, route = (
        Mpc(load(name).vehicle, limit=load(name).command.limit, rate_hz=HZ),
        sinuous_circle(0.6, 0.06, 5, speed_m_s),
    )
    state, solver = law.init(), law._program
    steps_s, calls_s, solve = [], [], solver.solve

    def timed_solve(program: Any, start: np.ndarray) -> np.ndarray | None:
        begin_s = process_time()
        solution = solve(program, start)
        calls_s.append(process_time() - begin_s)
        return solution

    solver.solve = timed_solve
    for k in range(WARM_UP + TICKS):
        t_ns, j = round(k * 1e9 / HZ), k % len(route.t_s)
        position = route.eta[j] + np.array([0.0, 0.01 * np.sin(0.1 * k), 0.0])
        reference = Reference(t_ns, route.eta[j], route.nu[j], 0.0)
        estimate = Estimate(t_ns, position, route.nu[j], np.eye(6))
        begin_s = process_time()
        state, _ = law.step(state, reference, estimate)
        steps_s.append(process_time() - begin_s)
    step_s, call_s = (median(times[WARM_UP:]) for times in (steps_s, calls_s))
    goal = {"its solver's call": HALF}
    rows = (row("a step", step_s, step_s, {}, {}), row("its solver's call", call_s, step_s, goal, {}))
    return Bench(f"predictive control, {name}", rows)
