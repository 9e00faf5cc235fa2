"""Compare a step of each controller with the same law by hand in C (laws.c), and `mpc` with its solver.

Both functions of a law receive the same references and estimates in one call, and compute the same commands. A step
may take at most 1.3 times the time of the code by hand. `mpc` must pay for the call of its solver: new P and q,
factors, iterations, solution. The call is timed within the step: repeated alone, with its data in the cache, it would
take less time. OSQP also reports a time, without that of its Python interface.
"""

from statistics import median
from time import process_time
from typing import Any

import numpy as np

from baqueano.contracts.blocks import Controller
from baqueano.controllers import Lqr, Mpc, Pd
from baqueano.guides.shapes import sinuous_circle
from baqueano.signals import Estimate, Reference
from baqueano.symbolic import scan
from baqueano.symbolic.c_code.compile import find_compiler
from baqueano.vehicle_file import load
from benchmarks.harness import Bench, Case, LeftOut, measured, row
from benchmarks.kernels import HANDS, Libraries, compiled_cases, libraries_of

HZ = 50.0
TICKS, WARM_UP = 1000, 50
HALF = 0.5  # the solver must use at least this share of a step's time
STEPS, ACCURACY = 20_000, 1e-12
LAWS = ("pd_feedforward", "kanayama", "pure_pursuit", "stanley", "lqr")


def benches(smallest: bool) -> list[Bench | LeftOut]:
    """Return the benches of the laws, and those of `mpc` for a robot and a car, or entries for what is missing."""
    results: list[Bench | LeftOut] = []
    if find_compiler().compiler is None:
        results.append(LeftOut("laws by hand", "sudo apt-get install gcc"))
    else:
        libraries, robot = libraries_of("laws.c"), load("small")
        laws = {"pd": Pd(alpha=4.0, beta=1.0, gamma=0.1, limit=np.ones(3))}
        laws |= {kind: robot.controller(kind) for kind in LAWS}
        rows = inputs(200 if smallest else STEPS)
        results += [by_hand(libraries, name, law, rows) for name, law in laws.items()]
    try:
        import osqp  # noqa: F401
    except ImportError:
        return [*results, LeftOut("predictive control", "pip install osqp")]
    return [*results, *(predictive(name, speed) for name, speed in (("small", 0.2), ("car", 0.8)))]


def inputs(count: int) -> np.ndarray:
    """Return rows (count, 13) of a drive beside a route: time [ns], pose and velocity of reference and estimate."""
    route, k = sinuous_circle(0.6, 0.06, 5, 0.2), np.arange(count)
    eta, nu = route.eta[k % len(route.t_s)], route.nu[k % len(route.t_s)]
    offset = np.array([0.02, 0.02, 0.1]) * np.sin(0.01 * k[:, None] + np.arange(3.0))
    noise = 1.0 + 0.1 * np.random.default_rng(0).normal(size=nu.shape)
    return np.column_stack([1e7 * k, eta, nu, eta + offset, nu * noise])


def by_hand(libraries: Libraries, name: str, law: Controller, rows: np.ndarray) -> Bench:
    """Return the bench of a law against the code by hand, after a check that their commands agree."""

    def step(state: Any, row: np.ndarray) -> tuple[Any, np.ndarray]:
        estimate = Estimate(row[0], row[7:10], row[10:13], np.zeros((6, 6)))
        state, command = law.step(state, Reference(row[0], row[1:4], row[4:7], 0.0), estimate)
        return state, command.u

    kernel, expected = scan(step, law.init(), rows[0], backend="c"), np.empty((len(rows), 3))
    P = law.memory() if isinstance(law, Lqr) else np.zeros((3, 3))
    cases = compiled_cases(libraries, name, len(rows), P, rows, expected)
    np.testing.assert_allclose(kernel.run(rows)[1], expected, rtol=0.0, atol=ACCURACY)
    cases = [Case("compiled", lambda: kernel.run(rows)), *cases]
    targets = dict.fromkeys(HANDS, 1.0 / 1.3)
    return measured(f"{name}: {len(rows):,} steps", cases, targets, clock=process_time)


def predictive(name: str, speed_m_s: float) -> Bench:
    """Return the bench: the steps of a drive beside a route, and the calls of the solver in these steps."""
    law, route = (
        Mpc(load(name).vehicle, limit=load(name).command.limit, rate_hz=HZ),
        sinuous_circle(0.6, 0.06, 5, speed_m_s),
    )
    state, solver = law.init(), law._program
    steps_s, calls_s, reports_s, solve = [], [], [], solver.solve

    def timed_solve(*arguments: Any) -> tuple[np.ndarray, np.ndarray] | None:
        begin_s = process_time()
        solution = solve(*arguments)
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
        reports_s.append(solver._solver.info.run_time)
    medians_s = [median(times[WARM_UP:]) for times in (steps_s, calls_s, reports_s)]
    names, goal = ("a step", "its solver's call", "the time that OSQP reports"), {"its solver's call": HALF}
    rows = (row(name, time_s, medians_s[0], goal, {}) for name, time_s in zip(names, medians_s, strict=True))
    return Bench(f"predictive control, {name}", tuple(rows))
