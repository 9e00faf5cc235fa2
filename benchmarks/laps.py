"""Drive ten thousand laps with ten thousand sets of gains of the paper's PD, as one batch, against vectorised NumPy."""

import time

import numpy as np

from baqueano.geometry import compose
from baqueano.guides.shapes import circle
from baqueano.tune.laps import simulated_laps
from baqueano.tune.objective import OFFSET_M
from baqueano.vehicle_file import load
from benchmarks import peers
from benchmarks.harness import ROUNDS, Bench, Case, measured

ROUTE = circle(0.3, 0.25)


def benches(smallest: bool) -> list[Bench]:
    """Return the bench of the time of all laps, after a check that the costs agree."""
    file, count = load("case-study-1"), 16 if smallest else 10_000
    laps = simulated_laps(file, ROUTE)
    low, high = laps.space.low, np.minimum(laps.space.high, [200.0, 200.0, 20.0])
    gains = np.random.default_rng(1).uniform(low, high, (count, 3))
    theta, m, I = peers.parameters()
    start = compose(ROUTE.eta[0], np.array([-OFFSET_M, OFFSET_M, 0.0]))
    ticks, weights = round(laps.seconds * file.rate_hz), laps.weights

    def by_numpy():
        return peers.driven_many(
            gains, start, ROUTE.t_s, ROUTE.eta, file.command.limit, theta, m, I, ticks, *weights[:2]
        )

    np.testing.assert_allclose(laps.costs(gains)[:, 0], by_numpy(), rtol=1e-3)
    cases = [
        Case("SimulatedLaps.costs", lambda: laps.costs(gains), 1 if smallest else ROUNDS),
        Case("vectorised NumPy", by_numpy, 1),
    ]
    title = f"{count:,} laps of {laps.seconds:.1f} s with gains of their own, time of the processors"
    return [measured(title, cases, {}, clock=time.process_time)]
