"""Read measurements made by hand: the distance from the start by tape, and the angle that the vehicle turned.

    d = √(x² + y²),   (x, y) = (0, 0) back on the mark,   (cos ψ, sin ψ)                                  (1)
    σ² = σ_hand² + Σ_i (d_i − d_0)² / SAMPLED_VEHICLES,   d_0 without noise                                          (2)

    "12.4 s: 2.31 m"               2.31 m from the start of the run, 12.4 s after the first tick
    "end: 0 m, 720 deg"            back on its mark, turned twice to the left
    "monday 5 s: 1.2 ± 0.02 m"     of the run "monday", with a standard deviation; default 1 cm and 2 degrees

A measurement describes the pose at its time. The run begins at x = y = ψ = 0 and is not split into segments.
Measurements determine the scales of the speed and of the gyro, which the sensors on board do not show. An angle is
used as a direction, so the model must predict it within half a turn. Process noise moves the vehicle away from its
simulation, by the spread of SAMPLED_VEHICLES vehicles with the `process_noise_std` of the file (2). If this value is 0,
a tape measurement after a minute has the weight of an error of only 1 cm: measure early.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from baqueano.calibration.hand_turns import ANGLE_STD_RAD
from baqueano.contracts.values import Tree
from baqueano.diagnostics import fault
from baqueano.errors import UsageError
from baqueano.identify.data.record import FittedBlocks
from baqueano.runs.run import Channel, Run
from baqueano.signals import NANOSECONDS, Motion, seconds, sensor_slots
from baqueano.symbolic import scan

LENGTH_STD_M = 0.01  # accuracy of a tape
LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
ANGLES = {"deg": np.pi / 180.0, "°": np.pi / 180.0, "rad": 1.0, "turn": 2.0 * np.pi, "turns": 2.0 * np.pi}
SAMPLED_VEHICLES = 24  # simulated vehicles; with these, the error of σ is 15 %
SMOOTHING_M = 1e-3  # keeps the root of (1) smooth at the mark
LINE_PATTERN = re.compile(
    r"^\s*(?:(?P<run>\S.*?)\s+)?(?:0(?:\.0*)?\s*s?\s*\.\.\s*)?(?P<t>end|[\d.]+\s*s)\s*:(?P<what>.+)$"
)
NUMBER_PATTERN = re.compile(
    r"^\s*(?P<x>[+-]?[\d.]+(?:e[+-]?\d+)?)\s*(?:(?:±|\+-|\+/-)\s*(?P<sd>[\d.]+)\s*)?(?P<unit>[a-z°]+)\s*$"
)


class HandMeasurement(NamedTuple):
    """One measurement by hand."""

    kind: str  # a key of KINDS
    t_ns: int
    z: np.ndarray  # (m,)
    std: float


@dataclass(frozen=True, slots=True, eq=False)
class HandSensor:
    """Sensor block of a kind of hand measurement. `h` returns z (size,): a distance [m], a position [m], or a direction
    without a jump at half a turn, whose standard deviation is that of the angle [rad].  (1)"""

    size: int
    std: float
    h: Callable[[Motion], np.ndarray]

    @property
    def cov(self) -> np.ndarray:
        """Return the covariance Q (m, m)."""
        return np.eye(self.size) * self.std**2


def _distance(motion: Motion) -> np.ndarray:
    return np.sqrt(np.array([motion.eta[0] ** 2 + motion.eta[1] ** 2 + SMOOTHING_M**2]))


KINDS = {
    "tape": HandSensor(1, LENGTH_STD_M, _distance),
    "back_on_mark": HandSensor(2, LENGTH_STD_M, lambda motion: motion.eta[:2]),
    "turned": HandSensor(
        2, ANGLE_STD_RAD, lambda motion: np.array([np.cos(motion.eta[2]), np.sin(motion.eta[2])])
    ),
}
EXAMPLE = '--measured "12.4 s: 2.31 m" --measured "end: 0 m, 720 deg"'


def with_hand_measurements(
    runs: Sequence[Run], blocks: FittedBlocks, measured: Sequence[str]
) -> tuple[list[Run], FittedBlocks]:
    """Return the runs with one channel for each hand measurement, and the blocks with a sensor for each channel.
    `measured` contains lines such as "12.4 s: 2.31 m". Raise UsageError for a line that cannot be parsed."""
    runs, sensors = list(runs), blocks.sensors._asdict()
    for line in measured:
        run_index, measurements = read_line(line, runs)
        for measurement in measurements:
            name, drift = measurement.kind, drift_std(blocks.model, runs[run_index], measurement)
            while name in sensors:
                name += "_"
            sensors[name] = replace(KINDS[measurement.kind], std=float(np.hypot(measurement.std, drift)))
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
        return state, KINDS[measurement.kind].h(motion)

    kernel = scan(step, vehicle.init(), np.zeros(n + 3))
    rng, ends = np.random.default_rng(0), []
    for noise in (np.zeros((tick_count, 3)), *rng.standard_normal((SAMPLED_VEHICLES, tick_count, 3))):
        ends.append(kernel.run(np.ascontiguousarray(np.column_stack([columns, noise])))[1][-1])
    deviations = np.array(ends[1:]) - ends[0]
    per_entry = 1 if measurement.kind == "turned" else len(measurement.z)  # both entries describe one angle
    return float(np.sqrt(np.sum(deviations**2) / (SAMPLED_VEHICLES * per_entry)))


def read_line(line: str, runs: Sequence[Run]) -> tuple[int, list[HandMeasurement]]:
    """Return the index of the run that `line` names, and the measurements in the line. Raise UsageError for a line that
    cannot be parsed, an unknown run, or a time outside the run."""
    match = LINE_PATTERN.match(line.replace(",", ", "))
    if match is None:
        raise UsageError(fault("tape.unreadable", EXAMPLE, line=line))
    run_index = _run_index(match["run"], line, runs)
    run = runs[run_index]
    t_s = run.duration_s if match["t"] == "end" else float(match["t"].rstrip("s "))
    if not 0.0 < t_s <= run.duration_s:
        raise UsageError(
            fault("tape.after-the-end", line=line, run=run.name, duration_s=run.duration_s, t_s=t_s)
        )
    t_ns = int(run.t_ns[0]) + round(t_s * NANOSECONDS)
    return run_index, [_measurement(part, line, t_ns) for part in match["what"].split(",")]


def _run_index(name: str | None, line: str, runs: Sequence[Run]) -> int:
    names = [run.name for run in runs]
    if name is None and len(runs) == 1:
        return 0
    if name not in names:
        if name is None:
            raise UsageError(fault("tape.of-no-run", line=line, valid=names))
        raise UsageError(fault("tape.of-another-run", line=line, value=name, valid=names))
    return names.index(name)


def _measurement(text: str, line: str, t_ns: int) -> HandMeasurement:
    number = NUMBER_PATTERN.match(text)
    unit = number["unit"] if number else ""
    if number is None or unit not in {**LENGTHS, **ANGLES}:
        raise UsageError(
            fault("tape.no-length", EXAMPLE, line=line, part=text.strip(), units=(*LENGTHS, *ANGLES))
        )
    factor = {**LENGTHS, **ANGLES}[unit]
    x, std = float(number["x"]) * factor, float(number["sd"] or 0.0) * factor
    if x < 0.0 and unit in LENGTHS:
        raise UsageError(fault("tape.negative", line=line, length_m=x))
    kind, z = ("tape", [x]) if x > 0.0 else ("back_on_mark", [0.0, 0.0])
    if unit in ANGLES:
        kind, z = "turned", [np.cos(x), np.sin(x)]
    return HandMeasurement(kind, t_ns, np.array(z), std or KINDS[kind].std)
