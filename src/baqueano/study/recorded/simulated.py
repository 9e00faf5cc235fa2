"""Simulate a model under only the commands of a run, from the start of the run: for tests on held-out runs."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.identify.data.record import make_record
from baqueano.runs.run import Run
from baqueano.signals import Motion, seconds
from baqueano.symbolic import scan
from baqueano.vehicle_file import VehicleFile
from baqueano.vehicles.state import Vehicle

if TYPE_CHECKING:
    Output = Callable[[Motion], np.ndarray]


def simulate_outputs(
    vehicle: Vehicle, start: Tree, dt_s: np.ndarray, u: np.ndarray, output: "Output", backend: str
) -> np.ndarray:
    """Return `output` (N, m) of the motion from the state `start`, under commands u (N, n) that last dt_s (N,)."""

    def step(state: Tree, row: np.ndarray) -> tuple[Tree, np.ndarray]:
        state, motion = vehicle.step(state, row[1:], row[0], np.zeros(3))
        return state, output(motion)

    kernel = scan(step, start, np.zeros(1 + vehicle.commands), backend=backend)
    return np.asarray(kernel.run(np.column_stack([dt_s, u]))[1])


def measured_and_simulated(
    vehicle_file: VehicleFile, run: Run, sensor: str, backend: str = "auto"
) -> tuple[np.ndarray, np.ndarray]:
    """Return the measurements (K, m) of a sensor, and the readings of the model at the same times, from rest."""
    block, vehicle = getattr(vehicle_file.sensors, sensor), vehicle_file.vehicle
    record = make_record(run, {sensor: block})
    simulated_values = simulate_outputs(vehicle, vehicle.init(), record.dt_s, record.u, block.h, backend)
    sensor_log = record.sensors[sensor]
    is_present = sensor_log.mask.all(axis=1)
    return sensor_log.z[is_present], simulated_values[is_present]


def final_poses(vehicle_file: VehicleFile, run: Run, backend: str = "auto") -> tuple[np.ndarray, np.ndarray]:
    """Return the last true pose (3,), and the pose (3,) that the model reaches from the first true pose."""
    truth, vehicle = run.truth, vehicle_file.vehicle
    assert truth is not None
    is_inside = (run.t_ns > truth.t_ns[0]) & (run.t_ns < truth.t_ns[-1])
    ends = np.concatenate([run.t_ns[is_inside], truth.t_ns[-1:]])
    u = run.applied_commands[np.searchsorted(run.t_ns, ends)]
    dt_s = np.diff(seconds(ends, truth.t_ns[0]), prepend=0.0)
    start = vehicle.init(eta=truth.eta[0])
    return truth.eta[-1], simulate_outputs(vehicle, start, dt_s, u, lambda motion: motion.eta, backend)[-1]
