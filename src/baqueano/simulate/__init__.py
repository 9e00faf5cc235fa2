"""Simulate a vehicle file and return the run: one vehicle or ten thousand, driven by a signal or by the loop.

simulate(vehicle, u)               # a signal, one kernel over the whole run
simulate_loop(vehicle, route)      # estimator, guide, controller, supervisor and vehicle, one kernel
simulate_many(vehicle, u, 10_000)  # many vehicles, each with other parameters
"""

from baqueano.simulate.closed_loop import simulate_loop, simulate_loops
from baqueano.simulate.many import Ensemble, simulate_many
from baqueano.simulate.open_loop import simulate

__all__ = ["Ensemble", "simulate", "simulate_loop", "simulate_loops", "simulate_many"]
