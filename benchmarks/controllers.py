"""Compare a step of the predictive controller with its solver's call, to find the cost of the rest.

Any code around the solver has to pay for its call: new P and q, factors, iterations, solution.
"""

from time import process_time

import numpy as np

from baqueano.controllers import Mpc
from baqueano.guides.shapes import sinuous_circle
from baqueano.signals import Estimate, Reference
from baqueano.vehicle_file import load
from benchmarks.harness import Bench, Case, LeftOut, measured

HZ = 50.0
HALF = 0.5  # least share of a step's time for the solver


def benches(smallest: bool) -> list[Bench] | list[LeftOut]:
    """Return the benches of a robot and a car."""
    try:
        import osqp  # noqa: F401
    except ImportError:
        return [LeftOut("predictive control", "pip install osqp")]
    return [predictive(name, speed) for name, speed in (("small", 0.2), ("car", 0.8))]


def predictive(name: str, speed_m_s: float) -> Bench:
    """Return the bench: drive beside a route, tick by tick, and solve the program of the last tick again."""
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
    E, _, program = law._horizon.linear(
        state, 1.0 / HZ, Reference(state.t_ns, route.eta[0], route.nu[0], 0.0), now
    )
    cases = [Case("a step", step), Case("its solver's call", lambda: law._program.solve(program, E))]
    return measured(f"predictive control, {name}", cases, {cases[1].name: HALF}, clock=process_time)
