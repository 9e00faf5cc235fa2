"""Simulate a model under only the commands of a run, from the start of the run: for tests on held-out runs."""

from typing import TYPE_CHECKING

import numpy as np

from baqueano.identify.data.record import record_of
from baqueano.signals import seconds
from baqueano.symbolic import scan

if TYPE_CHECKING:
    from baqueano.contracts.values import Tree
    from baqueano.runs.run import Run
    from baqueano.vehicle_file import VehicleFile


def measured_and_simulated(
    vehicle_file: "VehicleFile", run: "Run", sensor: str, backend: str = "auto"
) -> tuple[np.ndarray, np.ndarray]:
    """Return the measurements (K, m) of a sensor, and the readings of the model at the same times, from rest."""
    block, vehicle = getattr(vehicle_file.sensors, sensor), vehicle_file.vehicle
    record = record_of(run, {sensor: block})

    def step(state: "Tree", line: np.ndarray) -> tuple["Tree", np.ndarray]:
        state, motion = vehicle.step(state, line[1:], line[0], np.zeros(3))
        return state, block.h(motion)

    lines = np.ascontiguousarray(np.concatenate([record.dt_s[:, None], record.u], axis=1))
    kernel = scan(step, vehicle.init(), np.zeros(1 + vehicle.commands), backend=backend)
    simulated_values, sensor_log = np.asarray(kernel.run(lines)[1]), record.sensors[sensor]
    present = sensor_log.has.all(axis=1)
    return sensor_log.z[present], simulated_values[present]


def final_poses(
    vehicle_file: "VehicleFile", run: "Run", backend: str = "auto"
) -> tuple[np.ndarray, np.ndarray]:
    """Return the last true pose (3,), and the pose (3,) that the model reaches from the first true pose."""
    truth, vehicle = run.truth, vehicle_file.vehicle
    assert truth is not None
    is_inside = (run.t_ns > truth.t_ns[0]) & (run.t_ns < truth.t_ns[-1])
    ends = np.concatenate([run.t_ns[is_inside], truth.t_ns[-1:]])
    u = run.applied_commands[np.searchsorted(run.t_ns, ends)]
    dt_s = np.diff(seconds(ends, truth.t_ns[0]), prepend=0.0)

    def step(state: "Tree", line: np.ndarray) -> tuple["Tree", np.ndarray]:
        state, motion = vehicle.step(state, line[1:], line[0], np.zeros(3))
        return state, motion.eta

    lines = np.ascontiguousarray(np.concatenate([dt_s[:, None], u], axis=1))
    start = vehicle.init(eta=truth.eta[0])
    kernel = scan(step, start, np.zeros(1 + vehicle.commands), backend=backend)
    return truth.eta[-1], np.asarray(kernel.run(lines)[1])[-1]
