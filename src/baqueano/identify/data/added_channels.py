"""Add channels to a fit that are not sensors of the vehicle: the truth, the battery, and measurements made by hand.

    ν of the mark = R(−χ) (ν_x − l_y ν_ψ,  ν_y + l_x ν_ψ)                                                  (1)
    σ² = σ_hand² + Σ_i (d_i − d_0)² / SAMPLED_VEHICLES,   d_0 without noise                               (2)

The truth is z = ν of a simulation, from which the paper estimates its matrices, or the pose that a camera measured.
The pose of the mark on the body is a parameter, "sensors.truth.lever_arm_m" and "sensors.truth.heading_rad". It
belongs to the recording and is not written to a vehicle file. If battery = "logged" in the drivetrain, each row ends
with the newest voltage of the channel `battery`. This voltage replaces `battery_v`, and the actuator matrix is valid
at `battery_nominal_v`. A fit sets battery = "logged" itself if `battery_effect` is free. A measurement by hand
(calibration/hand_measurements.py) has the error of the hand and that of the process noise since the start (2).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from baqueano.calibration.hand_measurements import HAND_SENSORS, HandMeasurement, read_line
from baqueano.contracts.values import Tree
from baqueano.errors import UsageError
from baqueano.identify.data.record import FitRecord, FittedBlocks, Measurements
from baqueano.parameter import parameter
from baqueano.runs.run import Channel, Run
from baqueano.sensors import Pose
from baqueano.sensors.pose import rotate_vector
from baqueano.signals import ByName, Motion, seconds, sensor_slots
from baqueano.symbolic import scan
from baqueano.vehicles.bounds import check_bounds

TRUTH = "truth"
MOUNT_PREFIX = f"sensors.{TRUTH}."  # prefix of parameters that belong to a recording
BATTERY_CHANNEL = "battery"  # of the run
VOLTAGE_KEY = "voltage of the battery"  # key of the voltage in a record; it cannot be the name of a sensor
VOLTAGE_RATIO_RANGE = (0.5, 2.0)  # ratio to the nominal voltage
SAMPLED_VEHICLES = 24  # simulated vehicles; with these, the error of σ is 15 %


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
            raise UsageError.of("truth.absent", run=run.name)
        channel = Channel(truth.t_ns, truth.t_ns, truth.nu if has_velocity else truth.eta)
        runs_with_truth.append(replace(run, sensors={**run.sensors, TRUTH: channel}))
    block = Velocity() if has_velocity else Pose()
    return runs_with_truth, sensor_slots((*sensors._fields, TRUTH))(*sensors, block)


def with_voltage(
    records: Sequence[FitRecord], runs: Sequence[Run], blocks: FittedBlocks, is_needed: bool
) -> list[FitRecord]:
    """Return the records with the voltage of their run, if the drivetrain uses it. Raise UsageError if no run contains
    a voltage and `is_needed`, or if the median voltage of a run is far from the nominal voltage."""
    drivetrain = getattr(blocks.model, "drivetrain", None)
    if getattr(drivetrain, "battery", "steady") != "logged":
        return list(records)
    if is_needed and not any(_has_voltage(run) for run in runs):
        raise UsageError.of("battery.no-voltage", channel=BATTERY_CHANNEL)
    voltage_records = []
    for record in records:
        volts = _row_voltage(record, runs[record.run], drivetrain)
        readings = Measurements(volts[:, None], np.zeros((len(volts), 1)), None)
        voltage_records.append(record._replace(sensors={**record.sensors, VOLTAGE_KEY: readings}))
    return voltage_records


def _has_voltage(run: Run) -> bool:
    return BATTERY_CHANNEL in run.sensors and bool(np.isfinite(run.sensors[BATTERY_CHANNEL].z[:, 0]).any())


def _row_voltage(record: FitRecord, run: Run, drivetrain: Tree) -> np.ndarray:
    """Return the voltage (N,) [V] at the rows of the record, or `battery_v` for a run without a measured voltage."""
    if not _has_voltage(run):
        return np.full(len(record.dt_s), float(drivetrain.battery_v))
    channel = run.sensors[BATTERY_CHANNEL]
    is_finite = np.isfinite(channel.z[:, 0])
    t_s, z = seconds(channel.t_ns[is_finite], run.t_ns[0]), channel.z[is_finite, 0]
    nominal = drivetrain.battery_nominal_v
    if not VOLTAGE_RATIO_RANGE[0] < np.median(z) / nominal < VOLTAGE_RATIO_RANGE[1]:
        voltages = {"voltage_v": np.median(z), "nominal_v": nominal}
        raise UsageError.of("battery.other-voltage", run=run.name, **voltages)
    order = np.argsort(t_s, kind="stable")
    newest = np.searchsorted(t_s[order], record.t_s, side="right") - 1
    return z[order][np.maximum(newest, 0)]


def with_hand_measurements(
    runs: Sequence[Run], blocks: FittedBlocks, measurement_texts: Sequence[str]
) -> tuple[list[Run], FittedBlocks]:
    """Return the runs with one channel for each hand measurement, and the blocks with a sensor for each channel.
    Raise UsageError for a line of `measurement_texts` that cannot be parsed. The lines are such as

        "12.4 s: 2.31 m"               2.31 m from the start of the run, 12.4 s after the first tick
        "end: 0 m, 720 deg"            back on its mark, turned twice to the left
        "monday 5 s: 1.2 ± 0.02 m"     of the run "monday", with a standard deviation; default 1 cm and 2 degrees

    A measurement describes the pose at its time. The run begins at x = y = ψ = 0 and is not split into segments. An
    angle is used as a direction, so the model must predict it within half a turn. Process noise moves the vehicle
    away from its simulation, by the spread of SAMPLED_VEHICLES vehicles with the `process_noise_std` of the file (2).
    If this value is 0, a tape measurement after a minute has the weight of an error of only 1 cm: measure early.
    """
    runs, sensors = list(runs), blocks.sensors._asdict()
    for line in measurement_texts:
        run_index, measurements = read_line(line, runs)
        for measurement in measurements:
            name, drift = measurement.kind, drift_std(blocks.model, runs[run_index], measurement)
            while name in sensors:
                name += "_"
            sensors[name] = replace(
                HAND_SENSORS[measurement.kind], std=float(np.hypot(measurement.std, drift))
            )
            t_ns, z = np.array([measurement.t_ns], dtype=np.int64), measurement.z[None]
            channels = [Channel(t_ns[:n], t_ns[:n], z[:n]) for n in (np.arange(len(runs)) == run_index) * 1]
            runs = [
                replace(run, sensors={**run.sensors, name: c}) for run, c in zip(runs, channels, strict=True)
            ]
    return runs, blocks._replace(sensors=sensor_slots(tuple(sensors))(*sensors.values()))


def drift_std(vehicle: Tree, run: Run, measurement: HandMeasurement) -> float:
    """Return the standard deviation that process noise adds to the measurement, in the unit of `z`.  (2)"""
    if not np.any(getattr(vehicle, "process_noise_std", 0.0)):
        return 0.0
    tick_count = int(np.searchsorted(run.t_ns, measurement.t_ns)) + 1
    dt_s = seconds(np.diff(run.t_ns[:tick_count], prepend=2 * run.t_ns[0] - run.t_ns[1]))
    columns = np.column_stack([dt_s, np.nan_to_num(run.applied_commands[:tick_count])])
    n = 1 + vehicle.commands

    def step(state: Tree, row: np.ndarray) -> tuple[Tree, np.ndarray]:
        state, motion = vehicle.step(state, row[1:n], row[0], row[n:])
        return state, HAND_SENSORS[measurement.kind].h(motion)

    kernel = scan(step, vehicle.init(), np.zeros(n + 3))
    rng, ends = np.random.default_rng(0), []
    for noise in (np.zeros((tick_count, 3)), *rng.standard_normal((SAMPLED_VEHICLES, tick_count, 3))):
        ends.append(kernel.run(np.ascontiguousarray(np.column_stack([columns, noise])))[1][-1])
    deviations = np.array(ends[1:]) - ends[0]
    per_entry = 1 if measurement.kind == "turned" else len(measurement.z)  # both entries describe one angle
    return float(np.sqrt(np.sum(deviations**2) / (SAMPLED_VEHICLES * per_entry)))
