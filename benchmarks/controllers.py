"""Compare a step of the predictive controller with the call of its solver, to measure the cost of the other code.

Any such controller must pay for the call of the solver: new P and q, factors, iterations, solution.
"""

from time import process_time

import numpy as np

from baqueano.controllers import Mpc
from baqueano.guides.shapes import sinuous_circle
from baqueano.signals import Estimate, Reference
from baqueano.vehicle_file import load
from benchmarks.harness import Bench, Case, LeftOut, measured

HZ = 50.0
HALF = 0.5  # the solver must use at least this share of a step's time


def benches(smallest: bool) -> list[Bench] | list[LeftOut]:
    """Return the benches of a robot and a car, or an entry for the missing solver."""
    try:
        import osqp  # noqa: F401
    except ImportError:
        return [LeftOut("predictive control", "pip install osqp")]
    return [predictive(name, speed) for name, speed in (("small", 0.2), ("car", 0.8))]


def predictive(name: str, speed_m_s: float) -> Bench:
    """Return the bench: steps of a drive beside a route, against repeated calls of the solver with one program."""
    file, route = load(name), sinuous_circle(0.6, 0.06, 5, speed_m_s)
    law = Mpc(file.vehicle, limit=file.command.limit, rate_hz=HZ)
    state, tick = law.init(), 0

    def step() -> None:
        nonlocal state, tick
        k, t_ns, tick = tick % len(route.t_s), round(tick * 1e9 / HZ), tick + 1
        aside = route.eta[k] + np.array([0.0, 0.01 * np.sin(0.1 * tick), 0.0])
        state, _ = law.step(
            state,
            Reference(t_ns, route.eta[k], route.nu[k], 0.0),
            Estimate(t_ns, aside, route.nu[k], np.eye(6)),
        )

    for _ in range(50):
        step()
    now = Estimate(state.t_ns, route.eta[0], route.nu[0], np.eye(6))
    E, _, program = law._horizon.linearised_program(
        state, 1.0 / HZ, Reference(state.t_ns, route.eta[0], route.nu[0], 0.0), now
    )
    cases = [Case("a step", step), Case("its solver's call", lambda: law._program.solve(program, E))]
    return measured(f"predictive control, {name}", cases, {cases[1].name: HALF}, clock=process_time)
