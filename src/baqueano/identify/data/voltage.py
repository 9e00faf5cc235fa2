"""The voltage of the battery as an input of the drivetrain, tick by tick.

A run may hold a channel `battery` [V]. With battery = "logged" in the drivetrain, which a fit sets by itself
where `battery_effect` is free, each row ends with the voltage that was measured last, in the place of
`battery_v`; the actuator matrix is then the one at `battery_nominal_v`. Runs without the channel are taken to
have had `battery_v` all the time.
"""

from collections.abc import Sequence

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.diagnostics import fault
from baqueano.errors import UsageError
from baqueano.identify.data.record import FitRecord, FittedBlocks, Measured
from baqueano.runs.run import Run
from baqueano.signals import seconds
from baqueano.symbolic import put

CHANNEL = "battery"  # of the run
VOLTAGE = "voltage of the battery"  # its place in a record: no name of a sensor
LIKELY = (0.5, 2.0)  # of the nominal voltage


def with_voltage(records: Sequence[FitRecord], runs: Sequence[Run], blocks: FittedBlocks) -> list[FitRecord]:
    """The records with the voltage of their run, where the drivetrain asks for it."""
    drivetrain = getattr(blocks.model, "drivetrain", None)
    if getattr(drivetrain, "battery", "steady") != "logged":
        return list(records)
    if not any(_told(run) for run in runs):
        raise UsageError(fault("battery.no-voltage", channel=CHANNEL))
    out = []
    for record in records:
        volts = _volts(record, runs[record.run], drivetrain)
        measured = Measured(volts[:, None], np.zeros((len(volts), 1)), None)
        out.append(record._replace(sensors={**record.sensors, VOLTAGE: measured}))
    return out


def at_voltage(blocks: FittedBlocks, row: np.ndarray, volts: bool) -> FittedBlocks:
    """The blocks with the voltage at the end of the row, if there is one."""
    return put(blocks, "model.drivetrain.battery_v", row[-1]) if volts else blocks


def _told(run: Run) -> bool:
    return CHANNEL in run.sensors and bool(np.isfinite(run.sensors[CHANNEL].z[:, 0]).any())


def _volts(record: FitRecord, run: Run, drivetrain: Tree) -> np.ndarray:
    """(N,) at the rows of the record."""
    if not _told(run):
        return np.full(len(record.dt_s), float(drivetrain.battery_v))
    channel = run.sensors[CHANNEL]
    good = np.isfinite(channel.z[:, 0])
    t_s, z = seconds(channel.t_ns[good], run.t_ns[0]), channel.z[good, 0]
    nominal = drivetrain.battery_nominal_v
    if not LIKELY[0] < np.median(z) / nominal < LIKELY[1]:
        raise UsageError(
            fault("battery.other-voltage", run=run.name, voltage_v=np.median(z), nominal_v=nominal)
        )
    order = np.argsort(t_s, kind="stable")
    newest = np.searchsorted(t_s[order], record.t_s, side="right") - 1
    return z[order][np.maximum(newest, 0)]
