"""Tune the three gains of the paper's PD over a drive of 60 s: exact gradients against methods without gradients.

One peer is differential evolution with 200 times the evaluations: our cost must be at most 1 % above its cost. The
other peer is Nelder-Mead over a NumPy loop, which takes a minute or more. One evaluation of this loop is measured. It
is multiplied by the evaluations that the same search needs on our cost, which is the same function (checked).

Times are processor times. OPENBLAS_NUM_THREADS=1, as in the command line, excludes threads that wait for each other.
"""

from time import process_time

import numpy as np

from baqueano.guides.shapes import sinuous_circle
from baqueano.tune import tune
from baqueano.tune.objective import tuning_objective
from baqueano.vehicle_file import load
from benchmarks import peers
from benchmarks.harness import ROUNDS, Bench, Case, interleaved, row

NAMED = "tune(), tracing included"
EVOLVED, POPULATION = 200, 20  # evaluations of the peer for one of ours; members for each gain
WORSE = 1.01  # times the cost of the peer, at most
TARGET = 1500.0
ROUTE = sinuous_circle(2.0, 0.2, 6, 0.25)


def benches(smallest: bool) -> list[Bench]:
    """Return the bench of the times of all methods, with the costs that they reach."""
    duration_s = 2.0 if smallest else 60.0
    from scipy.optimize import minimize

    file = load("case-study-1")
    rehearsal = tuning_objective(file, ROUTE, laps=0, duration_s=duration_s, jerk_m2=0.0, offset_m=0.0)
    low, high = rehearsal.space.low, rehearsal.space.high
    fixed_bounds = {name: (l, h) for name, l, h in zip(rehearsal.space.names, low, high, strict=True)}
    tuning = by_baqueano(file, duration_s, fixed_bounds)
    theta, m, I = peers.parameters()
    weights, limit, ticks = tuning.weights, file.command.limit, round(duration_s * file.rate_hz)

    def numpy_cost(gains):
        return peers.drive_loop(gains, ROUTE.t_s, ROUTE.eta, limit, theta, m, I, ticks, *weights[:2])

    start = np.sqrt(np.maximum(low, 1e-3 * high) * high)
    np.testing.assert_allclose(numpy_cost(start), rehearsal.cost(start), rtol=1e-6)
    bounds = list(zip(low, high, strict=True))
    simplex = minimize(rehearsal.cost, start, method="Nelder-Mead", bounds=bounds)
    evolution_result = evolution(rehearsal, bounds, EVOLVED * len(tuning.history) if not smallest else 100)
    ours_s, one_s = interleaved(
        [
            Case(NAMED, lambda: by_baqueano(file, duration_s, fixed_bounds), 1 if smallest else ROUNDS),
            Case("NumPy loop", lambda: numpy_cost(start), 1),
        ],
        clock=process_time,
    )
    peer_name = "Nelder-Mead over a NumPy loop"
    notes = {peer_name: f"cost {simplex.fun:.5g}; {simplex.nfev} evaluations of {one_s:.2g} s, extrapolated"}
    rows = (
        row(
            NAMED, ours_s, ours_s, {}, {NAMED: f"cost {tuning.cost:.5g} in {len(tuning.history)} evaluations"}
        ),
        row(peer_name, one_s * simplex.nfev, ours_s, {peer_name: TARGET}, notes),
    )
    is_worse = tuning.cost > evolution_result.fun * WORSE
    comparison = (
        f"differential evolution reaches {evolution_result.fun:.5g} in "
        f"{evolution_result.nfev} batches of {POPULATION * len(bounds)} evaluations"
    )
    quality = rows[0]._replace(note=f"{rows[0].note}; {comparison}", is_missed=bool(is_worse))
    return [Bench(f"tuning of 3 gains over {duration_s:g} s", (quality, *rows[1:]))]


def evolution(rehearsal, bounds, evaluations):
    """Run differential evolution for this number of evaluations; each generation runs as one batch."""
    from scipy.optimize import differential_evolution

    members = POPULATION * len(bounds)
    return differential_evolution(
        lambda x: rehearsal.costs(x.T), bounds, seed=1, maxiter=max(1, evaluations // members - 1), popsize=POPULATION,
        polish=False, tol=0.0, vectorized=True, updating="deferred",
    )  # fmt: skip


def by_baqueano(file, duration_s, bounds=None):
    """Return our tuning with the paper's cost, within the bounds of the peers."""
    return tune(file, ROUTE, laps=0, duration_s=duration_s, jerk_m2=0.0, offset_m=0.0, bounds=bounds)
