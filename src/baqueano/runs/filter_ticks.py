"""Provide the ticks of a run as arrays, as a filter in a scan reads them."""

from typing import Any

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.estimators.pauses import split_ticks
from baqueano.runs.run import Run, age_s
from baqueano.signals import Slot, Tick, sensor_slots


def example_filter_tick(ekf: Tree) -> Tick:
    """Return a tick with the correct shapes for a trace, with every sensor of the filter but without measurements."""
    slots = {name: Slot(0.0, np.zeros(sensor.size)) for name, sensor in ekf.sensors._asdict().items()}
    return Tick(1, np.zeros(ekf.vehicle.commands), sensor_slots(tuple(slots))(**slots))


def make_ticks(run: Run, ekf: Tree, max_ticks: int) -> Any:
    """Return the first `max_ticks` ticks of the run as one tree with a leading axis. Pauses are split into rows without
    measurements."""
    t_ns = run.t_ns[:max_ticks]
    slots: dict[str, Tree] = {}
    for name, sensor in ekf.sensors._asdict().items():
        is_new, z, age = np.zeros(len(t_ns)), np.zeros((len(t_ns), sensor.size)), np.zeros(len(t_ns))
        channel = run.sensors.get(name)
        if channel is not None:
            tick_index = np.searchsorted(t_ns, channel.arrival_ns)
            is_inside = (tick_index < len(t_ns)) & np.isfinite(channel.z).any(axis=1)
            z[tick_index[is_inside]], is_new[tick_index[is_inside]] = channel.z[is_inside], 1.0
            age[tick_index[is_inside]] = age_s(channel.t_ns[is_inside], t_ns[tick_index[is_inside]])
        slots[name] = (is_new, z, age)
    u = np.where(np.isfinite(run.applied_commands[:max_ticks]), run.applied_commands[:max_ticks], 0.0)
    rows: Any = {name: Slot(*slot) for name, slot in slots.items()}
    columns: Tree = (t_ns, u, sensor_slots(tuple(rows))(**rows))
    return split_ticks(Tick(*columns), ekf.rate_hz)[0]
