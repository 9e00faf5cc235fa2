"""The three gains of the paper's PD over a drive of 60 s: exact gradients against what needs none.

The peer is Nelder-Mead over a NumPy loop. It takes a minute or more, so one evaluation of it is measured and
multiplied by the evaluations that the same search needs on our cost, which is the same function (checked).
"""

import numpy as np

from baqueano.guides.shapes import sinuous_circle
from baqueano.tune import tune
from baqueano.tune.gains import rehearse
from baqueano.vehicle_file import load
from benchmarks import peers
from benchmarks.harness import ROUNDS, Bench, Case, interleaved, row

ROUTE = sinuous_circle(2.0, 0.2, 6, 0.25)


def benches(smallest: bool) -> list[Bench]:
    """Time, and the cost that is reached."""
    duration_s = 2.0 if smallest else 60.0
    from scipy.optimize import differential_evolution, minimize

    file = load("case-study-1")
    found = ours(file, duration_s)
    rehearsal = rehearse(file, ROUTE, laps=0, duration_s=duration_s, effort_m2=0.0, aside_m=0.0)
    low, high = rehearsal.asked.low, rehearsal.asked.high
    theta, m, I = peers.parameters()
    weights, limit, ticks = found.weights, file.command.limit, round(duration_s * file.rate_hz)

    def numpy_cost(gains):
        return peers.driven(gains, ROUTE.t_s, ROUTE.eta, limit, theta, m, I, ticks, *weights[:2])

    start = np.sqrt(np.maximum(low, 1e-3 * high) * high)
    np.testing.assert_allclose(numpy_cost(start), rehearsal.cost(start), rtol=1e-6)
    simplex = minimize(rehearsal.cost, start, method="Nelder-Mead", bounds=list(zip(low, high, strict=True)))
    bounds = list(zip(low, high, strict=True))
    evolved = differential_evolution(
        rehearsal.cost, bounds, seed=1, maxiter=1 if smallest else 60, polish=False
    )
    ours_s, one_s = interleaved(
        [
            Case("tune()", lambda: ours(file, duration_s), 1 if smallest else ROUNDS),
            Case("NumPy loop", lambda: numpy_cost(start), 1),
        ]
    )
    named = "Nelder-Mead over a NumPy loop"
    notes = {named: f"cost {simplex.fun:.5g}; {simplex.nfev} evaluations of {one_s:.2g} s, extrapolated"}
    rows = (
        row(
            "tune(), tracing included",
            ours_s,
            ours_s,
            {},
            {"tune(), tracing included": f"cost {found.cost:.5g}"},
        ),
        row(named, one_s * simplex.nfev, ours_s, {}, notes),
    )
    worse = found.cost > evolved.fun * (1.0 + 1e-6)
    told = f"differential evolution reaches {evolved.fun:.5g} in {evolved.nfev} evaluations"
    quality = rows[0]._replace(note=f"{rows[0].note}; {told}", missed=bool(worse))
    return [Bench(f"tuning of 3 gains over {duration_s:g} s", (quality, *rows[1:]))]


def ours(file, duration_s):
    """The gains of the least cost of the paper."""
    return tune(file, ROUTE, laps=0, duration_s=duration_s, effort_m2=0.0, aside_m=0.0)
