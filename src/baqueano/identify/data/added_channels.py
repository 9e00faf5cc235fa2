"""Add channels to a fit that are not sensors of the vehicle: the truth, and the voltage of the battery.

    ν of the mark = R(−χ) (ν_x − l_y ν_ψ,  ν_y + l_x ν_ψ)                                                  (1)

The truth is z = ν of a simulation, from which the paper estimates its matrices, or the pose that a camera measured.
The pose of the mark on the body is a parameter, "sensors.truth.lever_arm_m" and "sensors.truth.heading_rad". It
belongs to the recording and is not written to a vehicle file. If battery = "logged" in the drivetrain, each row ends
with the newest voltage of the channel `battery`. This voltage replaces `battery_v`, and the actuator matrix is valid
at `battery_nominal_v`. A fit sets battery = "logged" itself if `battery_effect` is free.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.diagnostics import fault
from baqueano.errors import UsageError
from baqueano.identify.data.record import FitRecord, FittedBlocks, Measurements
from baqueano.parameter import parameter
from baqueano.runs.run import Channel, Run
from baqueano.sensors import Pose
from baqueano.sensors.pose import rotate_vector
from baqueano.signals import ByName, Motion, seconds, sensor_slots
from baqueano.vehicles.bounds import check_bounds

TRUTH = "truth"
MOUNT_PREFIX = f"sensors.{TRUTH}."  # prefix of parameters that belong to a recording
BATTERY_CHANNEL = "battery"  # of the run
VOLTAGE_KEY = "voltage of the battery"  # key of the voltage in a record; it cannot be the name of a sensor
VOLTAGE_RATIO_RANGE = (0.5, 2.0)  # of the nominal voltage


@dataclass(frozen=True, slots=True, eq=False)
class Velocity:
    """Sensor block of a measured velocity: z = (ν_x, ν_y, ν_ψ) [m/s, m/s, rad/s]."""

    size: int = 3
    lever_arm_m: np.ndarray = parameter(
        "m", "position of the mark in the body, l", low=-100.0, high=100.0, default=(0.0, 0.0), shape=(2,)
    )
    heading_rad: float = parameter(
        "rad", "angle to the left by which the mark is turned, χ", low=-7.0, high=7.0, default=0.0
    )

    def __post_init__(self) -> None:
        check_bounds(self)

    def h(self, motion: Motion) -> np.ndarray:
        """Return ν (3,) of the mark, in the axes of the mark.  (1)"""
        vx, vy, w = motion.nu
        velocity = np.array([vx - self.lever_arm_m[1] * w, vy + self.lever_arm_m[0] * w])
        return np.array([*rotate_vector(velocity, -self.heading_rad), w])


def with_truth(runs: Sequence[Run], sensors: ByName[Tree]) -> tuple[list[Run], Any]:
    """Return the runs with their truth as a sensor, and the sensor blocks with a block for the truth. The truth is a
    velocity if all runs contain one, else a pose. Raise UsageError if a run does not contain a truth."""
    runs_with_truth = []
    has_velocity = all(run.truth is not None and np.isfinite(run.truth.nu).all() for run in runs)
    for run in runs:
        truth = run.truth
        if truth is None or not np.isfinite(truth.nu if has_velocity else truth.eta).any():
            raise UsageError(fault("truth.absent", run=run.name))
        channel = Channel(truth.t_ns, truth.t_ns, truth.nu if has_velocity else truth.eta)
        runs_with_truth.append(replace(run, sensors={**run.sensors, TRUTH: channel}))
    block = Velocity() if has_velocity else Pose()
    return runs_with_truth, sensor_slots((*sensors._fields, TRUTH))(*sensors, block)


def with_voltage(records: Sequence[FitRecord], runs: Sequence[Run], blocks: FittedBlocks) -> list[FitRecord]:
    """Return the records with the voltage of their run, if the drivetrain requires it. Raise UsageError if no run
    contains a voltage, or if the median voltage of a run is far from the nominal voltage."""
    drivetrain = getattr(blocks.model, "drivetrain", None)
    if getattr(drivetrain, "battery", "steady") != "logged":
        return list(records)
    if not any(_has_voltage(run) for run in runs):
        raise UsageError(fault("battery.no-voltage", channel=BATTERY_CHANNEL))
    records_with_voltage = []
    for record in records:
        volts = _voltage_at_rows(record, runs[record.run], drivetrain)
        readings = Measurements(volts[:, None], np.zeros((len(volts), 1)), None)
        records_with_voltage.append(record._replace(sensors={**record.sensors, VOLTAGE_KEY: readings}))
    return records_with_voltage


def _has_voltage(run: Run) -> bool:
    return BATTERY_CHANNEL in run.sensors and bool(np.isfinite(run.sensors[BATTERY_CHANNEL].z[:, 0]).any())


def _voltage_at_rows(record: FitRecord, run: Run, drivetrain: Tree) -> np.ndarray:
    """Return the voltage (N,) [V] at the rows of the record, or `battery_v` for a run without a measured voltage."""
    if not _has_voltage(run):
        return np.full(len(record.dt_s), float(drivetrain.battery_v))
    channel = run.sensors[BATTERY_CHANNEL]
    is_finite = np.isfinite(channel.z[:, 0])
    t_s, z = seconds(channel.t_ns[is_finite], run.t_ns[0]), channel.z[is_finite, 0]
    nominal = drivetrain.battery_nominal_v
    if not VOLTAGE_RATIO_RANGE[0] < np.median(z) / nominal < VOLTAGE_RATIO_RANGE[1]:
        raise UsageError(
            fault("battery.other-voltage", run=run.name, voltage_v=np.median(z), nominal_v=nominal)
        )
    order = np.argsort(t_s, kind="stable")
    newest = np.searchsorted(t_s[order], record.t_s, side="right") - 1
    return z[order][np.maximum(newest, 0)]
